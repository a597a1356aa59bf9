"""Runs in object stores: a copy on this machine stands for one, and what changes in either is carried over.

A store has no renaming, and each file of a run is verified as a whole before it is believed. So the files are brought
here first, and what is written goes back whole: the store shows an object only once all of it is there. Others may read
the store at any time; one writes (`lease`).
"""

import contextlib
import functools
import hashlib
import logging
import os
import re
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from errno import EDQUOT, ENOSPC
from pathlib import Path, PurePosixPath
from typing import Any

from toppling.models.errors import InputError
from toppling.models.files.digest import read_json, write_json
from toppling.models.files.folder import cache_folder, local, new_file
from toppling.models.files.lease import WRITERS, Lease, put, repeated

log = logging.getLogger(__name__)

_PAUSE_S = 5.0
"""Between looks at what a run that goes on has written: as often as it writes parts."""

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

_ADDRESS = re.compile(r"^([a-z][a-z0-9+.-]+):/+(?=[^/])", re.IGNORECASE)
_AZURE = "AZURE_STORAGE_CONNECTION_STRING"
"""Arrow takes no key of an account from an address; without this the machine's own login is used."""

_Stamp = list[int]
"""Size, and time of the last change in nanoseconds."""


@dataclass
class Copy:
    """The copy on this machine of a folder in a store.

    Raises InputError if there is no such kind of store, or it does not answer.
    """

    address: str
    path: Path  # of the copy
    _root: str = field(init=False)
    _store: Any = field(init=False)
    _known: dict[str, tuple[_Stamp, _Stamp]] = field(init=False, default_factory=dict)
    _alone: threading.Lock = field(init=False, default_factory=threading.Lock)
    _lease: Lease = field(init=False)

    def __post_init__(self) -> None:
        self._store, self._root = _file_system(self.address)
        notes = self.path.with_name(f"{self.path.name}.writer")
        self._lease = Lease(self.address, self._store, f"{self._root}/{WRITERS}", notes)
        with contextlib.suppress(OSError, InputError, TypeError, ValueError):
            known = read_json(self._notes)
            self._known = {name: (list(here), list(there)) for name, (here, there) in known.items()}

    @property
    def _notes(self) -> Path:
        return self.path.with_name(f"{self.path.name}.json")

    def pull(self) -> None:
        """Bring here what is new or changed in the store; what the store has no more is removed here too.

        Raises InputError if the store does not answer, or holds what is no file of a folder.
        """
        with self._alone, self._told():
            there = self._listed()
            for name, stamp in there.items():
                place = self.path / name
                if name in self._known and self._known[name][1] == stamp and place.exists():
                    continue
                with (
                    new_file(place) as hidden,
                    self._store.open_input_stream(f"{self._root}/{name}") as source,
                    hidden.open("wb") as target,
                ):
                    shutil.copyfileobj(source, target, 2**20)
                self._known[name] = (_stamp(place), stamp)
            for name in self._known.keys() - there.keys():
                (self.path / name).unlink(missing_ok=True)
                del self._known[name]
            self._note()

    def push(self) -> None:
        """Carry what is new or changed here to the store, `run.json` last, then remove there what is no more here.

        Raises InputError if the store does not answer, or another process has taken this one's place meanwhile.
        """
        if self._lease.lost:
            return
        with self._alone, self._told():
            self._lease.make_sure()
            here = {
                name: place
                for place in self.path.rglob("*")
                if not _is_hidden(name := str(place.relative_to(self.path)))
                and place.is_file()
                and not place.is_symlink()
            }
            for name in sorted(here, key=lambda name: (name == "run.json", name)):
                with contextlib.suppress(FileNotFoundError):  # merged away meanwhile
                    stamp = _stamp(here[name])
                    if self._known.get(name, (None,))[0] != stamp:
                        self._known[name] = (stamp, self._put(name, here[name]))
            for name in self._known.keys() - here.keys():
                with contextlib.suppress(FileNotFoundError):
                    self._store.delete_file(f"{self._root}/{name}")
                del self._known[name]
            self._note()

    @contextlib.contextmanager
    def kept_up(self) -> Iterator[Callable[[], None]]:
        """Write as the only one: bring what others wrote, carry over what is written meanwhile, and all at the end.

        Yields callable: raises InputError once another process has taken this one's place.
        """
        with contextlib.ExitStack() as until_done:
            with self._told():
                until_done.enter_context(self._lease.held())
            self.pull()
            with self._carried():
                yield self._lease.check

    def holds_run(self) -> bool:
        """Whether the folder in the store is a run's.

        Raises InputError if the store does not answer.
        """
        from pyarrow.fs import FileType

        with self._told():
            return bool(self._store.get_file_info(f"{self._root}/run.json").type == FileType.File)

    def is_written_elsewhere(self) -> bool:
        """Whether another machine writes to the folder now.

        Raises InputError if the store does not answer.
        """
        with self._told():
            return self._lease.is_held_elsewhere()

    @contextlib.contextmanager
    def _carried(self) -> Iterator[None]:
        def keep_up() -> None:
            try:
                self.push()
            except InputError as error:
                log.warning("%s; what is done stays in %s, and is tried again", error.what, self.path)

        try:
            with repeated(keep_up, _PAUSE_S):
                yield
        finally:
            self.push()

    def _put(self, name: str, place: Path) -> _Stamp:
        target = f"{self._root}/{name}"
        with place.open("rb") as source:
            put(self._store, target, source)
        info = self._store.get_file_info(target)
        return [info.size, info.mtime_ns or 0]

    def _listed(self) -> dict[str, _Stamp]:
        from pyarrow.fs import FileSelector, FileType

        found = self._store.get_file_info(FileSelector(self._root, recursive=True, allow_not_found=True))
        files = {
            info.path.removeprefix(f"{self._root}/"): [info.size, info.mtime_ns or 0]
            for info in found
            if info.type == FileType.File
        }
        for name in files:
            if not name or name.startswith("/") or ".." in PurePosixPath(name).parts:
                raise InputError(
                    f"holds an object named {name!r}",
                    where=self.address,
                    expected="files of a run, in folders below it",
                    remedy="remove that object, or give another address",
                )
        return {name: stamp for name, stamp in files.items() if not _is_hidden(name)}

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except InputError:
            raise
        except Exception as error:  # packages of fsspec have errors of their own
            here = isinstance(error, OSError) and (
                str(error.filename).startswith(str(self.path.parent)) or error.errno in (ENOSPC, EDQUOT)
            )
            if here:  # of this machine's disk
                raise
            raise _no_answer(self.address, error) from None

    def _note(self) -> None:
        write_json(self._notes, self._known)


_COPIES: dict[str, Copy] = {}
"""Of this process: what is asked twice is brought once, and all is carried back at the end."""


def _copy_of(path: str | os.PathLike[str]) -> Copy:
    """The copy on this machine of a folder in a store, as the store has it at the first call.

    Raises InputError as `Copy` and `Copy.pull`.
    """
    address = _address_of(path)
    if address not in _COPIES:
        copy = _copy(address)
        copy.pull()
        _COPIES[address] = copy
    return _COPIES[address]


def _copy(address: str) -> Copy:
    name = PurePosixPath(address.partition("?")[0]).name
    key = hashlib.blake2b(address.encode(), digest_size=8).hexdigest()
    return Copy(address, cache_folder() / "stores" / key / name)


def at_hand(path: str | os.PathLike[str]) -> Path:
    """A folder of this machine as it is; of one in a store, the copy; of a rock of a run there, its place in that."""
    if not is_store(path):
        return local(path)
    run, inner, rock = _address_of(path).rpartition("/scenes/")
    if inner and "/" not in rock and is_store(run) and _copy(run).holds_run():
        return _copy_of(run).path / "scenes" / rock
    return _copy_of(path).path


def named(path: Path) -> str:
    """What a user calls a folder: the address, where it is the copy of one in a store."""
    return next((address for address, copy in _COPIES.items() if copy.path == path), str(path))


def kept_up(path: Path) -> AbstractContextManager[Callable[[], None]]:
    """As :meth:`Copy.kept_up`, if a folder is a copy of one in a store."""
    copies = (copy.kept_up() for copy in _COPIES.values() if copy.path == path)
    return next(copies, contextlib.nullcontext(lambda: None))


def is_written_elsewhere(path: Path) -> bool:
    """Whether a folder is the copy of one in a store to which another machine writes now."""
    return any(copy.is_written_elsewhere() for copy in _COPIES.values() if copy.path == path)


def carry_back() -> None:
    """Carry what was written into copies to their stores."""
    for copy in _COPIES.values():
        copy.push()


def _is_hidden(name: str) -> bool:
    """Whether a file is half written, a lock, a key or a sign of a writer, and no part of a run."""
    return any(part.startswith(".") for part in PurePosixPath(name).parts)


def _stamp(place: Path) -> _Stamp:
    state = place.stat()
    return [state.st_size, state.st_mtime_ns]


def is_store(path: str | os.PathLike[str]) -> bool:
    """Whether a path is an address in an object store; `Path` makes one slash of its two.

    Examples
    --------
    >>> is_store("s3://bucket/run"), is_store("s3:/bucket/run"), is_store("runs/first")
    (True, True, False)
    """
    found = _ADDRESS.match(os.fspath(path))
    return found is not None and found[1].lower() in kinds()


@functools.cache
def kinds() -> frozenset[str]:
    """Kinds of stores that Arrow or a package of fsspec reaches, by the beginning of an address."""
    import fsspec

    return frozenset({"abfss", "gcs", "viewfs", *fsspec.available_protocols()} - _NO_STORES)


def _address_of(path: str | os.PathLike[str]) -> str:
    """An address as its store wants it.

    Examples
    --------
    >>> _address_of("S3:/bucket/run/")
    's3://bucket/run'
    """
    text = os.fspath(path)
    found = _ADDRESS.match(text)
    assert found is not None
    return f"{found[1].lower()}://{text[found.end() :].rstrip('/')}"


def _file_system(address: str) -> tuple[Any, str]:
    """What reaches a store (an Arrow file system), and the path in it.

    Raises InputError if nothing here reaches such a store, or it does not answer.
    """
    import pyarrow as pa
    from pyarrow.fs import AzureFileSystem, FileSystem, FSSpecHandler, PyFileSystem

    kind, _, place = address.partition("://")
    if kind in ("az", "abfs", "abfss") and "@" not in place and (connection := os.environ.get(_AZURE)):
        try:
            return AzureFileSystem(**_azure_arguments(connection)), place
        except pa.ArrowException as error:
            raise _no_answer(address, error) from None
    # Google's store is otherwise asked for a quarter of an hour.
    patience = "?retry_limit_seconds=20" if kind in ("gs", "gcs") and "?" not in address else ""
    try:
        return FileSystem.from_uri(address + patience)
    except pa.ArrowInvalid:
        pass  # not one of Arrow's own
    except OSError as error:
        raise _no_answer(address, error) from None
    try:
        import fsspec

        system, root = fsspec.core.url_to_fs(address)
        system.dircache.use_listings_cache = False  # others write there too
    except (ImportError, ValueError) as error:
        raise InputError(
            f"is in a kind of store that cannot be reached from here ({error})",
            where=address,
            expected="s3://, gs://, abfs://, hdfs://, or what an installed package of fsspec reaches",
            remedy=f"install the package that is named ({_AZURE} is enough for az://), or copy the folder here",
        ) from None
    except Exception as error:  # (some connect at once, and each package has errors of its own)
        raise _no_answer(address, error) from None
    return PyFileSystem(FSSpecHandler(system)), root


def _azure_arguments(connection: str) -> dict[str, str]:
    """Arguments of Arrow's file system from a connection string, as Azure shows it for an account."""
    given = dict(one.partition("=")[::2] for one in connection.split(";") if one)
    endpoint = given.get("BlobEndpoint", "").split("/")  # https: // authority / account
    said = {
        "account_name": given.get("AccountName", ""),
        "account_key": given.get("AccountKey"),
        "sas_token": given.get("SharedAccessSignature"),
        "blob_storage_scheme": given.get("DefaultEndpointsProtocol"),
    }
    if len(endpoint) > 2:
        said["blob_storage_scheme"], said["blob_storage_authority"] = endpoint[0].rstrip(":"), endpoint[2]
        said["dfs_storage_scheme"], said["dfs_storage_authority"] = endpoint[0].rstrip(":"), endpoint[2]
    return {name: value for name, value in said.items() if value is not None}


def _no_answer(address: str, error: Exception) -> InputError:
    """Tell what a store, or what reaches it, complains of."""
    said = str(error).splitlines() or [type(error).__name__]
    return InputError(
        f"the store gives no answer ({said[0]})",
        where=address,
        expected="a bucket that exists, and credentials that may read and write it",
        remedy="check the address and the store's variables (AWS_ACCESS_KEY_ID, AWS_ENDPOINT_URL, ...; "
        f"{_AZURE}; FSSPEC_...)",
    )
