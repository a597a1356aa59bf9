"""A folder in an object store has a copy here; both are carried whole, against a server that is real."""

import pytest
from refusals import refused

from toppling.models.files.stores import Copy, Store, address_of, at_hand, azure_arguments, is_store


@pytest.fixture
def two_machines(address, tmp_path):
    """Copies of one folder in a store, as two machines have them."""
    return [Copy(address, tmp_path / machine / "run") for machine in ("first", "second")]


def content(copy):
    return {str(p.relative_to(copy.path)): p.read_bytes() for p in copy.path.rglob("*") if p.is_file()}


def write(copy, **files):
    for name, text in files.items():
        place = copy.path / name.replace("__", "/")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)


def test_what_one_machine_writes_another_reads(two_machines):
    first, second = two_machines
    second.pull()
    assert not second.path.exists()  # there is no run yet, and none begins by being looked for
    write(first, **{"run.json": "{}", "parts__a": "rows" * 1000, "scene__rock.ply": "mesh"})
    first.push()
    second.pull()
    assert content(second) == content(first)


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


def test_what_is_not_carried_yet_outlives_a_pull(two_machines):
    first, second = two_machines
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


def test_only_what_changed_is_carried(two_machines, monkeypatch):
    first, _ = two_machines
    write(first, a="1", b="2")
    first.push()
    carried = []
    send = Store._send
    monkeypatch.setattr(
        Store, "_send", lambda self, name, *given: carried.append(name) or send(self, name, *given)
    )
    first.push()
    write(first, b="3")
    first.push()
    assert carried == ["b"]


def test_a_bucket_that_is_not_there_is_told(bucket, tmp_path):
    copy = Copy("s3://no-such-bucket/run", tmp_path / "run")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    with refused("store.no_answer"):
        copy.push()


def test_a_connection_string_of_azure_names_account_key_and_server():
    said = "DefaultEndpointsProtocol=http;AccountName=a;AccountKey=k==;BlobEndpoint=http://127.0.0.1:10000/a;"
    server = {f"{kind}_storage_authority": "127.0.0.1:10000" for kind in ("blob", "dfs")}
    schemes = {f"{kind}_storage_scheme": "http" for kind in ("blob", "dfs")}
    assert azure_arguments(said) == {"account_name": "a", "account_key": "k=="} | server | schemes


@pytest.mark.parametrize("said", ["nonsense", "AccountName=;AccountKey=k"])
def test_a_connection_string_without_account_is_refused_by_the_name_of_its_variable(
    said, monkeypatch, tmp_path
):
    monkeypatch.setenv("AZURE_STORAGE_CONNECTION_STRING", said)
    with refused("store.no_answer", "account name", "AZURE_STORAGE_CONNECTION_STRING"):
        Copy("az://container/run", tmp_path / "run")


def test_a_kind_of_store_without_its_package_is_told(tmp_path):
    with refused("store.kind_unknown"):
        Copy("smb://server/share/run", tmp_path / "run")


@pytest.mark.parametrize("path", ["s3://b/run", "s3:/b/run", "S3://b/run/", "gs://b/r", "abfs://c@a/r"])
def test_addresses_of_stores_are_told_from_paths(path):
    assert is_store(path)
    assert address_of(path).startswith(path.partition(":")[0].lower() + "://")
    assert not is_store("runs/" + path)
