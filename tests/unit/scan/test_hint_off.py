"""An interface that the user gave is compared with what was seen of the pedestal beside the rock."""

import numpy as np
import pytest

from toppling.models.frames import plane_normal
from toppling.models.scan.hint_off import off_what_was_seen
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.measure import ObservedRock
from toppling.models.scan.surfels import Surfels

DIP_DEG, TOWARD_DEG, HEIGHT_M, RADIUS_M, PATCH_M = 4.0, 60.0, 2.0, 0.5, 0.02
ORIGIN_M = np.array([331_000.0, 3_777_000.0, 480.0])
NORMAL = plane_normal(DIP_DEG, TOWARD_DEG)


def on_the_slope(x, y):
    return np.column_stack([x, y, -(NORMAL[0] * x + NORMAL[1] * y) / NORMAL[2]])


def told(hint):
    """What is told of a hint about a column on a slope, whose foot and pedestal were seen all around."""
    x, y = (each.ravel() for each in np.meshgrid(*[np.arange(-1.0, 1.0, PATCH_M)] * 2))
    ground = on_the_slope(x, y)[np.hypot(x, y) > RADIUS_M]
    turn = np.arange(0.0, 2.0 * np.pi, PATCH_M / RADIUS_M)
    foot = on_the_slope(RADIUS_M * np.cos(turn), RADIUS_M * np.sin(turn))
    side = np.vstack([foot + np.array([0.0, 0.0, rise]) for rise in np.arange(0.01, 0.3, PATCH_M)])
    normals = np.vstack([np.broadcast_to(NORMAL, ground.shape), side * [2.0, 2.0, 0.0]])
    surfels = Surfels(np.vstack([ground, side]), normals, np.zeros(len(normals)), PATCH_M)
    rock = np.arange(len(normals)) >= len(ground)
    observed = ObservedRock(side, ground, side, ground, surfels, rock, HEIGHT_M, hint)
    interface = (
        InterfaceHint.plane(np.zeros(3), DIP_DEG, TOWARD_DEG).interface if hint is None else hint.interface
    )
    return off_what_was_seen(observed, interface, ORIGIN_M)


def test_a_true_interface_and_none_are_not_doubted():
    assert told(None) is None
    assert told(InterfaceHint.plane(np.zeros(3), DIP_DEG, TOWARD_DEG)) is None
    assert told(InterfaceHint.plane([0.0, 0.0, 0.01], DIP_DEG + 0.5, TOWARD_DEG)) is None


@pytest.mark.parametrize(
    ("hint", "low_m", "high_m"),
    [
        (InterfaceHint.plane(np.zeros(3), 0.0, 0.0), -0.035, 0.035),  # r tan 4 degrees
        (InterfaceHint.plane([0.0, 0.0, -0.1], DIP_DEG, TOWARD_DEG), 0.1, 0.1),
        (InterfaceHint.plane([0.0, 0.0, 0.1], DIP_DEG, TOWARD_DEG), -0.1, -0.1),
    ],
)
def test_how_far_a_wrong_one_lies_off_is_told_with_the_plane_that_was_seen(hint, low_m, high_m):
    sentence = told(hint).sentence
    lies = sentence.partition("beside it lies ")[2].split()
    assert (float(lies[0]), float(lies[2])) == pytest.approx((low_m, high_m), abs=0.003)
    x, y, z, dip_deg, toward_deg = map(float, sentence.partition("--plane ")[2].split())
    assert (dip_deg, toward_deg) == (DIP_DEG, TOWARD_DEG)
    seen = InterfaceHint.plane(np.array([x, y, z]) - ORIGIN_M, dip_deg, toward_deg)
    assert told(seen) is None
