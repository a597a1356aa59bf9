"""A folder in an object store has a copy here: carried whole, and written by one process until another takes over."""

import contextlib
import io
import threading

import pytest
from refusals import refused

from toppling.models.errors import InputError
from toppling.models.files import stores as module
from toppling.models.files.stores import CLAIM, Copy, Store, at_hand


@pytest.fixture
def two_machines(address, tmp_path):
    return [Copy(address, tmp_path / machine / "run") for machine in ("first", "second")]


def content(copy):
    return {str(p.relative_to(copy.path)): p.read_bytes() for p in copy.path.rglob("*") if p.is_file()}


def write(copy, **files):
    for name, text in files.items():
        place = copy.path / name.replace("__", "/")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)


def test_parts_that_are_merged_leave_the_store_and_the_other_copy(two_machines):
    first, second = two_machines
    write(first, parts__a="rows", parts__b="rows")
    first.push()
    second.pull()
    write(first, **{"results.parquet": "all rows"})
    for name in "ab":
        (first.path / "parts" / name).unlink()
    first.push()
    second.pull()
    assert content(second) == {"results.parquet": b"all rows"}


def test_other_machines_read_what_a_machine_writes_and_unsent_files_outlive_a_pull(two_machines):
    first, second = two_machines
    second.pull()
    assert not second.path.exists()  # there is no run yet, and none begins by being looked for
    write(first, parts__a="rows")
    first.push()
    second.pull()
    write(second, parts__b="more rows")  # then its machine is switched off
    write(first, parts__c="other rows")
    first.push()
    again = Copy(second.address, second.path)
    again.pull()
    assert content(again) == {"parts/a": b"rows", "parts/b": b"more rows", "parts/c": b"other rows"}
    again.push()
    first.pull()
    assert content(first) == content(again)


def test_a_rock_of_a_run_in_a_store_lies_in_the_copy_of_the_run(bucket, monkeypatch, tmp_path):
    monkeypatch.setenv("TOPPLING_CACHE", str(tmp_path / "cache"))
    first = Copy(f"s3://{bucket}/rock/run", tmp_path / "first" / "run")
    write(first, **{"run.json": "{}", "scenes__a__scene.json": "{}", "results.parquet": "rows"})
    first.push()
    place = at_hand(f"{first.address}/scenes/a")
    assert sorted(path.name for path in (place / "../..").iterdir()) == [
        "results.parquet",
        "run.json",
        "scenes",
    ]
    loose = at_hand(first.address.removesuffix("/run") + "/scenes/a")  # of no run
    assert not loose.exists()


def test_a_bucket_that_is_not_there_is_reported(bucket, tmp_path):
    copy = Copy("s3://no-such-bucket/run", tmp_path / "run")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    with refused("store.no_answer"):
        copy.push()


def test_a_kind_of_store_without_its_package_is_reported(tmp_path):
    with refused("store.kind_unknown"):
        Copy("smb://server/share/run", tmp_path / "run")


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(module, "_PAUSE_S", 0.05)


@pytest.fixture
def machine(address, tmp_path):
    return lambda name: Copy(address, tmp_path / name / "run")


def there(address):
    store = Store(address)
    return {name: store.read(name).decode() for name in store.objects() if name != CLAIM}


def test_a_second_writer_is_refused_with_the_writers_name_and_how_to_take_over(machine, address):
    with machine("first").sole_writer():
        for name in ("first", "second"):
            with (
                refused("store.written_by_another", address, machine(name).writer(), "--take-over"),
                machine(name).sole_writer(),
            ):
                pass
    with machine("second").sole_writer():
        pass
    assert not Store(address).holds(CLAIM)


def test_exactly_one_of_many_simultaneous_sessions_writes(machine):
    won, refused, start = [], [], threading.Barrier(6)
    done = threading.Barrier(6)

    def come(name):
        copy = machine(name)
        start.wait()
        try:
            with copy.sole_writer():
                won.append(name)
                done.wait()
        except InputError:
            refused.append(name)
            done.wait()

    threads = [threading.Thread(target=come, args=(f"machine {n}",)) for n in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (len(won), len(refused)) == (1, 5)


def test_a_killed_writer_leaves_its_claim_which_is_taken_over_only_when_asked(machine, address):
    first = machine("first")
    stopped = first.sole_writer()
    stopped.__enter__()
    write(first, a="1")
    first.push()
    first._claim._text = b"of a process that is no more"  # nothing more is put, nothing released
    with refused("store.taken_over"):
        stopped.__exit__(None, None, None)
    assert Store(address).holds(CLAIM)
    for name in ("first", "second"):
        with refused("store.written_by_another", "--take-over"), machine(name).sole_writer():
            pass
    with machine("second").sole_writer(take_over=True) as check:
        check()
    assert there(address) == {"a": "1"}
    assert not Store(address).holds(CLAIM)


@pytest.mark.parametrize("ended", [False, True])
def test_a_writer_that_stalls_in_a_put_while_another_takes_over_changes_nothing_of_that(
    machine, address, monkeypatch, ended
):
    former, successor = machine("former"), machine("successor")
    stalled, go_on = threading.Event(), threading.Event()
    inner = {"s3": "_put", "toy": "_stream"}[address.partition(":")[0]]  # what sends the bytes
    send = getattr(Store, inner)

    def slowly(store, *given, **condition):
        if store is former._store and ("b" in given or "/.b." in str(given[-1])):
            stalled.set()
            go_on.wait()
        return send(store, *given, **condition)

    monkeypatch.setattr(Store, inner, slowly)

    def write_slowly():
        with contextlib.suppress(InputError), former.sole_writer():
            write(former, a="old", b="old and long", c="old")
            former.push()

    thread = threading.Thread(target=write_slowly)
    thread.start()
    assert stalled.wait(20)
    with successor.sole_writer(take_over=True):
        assert successor.writer() != ""
        write(successor, a="new", b="new", c="new", d="new")
        successor.push()
        if not ended:
            go_on.set()
            thread.join()
    go_on.set()
    thread.join()
    assert there(address) == dict.fromkeys("abcd", "new")
    assert former._claim.loss.code == "store.taken_over"


def cutting(monkeypatch):
    put, stream = Store._put, Store._stream

    def cut(name):
        return name.strip("./").startswith("a")

    def put_half(store, name, body, **condition):
        return put(store, name, body[: len(body) // 2] if cut(name) else body, **condition)

    def stream_half(store, source, target):
        if not cut(target.rpartition("/")[2]):
            return stream(store, source, target)
        content = source.read()
        stream(store, io.BytesIO(content[: len(content) // 2]), target)
        return len(content)

    monkeypatch.setattr(Store, "_put", put_half)
    monkeypatch.setattr(Store, "_stream", stream_half)


def test_an_object_that_the_store_truncates_is_not_recorded_as_sent(machine, address, monkeypatch):
    with monkeypatch.context() as patch:
        cutting(patch)
        write(machine("first"), a="all of it")
        with refused("store.not_as_sent", 4, 9):
            machine("first").push()
    with machine("first").sole_writer():
        pass
    assert there(address) == {"a": "all of it"}


def test_figures_of_a_run_that_another_writes_are_retained_here_and_the_writer_named(machine, address):
    reader = machine("reader")
    with machine("writer").sole_writer():
        reader.pull()
        reader.upload_changes()  # nothing was made
        write(reader, figure="drawn")
        with refused("store.written_by_another", reader.writer()):
            reader.upload_changes()
        assert there(address) == {}
    reader.upload_changes()
    assert there(address) == {"figure": "drawn"}


def test_a_copy_that_a_process_of_this_machine_writes_to_is_left_to_that(machine, address):
    with machine("first").sole_writer() as check:
        other = machine("first")
        write(other, a="1")
        other.upload_changes()
        assert (other.path / "a").read_text() == "1"
        other.pull()
        assert (other.path / "a").exists()
        check()
    assert there(address) == {"a": "1"}
