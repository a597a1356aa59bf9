"""PLY as clouds and meshes are exchanged in it: ASCII and binary, single and double precision, any line ends.

What the header counts is compared with the size of the file before anything is taken from it.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from io import StringIO
from itertools import islice
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.errors import refusals
from toppling.models.files.given import check_lines, open_given

_HEADER_BYTES = 65_536
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_END = re.compile(rb"(?:\A|[\r\n])end_header[ \t]*(\r\n|\r|\n)")
_COUNT = re.compile(r"\d{1,18}", re.ASCII)
_INDICES = ("vertex_indices", "vertex_index")


_damaged = refusals(
    expected="a whole PLY file, ASCII or binary, as its header describes it",
    remedy="export the file again",
)


@dataclass(frozen=True)
class _Property:
    """A value of every row of an element, or a list of them."""

    # `kind` is NumPy's, without the order of bytes.
    name: str
    kind: str
    count_kind: str = ""  # of a list's length; empty if it is no list

    @property
    def least_bytes(self) -> int:
        """Size in a binary file; of a list, that of an empty one."""
        return np.dtype(self.count_kind or self.kind).itemsize


@dataclass(frozen=True)
class _Element:
    """Rows of like properties: vertices, faces and whatever else a program writes."""

    name: str
    count: int
    properties: tuple[_Property, ...]

    @property
    def has_lists(self) -> bool:
        """Whether rows may differ in length."""
        return any(each.count_kind for each in self.properties)

    def row(self, order: str) -> np.dtype:
        """Layout of a row without lists in a binary file."""
        return np.dtype([(each.name, order + each.kind) for each in self.properties])


@dataclass(frozen=True)
class _Header:
    """What a PLY file says of itself; `order` is empty for ASCII, `data_at` is where the rows begin.

    `remarks` are its comments and what it says of the object.
    """

    path: Path
    order: str
    line_end: str
    data_at: int
    elements: tuple[_Element, ...]
    remarks: tuple[str, ...] = ()


def read_header(path: Path) -> _Header:
    """Read and check a header.

    Raises InputError if it is none of PLY, or counts more rows than the file can hold.
    """
    with open_given(path, _damaged) as file:
        head = file.read(_HEADER_BYTES)
        size = file.seek(0, 2)
    end = _END.search(head)
    if not head.startswith((b"ply\n", b"ply\r", b"ply \n", b"ply \r")) or end is None:
        raise _damaged("ply.header_unreadable", "has no PLY header that ends in 'end_header'", path)
    lines = head[: end.start()].decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    order, elements = _parsed(lines, path)
    names = [each.name for each in elements]
    if len(set(names)) < len(names):
        what = f"the header declares {', '.join(names)}: one of them twice"
        raise _damaged("ply.name_repeated", what, path)
    least = sum(
        each.count * sum(2 if not order else part.least_bytes for part in each.properties)
        for each in elements
    )
    # Of the last number in ASCII the line end may lack.
    if least > size - end.end() + (not order):
        counts = ", ".join(f"{each.count} {each.name}" for each in elements)
        what = f"the header counts {counts}: at least {least} bytes, where {size - end.end()} follow it"
        raise _damaged("file.truncated", what, path)
    words = (line.strip().partition(" ") for line in lines)
    remarks = tuple(text.strip() for key, _, text in words if key in {"comment", "obj_info"})
    return _Header(path, order, end[1].decode(), end.end(), tuple(elements), remarks)


def read_vertices(path: Path) -> dict[str, NDArray]:
    """Properties of all vertices by name, each (n,), in the precision of the file.

    Raises InputError if the file is not whole, or its vertices have lists, or stand behind rows of any length.
    """
    return _vertex_rows(read_header(path))


def read_mesh(path: Path) -> tuple[Array, NDArray[np.int64]] | None:
    """Vertices (n, 3) and triangles (m, 3); None for a layout other than vertices, then faces that are all triangles.

    Raises InputError if the file is not whole.
    """
    header = read_header(path)
    names = [each.name for each in header.elements]
    if names != ["vertex", "face"] or header.elements[0].has_lists:
        return None
    indices = [each for each in header.elements[1].properties if each.count_kind]
    if len(indices) != 1 or indices[0].name not in _INDICES or not header.order:
        return None
    vertex, face = header.elements
    points = _vertex_rows(header)
    if not {"x", "y", "z"} <= points.keys():
        return None
    parts: list[tuple] = []
    for each in face.properties:
        if each.count_kind:
            parts.append(("corners of a face", header.order + each.count_kind))
        parts.append((each.name, header.order + each.kind, (3 if each.count_kind else 1,)))
    row = np.dtype(parts)
    at = header.data_at + vertex.count * vertex.row(header.order).itemsize
    if at + face.count * row.itemsize != path.stat().st_size:
        return None
    rows = np.fromfile(path, row, face.count, offset=at)
    if not (rows["corners of a face"] == 3).all():
        return None
    triangles = rows[indices[0].name]
    if triangles.dtype.kind not in "iu":
        raise _damaged("mesh.index_not_whole", "the corners of its faces are no whole numbers", path)
    return (
        np.column_stack([points[axis].astype(np.float64) for axis in "xyz"]),
        triangles.astype(np.int64).reshape(-1, 3),
    )


def _vertex_rows(header: _Header) -> dict[str, NDArray]:
    names = [each.name for each in header.elements]
    if "vertex" not in names:
        return {}
    *before, element = header.elements[: names.index("vertex") + 1]
    if element.has_lists or any(each.has_lists for each in before if header.order):
        what = "a list stands before or among the properties of 'vertex'"
        raise _damaged("ply.list_before_vertex", what, header.path)
    if header.order:
        at = header.data_at + sum(each.count * each.row(header.order).itemsize for each in before)
        rows = np.fromfile(header.path, element.row(header.order), element.count, offset=at)
        if len(rows) < element.count:
            what = f"{len(rows)} of {element.count} rows of 'vertex' follow: it is truncated"
            raise _damaged("file.truncated", what, header.path)
        return {each.name: rows[each.name] for each in element.properties}
    return _ascii_rows(header, element, sum(each.count for each in before))


def _ascii_rows(header: _Header, element: _Element, skipped: int) -> dict[str, NDArray]:
    with open_given(header.path, _damaged) as binary:
        check_lines(binary, header.path, _damaged)
        binary.seek(header.data_at)
        lines = islice(_lines(binary, header), skipped, skipped + element.count)
        table = np.empty((0, len(element.properties)))
        if element.count:
            table = np.loadtxt(lines, ndmin=2, comments=None)
    if table.shape != (element.count, len(element.properties)):
        raise _damaged(
            "file.truncated",
            f"{' x '.join(map(str, table.shape))} numbers where the header counts {element.count} rows of "
            f"{len(element.properties)}: it is damaged or truncated",
            header.path,
        )
    return {each.name: table[:, column] for column, each in enumerate(element.properties)}


def _lines(binary: IO[bytes], header: _Header) -> Iterator[str]:
    """Rows of ASCII data; a lone carriage return ends lines in files of old programs."""
    if header.line_end == "\r":
        return StringIO(binary.read().decode("latin-1").replace("\r", "\n"))
    return (line.decode("latin-1") for line in binary)


def _parsed(lines: list[str], path: Path) -> tuple[str, list[_Element]]:
    order: str | None = None
    elements: list[tuple[str, int, list[_Property]]] = []
    for number, line in enumerate(lines[1:], 2):
        words = line.split()
        match words:
            case ["format", kind, _] if kind in _ORDERS and order is None:
                order = _ORDERS[kind]
            case ["element", name, count] if _COUNT.fullmatch(count):
                elements.append((name, int(count), []))
            case ["property", "list", of, kind, name] if elements and {of, kind} <= _TYPES.keys():
                elements[-1][2].append(_Property(name, _TYPES[kind], _TYPES[of]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1][2].append(_Property(name, _TYPES[kind]))
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case _:
                raise _damaged("ply.header_unreadable", f"line {number} of the header is {line[:60]!r}", path)
    if order is None:
        raise _damaged("ply.format_missing", "the header states no format", path)
    for name, _, properties in elements:
        names = [each.name for each in properties]
        if not names or len(set(names)) < len(names):
            what = f"the element '{name[:60]}' has no properties, or two of one name"
            raise _damaged("ply.element_unusable", what, path)
    return order, [_Element(name, count, tuple(properties)) for name, count, properties in elements]
