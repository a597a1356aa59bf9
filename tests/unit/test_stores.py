"""A folder in an object store has a copy here; both are carried whole, against a server that is real."""

import pytest

from toppling.models.errors import InputError
from toppling.models.stores import Copy, address_of, is_store


@pytest.fixture(scope="module")
def bucket():
    """Name of a bucket on an S3 server on loopback."""
    server = pytest.importorskip("moto.server").ThreadedMotoServer(
        ip_address="127.0.0.1", port=0, verbose=False
    )
    server.start()
    host, port = server.get_host_and_port()
    variables = {
        "AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b", "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
    }  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        for name, value in variables.items():
            patch.setenv(name, value)
        pytest.importorskip("boto3").client("s3").create_bucket(Bucket="bucket")
        yield "bucket"
    server.stop()


@pytest.fixture
def two_machines(bucket, tmp_path, request):
    """Copies of one folder in a store, as two machines have them."""
    address = f"s3://{bucket}/{request.node.name}/run"
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


def test_locks_and_half_written_files_stay_here(two_machines):
    first, second = two_machines
    write(first, **{".lock": "host", ".run.tmp__campaign.toml": "half", "run.json": "{}"})
    first.push()
    second.pull()
    assert content(second) == {"run.json": b"{}"}


def test_only_what_changed_is_carried(two_machines, monkeypatch):
    first, _ = two_machines
    write(first, a="1", b="2")
    first.push()
    carried = []
    put = Copy._put
    monkeypatch.setattr(
        Copy, "_put", lambda self, name, place: carried.append(name) or put(self, name, place)
    )
    first.push()
    write(first, b="3")
    first.push()
    assert carried == ["b"]


def test_a_bucket_that_is_not_there_is_told(bucket, tmp_path):
    copy = Copy("s3://no-such-bucket/run", tmp_path / "run")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    with pytest.raises(InputError, match="the store gives no answer"):
        copy.push()


def test_a_kind_of_store_without_its_package_is_told(tmp_path):
    with pytest.raises(InputError, match="cannot be reached from here"):
        Copy("smb://server/share/run", tmp_path / "run")


@pytest.mark.parametrize("path", ["s3://b/run", "s3:/b/run", "S3://b/run/", "gs://b/r", "abfs://c@a/r"])
def test_addresses_of_stores_are_told_from_paths(path):
    assert is_store(path)
    assert address_of(path).startswith(path.partition(":")[0].lower() + "://")
    assert not is_store("runs/" + path)


@pytest.mark.parametrize(
    "path", ["runs/first", "file:///tmp/x", "https://host/run", "s3:run", "c/s3://b/run", "s3://"]
)
def test_paths_and_other_addresses_are_no_stores(path):
    assert not is_store(path)
