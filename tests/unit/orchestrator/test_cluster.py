"""Connecting to a scheduler that somebody else has started."""

import threading

import pytest

from toppling.models.errors import InputError
from toppling.orchestrator.cluster import existing


def test_an_address_that_asks_for_tls_is_refused_without_certificates_and_nothing_is_left_open():
    before = set(threading.enumerate())
    with pytest.raises(InputError, match="no certificates are given") as refused:
        existing("tls://127.0.0.1:1", None, None).__enter__()
    # A client that is still open would wait for its loop for a minute when the program ends.
    assert set(threading.enumerate()) <= before
    assert "--tls-" in refused.value.remedy
