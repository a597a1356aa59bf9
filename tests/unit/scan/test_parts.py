"""Rock and pedestal that were separated before are taken as they are, however they are named."""

import numpy as np
import pytest
from cloud_samples import las, ply, read
from patches import level
from refusals import refused

from toppling.models.scan import virtual
from toppling.models.scan.parts import as_labelled
from toppling.models.scan.segment import NEITHER, PEDESTAL, ROCK
from toppling.models.scan.survey import work_out
from toppling.orchestrator.public.making import placed_cloud

LABELLED = ("x", "y", "z", "scalar_Label")
LAS_CLASS = {ROCK: 40, PEDESTAL: 2, NEITHER: 5}


@pytest.fixture(scope="module")
def parted(stump, tmp_path_factory):
    """The stump as seen, the labels of its points, and its true volume; written in every way."""
    truth, cloud, label = stump
    folder = tmp_path_factory.mktemp("parts")
    points = np.round(cloud.points_m + cloud.origin_m, 4)
    for name, value in (("rock", ROCK), ("ground", PEDESTAL)):
        np.savetxt(folder / f"{name}.xyz", points[label == value], fmt="%.4f")
    classes = np.vectorize(LAS_CLASS.get)(label)
    las(folder / "all.las", points, version="1.4", classification=classes)
    ply(folder / "all.ply", np.column_stack([points, label + 1]), axes=LABELLED)
    return folder, label, truth.rock


NAMINGS = {
    "two files": (["rock.xyz", "ground.xyz"], {"rock": "rock.xyz", "pedestal": "ground.xyz"}),
    "two files, one named": (["rock.xyz", "ground.xyz"], {"rock": "rock.xyz"}),
    "classes": (["all.las"], {"rock": "40", "pedestal": "2"}),
    "a class by its field": (["all.las"], {"rock": "classification=40", "pedestal": "2,3"}),
    "a scalar": (["all.ply"], {"rock": "1", "pedestal": "2"}),
    "a scalar by its name": (["all.ply"], {"rock": "LABEL=1", "pedestal": "scalar_label=2"}),
}


def separated(parted, direction):
    files, hints = NAMINGS[direction]
    return placed_cloud([parted[0] / name for name in files], hints)[0]


@pytest.mark.parametrize("direction", NAMINGS)
def test_every_part_holds_its_points_however_it_is_named(parted, direction):
    cloud = separated(parted, direction)
    counts = np.bincount(cloud.label, minlength=3)
    assert tuple(counts[:2]) == tuple(np.bincount(parted[1])[:2])
    assert not cloud.station.any()
    high = cloud.points_m[cloud.label == ROCK, 2].max() + cloud.origin_m[2]
    assert high == pytest.approx(parted[2].vertices_m[:, 2].max() + virtual.DEMO_ORIGIN_M[2], abs=0.05)


def test_files_named_as_parts_alone_are_read_and_what_is_of_none_is_of_the_other(parted):
    folder, label, _ = parted
    cloud = placed_cloud([], {"rock": str(folder / "rock.xyz"), "pedestal": str(folder / "ground.xyz")})[0]
    assert len(cloud.files) == 2
    cloud = placed_cloud([folder / "all.las"], {"pedestal": "2"})[0]
    assert (cloud.label == ROCK).sum() == (label != PEDESTAL).sum()


@pytest.mark.thorough
def test_a_separated_rock_is_measured_without_being_cut_again(parted):
    cloud = separated(parted, "classes")
    remaining, label, _ = work_out(cloud)
    assert (label == cloud.label).all()
    assert remaining.closed.rock.volume_m3 == pytest.approx(parted[2].volume_m3, rel=0.01)  # as of any scan
    np.testing.assert_allclose(
        remaining.interface.normal, [*remaining.interface.normal[:2], np.cos(np.deg2rad(6.0))], atol=3e-3
    )


def test_what_no_point_is_of_is_refused_with_what_there_is(parted):
    with refused("parts.class_empty", "41"):
        placed_cloud([parted[0] / "all.las"], {"rock": "41"})
    with refused("parts.class_missing", "'material'"):
        placed_cloud([parted[0] / "all.ply"], {"rock": "material=1"})
    with refused("parts.class_missing"):
        placed_cloud([parted[0] / "rock.xyz"], {"rock": "1"})
    with refused("parts.too_few_points", "0"):
        placed_cloud([parted[0] / "rock.xyz"], {"rock": "rock.xyz"})
    with refused("parts.near_needless"):
        placed_cloud([parted[0] / "all.las"], {"rock": "40", "near": (1.0, 2.0)})


def test_points_that_are_not_finite_shift_no_label(parted):
    folder, label, _ = parted
    rows = np.column_stack([read(folder / "all.ply"), label + 1])
    rows[::7, :3] = np.nan
    ply(folder / "holes.ply", rows, axes=LABELLED)
    cloud = placed_cloud([folder / "holes.ply"], {"rock": "1", "pedestal": "2"})[0]
    np.testing.assert_array_equal(cloud.label, np.delete(label, np.s_[::7]))


@pytest.mark.parametrize("apart_m", [0.2, 30.0])
def test_a_rock_that_lies_apart_from_its_pedestal_is_refused_as_that(apart_m):
    pedestal = level(1.51, 0.02)
    rock = np.random.default_rng(1).uniform(-1.0, 1.0, (20_000, 3))
    rock = 0.5 * rock / np.abs(rock).max(axis=1, keepdims=True) + [0.0, 0.0, 0.5 + apart_m]
    label = np.repeat(np.array([PEDESTAL, ROCK], np.int8), [len(pedestal), len(rock)])
    result = "nearest by 0.2" if apart_m < 1.0 else "farther than the rock is high"
    with refused("rock.apart_from_pedestal", result):
        as_labelled(np.vstack([pedestal, rock]), label, None)
