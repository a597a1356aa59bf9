"""An interface that the user gave is compared with what was seen of the pedestal beside the rock."""

import numpy as np
import pytest
from patches import level

from toppling.models.frames import plane_normal
from toppling.models.scan.interface_hint import InterfaceHint, points_text, seen_about_points
from toppling.models.scan.scan_warnings import off_hint
from toppling.models.scan.surfels import Surfels
from toppling.models.scan.uncertainty import ObservedRock

DIP_DEG, TOWARD_DEG, HEIGHT_M, RADIUS_M, PATCH_M = 4.0, 60.0, 2.0, 0.5, 0.02
ORIGIN_M = np.array([331_000.0, 3_777_000.0, 480.0])
NORMAL = plane_normal(DIP_DEG, TOWARD_DEG)


def on_the_slope(x, y):
    return np.column_stack([x, y, -(NORMAL[0] * x + NORMAL[1] * y) / NORMAL[2]])


def column_on_the_slope(bumps_m=0.0):
    """Patches of a column on a slope, whose foot and pedestal were seen all around, and which are the column's."""
    x, y, _ = level(1.0, PATCH_M).T
    ground = on_the_slope(x, y)[np.hypot(x, y) > RADIUS_M]
    ground[:, 2] += bumps_m * np.random.default_rng(3).normal(size=len(ground))
    turn = np.arange(0.0, 2.0 * np.pi, PATCH_M / RADIUS_M)
    foot = on_the_slope(RADIUS_M * np.cos(turn), RADIUS_M * np.sin(turn))
    side = np.vstack([foot + np.array([0.0, 0.0, rise]) for rise in np.arange(0.01, HEIGHT_M, PATCH_M)])
    normals = np.vstack([np.broadcast_to(NORMAL, ground.shape), side * [2.0, 2.0, 0.0]])
    surfels = Surfels(np.vstack([ground, side]), normals, np.zeros(len(normals)), PATCH_M)
    return surfels, np.arange(len(normals)) >= len(ground)


def warned(hint):
    surfels, rock = column_on_the_slope()
    ground, side = surfels.points_m[~rock], surfels.points_m[rock]
    side = side[side[:, 2] < 0.3]
    observed = ObservedRock(side, ground, side, ground, surfels, rock, HEIGHT_M, hint)
    interface = (
        InterfaceHint.plane(np.zeros(3), DIP_DEG, TOWARD_DEG).interface if hint is None else hint.interface
    )
    return off_hint(observed, interface, ORIGIN_M)


def test_a_true_interface_and_none_are_not_doubted():
    assert warned(None) is None
    assert warned(InterfaceHint.plane(np.zeros(3), DIP_DEG, TOWARD_DEG)) is None
    assert warned(InterfaceHint.plane([0.0, 0.0, 0.01], DIP_DEG + 0.5, TOWARD_DEG)) is None


@pytest.mark.parametrize(
    ("hint", "low_m", "high_m"),
    [
        (InterfaceHint.plane(np.zeros(3), 0.0, 0.0), -0.035, 0.035),  # r tan 4 degrees
        (InterfaceHint.plane([0.0, 0.0, -0.1], DIP_DEG, TOWARD_DEG), 0.1, 0.1),
        (InterfaceHint.plane([0.0, 0.0, 0.1], DIP_DEG, TOWARD_DEG), -0.1, -0.1),
    ],
)
def test_the_distance_of_a_wrong_hint_is_stated_with_the_observed_plane(hint, low_m, high_m):
    sentence = warned(hint).sentence
    lies = sentence.partition("beside it lies ")[2].split()
    assert (float(lies[0]), float(lies[2])) == pytest.approx((low_m, high_m), abs=0.003)
    x, y, z, dip_deg, toward_deg = map(float, sentence.partition("--plane ")[2].split())
    assert (dip_deg, toward_deg) == (DIP_DEG, TOWARD_DEG)
    seen = InterfaceHint.plane(np.array([x, y, z]) - ORIGIN_M, dip_deg, toward_deg)
    assert warned(seen) is None


def pointed_at(off_m, away=1.0, middle_m=0.0):
    """Places around a middle on the x axis, so far above the pedestal, at such a share of the column's radius."""
    turn = np.deg2rad([20.0, 110.0, 200.0, 290.0])
    places = on_the_slope(middle_m + away * RADIUS_M * np.cos(turn), away * RADIUS_M * np.sin(turn))
    return InterfaceHint.points(places + np.outer(off_m, NORMAL))


def seen_about(hint, bumps_m=0.0):
    surfels, rock = column_on_the_slope(bumps_m)
    return seen_about_points(hint, surfels, rock)


CLICKED_M = [0.09, 0.01, 0.01, 0.02]
"""Heights over the pedestal of clicks on the column's side."""


@pytest.mark.parametrize("share", [2.0, 1.0, 0.4])
def test_places_clicked_off_a_plane_pedestal_are_moved_onto_it(share):
    hint = pointed_at(share * np.array(CLICKED_M))
    assert hint.interface.normal @ NORMAL < np.cos(np.deg2rad(3.0 * share))
    seen = seen_about(hint)
    assert seen.interface.normal == pytest.approx(NORMAL, abs=1e-6)
    assert seen.interface.flat(on_the_slope(np.zeros(1), np.zeros(1)))[0, 2] == pytest.approx(0.0, abs=1e-6)
    assert seen.kind == hint.kind
    text = points_text(hint, seen.interface)
    assert f"{0.01 * share:+.2g} to {0.09 * share:+.2g} m" in text
    assert "dips by 4.0 degrees toward N30E" in text


def test_true_places_close_together_determine_the_interface_less_than_the_observations():
    hint = pointed_at(np.array([0.003, -0.003, -0.002, 0.001]), away=0.05, middle_m=RADIUS_M)
    assert hint.interface.normal @ NORMAL < np.cos(np.deg2rad(2.0))
    assert seen_about(hint).interface.normal == pytest.approx(NORMAL, abs=1e-6)


@pytest.mark.parametrize(
    ("hint", "bumps_m"),
    [
        pytest.param(pointed_at([0.002, -0.003, 0.001, 0.003]), 0.0, id="what was seen agrees"),
        pytest.param(pointed_at([0.01, -0.01, 0.01, 0.02]), 0.01, id="what was seen is as uneven"),
        pytest.param(pointed_at([-0.06, -0.05, -0.07, -0.06]), 0.0, id="places measured below what was seen"),
        pytest.param(pointed_at([0.12, 0.13, 0.11, 0.12]), 0.0, id="another pedestal is meant"),
        pytest.param(pointed_at([0.25, 0.01, -0.01, 0.0]), 0.0, id="one of them is no place of the pedestal"),
        pytest.param(pointed_at(np.multiply(0.7, CLICKED_M)), 0.03, id="the pedestal is no plane"),
        pytest.param(InterfaceHint.plane([0.0, 0.0, 0.05], 0.0, 0.0), 0.0, id="a measured plane"),
        pytest.param(
            InterfaceHint.points(pointed_at(CLICKED_M).anchors_m, "outline"), 0.0, id="a contact outline"
        ),
    ],
)
def test_a_word_on_the_interface_counts_as_given_otherwise(hint, bumps_m):
    assert seen_about(hint, bumps_m) is None
