"""Steps in which coordinates are stored, whatever the format: a scale, decimals, single precision far from zero."""

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import distinct
from toppling.models.errors import InputError

_TOLD_PER_HEIGHT = 1e-3
"""Steps above this share of the rock's height are told with their effect."""
_COARSEST_PER_HEIGHT = 1e-2
"""Above this one they are as wide as the patches that rock and pedestal are made of, and the crevice is lost."""
_SAMPLE = 200_000
_MULTIPLES = 0.9
"""Share of the distances between neighbouring values that must be multiples of a step."""
_DRAWN = 1.5
"""Steps along a mesh's median edge below which it was drawn in them: rounded so, many triangles would have no area."""
_ALONE, _TAKEN = 0.99, 0.5
"""Shares of a grid of heights: of its points that have a node to themselves, and of its nodes that have a point."""


def coordinate_steps(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Step (3,) in which each coordinate of points (n, 3) comes, 0 where none shows.

    Examples
    --------
    >>> coordinate_steps(np.random.default_rng(1).uniform(0.0, 5.0, (3000, 3)).round(2)).round(6)
    array([0.01, 0.01, 0.01])
    """
    finite = points if np.isfinite(points.sum()) else points[np.isfinite(points).all(axis=1)]
    sample = finite[:: max(1, len(finite) // _SAMPLE)]
    if len(sample) < 3:
        return np.zeros(3)
    steps = np.array([_step(sample[:, axis]) for axis in range(3)])
    steps[_grid_axes(finite, steps)] = 0.0
    return np.maximum(steps, _single_precision(sample))


def _grid_axes(points: NDArray[np.float64], steps: NDArray[np.float64]) -> list[int]:
    """Axes along which points (n, 3) are the nodes of a grid of heights: laid out so, not rounded to it.

    Rounding puts several points of a wall, and of any surface that is finer than the step, at one node.
    """
    axes = np.flatnonzero(steps > 0.0)
    if len(axes) != 2:
        return []
    nodes = np.rint((points[:, axes] - points[:, axes].min(axis=0)) / steps[axes])
    taken = len(distinct(nodes[:, 0] * (nodes[:, 1].max() + 1.0) + nodes[:, 1]))
    alone = taken >= _ALONE * len(points)
    return axes.tolist() if alone and taken >= _TAKEN * np.prod(nodes.max(axis=0) + 1.0) else []


def steps_of_mesh(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """The same (3,) for the vertices (n, 3) of triangles (m, 3): a mesh whose edges are a step wide was drawn so."""
    steps = coordinate_steps(vertices)
    edges = np.abs(vertices[faces] - vertices[np.roll(faces, 1, axis=1)]).reshape(-1, 3)
    for axis in np.flatnonzero(steps):
        along = edges[edges[:, axis] > 0.0, axis]
        if len(along) and np.median(along) < _DRAWN * steps[axis]:
            steps[axis] = 0.0
    return np.maximum(steps, _single_precision(vertices[:: max(1, len(vertices) // _SAMPLE)]))


def single_precision_step(points: NDArray[np.float64]) -> float:
    """Widest step between neighbouring single-precision numbers at the coordinates, 0 if they are not such numbers."""
    return float(_single_precision(points[:: max(1, len(points) // 10_000)]).max(initial=0.0))


def _single_precision(sample: NDArray[np.float64]) -> NDArray[np.float64]:
    single = sample.astype(np.float32)
    steps = np.spacing(np.abs(single).max(axis=0)).astype(float)
    return np.where((single == sample).all(axis=0), steps, 0.0)


def _step(values: NDArray[np.float64]) -> float:
    """Step of one coordinate: the widest of some candidates that most distances are multiples of."""
    apart = np.diff(distinct(values))
    apart = apart[apart > 1e-12 * np.abs(values).max()]
    if len(apart) < 3:
        return 0.0
    for step in np.quantile(apart, [0.5, 0.1, 0.01, 0.0], method="lower"):
        counts = apart / step
        # Beyond a hundred steps a distance is near a multiple of anything.
        near = counts < 100.0
        if near.mean() > _MULTIPLES and (np.abs(counts - counts.round()) < 0.02)[near].mean() > _MULTIPLES:
            return float(step)
    return 0.0


def step_note(step_m: float, height_m: float, where: str = "coordinates") -> str:
    """What steps of coordinates mean for a rock; empty where they are fine.

    step_m, height_m: widest step of the clouds, height of the rock. where: the file that has it.
    Raises InputError if they are so wide that the crevice is lost.
    """
    if step_m > _COARSEST_PER_HEIGHT * height_m:
        raise InputError(
            f"coordinates come in steps of {step_m:.3g} m, and the rock is {height_m:.3g} m high",
            where=where,
            expected=f"steps of at most {_COARSEST_PER_HEIGHT * height_m:.2g} m, a hundredth of the rock's height; "
            f"{_TOLD_PER_HEIGHT * height_m:.1g} m or less lose nothing",
            remedy="export again with more decimals, a smaller scale (LAS), in double precision, or with an offset "
            "taken away",
        )
    if step_m <= _TOLD_PER_HEIGHT * height_m:
        return ""
    # A rock topples at g r / z: the arm r is half a step off, and its centre of mass about half the height z up.
    return (
        f"coordinates come in steps of {step_m:.2g} m, 1/{height_m / step_m:.0f} of the rock's height: of the gap and "
        f"the bumps below the rock nothing finer was stored, heights and the edges that it turns on are uncertain by "
        f"up to {0.5 * step_m:.2g} m, and with them the least toppling acceleration by {step_m / height_m:.1g} g; "
        "export with more decimals or in double precision if the survey has them"
    )
