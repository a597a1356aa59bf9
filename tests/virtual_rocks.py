"""Rocks that several tests scan or shake."""

import dataclasses
from contextlib import contextmanager

import manifold3d
import numpy as np
import pytest
import trimesh

from toppling.models.arrays import Array
from toppling.models.frames import horizontal_unit_vector
from toppling.models.hidden_base import draw_bases
from toppling.models.rock import Rock
from toppling.models.scan import virtual


@contextmanager
def drawing_few():
    """A hidden base is drawn 12 times: for laws that hold of however many draws."""
    with pytest.MonkeyPatch.context() as patched:
        for name, number in (("DRAWS", 12), ("CANDIDATES", 12), ("ENOUGH", 4.0)):
            patched.setattr(draw_bases, name, number)
        yield


def stump_on_a_slope():
    """A boulder of 2 m with bumps, on a pedestal that dips 6 degrees."""
    return virtual.on_slope(
        virtual.boulder(2.0, 1.3, 1.0, 3, bumps=0.02, sides=64),
        virtual.ground(5.0, 0.7, 3, bumps_m=0.1), 6.0, 250.0,
    )  # fmt: skip


def ellipsoid(semi_axes_m: tuple[float, float, float], subdivisions: int = 4) -> Rock:
    """Subdivided icosahedron scaled to an ellipsoid, centred on the origin."""
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    return Rock.from_triangles(sphere.vertices * np.asarray(semi_axes_m, float), sphere.faces)


def cut_by(mesh: virtual.Mesh, *planes: tuple[tuple[float, float, float], float]) -> virtual.Mesh:
    """What of a closed mesh lies below planes, each given by its normal and its height at the origin."""
    body = _body(mesh)
    for normal, height_m in planes:
        length = float(np.linalg.norm(normal))
        down = (-normal[0] / length, -normal[1] / length, -normal[2] / length)
        body = body.trim_by_plane(down, -height_m * normal[2] / length)
    return _mesh(body)


def dented(mesh: virtual.Mesh, height_m: float, depth_m: float, half_width_m: float) -> virtual.Mesh:
    """A closed mesh with a bowl in its level top at a height."""
    radius_m = (half_width_m**2 + depth_m**2) / (2.0 * depth_m)
    ball = manifold3d.Manifold.sphere(radius_m, 96).translate([0.0, 0.0, height_m - depth_m + radius_m])
    return _mesh(_body(mesh) - ball)


def turned(radii_m: Array, heights_m: Array) -> virtual.Mesh:
    rings = np.repeat(radii_m[:, None], 96, axis=1)
    return virtual.lathe(rings, heights_m, np.zeros((len(heights_m), 2)), 96)


def seen_from_tripods(truth: virtual.Truth, seed: int, stations: int = 4) -> virtual.Cloud:
    """Cloud, with its true labels, of stations around a rock whose crown lies higher than they do."""
    random, rock = np.random.default_rng(seed), truth.rock
    size_m = float(np.ptp(rock.vertices_m, axis=0).max())
    seen = []
    for turn in 360.0 / stations * (np.arange(stations) + 0.5 * random.random(stations)):
        at = rock.com_m + 3.2 * size_m * horizontal_unit_vector(float(turn))
        at[2] = 0.55 * rock.height_m
        step_deg = np.rad2deg(0.008 * rock.height_m / (3.2 * size_m))
        seen.append(
            virtual.scan_from(
                truth.bodies, at, rock.com_m, 1.5 * size_m, step_deg, 0.001 * rock.height_m, random
            )
        )
    cloud, label = virtual.cloud_of(seen, np.zeros(3))
    return dataclasses.replace(cloud, label=label, station=np.zeros_like(cloud.station))


def _body(mesh: virtual.Mesh) -> manifold3d.Manifold:
    return manifold3d.Manifold(manifold3d.Mesh64(np.asarray(mesh[0], float), np.asarray(mesh[1], np.uint64)))


def _mesh(body: manifold3d.Manifold) -> virtual.Mesh:
    found = body.to_mesh64()
    return np.array(found.vert_properties[:, :3]), np.array(found.tri_verts, np.int64)
