"""Scenes from user-supplied meshes: conversion to metres, and seating on a plane or a surface."""

import contextlib
import os
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from toppling.models.arrays import Array
from toppling.models.files.mesh_files import MeshLike, remarks_of, triangles_of
from toppling.models.frames import rotation_between
from toppling.models.lengths import check_remarks, metres_in, too_large
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock, check_size, check_triangles, nearby_origin_m


def rock_of(mesh: MeshLike, units: str | None) -> tuple[Rock, Array]:
    """Rock from a mesh, moved to a nearby origin (3,) if it is far from its own.

    units: unit of the coordinates; None for that of a trimesh object, or else metres, with a warning if the rock would
    be larger than any precarious rock.
    Raises InputError if the mesh is not a single closed body, or not of a rock's height.
    """
    vertices, faces, where, stated = _in_metres(mesh, units, "rock mesh")
    rock = Rock.from_triangles(vertices, faces, where=where)
    check_size(rock.height_m, where, "units")
    warning = "" if stated else too_large(rock.height_m, rock.volume_m3, "units")
    if warning:
        warnings.warn(f"{where}: {warning}. If they are in metres, give units='m'.", stacklevel=3)
    origin = nearby_origin_m(rock.vertices_m)
    return (rock.moved(np.eye(3), -origin) if origin.any() else rock), origin


def seated(rock: Rock, plane: Pedestal) -> Rock:
    """Rock rotated from the level to a plane's slope, and shifted until its lowest point touches."""
    turned = rock.moved(rotation_between((0.0, 0.0, 1.0), plane.normal))
    lowest = float((turned.vertices_m @ plane.normal).min())
    return turned.moved(np.eye(3), -lowest * plane.normal)


def on_surface(
    rock: Rock, pedestal: MeshLike, units: str | None, origin_m: Array, gravity_m_s2: float, friction: float
) -> tuple[Rock, Pedestal]:
    """Seat a rock, already moved to a local origin, on a surface given in the original frame."""
    from toppling.models.ground.interface import surface_below

    vertices, faces, where, _ = _in_metres(pedestal, units, "pedestal mesh")
    check_triangles(vertices, faces, where)
    at_origin = np.asarray(vertices, float) - origin_m
    return surface_below(rock, at_origin, np.asarray(faces, np.int64), gravity_m_s2, friction, where)


def _in_metres(mesh: MeshLike, units: str | None, what: str) -> tuple[ArrayLike, ArrayLike, str, str | None]:
    """Vertices in metres, triangles, name for error messages, and stated unit of a mesh."""
    vertices, faces, where = triangles_of(mesh, what)
    stated = units or _stated_unit(mesh)
    if stated:
        factor = metres_in(stated)
        with contextlib.suppress(TypeError, ValueError):  # invalid arrays are refused later
            vertices = factor * np.asarray(vertices, float)
    return vertices, faces, where, stated


def _stated_unit(mesh: MeshLike) -> str | None:
    """Unit of an object, such as trimesh's for some formats; None for files, which are taken in metres."""
    if isinstance(mesh, str | os.PathLike):
        check_remarks(remarks_of(Path(mesh)), str(mesh))
        return None
    stated = getattr(mesh, "units", None)
    return stated if isinstance(stated, str) else None
