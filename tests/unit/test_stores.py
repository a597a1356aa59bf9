"""A folder in an object store has a copy here; both are carried whole, against a server that is real."""

import subprocess
import sys
import threading

import pytest
from refusals import refused, tells

from toppling.models.files.store_access import Store, azure_arguments
from toppling.models.files.stores import Copy, address_of, at_hand, is_store


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


def test_a_rock_of_a_run_in_a_store_lies_in_the_copy_of_the_run(two_machines, monkeypatch, tmp_path):
    monkeypatch.setenv("TOPPLING_CACHE", str(tmp_path / "cache"))
    first, _ = two_machines
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


@pytest.fixture
def google(monkeypatch):
    """Address of a bucket on a server on loopback that speaks as Google's store does."""
    flask, serving = pytest.importorskip("flask"), pytest.importorskip("werkzeug.serving")
    app, objects = flask.Flask("google"), {}

    def described(name):
        said = {
            "kind": "storage#object",
            "bucket": "bucket",
            "name": name,
            "size": str(len(objects[name][0])),
        }
        return said | {"updated": f"2026-01-01T00:00:{objects[name][1] % 60:02}.000Z"}

    @app.post("/upload/storage/v1/b/bucket/o")
    def begin():
        there = f"{flask.request.host_url}upload/storage/v1/b/bucket/o?name={flask.request.args['name']}"
        return "", 200, {"Location": there}

    @app.put("/upload/storage/v1/b/bucket/o")
    def upload():
        name = flask.request.args["name"]
        objects[name] = (flask.request.data, len(objects) + objects.get(name, ("", 0))[1])
        return described(name)

    @app.get("/storage/v1/b/bucket/o")
    def list_objects():
        found = [n for n in sorted(objects) if n.startswith(flask.request.args.get("prefix", ""))]
        return {"kind": "storage#objects", "items": [described(name) for name in found]}

    @app.get("/storage/v1/b/bucket/o/<path:name>")
    def read(name):
        if name not in objects:
            return {"error": {"code": 404, "message": "no such object"}}, 404
        return objects[name][0] if flask.request.args.get("alt") == "media" else described(name)

    @app.delete("/storage/v1/b/bucket/o/<path:name>")
    def delete(name):
        return ("", 204) if objects.pop(name, None) else ("", 404)

    server = serving.make_server("127.0.0.1", 0, app, threaded=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"gs://anonymous@bucket/run?endpoint_override=127.0.0.1:{server.server_port}&scheme=http"
    server.shutdown()


@pytest.mark.parametrize("kind", ["google", "of_fsspec"])
def test_every_kind_of_store_carries_a_run_and_has_one_writer(kind, request, tmp_path):
    address = request.getfixturevalue(kind)
    first, second = (Copy(address, tmp_path / machine / "run") for machine in ("first", "second"))
    second.pull()
    assert not second.path.exists()
    write(first, **{"run.json": "{}", "parts__a": "rows", "parts__b": "rows"})
    with first.kept_up() as check:
        check()
        with refused("store.written_by_another"):
            second.kept_up().__enter__()
        write(first, **{"run.json": "{1}", "results.parquet": "all rows"})
        (first.path / "parts" / "b").unlink()
    with second.kept_up():
        assert content(second) == content(first)


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


@pytest.mark.parametrize(
    "words",
    [["status", "s4://bucket/run"], ["run", "c.toml", "--out", "memory://run"], ["query", "file://host/x"]],
)
def test_a_misspelled_kind_of_store_is_refused_by_name_and_nothing_is_made(words, tmp_path):
    command = [sys.executable, "-P", "-m", "toppling", *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    tells(done.stderr, "file.is_address", f"({words[-1].partition(':')[0]}://)")
    assert not list(tmp_path.iterdir())


def test_a_kind_of_store_without_its_package_is_told(tmp_path):
    with refused("store.kind_unknown"):
        Copy("smb://server/share/run", tmp_path / "run")


@pytest.mark.parametrize("path", ["s3://b/run", "s3:/b/run", "S3://b/run/", "gs://b/r", "abfs://c@a/r"])
def test_addresses_of_stores_are_told_from_paths(path):
    assert is_store(path)
    assert address_of(path).startswith(path.partition(":")[0].lower() + "://")
    assert not is_store("runs/" + path)


@pytest.mark.parametrize(
    "path",
    [
        "runs/first", "file:///tmp/x", "memory://x", "tcp://node:1", "https://host/run", "s3:run",
        "c/s3://b/run", "s3://",
    ],
)  # fmt: skip
def test_paths_and_other_addresses_are_no_stores(path):
    assert not is_store(path)
