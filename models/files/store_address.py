"""Addresses of stores: which words are one, and what reaches it."""

import functools
import os
import re
from typing import Any

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

_ADDRESS = re.compile(r"^([a-z][a-z0-9+.-]+):/+(?=[^/])", re.IGNORECASE)
_AZURE = "AZURE_STORAGE_CONNECTION_STRING"
"""Arrow takes no key of an account from an address; without this the machine's own login is used."""


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


def address_of(path: str | os.PathLike[str]) -> str:
    """An address as its store wants it.

    Examples
    --------
    >>> address_of("S3:/bucket/run/")
    's3://bucket/run'
    """
    text = os.fspath(path)
    found = _ADDRESS.match(text)
    assert found is not None
    return f"{found[1].lower()}://{text[found.end() :].rstrip('/')}"


def file_system(address: str) -> tuple[Any, str]:
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
            f"is in a kind of store that cannot be reached from here ({error})",
            where=address,
            expected="s3://, gs://, abfs://, hdfs://, or what an installed package of fsspec reaches",
            remedy=f"install the package that is named ({_AZURE} is enough for az://), or copy the folder here",
        ) from None
    except Exception as error:  # (some connect at once, and each package has errors of its own)
        raise no_answer(address, error) from None
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


def no_answer(address: str, error: Exception) -> InputError:
    """Tell what a store, or what reaches it, complains of."""
    said = str(error).splitlines() or [type(error).__name__]
    return InputError(
        f"the store gives no answer ({said[0]})",
        where=address,
        expected="a bucket that exists, and credentials that may read and write it",
        remedy="check the address and the store's variables (AWS_ACCESS_KEY_ID, AWS_ENDPOINT_URL, ...; "
        f"{_AZURE}; FSSPEC_...)",
    )
