"""A rock at rest: whether its contact can hold it, and the time that it may be left alone."""

from __future__ import annotations

import math

import numpy as np

from toppling.models.compiled import Array, Indices, compiled, inner
from toppling.models.statics import EQUILIBRIUM_MARGIN
from toppling.workers.engines.protocol import Integrator
from toppling.workers.observation import Observation
from toppling.workers.problem import Problem
from toppling.workers.quaternion import to_world
from toppling.workers.simulation import Simulation, X, Y, Z


class Rest:
    """Whether the rock rests, held by its contact, and what is left out while it does."""

    def __init__(self, problem: Problem, integrator: Integrator) -> None:
        sim = integrator.history.sim
        self._problem, self._integrator, self._sample_s = problem, integrator, problem.motion.time_step_s
        self._history = integrator.history
        gravity_m_s2 = sim.fixed["gravity_m_s2"][0]
        self._forces = np.vstack([gravity_m_s2 - sim.ground[:, :3], gravity_m_s2])
        """Specific force at the motion's samples, and after the last of them."""
        self.rests = problem.start is None
        """For the whole of the last block."""
        self.came_to_rest = False
        self.skipped_s = 0.0

    def keep(self, seen: Observation, since: int) -> bool:
        """Set a rock that has rested for a block to where it was, if its contact holds it there; whether it was set.

        In the block in which it comes to rest it stays where it is: only what follows is known to be creep.
        """
        history, rested = self._history, self.rests
        slow_m_s = self._problem.rest_speed_m_s
        slow = seen.drift_m_s < slow_m_s
        self.came_to_rest = slow and seen.speed_m_s < slow_m_s
        self.rests = slow if rested else self.came_to_rest
        if not self.rests or history.rests:
            return False
        last = len(self._forces) - 1  # the motion may have been over before
        first = min(int(history.sim.time_s[since] / self._sample_s), last)
        end = min(math.ceil(seen.time_s / self._sample_s) + 1, last + 1)
        self.rests = self._held_until(since if rested else history.last, first, end) == end
        if rested and self.rests:
            self._rest_until(since, history.grid)
            return True
        return False

    def is_held(self) -> bool:
        """Whether the contact can hold the rock where it is on ground at rest."""
        last = len(self._forces) - 1
        return self._held_until(self._history.last, last, last + 1) > last

    def lasts(self) -> bool:
        """Skip to the last block before equilibrium becomes impossible; true if it stays possible to the end.

        The specific forces that friction and the support can hold form a convex cone, and the motion is linear between
        its samples: a rock at rest stays so up to the last sample of those that all lie in the cone. Blocks are skipped
        whole, so that what comes after is to the bit what it is without the skip.
        """
        history, step_s = self._history, self._problem.time_step_s
        first, end = int(history.time_s / self._sample_s), len(self._forces)
        until = self._held_until(history.last, first, end)
        if until == end:
            return True
        until_s = max(until - 1, first) * self._sample_s
        block = self._problem.options.termination.block
        blocks = (int(until_s / step_s) - history.grid) // block
        if blocks > 0:
            self.skipped_s += blocks * block * step_s
            self._rest_until(history.last, history.grid + blocks * block)
        return False

    def _rest_until(self, since: int, grid: int) -> None:
        """Let the rock rest in a pose up to a step."""
        self._history.rest_until(since, grid)
        self._integrator.restart()

    def _held_until(self, index: int, first: int, end: int) -> int:
        """First sample, from `first` on, whose force the points that touch in a pose cannot hold; `end` if all."""
        friction = self._problem.scene.contact.friction_static
        return int(_first_not_held(self._history.sim, index, friction, self._forces, first, end))


@compiled(allocates=True)
def _first_not_held(
    sim: Simulation, index: int, friction: float, forces_m_s2: Array, first: int, end: int
) -> int:
    """First of some specific forces (m, 3) that the points which touch in a pose cannot hold; `end` if they hold all.

    The cone of :func:`models.statics.equilibrium_possible`: the force points into the plane, its tangential part is at
    most the friction times the normal one, and its line of action through the centre of mass pierces the hull of the
    points.
    """
    candidates, pose, touching_m = sim.candidates, sim.pose[index], sim.fixed[0].resting_m
    arms, count = np.empty((candidates.shape[1], 3)), 0
    for i in range(len(arms)):
        x, y, z = to_world(candidates[X, i], candidates[Y, i], candidates[Z, i], pose)
        if pose[2] + z <= touching_m:
            arms[count, 0], arms[count, 1], arms[count, 2] = x, y, z
            count += 1
    ring = _convex_ring(arms[:count], touching_m)
    if len(ring) < 3:
        return first
    moments, longest = np.empty((len(ring), 3)), 0.0
    for k in range(len(ring)):
        a, b = arms[ring[k]], arms[ring[(k + 1) % len(ring)]]
        x, y = b[0] - a[0], b[1] - a[1]
        far = math.sqrt(x * x + y * y)
        # w . f > 0 where the force f on the centre of mass holds the rock down on the edge.
        # One by one: for a whole row Numba compiles a message about shapes, for seconds.
        moments[k, 0], moments[k, 1], moments[k, 2] = (
            y * a[2] / far,
            -x * a[2] / far,
            (a[1] * x - a[0] * y) / far,
        )
        longest = max(longest, math.sqrt(a[0] ** 2 + a[1] ** 2 + a[2] ** 2))
    for n in range(first, end):
        x, y, z = forces_m_s2[n]
        margin = EQUILIBRIUM_MARGIN * math.sqrt(x * x + y * y + z * z)
        if not (-z > margin and math.sqrt(x * x + y * y) <= -friction * z - margin):
            return n
        for k in range(len(ring)):
            if moments[k, 0] * x + moments[k, 1] * y + moments[k, 2] * z < margin * longest:
                return n
    return end


@compiled(allocates=True)
def _convex_ring(points: Array, width: float) -> Indices:
    """Indices of the convex hull's corners in the plane of x and y, counter-clockwise; fewer than three if thinner.

    Andrew's monotone chain (1979).
    """
    n = len(points)
    if n < 3:
        return np.arange(n)
    order = np.arange(n)
    for i in range(1, n):  # by x, then y; few points
        k = order[i]
        j = i - 1
        while j >= 0 and (points[order[j], 0], points[order[j], 1]) > (points[k, 0], points[k, 1]):
            order[j + 1] = order[j]
            j -= 1
        order[j + 1] = k
    ring, size = np.empty(2 * n, np.int64), 0
    for turn in range(2):
        start = size
        for step in range(n):
            k = order[step] if turn == 0 else order[n - 1 - step]
            while size - start >= 2 and _left_of(points, ring[size - 2], ring[size - 1], k) <= 0.0:
                size -= 1
            ring[size] = k
            size += 1
        size -= 1
    area, longest = 0.0, 0.0
    for i in range(1, size - 1):
        area += _left_of(points, ring[0], ring[i], ring[i + 1])
    for i in range(size):
        a, b = points[ring[i]], points[ring[(i + 1) % size]]
        longest = max(longest, math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2))
    return ring[:size] if area > width * longest else ring[: min(size, 2)]


@inner
def _left_of(points: Array, i: int, j: int, k: int) -> float:
    """Twice the area of a triangle, positive where k lies to the left of the way from i to j."""
    a, b, c = points[i], points[j], points[k]
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
