"""Object stores on this machine."""

import io
import threading
from typing import ClassVar

import pytest

from toppling.models.files.stores import kinds


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
