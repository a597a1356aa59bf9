"""Small files of clouds in survey coordinates, and what is read of them."""

import struct
from pathlib import Path

import laspy
import numpy as np

from toppling.models.arrays import Array
from toppling.models.scan.read import read_clouds


def read(path: Path, unit: str | None = None) -> Array:
    """Points (n, 3) of a file, in its own frame."""
    cloud = read_clouds([path], unit)
    return cloud.points_m + cloud.origin_m


def las(path: Path, points: Array, scale=1e-4, *, version="1.2", wkt="", keys=(), doubles=(), **fields):
    """A LAS file with its coordinate system in words, in GeoTIFF's keys or in none, and more fields of its points."""
    header = laspy.LasHeader(point_format=6 if version == "1.4" else 1, version=version)
    header.offsets, header.scales = np.floor(points.min(axis=0)), np.full(3, scale)
    if wkt:
        header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "WKT", wkt.encode() + b"\0"))
        header.global_encoding.wkt = version == "1.4"
    if keys:
        words = [1, 1, 0, len(keys)]
        for key, value in keys:
            words += [key, 34736 if key == 3077 else 0, 1, value]
        for number, form, values in ((34735, "H", words), (34736, "d", doubles)):
            content = struct.pack(f"<{len(values)}{form}", *values)
            header.vlrs.append(laspy.VLR("LASF_Projection", number, "", content))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T
    for name, values in fields.items():
        setattr(cloud, name, values)
    cloud.write(path)
    return path


def ply(path: Path, points: Array, *comments: str, kind="double", axes=("x", "y", "z")):
    """A PLY file of one property for each column."""
    head = ["ply", "format binary_little_endian 1.0", *comments, f"element vertex {len(points)}"]
    head += [*(f"property {kind} {axis}" for axis in axes), "end_header\n"]
    path.write_bytes("\n".join(head).encode() + points.astype("<f8" if kind == "double" else "<f4").tobytes())
    return path


def ptx(path: Path, scans):
    """Scans as their points (n, 3) in a scanner's own frame, its rotation and place; with intensities."""
    lines = []
    for points, turn, shift in scans:
        axes = turn.as_matrix().T
        pose = np.column_stack([np.vstack([axes, shift]), (0, 0, 0, 1)])
        rows = (" ".join(map(repr, map(float, row))) for row in (shift, *axes, *pose))
        lines += [str(len(points)), "1", *rows]
        lines += [" ".join(f"{value:.9f}" for value in row) + " 0.5" for row in points]
    path.write_text("\n".join(lines) + "\n")
    return path
