"""Triangle meshes on disk, and PLY: ASCII and binary, single and double precision, any line ends."""

import json
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO, StringIO
from itertools import islice
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.files import digest
from toppling.models.files.given import END_BYTES, LARGEST_DATA_BYTES, bytes_given, check_lines, open_given
from toppling.models.files.guarded import read_guarded
from toppling.models.rock import check_triangles

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_END = re.compile(rb"(?:\A|[\r\n])end_header[ \t]*(\r\n|\r|\n)")
_COUNT = re.compile(r"\d{1,18}", re.ASCII)
_INDICES = ("vertex_indices", "vertex_index")


_damaged_ply = refusals(
    expected="a whole PLY file, ASCII or binary, as its header describes it", remedy="export the file again"
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
        return any(column.count_kind for column in self.properties)

    def row(self, order: str) -> np.dtype:
        """Layout of a row without lists in a binary file."""
        return np.dtype([(column.name, order + column.kind) for column in self.properties])


@dataclass(frozen=True)
class _Header:
    """Header of a PLY file; `order` is empty for ASCII, `data_at` is where the rows begin.

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
    with open_given(path, _damaged_ply) as file:
        head = file.read(END_BYTES)
        size = file.seek(0, 2)
    end = _END.search(head)
    if not head.startswith((b"ply\n", b"ply\r", b"ply \n", b"ply \r")) or end is None:
        raise _damaged_ply("ply.header_unreadable", "has no PLY header that ends in 'end_header'", path)
    lines = head[: end.start()].decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    order, elements = _parsed(lines, path)
    names = [element.name for element in elements]
    if len(set(names)) < len(names):
        what = f"the header declares {', '.join(names)}: one of them twice"
        raise _damaged_ply("ply.name_repeated", what, path)
    least = sum(
        element.count * sum(2 if not order else part.least_bytes for part in element.properties)
        for element in elements
    )
    # Of the last number in ASCII the line end may lack.
    if least > size - end.end() + (not order):
        counts = ", ".join(f"{element.count} {element.name}" for element in elements)
        what = f"the header counts {counts}: at least {least} bytes, where {size - end.end()} follow it"
        raise _damaged_ply("file.truncated", what, path)
    words = (line.strip().partition(" ") for line in lines)
    remarks = tuple(text.strip() for key, _, text in words if key in {"comment", "obj_info"})
    return _Header(path, order, end[1].decode(), end.end(), tuple(elements), remarks)


def read_vertices(path: Path) -> dict[str, NDArray]:
    """Properties of all vertices by name, each (n,), in the precision of the file.

    Raises InputError if the file is not whole, or its vertices have lists, or stand behind rows of any length.
    """
    return _vertex_rows(read_header(path))


def _read_mesh(path: Path) -> tuple[Array, NDArray[np.int64]] | None:
    """Vertices (n, 3) and triangles (m, 3); None unless the layout is vertices, then faces that are all triangles."""
    header = read_header(path)
    names = [element.name for element in header.elements]
    if names != ["vertex", "face"] or header.elements[0].has_lists:
        return None
    indices = [column for column in header.elements[1].properties if column.count_kind]
    if len(indices) != 1 or indices[0].name not in _INDICES or not header.order:
        return None
    vertex, face = header.elements
    points = _vertex_rows(header)
    if not {"x", "y", "z"} <= points.keys():
        return None
    parts: list[tuple] = []
    for column in face.properties:
        if column.count_kind:
            parts.append(("corners of a face", header.order + column.count_kind))
        parts.append((column.name, header.order + column.kind, (3 if column.count_kind else 1,)))
    row = np.dtype(parts)
    at = header.data_at + vertex.count * vertex.row(header.order).itemsize
    if at + face.count * row.itemsize != path.stat().st_size:
        return None
    rows = np.fromfile(path, row, face.count, offset=at)
    if not (rows["corners of a face"] == 3).all():
        return None
    triangles = rows[indices[0].name]
    if triangles.dtype.kind not in "iu":
        raise _damaged_ply("mesh.index_not_whole", "the corners of its faces are no whole numbers", path)
    return (
        np.column_stack([points[axis].astype(np.float64) for axis in "xyz"]),
        triangles.astype(np.int64).reshape(-1, 3),
    )


def _vertex_rows(header: _Header) -> dict[str, NDArray]:
    names = [element.name for element in header.elements]
    if "vertex" not in names:
        return {}
    *before, element = header.elements[: names.index("vertex") + 1]
    if element.has_lists or any(earlier.has_lists for earlier in before if header.order):
        what = "a list stands before or among the properties of 'vertex'"
        raise _damaged_ply("ply.list_before_vertex", what, header.path)
    if header.order:
        at = header.data_at + sum(earlier.count * earlier.row(header.order).itemsize for earlier in before)
        rows = np.fromfile(header.path, element.row(header.order), element.count, offset=at)
        if len(rows) < element.count:
            what = f"{len(rows)} of {element.count} rows of 'vertex' follow: it is truncated"
            raise _damaged_ply("file.truncated", what, header.path)
        return {column.name: rows[column.name] for column in element.properties}
    return _ascii_rows(header, element, sum(earlier.count for earlier in before))


def _ascii_rows(header: _Header, element: _Element, skipped: int) -> dict[str, NDArray]:
    with open_given(header.path, _damaged_ply) as binary:
        check_lines(binary, header.path, _damaged_ply)
        binary.seek(header.data_at)
        lines = islice(_lines(binary, header), skipped, skipped + element.count)
        table = np.empty((0, len(element.properties)))
        if element.count:
            table = np.loadtxt(lines, ndmin=2, comments=None)
    if table.shape != (element.count, len(element.properties)):
        raise _damaged_ply(
            "file.truncated",
            f"{' x '.join(map(str, table.shape))} numbers where the header counts {element.count} rows of "
            f"{len(element.properties)}: it is damaged or truncated",
            header.path,
        )
    return {named.name: table[:, n] for n, named in enumerate(element.properties)}


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
                raise _damaged_ply(
                    "ply.header_unreadable", f"line {number} of the header is {line[:60]!r}", path
                )
    if order is None:
        raise _damaged_ply("ply.format_missing", "the header states no format", path)
    for name, _, properties in elements:
        names = [column.name for column in properties]
        if not names or len(set(names)) < len(names):
            what = f"the element '{name[:60]}' has no properties, or two of one name"
            raise _damaged_ply("ply.element_unusable", what, path)
    return order, [_Element(name, count, tuple(properties)) for name, count, properties in elements]


class TriangleMesh(Protocol):
    """A mesh of trimesh, or one like it."""

    @property
    def vertices(self) -> ArrayLike:
        """Vertices (n, 3)."""

    @property
    def faces(self) -> ArrayLike:
        """Triangles (m, 3), as indices of vertices."""


MeshLike = str | os.PathLike[str] | tuple[ArrayLike, ArrayLike] | TriangleMesh
"""A file, a pair of vertices and triangles, or an object that has both."""

_UNUSUAL_INDICES = re.compile(rb"^[ \t]*f(?=[ \t])[^\n\r#]*?(?:[ \t/]-\d|[ \t]0+(?=[/\s]))", re.MULTILINE)
"""A face of an OBJ whose vertices are not numbered from 1 on: trimesh counts back from the end of the file."""
_OF_LOOKS = ("KHR_materials", "KHR_texture", "EXT_texture", "KHR_lights", "KHR_xmp", "KHR_mesh_quantization")
"""How extensions of glTF begin without which the triangles are the same, and one that is read."""
_damaged = refusals(
    expected="a whole mesh that is written by the rules of its format", remedy="export the mesh again"
)

_STL_HEADER_BYTES = 80
_STL_TRIANGLE_BYTES = 50

MESH_FORMATS = (".ply", ".stl", ".obj", ".off", ".glb", ".gltf")


def read_triangles(path: str | os.PathLike[str]) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (n, 3) in metres, z up, and triangles (m, 3) of a mesh file; glTF's up is y, by its rule.

    The format is that of the file's name. Nothing beside the file is read: materials, textures, buffers of their own.

    Raises InputError if the file is absent, of another format or holds no triangles.
    """
    suffix, expected = Path(path).suffix.lower(), f"a triangle mesh: {', '.join(MESH_FORMATS)}"
    if suffix not in MESH_FORMATS:
        what, remedy = (
            f"{suffix or 'no suffix'} is not a mesh format that is read",
            "convert it, or correct its name",
        )
        raise InputError("mesh.format_unknown", what, where=str(path), expected=expected, remedy=remedy)
    found = _read_mesh(Path(path)) if suffix == ".ply" else None
    vertices, faces = found or read_guarded("toppling.models.files.mesh_files:_parse_mesh", Path(path))[1]
    if len(faces) == 0:
        remedy = "a point cloud becomes a scene with 'toppling scan'"
        what = "holds no triangles"
        raise InputError("mesh.empty", what, where=str(path), expected="a triangle mesh", remedy=remedy)
    check_triangles(vertices, faces, str(path))
    if suffix in (".glb", ".gltf"):
        vertices = vertices[:, [0, 2, 1]] * (1.0, -1.0, 1.0)
    return vertices, faces


def remarks_of(path: Path) -> tuple[str, ...]:
    """Comments at the beginning of a mesh's file, and what an STL has in their place."""
    suffix = path.suffix.lower()
    if suffix == ".ply":
        return read_header(path).remarks
    with open_given(path, _damaged) as file:
        head = file.read(END_BYTES).decode("latin-1")
    if suffix == ".stl":
        text = head[:_STL_HEADER_BYTES].partition("\n")[0]
        return (re.sub("[^ -~]+", " ", text).removeprefix("solid ").strip(),)
    if suffix not in (".obj", ".off"):
        return ()
    return tuple(line.lstrip("# ") for line in head.splitlines() if line.startswith("#"))


def triangles_of(mesh: MeshLike, what: str) -> tuple[ArrayLike, ArrayLike, str]:
    """Vertices (n, 3) and triangles (m, 3) of a mesh however it is given, and its name in errors.

    what: its name where it is no file.
    Raises InputError as :func:`read_triangles`, or if it is none of these.
    """
    if isinstance(mesh, str | os.PathLike):
        return *read_triangles(mesh), str(mesh)
    if isinstance(mesh, Sequence):
        if len(mesh) == 2:
            return mesh[0], mesh[1], what
    elif hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
        return mesh.vertices, mesh.faces, what
    raise InputError(
        "mesh.kind_unknown",
        f"is a {type(mesh).__name__}",
        where=what,
        expected="a path, a pair of vertices (n, 3) and triangles (m, 3), or an object with vertices and faces",
        remedy="a trimesh.Scene becomes one mesh with to_mesh()",
    )


def _parse_mesh(path: Path) -> tuple[None, list[NDArray]]:
    """Vertices and triangles of a file by trimesh; called in the guarded process, since a small file may say much."""
    content, suffix = bytes_given(path, _damaged, LARGEST_DATA_BYTES), path.suffix.lower()
    if suffix == ".obj" and _UNUSUAL_INDICES.search(content):
        raise _damaged("mesh.index_out_of_range", "a face has a number that is not 1 or more", path)
    if suffix in (".glb", ".gltf"):
        _check_gltf(content, path)
    if suffix == ".stl":
        content = _whole_stl(content, path)
    resolver = trimesh.resolvers.FilePathResolver(str(path))  # glTF keeps its numbers in a file beside it
    mesh: Any = trimesh.load(
        BytesIO(content), file_type=suffix[1:], resolver=resolver, force="mesh", process=False
    )
    return None, [np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64)]


def _whole_stl(content: bytes, path: Path) -> bytes:
    """Content of an STL, of a binary one without zeros behind its triangles; one that lacks some is refused."""
    head = content[:END_BYTES].lower()
    if head.lstrip().startswith(b"solid") and b"facet" in head:
        return content
    count = int.from_bytes(content[_STL_HEADER_BYTES : _STL_HEADER_BYTES + 4], "little")
    whole = _STL_HEADER_BYTES + 4 + _STL_TRIANGLE_BYTES * count
    if len(content) < whole:
        lacking = -(-(whole - len(content)) // _STL_TRIANGLE_BYTES)
        what = f"lacks {lacking} of the {count} triangles that its header counts: truncated"
        raise _damaged("file.truncated", what, path)
    return content if content[whole:].strip(b"\0") else content[:whole]


def _check_gltf(content: bytes, path: Path) -> None:
    """Refuse triangles that trimesh does not unpack: by an extension that it has not, or stored as shares of a span."""
    binary = content.startswith(b"glTF")
    document = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")] if binary else content)
    needed = [name for name in document.get("extensionsRequired", []) if not str(name).startswith(_OF_LOOKS)]
    accessors = document.get("accessors", [])
    parts = [part for mesh in document.get("meshes", []) for part in mesh["primitives"]]
    places = [part["attributes"]["POSITION"] for part in parts if "POSITION" in part["attributes"]]
    if any(accessors[place].get("normalized") for place in places):
        needed.append("normalised positions")
    if needed:
        what = f"its triangles need {', '.join(map(str, needed))}, which is not read"
        raise _damaged("mesh.variant_unknown", what, path)


def write_ply(path: Path, vertices_m: Array, faces: NDArray[np.int64]) -> None:
    """Write a binary PLY with its digest, in double precision, which trimesh's own writer does not keep."""
    header = (
        f"ply\nformat binary_little_endian 1.0\ncomment {digest.BLANK}\ncomment metres, x east, y north, z up\n"
        f"element vertex {len(vertices_m)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    rows["count"], rows["index"] = 3, faces
    path.write_bytes(header.encode() + np.ascontiguousarray(vertices_m, "<f8").tobytes() + rows.tobytes())
    digest.seal(path)
