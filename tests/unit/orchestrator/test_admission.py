"""A cluster is made ready for a run, though workers may leave at that moment."""

from types import SimpleNamespace

import pytest

from toppling.orchestrator import admission
from toppling.orchestrator.context import RunError


@pytest.mark.parametrize("cluster", [None, object()], ids=["somebody else's", "ours"])
def test_a_worker_that_leaves_while_all_are_asked_is_no_lost_scheduler(cluster, monkeypatch):
    client, asked = SimpleNamespace(status="running", cluster=cluster), []

    def ask(client):
        asked.append(client)
        if len(asked) < 3:
            raise OSError("Stream is closed")

    monkeypatch.setattr(admission, "let_leave_in_order", ask)
    monkeypatch.setattr(admission, "check_workers", lambda client, *orders: None)
    admission.make_ready(client)
    assert len(asked) == 3


def test_a_scheduler_of_ours_that_is_lost_is_not_waited_for(monkeypatch):
    client = SimpleNamespace(status="running", cluster=object())

    def ask(client):
        client.status = "connecting"
        raise OSError("Stream is closed")

    monkeypatch.setattr(admission, "let_leave_in_order", ask)
    monkeypatch.setattr(admission, "check_workers", lambda client, *orders: None)
    with pytest.raises(RunError, match=r"the connection to the scheduler is lost$"):
        admission.make_ready(client)
