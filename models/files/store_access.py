"""What reaches an object store, and how one object of it is listed, read, written and removed.

Arrow's file systems reach S3, Google's and Azure's stores and HDFS, packages of fsspec all others. Neither writes under
a condition, so that objects of S3 are put with boto3 where it is installed: only over what was there just before.
"""

import contextlib
import functools
import io
import os
import shutil
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import IO, Any
from urllib.parse import parse_qs, unquote, urlsplit

from toppling.models.errors import InputError

_NO_STORES = {
    "arrow_hdfs",
    "asynclocal",
    "data",
    "dir",
    "file",
    "http",
    "https",
    "local",
    "memory",
    "tar",
    "zip",
}
"""Kinds of fsspec that keep no folder, or that are this machine: the last is a path (`local`)."""

_AZURE = "AZURE_STORAGE_CONNECTION_STRING"
"""Arrow takes no key of an account from an address; without this the machine's own login is used."""

Stamp = list[int]
"""Size, and time of the last change in nanoseconds."""

_WHOLE = ("s3", "gcs", "abfs")
"""Types of Arrow's file systems that have no folders to be made, and show what is written whole or not at all."""

_IN_MEMORY_BYTES = 2**26
"""Files up to this size are read before they are put, so that one that grows meanwhile does not grow in flight."""

_MOST_IN_ONE_PUT_BYTES = 5 * 10**9
"""Limit of S3 (Amazon S3 API reference, PutObject): larger objects go in parts, without a condition."""

_TRIES = 3
"""Times that an object is put which the store then does not hold whole."""

_REFUSED = ("PreconditionFailed", "ConditionalRequestConflict")
"""Answers of S3 to a put whose condition does not hold (Amazon S3 API reference, PutObject)."""


@dataclass
class Store:
    """A folder in an object store, whose objects are named by their place below it.

    Raises InputError if there is no such kind of store, or it does not answer.
    """

    address: str
    _files: Any = field(init=False)
    _root: str = field(init=False)
    _hidden: str = field(init=False, default_factory=lambda: uuid.uuid4().hex)  # two writers hide apart

    def __post_init__(self) -> None:
        self._files, self._root = _file_system(self.address)

    @functools.cached_property
    def _s3(self) -> Any:
        """Client of boto3, which puts under a condition; None for other stores, and where it is not installed."""
        if self._files.type_name != "s3":
            return None
        try:
            return _s3_client(self.address, self._files.region)
        except ImportError:
            return None

    def objects(self) -> dict[str, Stamp]:
        """Every object by name, hidden ones included.

        Raises InputError if one is no file of a folder.
        """
        from pyarrow.fs import FileSelector, FileType

        found = self._files.get_file_info(FileSelector(self._root, recursive=True, allow_not_found=True))
        files = {
            info.path.removeprefix(f"{self._root}/"): _stamp(info)
            for info in found
            if info.type == FileType.File
        }
        for name in files:
            if not name or name.startswith("/") or ".." in PurePosixPath(name).parts:
                raise InputError(
                    "store.object_foreign",
                    f"holds an object named {name!r}",
                    where=self.address,
                    expected="files of a run, in folders below it",
                    remedy="remove that object, or give another address",
                )
        return files

    def holds(self, name: str) -> bool:
        """Whether there is an object of a name."""
        from pyarrow.fs import FileType

        return bool(self._files.get_file_info(self._path(name)).type == FileType.File)

    def read(self, name: str) -> bytes:
        """Content of a small object; empty where there is none."""
        with (
            contextlib.suppress(FileNotFoundError),
            self._files.open_input_stream(self._path(name)) as source,
        ):
            return bytes(source.read(1000))
        return b""

    def fetch(self, name: str, place: Path) -> None:
        """Copy an object to a file."""
        with self._files.open_input_stream(self._path(name)) as source, place.open("wb") as target:
            shutil.copyfileobj(source, target, 2**20)

    def remove(self, name: str) -> None:
        """Remove an object, if it is there."""
        with contextlib.suppress(FileNotFoundError):
            self._files.delete_file(self._path(name))

    def create(self, name: str, content: bytes) -> None:
        """Write a small object unless there is one: in one step where the store can, which Arrow has no call for."""
        handler = getattr(self._files, "handler", None)
        if self._s3:
            self._put(name, content, IfNoneMatch="*")
        elif handler is not None:
            self._files.create_dir(self._root)
            with contextlib.suppress(FileExistsError):
                handler.fs.pipe_file(self._path(name), content, mode="create")
        elif not self.holds(name):
            self.write(name, io.BytesIO(content))

    def write(
        self, name: str, source: IO[bytes], check: Callable[[], None] = lambda: None
    ) -> tuple[Stamp, int]:
        """Write an object that appears whole or not at all; return what is there then, and how many bytes were sent.

        The two differ in size where the store cut it short, again and again, or another process wrote it meanwhile.

        check: called as late before it appears as can be; an error of it stops that.
        """
        for _ in range(_TRIES):
            sent = self._send(name, source, check)
            there = _stamp(self._files.get_file_info(self._path(name)))
            if there[0] == sent:
                break
        return there, sent

    def _send(self, name: str, source: IO[bytes], check: Callable[[], None]) -> int:
        """Put an object; tell how many bytes were sent, or -1 where another process wrote it since `check`."""
        target = self._path(name)
        size = source.seek(0, os.SEEK_END)
        source.seek(0)
        if self._s3 and size <= _MOST_IN_ONE_PUT_BYTES:
            tag = self._tag(name)
            check()
            body = source.read() if size <= _IN_MEMORY_BYTES else source
            held = self._put(name, body, **({"IfMatch": tag} if tag else {"IfNoneMatch": "*"}))
            return (len(body) if isinstance(body, bytes) else size) if held else -1
        if self._files.type_name in _WHOLE:
            check()
            return self._stream(source, target)
        place = PurePosixPath(target)
        hidden = str(place.with_name(f".{place.name}.{self._hidden}.tmp"))
        self._files.create_dir(str(place.parent))
        sent = self._stream(source, hidden)
        check()
        self._move(hidden, target)
        return sent

    def _stream(self, source: IO[bytes], target: str) -> int:
        with self._files.open_output_stream(target) as sink:
            shutil.copyfileobj(source, sink, 2**20)
        return source.tell()

    def _move(self, hidden: str, target: str) -> None:
        handler = getattr(self._files, "handler", None)  # fsspec's: some cannot all that Arrow asks for
        move = self._files.move if handler is None else handler.fs.mv
        try:
            move(hidden, target)
        except Exception:  # some rename only to what is not there, and each has errors of its own
            self._files.delete_file(target)
            move(hidden, target)

    def _put(self, name: str, body: bytes | IO[bytes], **condition: str) -> bool:
        """Put an object of S3; tell whether the condition held."""
        from botocore.exceptions import ClientError

        try:
            self._s3.put_object(**self._key(name), Body=body, **condition)
        except ClientError as error:
            if error.response["Error"]["Code"] in _REFUSED:
                return False
            raise
        return True

    def _tag(self, name: str) -> str:
        """Entity tag of an object of S3, which is another for another content; empty where there is none."""
        from botocore.exceptions import ClientError

        try:
            return str(self._s3.head_object(**self._key(name))["ETag"])
        except ClientError as error:
            if error.response["ResponseMetadata"]["HTTPStatusCode"] == 404:
                return ""
            raise

    def _key(self, name: str) -> dict[str, str]:
        bucket, _, key = self._path(name).partition("/")
        return {"Bucket": bucket, "Key": key}

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}"


def _stamp(info: Any) -> Stamp:
    return [info.size or 0, info.mtime_ns or 0]


def _s3_client(address: str, region: str) -> Any:
    """Client of boto3 for the server, the region and the account that Arrow reads from an address.

    Raises ImportError if boto3 is not installed.
    """
    import boto3
    from botocore.config import Config

    parts = urlsplit(address)
    asked = {name: values[-1] for name, values in parse_qs(parts.query).items()}
    server = asked.get("endpoint_override")
    style = "virtual" if asked.get("force_virtual_addressing") == "true" else "path"
    return boto3.client(
        "s3",
        endpoint_url=server and f"{asked.get('scheme', 'https')}://{server}",
        region_name=region or None,
        aws_access_key_id=parts.username and unquote(parts.username),
        aws_secret_access_key=parts.password and unquote(parts.password),
        config=Config(s3={"addressing_style": style}),
    )


@functools.cache
def kinds() -> frozenset[str]:
    """Kinds of stores that Arrow or a package of fsspec reaches, by the beginning of an address."""
    import fsspec

    return frozenset({"abfss", "gcs", "viewfs", *fsspec.available_protocols()} - _NO_STORES)


def _file_system(address: str) -> tuple[Any, str]:
    """What reaches a store (an Arrow file system), and the path in it.

    Raises InputError if nothing here reaches such a store, or it does not answer.
    """
    import pyarrow as pa
    from pyarrow.fs import AzureFileSystem, FileSystem, FSSpecHandler, PyFileSystem

    kind, _, place = address.partition("://")
    if kind in ("az", "abfs", "abfss") and "@" not in place and (connection := os.environ.get(_AZURE)):
        try:
            return AzureFileSystem(**azure_arguments(connection)), place
        except pa.ArrowException as error:
            raise no_answer(address, error) from None
    # Google's store is otherwise asked for a quarter of an hour.
    patience = "?retry_limit_seconds=20" if kind in ("gs", "gcs") and "?" not in address else ""
    try:
        return FileSystem.from_uri(address + patience)
    except pa.ArrowInvalid:
        pass  # not one of Arrow's own
    except OSError as error:
        raise no_answer(address, error) from None
    try:
        import fsspec

        system, root = fsspec.core.url_to_fs(address)
        system.dircache.use_listings_cache = False  # others write there too
    except (ImportError, ValueError) as error:
        raise InputError(
            "store.kind_unknown",
            f"is in a kind of store that cannot be reached from here ({error})",
            where=address,
            expected="s3://, gs://, abfs://, hdfs://, or what an installed package of fsspec reaches",
            remedy=f"install the package that is named ({_AZURE} is enough for az://), or copy the folder here",
        ) from None
    except Exception as error:  # (some connect at once, and each package has errors of its own)
        raise no_answer(address, error) from None
    return PyFileSystem(FSSpecHandler(system)), root


def azure_arguments(connection: str) -> dict[str, str]:
    """Arguments of Arrow's file system from a connection string, as Azure shows it for an account."""
    given = dict(pair.partition("=")[::2] for pair in connection.split(";") if pair)
    endpoint = given.get("BlobEndpoint", "").split("/")  # https: // authority / account
    named = {
        "account_name": given.get("AccountName", ""),
        "account_key": given.get("AccountKey"),
        "sas_token": given.get("SharedAccessSignature"),
        "blob_storage_scheme": given.get("DefaultEndpointsProtocol"),
    }
    if len(endpoint) > 2:
        named["blob_storage_scheme"], named["blob_storage_authority"] = endpoint[0].rstrip(":"), endpoint[2]
        named["dfs_storage_scheme"], named["dfs_storage_authority"] = endpoint[0].rstrip(":"), endpoint[2]
    return {name: value for name, value in named.items() if value is not None}


def no_answer(address: str, error: Exception) -> InputError:
    """Tell what a store, or what reaches it, complains of."""
    lines = str(error).splitlines() or [type(error).__name__]
    return InputError(
        "store.no_answer",
        f"the store gives no answer ({lines[0]})",
        where=address,
        expected="a bucket that exists, and credentials that may read and write it",
        remedy="check the address and the store's variables (AWS_ACCESS_KEY_ID, AWS_ENDPOINT_URL, ...; "
        f"{_AZURE}; FSSPEC_...)",
    )
