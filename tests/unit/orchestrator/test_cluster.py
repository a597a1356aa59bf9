"""Connecting to a scheduler that somebody else has started."""

import threading

import pytest

from toppling.models.errors import InputError, UsageError
from toppling.orchestrator.cluster import existing, local


def test_an_address_that_asks_for_tls_is_refused_without_certificates_and_nothing_is_left_open():
    before = set(threading.enumerate())
    with pytest.raises(InputError, match="no certificates are given") as refused:
        existing("tls://127.0.0.1:1", None, None).__enter__()
    # A client that is still open would wait for its loop for a minute when the program ends.
    assert set(threading.enumerate()) <= before
    assert "--tls-" in refused.value.remedy


@pytest.mark.parametrize("asked", [(10_000, None), (1, 10_000)])
def test_more_workers_than_a_machine_has_room_for_are_refused_before_one_starts(asked):
    before = set(threading.enumerate())
    with pytest.raises(UsageError, match="this machine has") as refused:
        local(*asked)
    assert set(threading.enumerate()) <= before
    assert "--queue" in refused.value.remedy
