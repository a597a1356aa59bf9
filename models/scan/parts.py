"""Rock and pedestal that were separated before: two files, classes of LAS, a scalar of PLY."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, Flags
from toppling.models.errors import InputError
from toppling.models.files.documents import MOST_SHOWN
from toppling.models.files.guarded import read_guarded
from toppling.models.files.mesh_files import read_vertices
from toppling.models.scan.interface import LEAST_SEEN
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.meshes import is_mesh
from toppling.models.scan.read import Cloud
from toppling.models.scan.segment import (
    NEITHER,
    PEDESTAL,
    ROCK,
    Segmentation,
    at_seen,
    label_surfels,
    patches_around,
)

_CLASSES = ("classification", "class", "label", "segment")
"""Names that a PLY's scalar has which says what a point is of, alone or after "scalar_"."""
_APART_PER_HEIGHT = 0.05
"""Farther from its pedestal a rock shows no crevice."""


@dataclass(frozen=True)
class Part:
    """Selection of the points of a part: a file, or values of a scalar field."""

    option: str
    file: Path | None = None
    field: str = ""
    values: tuple[float, ...] = ()

    @classmethod
    def of(cls, text: str, option: str) -> Part:
        """Read `ground.obj`, `40`, `2,6` or `label=1`.

        Examples
        --------
        >>> Part.of("label=1,2", "--rock").values, Part.of("rock.obj", "--rock").file.name
        ((1.0, 2.0), 'rock.obj')
        """
        field, _, values = text.rpartition("=")
        try:
            numbers = tuple(float(value) for value in values.split(","))
        except ValueError:
            return cls(option, Path(text))
        return cls(option, None, field.strip().lower(), numbers)

    def among(self, path: Path) -> bool:
        """Whether it is this file."""
        return self.file is not None and (path == self.file or path.name == self.file.name)


def parts_of(rock: str | None, pedestal: str | None) -> tuple[Part | None, Part | None]:
    """Selections of rock and pedestal that the user gives."""
    return (Part.of(rock, "--rock") if rock else None, Part.of(pedestal, "--pedestal") if pedestal else None)


def files_with(files: Sequence[Path], parts: tuple[Part | None, Part | None]) -> list[Path]:
    """Files of the clouds, with those that are named as a part alone."""
    named = [part for part in parts if part is not None and part.file is not None]
    return [*files, *(part.file for part in named if part.file and not any(map(part.among, files)))]


def labelled(cloud: Cloud, files: Sequence[Path], parts: tuple[Part | None, Part | None]) -> Cloud:
    """The cloud with the label of each point: what is of no part that is named is of the other, or of neither.

    Raises
    ------
    InputError
        If a file has no such scalar, or a part has next to no points.
    """
    rock, pedestal = parts
    if rock is None and pedestal is None:
        return cloud
    label = np.full(
        len(cloud.points_m), NEITHER if rock and pedestal else PEDESTAL if rock else ROCK, np.int8
    )
    ends = np.cumsum([points for _, points in cloud.files])
    for part, value in ((pedestal, PEDESTAL), (rock, ROCK)):
        if part is None:
            continue
        of_part = [
            np.full(source.points, part.among(path)) if part.file else _has_values(path, part, source.points)
            for path, source in zip(files, cloud.sources, strict=True)
        ]
        for start, mask in zip([0, *ends], of_part, strict=False):
            label[start : start + len(mask)][mask] = value
    for value, option in ((ROCK, "--rock"), (PEDESTAL, "--pedestal")):
        count = int((label == value).sum())
        if count < LEAST_SEEN:
            raise InputError(
                "parts.too_few_points",
                f"{count} points are of the {option[2:]}",
                where=option,
                expected="rock and pedestal, each by a file, a class, or all that is not of the other",
                remedy=f"give {option} too, or correct the other one",
            )
    return dataclasses.replace(cloud, label=label, station=np.zeros_like(cloud.station))


def _has_values(path: Path, part: Part, points: int) -> Flags:
    """Which points of a file have one of the values."""
    found = None if is_mesh(path) else _scalar(path, part)
    if found is None or len(found) != points:
        raise InputError(
            "parts.class_missing",
            "a mesh has no classes of points"
            if is_mesh(path)
            else f"has no scalar '{part.field or 'class'}'",
            where=f"{path.name}, {part.option}",
            expected="a class of LAS or LAZ, or FIELD=VALUE of a scalar in a PLY cloud",
            remedy="name the field as the file does, or give the part as a file of its own",
        )
    mask = np.isin(found, part.values)
    if not mask.any():
        values, count = np.unique(found, return_counts=True)
        most = zip(values[:MOST_SHOWN], count[:MOST_SHOWN], strict=True)
        there = ", ".join(f"{value:g} ({n})" for value, n in most)
        raise InputError(
            "parts.class_empty",
            f"no point has the value {', '.join(f'{number:g}' for number in part.values)}",
            where=f"{path.name}, {part.option}",
            expected=f"one of those there, with their points: {there}",
            remedy="look which value the part has in the program that separated it",
        )
    return mask


def _scalar(path: Path, part: Part) -> Array | None:
    """Values of the scalar at the points that are read; None if the file has none of the name."""
    if path.suffix.lower() in (".las", ".laz"):
        if part.field not in ("", "classification", "class"):
            return None
        return read_guarded("toppling.models.scan.binary:classes", path, ["laspy"])[1][0].astype(float)
    if path.suffix.lower() != ".ply":
        return None
    vertices = {name.lower(): values for name, values in read_vertices(path).items()}
    names = [part.field] if part.field else _CLASSES
    name = next((field for name in names for field in (name, f"scalar_{name}") if field in vertices), None)
    if name is None:
        return None
    finite = np.isfinite([vertices[axis] for axis in "xyz"]).all(axis=0)
    return vertices[name][finite].astype(float)


def as_labelled(points_m: Array, label: NDArray[np.int8], hint: InterfaceHint | None) -> Segmentation:
    """Patches around a rock that was separated before.

    Raises InputError if it has no height, or lies apart from its pedestal.
    """
    rock = points_m[label == ROCK]
    height = float(np.ptp(rock[:, 2]))
    if height == 0.0:
        raise InputError(
            "parts.rock_flat",
            "all points of the rock lie at one height",
            where="--rock, --pedestal",
            expected="a rock that rises over its pedestal",
            remedy="see whether the two are exchanged, or name another class or file",
        )
    surfels, _, _ = patches_around(points_m, rock, height)
    surfel_label = label_surfels(surfels, points_m, label)
    _check_together(surfels.points_m, surfel_label, height)
    return at_seen(Segmentation(label, surfels, surfel_label, [], hint=hint))


def _check_together(patches_m: Array, label: NDArray[np.int8], height_m: float) -> None:
    """Refuse a rock that touches nothing: what follows would look for a crevice between the two."""
    rock, pedestal = patches_m[label == ROCK], patches_m[label == PEDESTAL]
    apart_m = float(cKDTree(pedestal).query(rock)[0].min()) if len(pedestal) and len(rock) else np.inf
    if apart_m < _APART_PER_HEIGHT * height_m:
        return
    distance = f"{apart_m:.3g} m" if np.isfinite(apart_m) else "farther than the rock is high"
    raise InputError(
        "rock.apart_from_pedestal",
        f"rock and pedestal lie apart, where they are nearest by {distance}",
        where="--rock, --pedestal",
        expected=f"a rock that stands on its pedestal, in the files no farther from it than "
        f"{_APART_PER_HEIGHT * height_m:.2g} m",
        remedy="give both in one frame and one unit, the rock as it stands, and cut off neither what lies beside the "
        "crevice",
    )
