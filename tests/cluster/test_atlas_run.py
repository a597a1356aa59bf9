"""Many rocks in one run, on real workers: rows as of each rock alone, and rocks that fall hold up no other."""

from contextlib import nullcontext

import numpy as np
import pytest

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.idealised import ricker
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.run import run
from toppling.results.run import open_run


def leaning(folder):
    """A block whose base is cut so obliquely that it falls over."""
    lean = np.deg2rad(40.0)
    low = np.array([(x, y, -1.0 + 0.4 * x * np.tan(lean)) for x in (-0.3, 0.3) for y in (-0.3, 0.3)])
    top = np.array([(x + 3.0, y, 1.0) for x in (-0.3, 0.3) for y in (-0.3, 0.3)])
    from scipy.spatial import ConvexHull

    points = np.vstack([low, top])
    hull = ConvexHull(points)
    out = (
        np.einsum(
            "ij,ij->i",
            np.cross(*(points[hull.simplices[:, k]] - points[hull.simplices[:, 0]] for k in (1, 2))),
            hull.equations[:, :3],
        )
        > 0
    )
    faces = np.where(out[:, None], hull.simplices, hull.simplices[:, ::-1])
    Scene.from_mesh((points, faces)).save(folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("rocks")
    for name, width in (("narrow", 0.15), ("wide", 0.3)):
        Scene.block(width, 0.25, 0.8).save(place / "scenes" / name)
    leaning(place / "scenes" / "leaning")
    Ensemble.write(place / "quakes", [Record.of(f"P{n}", ricker(2.0, 0.5 + 0.4 * n, 0.01)) for n in range(3)])
    (place / "atlas.toml").write_text(
        'scenes = ["scenes/*"]\nensemble = "quakes"\npga_m_s2 = [2, 4, 8]\nazimuth_deg = [0, 90]\nfriction = [0.8]\n'
        'preset = "fast"\n'
    )
    return place


def test_rows_of_an_atlas_are_those_of_each_rock_alone_and_a_falling_rock_holds_up_no_other(
    client, folder, tmp_path
):
    campaign = Campaign.read(folder / "atlas.toml")
    tally = run(campaign, tmp_path / "atlas", nullcontext(client), lambda _: None)
    together = open_run(tmp_path / "atlas").frame()
    assert sorted(together["rock"].unique()) == ["leaning", "narrow", "wide"]
    for site in campaign.sites:
        of_rock = together[together["rock"] == site.rock]
        if site.rock == "leaning":
            assert set(of_rock["status"]) == {"failed"}
            assert of_rock["message"].str.contains("does not stand").all()
            continue
        run(campaign.of_site(site), tmp_path / site.rock, nullcontext(client), lambda _: None)
        alone = open_run(tmp_path / site.rock).frame().set_index("job_id")
        of_rock = of_rock.set_index("job_id").loc[alone.index]
        for column in ("toppled", "max_tilt_deg", "slip_m", "topple_time_s", "pgv_m_s", "scene_id"):
            assert of_rock[column].equals(alone[column]), column
    assert tally.done == 2 * 18
    again = run(campaign, tmp_path / "atlas", nullcontext(client), lambda _: None)
    assert (again.done, again.before) == (0, 3 * 18)
