"""How hypothesis looks for examples in all tests."""

import signal

import pytest
from hypothesis import HealthCheck, settings

# An example may take long where other tests have the processors: time says nothing about a law.
settings.register_profile("shared machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("shared machine")


@pytest.fixture(autouse=True)
def _ctrl_c_still_stops_the_tests():
    """A test that calls the command within this process leaves Ctrl-C ignored, as at the command's end."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)
