"""Virtual scans of known rocks against their truth: one line of errors a shape, to the terminal.

.venv/bin/python benchmarks/scan.py [SHAPE ...]
"""

import sys
import time
from collections.abc import Callable

import numpy as np

from models import Pedestal, Scene
from models.frames import slope_of_normal
from models.scan import virtual
from models.scan.survey import Survey, survey
from models.statics import quasi_static_toppling_m_s2

AZIMUTHS_DEG = np.arange(0.0, 360.0, 10.0)


def block() -> virtual.Truth:
    """Upright block of rough sides on a slope."""
    rock = virtual.boulder(2.0, 1.1, 0.9, 11, bumps=0.015, squareness=0.8)
    return virtual.on_slope(rock, virtual.ground(5.0, 0.7, 11, bumps_m=0.08), 4.0, 300.0)


def stump() -> virtual.Truth:
    """Boulder on a broad base."""
    rock = virtual.boulder(2.0, 1.3, 1.0, 3, bumps=0.02)
    return virtual.on_slope(rock, virtual.ground(5.0, 0.7, 3, bumps_m=0.1), 6.0, 250.0)


def leaning() -> virtual.Truth:
    """Boulder with a nose, whose narrow base lies in the shadow of its belly."""
    rock = virtual.boulder(3.0, 1.9, 1.0, 7, bumps=0.03, nose=0.25, nose_azimuth_deg=70.0)
    return virtual.on_slope(rock, virtual.ground(8.0, 0.8, 7, bumps_m=0.15), 8.0, 70.0)


def hour_glass() -> virtual.Truth:
    """Boulder on a neck of its own width."""
    rock = virtual.boulder(2.0, 1.5, 0.8, 5, bumps=0.02)
    return virtual.on_slope(rock, virtual.ground(5.0, 0.42, 5, neck_drop_m=0.8, bumps_m=0.05), 3.0, 10.0)


SHAPES: dict[str, Callable[[], virtual.Truth]] = {
    "Echo Cliffs": lambda: virtual.echo_cliffs_like(0),
    "stump": stump,
    "block": block,
    "leaning boulder": leaning,
    "hour-glass": hour_glass,
    "in a crevice": lambda: virtual.rock_in_a_crevice(4),
    "one of two": lambda: virtual.two_rocks_side_by_side(2),
}


def errors(truth: virtual.Truth, found: Survey, label: np.ndarray) -> dict[str, float]:
    """What the issue asks for, in its units."""
    rock, true = found.scene.rock, truth.rock
    slope, downhill = slope_of_normal(truth.pedestal.normal)
    pedestal = found.scene.pedestal
    turn = (pedestal.downhill_azimuth_deg - downhill + 180.0) % 360.0 - 180.0
    plane = Pedestal(truth.pedestal.point_m, truth.pedestal.normal)
    seen = _toppling(found.scene)
    known = _toppling(Scene(true, plane))
    principal = np.linalg.eigvalsh(rock.inertia_per_mass_m2) / np.linalg.eigvalsh(true.inertia_per_mass_m2)
    return {
        "rock points right %": 100 * float((found.label[label == 0] == 0).mean()),
        "pedestal points right %": 100 * float((found.label[label == 1] == 1).mean()),
        "volume %": 100 * (rock.volume_m3 / true.volume_m3 - 1),
        "centre of mass % of h": 100 * float(np.linalg.norm(rock.com_m - true.com_m)) / true.height_m,
        "inertia %": 100 * float(np.abs(principal - 1).max()),
        "slope deg": pedestal.slope_deg - slope,
        "downhill deg": turn,
        "toppling rms %": 100 * float(np.sqrt(np.mean((seen / known - 1) ** 2))),
        "toppling worst %": 100 * float(np.abs(seen / known - 1).max()),
    }


def _toppling(scene: Scene) -> np.ndarray:
    table = quasi_static_toppling_m_s2(scene.rock, scene.pedestal, 9.81, AZIMUTHS_DEG)
    return np.array(table)[:, 1]


def accuracy(names: list[str]) -> dict[str, dict[str, float]]:
    """Errors of each shape, scanned from six stations at 0.6 % of its height."""
    rows = {}
    for name in names:
        truth = SHAPES[name]()
        stations = virtual.scan_around(truth, seed=1)
        cloud, label = virtual.cloud_of(stations, virtual.DEMO_ORIGIN_M)
        start = time.perf_counter()
        near = truth.rock.vertices_m[np.argmax(truth.rock.vertices_m[:, 2]), :2] + virtual.DEMO_ORIGIN_M[:2]
        found = survey(cloud, near_m=(float(near[0]), float(near[1])))
        rows[name] = {"points": len(label), **errors(truth, found, label)}
        print(
            name,
            f"{time.perf_counter() - start:.1f} s",
            {k: round(v, 3) for k, v in rows[name].items()},
            flush=True,
        )
    return rows


if __name__ == "__main__":
    accuracy(sys.argv[1:] or list(SHAPES))
