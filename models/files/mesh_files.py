"""Triangle meshes on disk."""

import json
import os
import re
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.files import digest
from toppling.models.files.given import bytes_given, open_given
from toppling.models.files.guarded import read_guarded
from toppling.models.files.ply import read_header, read_mesh
from toppling.models.rock import check_triangles


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

_COUNTED_BACK = re.compile(rb"^[ \t]*f[ \t][^\n\r]*-\d", re.MULTILINE)
"""A face of an OBJ by negative numbers."""
_FROM_ZERO = re.compile(rb"^[ \t]*f[ \t](?:[^\n\r#]*[ \t])?0+(?=[/\s])", re.MULTILINE)
"""A face of an OBJ whose vertices are counted from 0: their numbers are from 1 on."""
_OF_LOOKS = ("KHR_materials", "KHR_texture", "EXT_texture", "KHR_lights", "KHR_xmp", "KHR_mesh_quantization")
"""How extensions of glTF begin without which the triangles are the same, and one that is read."""
_damaged = refusals(
    expected="a whole mesh that is written by the rules of its format", remedy="export the mesh again"
)

_COMMENT_BYTES = 65_536
_LARGEST_BYTES = 800_000_000
"""Size limit of a mesh that a library reads: sixteen million triangles of an STL."""
_STL_HEADER_BYTES, _STL_TRIANGLE_BYTES = 80, 50

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
    found = read_mesh(Path(path)) if suffix == ".ply" else None
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
        head = file.read(_COMMENT_BYTES).decode("latin-1")
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
    content, suffix = bytes_given(path, _damaged, _LARGEST_BYTES), path.suffix.lower()
    if suffix == ".obj" and _FROM_ZERO.search(content):
        raise _damaged("mesh.index_out_of_range", "a face has the vertex 0, and the first one is 1", path)
    if suffix in (".glb", ".gltf"):
        _check_gltf(content, path)
    if suffix == ".stl":
        content = _whole_stl(content, path)
    if suffix == ".obj" and _COUNTED_BACK.search(content):
        content = _counted_from_the_first(content)
    resolver = trimesh.resolvers.FilePathResolver(str(path))  # glTF keeps its numbers in a file beside it
    mesh: Any = trimesh.load(
        BytesIO(content), file_type=suffix[1:], resolver=resolver, force="mesh", process=False
    )
    return None, [np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64)]


def _whole_stl(content: bytes, path: Path) -> bytes:
    """Content of an STL, of a binary one without zeros behind its triangles; one that lacks some is refused."""
    head = content[:_COMMENT_BYTES].lower()
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


def _counted_from_the_first(content: bytes) -> bytes:
    """Write an OBJ with numbers of vertices from the first on; negative ones count back from the line they stand in.

    trimesh counts them back from the end of the file, which is another vertex wherever pieces follow each other.
    """
    seen = {b"v": 0, b"vt": 0, b"vn": 0}
    lines = []
    for line in content.replace(b"\\\r\n", b"").replace(b"\\\n", b"").splitlines():
        word, *rest = line.split() or [b""]
        if word in seen:
            seen[word] += 1
        elif word == b"f" and b"-" in line:
            corners = [corner.split(b"/") for corner in rest]
            line = b"f " + b" ".join(
                b"/".join(
                    b"%d" % (seen[kind] + 1 + int(number)) if number.startswith(b"-") else number
                    for kind, number in zip(seen, corner, strict=False)
                )
                for corner in corners
            )
        lines.append(line)
    return b"\n".join(lines)


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
