"""One writer at a time to a run in a store, on file systems of this machine that stand for stores."""

import threading
import time

import pytest
from pyarrow.fs import LocalFileSystem

from toppling.models.errors import InputError
from toppling.models.files import lease as module
from toppling.models.files.lease import Lease


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(module, "_RENEW_S", 0.1)
    monkeypatch.setattr(module, "_GONE_AFTER_S", 1.0)
    monkeypatch.setattr(module, "_PAUSE_S", (0.02, 0.1))


@pytest.fixture
def machine(tmp_path):
    """Make the lease of a machine, as its programs have it."""
    return lambda name: Lease(
        "s3://bucket/run",
        LocalFileSystem(),
        str(tmp_path / "store" / ".writers"),
        tmp_path / name / "run.writer",
    )


def signs(tmp_path):
    return [place.name for place in (tmp_path / "store" / ".writers").glob("*")]


def killed(lease, monkeypatch):
    """Leave the store as a process does that is killed while it writes."""
    with monkeypatch.context() as patch:
        patch.setattr(Lease, "_remove", lambda self, name: None)
        with lease.held():
            kept = lease.notes.read_text()
    lease.notes.write_text(kept)


def until_lost(lease):
    for _ in range(500):
        lease.check()
        time.sleep(0.02)


def test_while_one_writes_every_other_is_refused_and_the_writer_named(machine):
    with machine("first").held():
        for name, expected in (
            ("second", "another machine writes"),
            ("first", "another process of this machine"),
        ):
            with (
                pytest.raises(InputError, match=rf"{expected}.*, \S+:\d+ since \d{{4}}-"),
                machine(name).held(),
            ):
                pass


def test_the_next_writes_as_soon_as_the_first_has_ended(machine, tmp_path):
    for name in ("first", "second", "first"):
        began = time.monotonic()
        with machine(name).held():
            assert len(signs(tmp_path)) == 1
        assert time.monotonic() - began < module._GONE_AFTER_S
    assert not signs(tmp_path)


def test_a_dead_writer_is_waited_for_elsewhere_and_not_on_its_own_machine(
    machine, tmp_path, monkeypatch, caplog
):
    for name, waits in (("second", True), ("first", False)):
        killed(machine("first"), monkeypatch)
        assert len(signs(tmp_path)) == 1
        began = time.monotonic()
        with machine(name).held():
            assert (time.monotonic() - began > module._GONE_AFTER_S) == waits
    assert "gives no sign any more: its run goes on here" in caplog.text
    assert not signs(tmp_path)


def test_a_writer_that_was_taken_for_dead_stops_once_it_wakes(machine, monkeypatch):
    sleeper, asleep, awake = machine("first"), threading.Event(), threading.Event()
    renew = Lease._renew

    def renew_after_sleep(lease):
        if lease is sleeper:
            asleep.set()
            awake.wait()
        renew(lease)

    monkeypatch.setattr(Lease, "_renew", renew_after_sleep)
    with sleeper.held():
        asleep.wait()
        sleeper.check()
        with machine("second").held():
            awake.set()
            with pytest.raises(InputError, match="another took its place"):
                until_lost(sleeper)
            with pytest.raises(InputError, match="another took its place"):
                sleeper.make_sure()
        with machine("third").held():
            assert sleeper.lost


def test_a_sign_that_is_old_is_renewed_before_anything_is_written(machine, monkeypatch):
    writer = machine("first")
    with monkeypatch.context() as patch:
        patch.setattr(module, "_RENEW_S", 1e3)
        with writer.held():
            writer.make_sure()
            assert writer._renewals == 0
            writer._renewed_s -= 2.0  # as after a night's sleep
            writer.make_sure()
            assert writer._renewals == 1


def test_of_many_that_come_at_once_one_at_a_time_writes(machine):
    inside, most, refused = [], [], []
    start = threading.Barrier(6)

    def come(name):
        start.wait()
        try:
            with machine(name).held():
                inside.append(name)
                most.append(len(inside))
                time.sleep(0.3)
                inside.remove(name)
        except InputError:
            refused.append(name)

    threads = [threading.Thread(target=come, args=(f"machine {n}",)) for n in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert max(most) == 1
    assert len(most) + len(refused) == 6


def test_only_young_signs_of_other_machines_say_that_a_run_goes_on(machine, monkeypatch):
    first, second = machine("first"), machine("second")
    assert not second.is_held_elsewhere()
    with first.held():
        assert second.is_held_elsewhere()
        assert not first.is_held_elsewhere()
    killed(first, monkeypatch)
    assert second.is_held_elsewhere()
    monkeypatch.setattr(module, "_GONE_AFTER_S", 0.0)
    assert not second.is_held_elsewhere()
