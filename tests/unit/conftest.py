"""Object stores on this machine."""

import io
import threading
from typing import ClassVar

import pytest

from toppling.models.files.stores import kinds


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
def of_fsspec():
    """Address in a store that only a package of fsspec reaches, with renaming, folders and errors of its own."""
    from fsspec import register_implementation
    from fsspec.implementations.memory import MemoryFileSystem

    class Toy(MemoryFileSystem):
        protocol = "toy"
        store: ClassVar[dict] = {}
        pseudo_dirs: ClassVar[list] = [""]

        # As a real store: one creation of a name succeeds, and who reads has a position of his own.
        lock = threading.RLock()

        def pipe_file(self, path, value, mode="overwrite", **options):
            with self.lock:
                super().pipe_file(path, value, mode, **options)

        def _open(self, path, mode="rb", **options):
            with self.lock:
                found = super()._open(path, mode, **options)
                return io.BytesIO(found.getvalue()) if mode == "rb" else found

        def mv(self, source, target):
            if self.exists(target):
                raise RuntimeError("there is one of that name")
            super().mv(source, target)

    register_implementation("toy", Toy, clobber=True)
    kinds.cache_clear()
    return "toy://folder/run"


@pytest.fixture(params=["s3", "of_fsspec"])
def address(request):
    """A folder in a store whose puts have conditions, and in one with renaming."""
    if request.param == "of_fsspec":
        return request.getfixturevalue("of_fsspec")
    return f"s3://{request.getfixturevalue('bucket')}/{request.getfixturevalue('tmp_path').name}/run"
