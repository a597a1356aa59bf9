"""Ctrl-C ends a program with code 130 and one line, wherever it comes; each program here is a process of its own."""

import signal
import subprocess
import sys
import textwrap

import pytest

BEGINNING = """
    import os, signal, sys, threading, time
    from toppling.orchestrator.interrupt import uninterrupted, as_program, held_back, signals_as_stop

    def ctrl_c(times=6):
        for _ in range(times):
            os.kill(os.getpid(), signal.SIGINT)
"""


def ended(work, before=""):
    """Code, output and errors of a program that does this work, started under what is done before."""
    program = f"{before}\n{textwrap.dedent(BEGINNING)}\ndef work():\n{textwrap.indent(textwrap.dedent(work), '    ')}\n"
    done = subprocess.run(
        [sys.executable, "-c", f"{program}\nas_program(work)"], capture_output=True, text=True, timeout=50
    )
    return done.returncode, done.stdout, done.stderr


def test_a_program_that_nobody_stops_ends_with_its_own_code():
    assert ended("print('done')") == (0, "done\n", "")
    assert ended("sys.exit(3)") == (3, "", "")


STOPPED = {
    "anywhere": "ctrl_c()\ntime.sleep(60)",
    "in a finalizer, which swallows it": """
        class Closed:
            def __del__(self):
                ctrl_c()
                sum(range(1000))
        closed = Closed()
        del closed
        time.sleep(60)
    """,
    "and what it ends fails": """
        try:
            ctrl_c()
        finally:
            raise AssertionError("the scheduler has gone")
    """,
    "and a thread fails because of it": """
        def fails():
            gone.wait()
            raise AssertionError("the loop has gone")
        gone = threading.Event()
        thread = threading.Thread(target=fails)
        thread.start()
        try:
            ctrl_c()
        finally:
            gone.set()
            thread.join()
    """,
}


@pytest.mark.parametrize("work", STOPPED.values(), ids=STOPPED)
def test_ctrl_c_ends_it_with_a_single_line(work):
    assert ended(work) == (130, "", "stopped\n")


def test_it_is_raised_once_and_no_more_while_the_program_ends():
    work = """
        try:
            ctrl_c()
            time.sleep(60)
        finally:
            try:
                raise ValueError("of the end")
            except ValueError:
                time.sleep(0.5)
            time.sleep(0.5)
            print("ended in order", flush=True)
    """
    assert ended(work) == (130, "ended in order\n", "stopped\n")


def test_what_fails_by_itself_is_reported():
    code, _, result = ended("raise AssertionError('a defect')")
    assert code == 1
    assert "a defect" in result


def test_what_is_held_back_is_done_whole_and_then_stopped():
    work = """
        with held_back():
            with held_back():
                ctrl_c()
            print("whole", flush=True)
        print("more", flush=True)
    """
    assert ended(work) == (130, "whole\n", "stopped\n")


@pytest.mark.parametrize("when", ["begins", "works", "ends"])
def test_a_context_begins_and_ends_whole(when):
    work = f"""
        from contextlib import contextmanager
        @contextmanager
        def context():
            {"ctrl_c()" if when == "begins" else "pass"}
            print("begins", flush=True)
            try:
                yield
            finally:
                {"ctrl_c()" if when == "ends" else "pass"}
                print("ends", flush=True)
        with uninterrupted(context()):
            {"ctrl_c()" if when == "works" else "pass"}
        time.sleep(60)
    """
    assert ended(work) == (130, "begins\nends\n", "stopped\n")


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_terminal_that_closes_and_a_batch_system_stop_in_order(name):
    work = f"""
        try:
            os.kill(os.getpid(), signal.{name})
            time.sleep(60)
        finally:
            print("ended in order")
    """
    before = f"import signal; signal.signal(signal.{name}, signal.SIG_DFL)"  # whatever the tests were started under
    assert ended(work, before) == (130, "ended in order\n", "stopped\n")


def test_under_nohup_a_terminal_that_closes_stops_nothing():
    work = """
        os.kill(os.getpid(), signal.SIGHUP)
        print("goes on")
    """
    before = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)"
    assert ended(work, before) == (0, "goes on\n", "")


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_verb_that_is_asked_to_end_prints_a_single_line(name, tmp_path):
    program = f"""
        import signal, sys, time
        signal.signal(signal.{name}, signal.SIG_DFL)
        from toppling.orchestrator import cli, verbs
        class Waits:
            def find_spec(self, name, path=None, target=None):
                if name == "toppling.orchestrator.verbs.query":
                    print("begun", flush=True)
                    time.sleep(60)
        sys.meta_path.insert(0, Waits())
        sys.argv[1:] = ["query", "{tmp_path}"]
        cli.main()
    """
    going = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )  # fmt: skip
    assert going.stdout.readline() == "begun\n"
    going.send_signal(getattr(signal, name))
    assert (going.communicate(timeout=50)[1], going.returncode) == ("stopped\n", 130)
