"""What is worked out apart delays nobody here, is given up when it is not wanted, and its end is told."""

import ctypes
import os
import threading
import time

import pytest

from toppling.models.errors import InputError
from toppling.orchestrator.pick.picking import Apart, EndedError

HELD_S = 2


def hold(note):
    """Block every thread of the process, as native code may."""
    note("holding")
    ctypes.PyDLL(None).sleep(HELD_S)
    return os.getpid()


def refuse(what, note):
    raise InputError("a.b", what, where="there", expected="else", remedy="say it")


def fail(note):
    raise KeyError("a fault")


def die(note):
    os._exit(7)


@pytest.fixture
def apart():
    made = Apart()
    yield made
    made.end()


def test_work_that_holds_every_thread_of_its_process_delays_none_here(apart):
    found, holding = [], threading.Event()
    thread = threading.Thread(target=lambda: found.append(apart.do(lambda _: holding.set(), hold)))
    thread.start()
    assert holding.wait(60)
    longest, since = 0.0, time.perf_counter()
    while thread.is_alive():
        time.sleep(0.01)
        longest, since = max(longest, time.perf_counter() - since), time.perf_counter()
    assert longest < 0.5 * HELD_S
    assert found[0] != os.getpid()


@pytest.mark.thorough
def test_errors_come_back_and_the_process_goes_on(apart):
    with pytest.raises(InputError, match="no rock") as refused:
        apart.do(print, refuse, "no rock")
    assert refused.value.remedy == "say it"
    with pytest.raises(RuntimeError, match="KeyError: 'a fault'"):
        apart.do(print, fail)
    with pytest.raises(InputError, match=r"died .exit code 7"):
        apart.do(print, die)
    assert isinstance(apart.do(print, hold), int)


def test_what_nobody_wants_any_more_ends_at_its_next_note_and_the_process_at_once(apart):
    def unwanted(stage):
        raise TimeoutError

    with pytest.raises(TimeoutError):
        apart.do(unwanted, hold)
    with pytest.raises(EndedError):
        apart.do(lambda _: apart.end(), hold)
    with pytest.raises(EndedError):
        apart.do(print, hold)
