"""Waiting for what another process does."""

import time


def wait_until(holds, seconds=120.0, pause_s=0.1):
    end = time.monotonic() + seconds
    while not (found := holds()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(pause_s)
    return found
