"""A scan that follows its hints: the latest ones count, errors are told, and nothing unfinished is saved."""

import threading
import time
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from toppling.models.errors import InputError
from toppling.models.scan.placement import AXES, Placement, placement_of
from toppling.models.scan.read import Cloud
from toppling.models.scan.register import Registered
from toppling.orchestrator.pick import picking as picking_module
from toppling.orchestrator.pick.picking import Picking, Placed
from toppling.orchestrator.pick.user_hints import UserHints, View

NEAR = [UserHints(near=(float(n), 0.0)) for n in range(6)]


@dataclass(frozen=True)
class FakeResult:
    near: tuple
    inspection: object = None


class Here:
    def do(self, note, function, *arguments):
        return function(*arguments, note)

    def end(self):
        pass


@pytest.fixture
def work(monkeypatch):
    """Replaces the scan by counters; `go` lets it pass its first stage."""

    made = SimpleNamespace(go=threading.Event(), splits=[], bases=[], reads=[], refused=set())

    def work_out(cloud, note, near, hint, inspection):
        made.splits.append(near)
        note("splitting")
        made.go.wait(30)
        note("closing")
        if near in made.refused:
            raise InputError(
                "scan.no_rock", "no rock", where="there", expected="a rock", remedy="look elsewhere"
            )
        return FakeResult(near), np.zeros(3, np.int8), ("a note",)

    def read(stated):
        made.reads.append(stated.of_the_cloud)
        if stated.units == "mm":
            raise InputError(
                "scan.no_unit", "no unit", where="there", expected="another", remedy="say another"
            )
        return Placed(Cloud(np.ones((3, 3)), np.zeros(3), np.zeros(3, np.int32), ()), Placement())

    def scene(worked):
        made.bases.append((worked.near, worked.inspection))
        return "scene", worked

    made.read = read
    monkeypatch.setattr(picking_module, "Apart", Here)
    monkeypatch.setattr(picking_module, "work_out", work_out)
    monkeypatch.setattr(picking_module, "registered", lambda cloud: Registered(cloud, {}, cloud.bounds_m))
    monkeypatch.setattr(
        picking_module, "view_of", lambda points, label, number: View(number, (3, 0), (1.0, 1.0), b"")
    )
    monkeypatch.setattr(picking_module, "tops", lambda worked: [])
    monkeypatch.setattr(picking_module, "answer_shown", lambda survey, worked: {"near": worked.near})
    monkeypatch.setattr(picking_module, "find_candidates", lambda points, surfels: [])
    monkeypatch.setattr(picking_module, "surfels_of", lambda points: None)
    monkeypatch.setattr(FakeResult, "scene", scene, raising=False)
    return made


@pytest.fixture
def written():
    return []


@pytest.fixture
def picking(work, written):
    cloud = Cloud(np.zeros((3, 3)), np.array([100.0, 200.0, 0.0]), np.zeros(3, np.int32), ())
    picking = Picking(
        Placed(cloud, Placement()), work.read, lambda survey, stated: written.append(stated), "rock", NEAR[0]
    )
    thread = threading.Thread(target=picking.work, daemon=True)
    thread.start()
    yield picking
    work.go.set()
    picking.end()
    thread.join(30)
    assert not thread.is_alive()


def until(picking, condition):
    end = time.monotonic() + 30
    while not condition(state := picking.state()):
        assert time.monotonic() < end, state
        picking.wait(state["number"], 1.0)
    return state


def test_only_the_latest_hints_are_computed(picking, work):
    until(picking, lambda state: state["stage"] == "splitting")
    for text in NEAR[1:]:
        picking.set_hints(text)
    work.go.set()
    state = until(picking, lambda state: state["current"])
    assert state["answer"]["near"] == NEAR[-1].near
    assert [near for near, _ in work.bases] == [NEAR[-1].near]
    assert len(work.splits) == 2


def test_a_page_that_is_owed_an_answer_is_never_idle(picking, work):
    work.go.set()
    until(picking, lambda state: state["current"])
    work.go.clear()
    picking.set_hints(NEAR[1])
    assert picking.state()["stage"] in ("starting", "splitting")


def test_a_refusal_is_reported_and_goes_with_the_next_hint(picking, work, written):
    work.go.set()
    until(picking, lambda state: state["current"])
    work.refused.add(NEAR[1].near)
    picking.set_hints(NEAR[1])
    state = until(picking, lambda state: state["error"])
    assert state["error"] == {
        "what": "no rock",
        "where": "there",
        "expected": "a rock",
        "remedy": "look elsewhere",
    }
    assert not state["current"]
    assert state["answer"]["near"] == NEAR[0].near
    picking.save()
    state = until(picking, lambda state: not state["saving"])
    assert "came no scene" in state["error"]["what"]
    assert not written
    picking.set_hints(NEAR[2])
    assert until(picking, lambda state: state["current"])["error"] is None


def test_what_is_saved_is_what_was_stated_last(picking, work, written):
    until(picking, lambda state: state["stage"] == "splitting")
    picking.set_hints(NEAR[3])
    picking.save()
    work.go.set()
    state = until(picking, lambda state: state["saved"] == 1)
    assert written == [NEAR[3]]
    assert (state["saving"], state["target"]) == (False, "rock")
    assert picking.detail(np.full(3, 9.0), 1.0) == (0.0, b"")  # where no point is


@pytest.mark.parametrize("up", [*AXES, "0.2,1,-3"])
def test_ends_of_a_length_are_reported_in_coordinates_of_the_model(up):
    rng = np.random.default_rng(5)
    model = rng.normal(size=(4, 3))
    placement = placement_of(up, ((0, 0, 0), (3, 0, 0), 1.2))
    cloud = Cloud(placement.apply(model), np.zeros(3), np.zeros(4, np.int32), ())
    placed = Placed(cloud, placement)
    assert placed.model(cloud.points_m) == pytest.approx(model, abs=1e-12)
    assert placed.metres(model) == pytest.approx(cloud.points_m, abs=1e-12)


def test_a_cloud_that_is_placed_anew_is_read_and_split_anew(picking, work):
    work.go.set()
    number = until(picking, lambda state: state["current"])["view"]["number"]
    assert not work.reads
    turned = UserHints(up="y", near=NEAR[1].near)
    picking.set_hints(turned)
    state = until(picking, lambda state: state["current"])
    assert work.reads == [UserHints(up="y")]
    assert state["origin_m"] == [0.0, 0.0, 0.0]
    assert state["view"]["number"] > number
    picking.set_hints(UserHints(units="mm"))
    state = until(picking, lambda state: state["error"])
    assert state["error"]["what"] == "no unit"
    assert state["answer"]["near"] == NEAR[1].near
    picking.set_hints(turned)
    until(picking, lambda state: state["current"])
    assert len(work.reads) == 2
