"""Runs in object stores: access to objects, and a copy on this machine whose changes are carried over."""

import contextlib
import fcntl
import functools
import hashlib
import io
import logging
import os
import re
import shutil
import socket
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from errno import EDQUOT, ENOSPC
from pathlib import Path, PurePosixPath
from typing import IO, Any
from urllib.parse import parse_qs, unquote, urlsplit

from toppling.models.errors import InputError
from toppling.models.files.digest import read_json, write_json
from toppling.models.files.folder import cache_folder, local, new_file

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

Stamp = list[int]
"""Size, and time of the last change in nanoseconds."""

_WHOLE = ("s3", "gcs", "abfs")
"""Types of Arrow's file systems that have no folders to be made, and show what is written whole or not at all."""

_IN_MEMORY_BYTES = 2**26
"""Files up to this size are read before they are put, so that one that grows meanwhile does not grow in flight."""

_MOST_IN_A_PUT_BYTES = 5 * 10**9
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
            info.path.removeprefix(f"{self._root}/"): _object_stamp(info)
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
            there = _object_stamp(self._files.get_file_info(self._path(name)))
            if there[0] == sent:
                break
        return there, sent

    def _send(self, name: str, source: IO[bytes], check: Callable[[], None]) -> int:
        """Put an object; return the number of bytes sent, or -1 where another process wrote it since `check`."""
        target = self._path(name)
        size = source.seek(0, os.SEEK_END)
        source.seek(0)
        if self._s3 and size <= _MOST_IN_A_PUT_BYTES:
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
        """Put an object of S3; return whether the condition held."""
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


def _object_stamp(info: Any) -> Stamp:
    return [info.size or 0, info.mtime_ns or 0]


def _s3_client(address: str, region: str) -> Any:
    """Client of boto3 for the server, the region and the account that Arrow reads from an address."""
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
    """Arrow file system that reaches a store, and the path in it."""
    import pyarrow as pa
    from pyarrow.fs import FileSystem, FSSpecHandler, PyFileSystem

    # Google's store is otherwise asked for a quarter of an hour.
    patience = "?retry_limit_seconds=20" if address.startswith(("gs:", "gcs:")) and "?" not in address else ""
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
            remedy="install the package that is named, or copy the folder here",
        ) from None
    except Exception as error:  # (some connect at once, and each package has errors of its own)
        raise no_answer(address, error) from None
    return PyFileSystem(FSSpecHandler(system)), root


def no_answer(address: str, error: Exception) -> InputError:
    """Refusal with the first line of an error of a store, or of the package that reaches it."""
    lines = str(error).splitlines() or [type(error).__name__]
    return InputError(
        "store.no_answer",
        f"the store gives no answer ({lines[0]})",
        where=address,
        expected="a bucket that exists, and credentials that may read and write it",
        remedy="check the address and the store's variables (AWS_ACCESS_KEY_ID, AWS_ENDPOINT_URL, ...; FSSPEC_...)",
    )


log = logging.getLogger(__name__)

_PAUSE_S = 5.0
"""Interval between uploads of a run in progress, which writes its parts as often."""

_NOT_SENT: Stamp = [-1, -1]
"""Stamp of a file whose object in the store differs, and has to be put again."""

_ADDRESS = re.compile(r"^([a-z][a-z0-9+.-]+):/+(?=[^/])", re.IGNORECASE)


CLAIM = ".writer"
"""Name of the object of the claim."""


@dataclass
class Claim:
    """The right of this process to write to a folder in a store."""

    store: Store
    loss: InputError | None = field(init=False, default=None)
    """Why this process may not write any more."""
    _text: bytes = field(init=False, default=b"")
    """Content of the claim's object while this process may write; empty before the folder is claimed."""

    def take(self, *, over: bool = False) -> None:
        """Claim the folder.

        over: although another process has claimed it.

        Raises InputError if another process has.
        """
        since = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
        text = f"{socket.gethostname()}:{os.getpid()} since {since}\n{uuid.uuid4().hex}\n".encode()
        former = self.writer()
        if over and former:
            log.warning("%s: taken over from %s", self.store.address, former)
            self.store.remove(CLAIM)
        self.store.create(CLAIM, text)
        # Whose it is counts: a put that was answered too late has been carried out, and some stores know no condition.
        if self.store.read(CLAIM) != text:
            raise self._error(
                "store.written_by_another",
                f"is written to by {self.writer()}",
                "wait for it or stop it; if it was killed, add --take-over (in Python take_over=True)",
            )
        self.loss, self._text = None, text

    def check(self) -> None:
        """Refuse to write where another process has claimed the folder, or taken it over from this one.

        Raises InputError if one has.
        """
        there = self.store.read(CLAIM)
        if there == self._text:
            return
        by = _first_line(there) or "a process that has ended"
        if not self._text:
            raise self._error(
                "store.written_by_another",
                f"is written to by {by}",
                "give the same command again once that has ended; if it was killed, go on with the run by --take-over",
            )
        self.loss = self._error("store.taken_over", f"was taken over by {by}",
            "let that one go on, or stop it and give the same command again")  # fmt: skip
        raise self.loss

    def release(self) -> None:
        """Give the folder free, if this process has claimed it and it was not taken over."""
        with contextlib.suppress(Exception):  # the store may be gone: the next writer then takes over
            if self._text and self.store.read(CLAIM) == self._text:
                self.store.remove(CLAIM)
        self._text = b""

    def writer(self) -> str:
        """Claimant of the folder: host, process and time; empty if there is none."""
        return _first_line(self.store.read(CLAIM))

    def _error(self, code: str, what: str, remedy: str) -> InputError:
        return InputError(
            code,
            what,
            where=self.store.address,
            expected="one process that writes to a folder in a store, on whichever machine",
            remedy=remedy,
        )


def _first_line(text: bytes) -> str:
    return text.decode(errors="replace").partition("\n")[0]


@dataclass
class Copy:
    """The copy on this machine of a folder in a store.

    Raises InputError if there is no such kind of store, or it does not answer.
    """

    address: str
    path: Path  # of the copy
    _store: Store = field(init=False)
    _claim: Claim = field(init=False)
    _known: dict[str, tuple[Stamp, Stamp]] = field(init=False, default_factory=dict)
    _left: dict[str, Stamp] = field(init=False, default_factory=dict)  # by an earlier process, not carried
    _alone: threading.Lock = field(init=False, default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self._store = Store(self.address)
        self._claim = Claim(self._store)
        with contextlib.suppress(OSError, InputError, TypeError, ValueError):
            known = read_json(self._companion("json"))
            self._known = {name: (list(here), list(there)) for name, (here, there) in known.items()}

    def pull(self) -> None:
        """Bring here what is new or changed in the store; what the store has no more is removed here too.

        While another process of this machine writes to the copy, the copy is what is newest.

        Raises InputError if the store does not answer, or holds what is no file of a folder.
        """
        with self._alone, self._errors_as_refusals():
            if self._is_locked():
                return
            there = {name: stamp for name, stamp in self._store.objects().items() if not _is_hidden(name)}
            for name, stamp in there.items():
                place = self.path / name
                if name in self._known and self._known[name][1] == stamp and place.exists():
                    continue
                with new_file(place) as hidden:
                    self._store.fetch(name, hidden)
                self._known[name] = (_stamp(place), stamp)
            for name in self._known.keys() - there.keys():
                (self.path / name).unlink(missing_ok=True)
                del self._known[name]
            self._left = self._changed()
            self._note()

    def push(self) -> None:
        """Carry what is new or changed here to the store, `run.json` last, then remove there what is no more here.

        Raises InputError if the store does not answer, holds less of an object than was sent, or another process
        has claimed the folder.
        """
        with self._alone, self._errors_as_refusals():
            self._claim.check()
            try:
                for name in sorted(self._changed(), key=lambda name: (name == "run.json", name)):
                    with (
                        contextlib.suppress(FileNotFoundError),  # merged away meanwhile
                        (self.path / name).open("rb") as source,
                    ):
                        stamp = _stamp(self.path / name)
                        there, sent = self._store.write(name, source, self._claim.check)
                        self._known[name] = (stamp if there[0] == sent else _NOT_SENT, there)
                        if there[0] != sent:
                            raise self._not_whole(name, there[0], sent)
                for name in [name for name in self._known if not (self.path / name).exists()]:
                    self._claim.check()
                    self._store.remove(name)
                    del self._known[name]
            finally:
                self._note()

    @contextlib.contextmanager
    def sole_writer(self, *, take_over: bool = False) -> Iterator[Callable[[], None]]:
        """Write as the only one: bring what others wrote, carry over what is written meanwhile, and all at the end.

        take_over: although another process, which is dead, has claimed the folder.

        Yields callable: raises InputError once another process has taken the folder over.
        """
        with self._errors_as_refusals():
            self._claim.take(over=take_over)
            for name in self._store.objects():
                if PurePosixPath(name).match(".*.tmp"):  # of a writer that was killed
                    self._store.remove(name)
        try:
            self.pull()
            with self._locked(), self._uploads():
                yield self._check
        finally:
            self._claim.release()

    def holds_run(self) -> bool:
        """Whether the folder in the store is a run's.

        Raises InputError if the store does not answer.
        """
        with self._errors_as_refusals():
            return self._store.holds("run.json")

    def writer(self) -> str:
        """Process that has claimed the folder; empty if none has.

        Raises InputError if the store does not answer.
        """
        with self._errors_as_refusals():
            return self._claim.writer()

    def upload_changes(self) -> None:
        """Carry what this process made, unless it has lost the folder, or another one here carries everything.

        Raises InputError as `push`.
        """
        if self._claim.loss is None and not self._is_locked() and self._changed() != self._left:
            self.push()

    def _check(self) -> None:
        if self._claim.loss is not None:
            raise self._claim.loss

    @contextlib.contextmanager
    def _uploads(self) -> Iterator[None]:
        over = threading.Event()

        def push_repeatedly() -> None:
            while self._claim.loss is None and not over.wait(_PAUSE_S):
                try:
                    self.push()
                except InputError as error:
                    if self._claim.loss is None:
                        log.warning(
                            "%s; what is done stays in %s, and is tried again", error.brief, self.path
                        )

        thread = threading.Thread(target=push_repeatedly, daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()
            self._check()
            self.push()

    def _changed(self) -> dict[str, Stamp]:
        """Files that the store does not have as they are here."""
        found = {}
        for place in self.path.rglob("*"):
            name = str(place.relative_to(self.path))
            if not _is_hidden(name) and place.is_file() and not place.is_symlink():
                with contextlib.suppress(FileNotFoundError):
                    found[name] = _stamp(place)
        return {name: stamp for name, stamp in found.items() if self._known.get(name, (None,))[0] != stamp}

    def _not_whole(self, name: str, there: int, sent: int) -> InputError:
        return InputError(
            "store.not_as_sent",
            f"the store does not hold {name} as it was sent: {there} bytes are there, "
            + (f"{sent} were sent" if sent >= 0 else "which another process wrote"),
            where=self.address,
            expected="all of each file, from one writer",
            remedy="give the same command again; if it happens again, look for its cause in the store",
        )

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """Let other processes of this machine see that this one writes to the copy."""
        with self._companion("lock").open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _is_locked(self) -> bool:
        try:
            with self._companion("lock").open() as lock:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except FileNotFoundError:
            pass
        return False

    @contextlib.contextmanager
    def _errors_as_refusals(self) -> Iterator[None]:
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
            raise no_answer(self.address, error) from None

    def _note(self) -> None:
        write_json(self._companion("json"), self._known)

    def _companion(self, ending: str) -> Path:
        return self.path.with_name(f"{self.path.name}.{ending}")


_COPIES: dict[str, Copy] = {}
"""Copies of this process, by address: each is downloaded once, and uploaded at the end."""


def _copy_of(path: str | os.PathLike[str]) -> Copy:
    """The copy on this machine of a folder in a store, as the store has it at the first call."""
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


def by_address(text: str) -> str:
    """Text in which paths of copies are replaced by the addresses of their folders in a store."""
    for address, copy in _COPIES.items():
        text = text.replace(str(copy.path), address)
    return text


def sole_writer(path: Path, *, take_over: bool = False) -> AbstractContextManager[Callable[[], None]]:
    """Context of :meth:`Copy.sole_writer` for a copy of a folder in a store; of nothing for other folders."""
    copies = (copy.sole_writer(take_over=take_over) for copy in _COPIES.values() if copy.path == path)
    return next(copies, contextlib.nullcontext(lambda: None))


def writer_of(path: Path) -> str:
    """Process that has claimed the folder in a store whose copy a folder is; empty if none has, or it is no copy."""
    return next((copy.writer() for copy in _COPIES.values() if copy.path == path), "")


def upload_changes() -> None:
    """Carry what was written into copies to their stores."""
    for copy in _COPIES.values():
        copy.upload_changes()


def _is_hidden(name: str) -> bool:
    """Whether a file is half written, a lock, a key or a claim, and no part of a run."""
    return any(part.startswith(".") for part in PurePosixPath(name).parts)


def _stamp(place: Path) -> Stamp:
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
