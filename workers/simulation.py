"""What the compiled code of a shake works on, laid out once: arrays and records, and what is read off them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.workers.compiled import Array, Flags, Indices, Vector, compiled, inner
from toppling.workers.contact.candidates import REACH_DEG
from toppling.workers.contact.gaps import centripetal_m_s2, gaps_m
from toppling.workers.options import ContactOptions, ImpactOptions
from toppling.workers.problem import Problem
from toppling.workers.quaternion import normal_in_body

NOT, RAISED, EXACT = 0, 1, 2
"""How a world has the rock in the latest pose: not; a little higher; as it is, with its velocity."""

ROOM = 512
"""Poses that one step, cut at its impacts, may add."""

STATE = np.dtype(
    [
        ("last", "i8"),  # index of the latest pose
        ("grid", "i8"),  # steps from time 0 to it
        ("engine_steps", "i8"),
        ("set", "i8"),  # set of contact points, by the tilt that it serves
        ("widest", "i8"),  # that of all so far
        ("world", "i8"),  # set whose world holds the rock, -1 for none
        ("placed", "i8"),  # how
        ("rests", "i8"),  # whether the rock rests in the latest pose
        ("offset_for_s", "f8"),  # active points stand off by the normal offset of a step of this duration
        # least coefficient at which the latest step's contacts stick; 0 unless known
        ("needed_friction", "f8"),
        # when slip began, in steps after the middle of the latest one; negative if it did not
        ("slips_after", "f8"),
        ("axes_rad", "f8"),
        ("near_share", "f8"),  # of R: within it the engine was told of contacts
    ]
)


class Simulation(NamedTuple):
    """A rock on its way through a motion, as arrays and records; the arrays are the caller's.

    Poses are (7,): centre of mass in the support frame, and attitude as a quaternion. Velocities are (6,): of the
    centre of mass, and angular. That of a pose is the one with which the rock came to it, or which an impact there has
    left; it belongs to `velocity_time_s`, up to which the specific force is in it.
    """

    state: Any  # (1,) record of STATE
    contact: ContactOptions
    impact: ImpactOptions
    resolved_m_s: float
    allowed_m_s: float
    skips_rest: bool
    friction_static: float
    restitution: float
    # the trajectory, in arrays that may be longer than it
    time_s: Array
    velocity_time_s: Array
    pose: Array
    velocity: Array
    # what the latest step leaves to the next
    active: Flags  # contact candidates that carried
    acceleration: Array  # (6,) at which the velocity changed; zero where that says nothing of the next step
    # the rock
    points_m: Array
    centres_m: Array  # of the spheres that stand for the points in the engine
    radius_m: float
    mobilities: Array
    inertia_m2: Array
    upright: Array  # the normal in body axes in the pose of the scene
    half_diagonal_m: float
    set_tilt_deg: Array  # sets of the first contact points, which serve up to these tilts
    set_points: Indices
    # what shakes it
    gravity_m_s2: Array
    ground_acceleration_m_s2: Array
    ground_velocity_m_s: Array
    sample_s: float
    step_s: float


@inner
def append(sim: Simulation, step_s: float, velocity_s: float) -> int:
    """Add a pose after a step, still to be filled in, with its velocity so long after the latest one; its index."""
    last = sim.state[0].last
    sim.time_s[last + 1] = sim.time_s[last] + step_s
    sim.velocity_time_s[last + 1] = sim.time_s[last] + velocity_s
    sim.state[0].last = last + 1
    return last + 1


@inner
def gaps_of(sim: Simulation, pose: Array) -> Array:
    """Gaps (points,), m, of the present set in a pose: so many contact points are looked at, from the first."""
    out = np.empty(sim.set_points[sim.state[0].set])
    gaps_m(sim.points_m, pose, out)
    return out


@inner
def touching_m(sim: Simulation) -> float:
    """Gap up to which a point touches."""
    return sim.contact.touching_share * sim.half_diagonal_m


@compiled
def largest_tilt_deg(sim: Simulation, since: int) -> float:
    """Largest angle, from a pose on, of the interface's normal carried along to where it was in the scene."""
    a, b, c = sim.upright
    cosine = 1.0
    for index in range(since, sim.state[0].last + 1):
        x, y, z = normal_in_body(sim.pose[index])
        cosine = min(cosine, x * a + y * b + z * c)
    return math.degrees(math.acos(max(cosine, -1.0)))


@compiled
def lowest_gap_m(sim: Simulation, since: int) -> float:
    """Least gap, from a pose on, of the contact points that were looked at so far."""
    out, lowest = np.empty(sim.set_points[sim.state[0].widest]), np.inf
    for index in range(since, sim.state[0].last + 1):
        gaps_m(sim.points_m, sim.pose[index], out)
        lowest = min(lowest, out.min())
    return lowest


@inner
def velocity_increment_m_s(sim: Simulation, since_s: float, until_s: float) -> Vector:
    """What gravity less the ground's acceleration adds to a velocity between two times, support frame."""
    before, after = _ground_velocity_m_s(sim, since_s), _ground_velocity_m_s(sim, until_s)
    lasting_s = until_s - since_s
    return (
        sim.gravity_m_s2[0] * lasting_s - (after[0] - before[0]),
        sim.gravity_m_s2[1] * lasting_s - (after[1] - before[1]),
        sim.gravity_m_s2[2] * lasting_s - (after[2] - before[2]),
    )


@inner
def _ground_velocity_m_s(sim: Simulation, time_s: float) -> Vector:
    """Ground velocity: the exact integral of an acceleration that is linear between samples."""
    acceleration, velocity, sample = sim.ground_acceleration_m_s2, sim.ground_velocity_m_s, sim.sample_s
    time = min(max(time_s, 0.0), (len(acceleration) - 1) * sample)
    i = min(int(time / sample), len(acceleration) - 2)
    since = time - i * sample
    here, after, at = acceleration[i], acceleration[i + 1], velocity[i]
    x = at[0] + since * (here[0] + 0.5 * since * ((after[0] - here[0]) / sample))
    y = at[1] + since * (here[1] + 0.5 * since * ((after[1] - here[1]) / sample))
    z = at[2] + since * (here[2] + 0.5 * since * ((after[2] - here[2]) / sample))
    return x, y, z


@inner
def note_acceleration(sim: Simulation, since: int) -> None:
    """Keep at what rate the velocity has changed since a pose."""
    last = sim.state[0].last
    lasting_s = sim.velocity_time_s[last] - sim.velocity_time_s[since]
    sim.acceleration[:] = (sim.velocity[last] - sim.velocity[since]) / lasting_s


@inner
def _centripetal_m_s2(sim: Simulation) -> Array:
    """Acceleration (points,) of the present set in the latest pose toward the axis of rotation, along the normal."""
    last, out = sim.state[0].last, np.empty(sim.set_points[sim.state[0].set])
    centripetal_m_s2(sim.points_m, sim.pose[last], sim.velocity[last], out)
    return out


@inner
def largest_offset_m(sim: Simulation) -> float:
    """Gap from which a point does not carry in an engine's step: those that do stand off by an offset at most."""
    largest = np.abs(_centripetal_m_s2(sim)).max()
    carrying_m = sim.contact.carrying_share * sim.half_diagonal_m
    return max(sim.contact.highest_offset * sim.step_s**2 * largest, carrying_m)


@inner
def set_normal_offset(sim: Simulation, step_s: float) -> None:
    """Set the latest pose to the height that belongs to an engine's step of this duration; 0 is the surface.

    Such a step leads a point that carries off the plane along its tangent, by half of (step)^2 times its centripetal
    acceleration, and the next one takes that back. After a change of step the offset is another one.
    """
    state = sim.state[0]
    if state.offset_for_s == step_s:
        return
    state.offset_for_s = step_s
    pose = sim.pose[state.last]
    gap, offset = gaps_of(sim, pose), 0.5 * step_s**2 * _centripetal_m_s2(sim)
    if step_s > 0.0:  # the engine's points are small spheres
        gaps_m(sim.centres_m, pose, gap)
        gap -= sim.radius_m
    raised_m = -(gap - offset).min()
    # Else the rock is aloft, or a point has penetrated.
    if (
        raised_m != 0.0
        and -largest_offset_m(sim) < raised_m < sim.contact.penetrating_share * sim.half_diagonal_m
    ):
        pose[2] += raised_m
        state.placed = NOT


@compiled
def rest_until(sim: Simulation, grid: int) -> None:
    """Let the rock rest where it is up to a step; what comes then depends on that pose alone."""
    state = sim.state[0]
    set_normal_offset(sim, 0.0)
    last = state.last
    if not (last > 0 and state.rests and (sim.pose[last] == sim.pose[last - 1]).all()):
        last = append(sim, 0.0, 0.0)
        sim.pose[last] = sim.pose[last - 1]
    sim.time_s[last] = sim.velocity_time_s[last] = grid * sim.step_s
    sim.velocity[last] = 0.0
    sim.acceleration[:] = 0.0
    state.grid, state.rests, state.placed = grid, 1, NOT


class StateHistory:
    """States of a rock in one shake, from its start on: the arrays of a :class:`Simulation`, and their growth."""

    def __init__(self, problem: Problem) -> None:
        contact, motion, options = problem.contact, problem.motion, problem.options
        # Of sets with equally many points the one that serves the largest tilt.
        reach_deg = {contact.points_within(tilt): tilt for tilt in REACH_DEG}
        acceleration = motion.acceleration_m_s2 @ contact.scene_from_support
        velocity = np.zeros_like(acceleration)
        means = 0.5 * (acceleration[1:] + acceleration[:-1])
        np.cumsum(motion.time_step_s * means, axis=0, out=velocity[1:])
        self.sim = Simulation(
            state=np.zeros(1, STATE),
            contact=options.contact,
            impact=options.impact,
            resolved_m_s=options.resolved_impact * problem.speed_m_s,
            allowed_m_s=options.contact.allowed_speed * problem.speed_m_s,
            skips_rest=problem.shortcuts,
            friction_static=float(problem.scene.contact.friction_static),
            restitution=float(problem.scene.contact.restitution),
            **_track(4 * ROOM),
            active=np.zeros(len(contact.points_body_m), np.bool_),
            acceleration=np.zeros(6),
            points_m=contact.points_body_m,
            centres_m=contact.centres_body_m,
            radius_m=contact.radius_m,
            mobilities=np.ascontiguousarray(contact.mobilities_m2),
            inertia_m2=contact.principal_inertia_m2,
            upright=np.ascontiguousarray(contact.support_from_body[2]),
            half_diagonal_m=contact.half_diagonal_m,
            set_tilt_deg=np.array(list(reach_deg.values())),
            set_points=np.array(list(reach_deg)),
            gravity_m_s2=np.array([0.0, 0.0, -problem.scene.gravity_m_s2]) @ contact.scene_from_support,
            ground_acceleration_m_s2=acceleration,
            ground_velocity_m_s=velocity,
            sample_s=motion.time_step_s,
            step_s=problem.time_step_s,
        )
        self._deepest_m = 0.0
        self.sim.pose[0], self.sim.velocity[0] = problem.initial
        state = self.sim.state
        state["world"], state["rests"], state["slips_after"] = -1, problem.start is None, -1.0

    @property
    def last(self) -> int:
        """Index of the latest pose."""
        return int(self.sim.state["last"][0])

    @property
    def time_s(self) -> float:
        """Time of the latest pose."""
        return float(self.sim.time_s[self.last])

    @property
    def grid(self) -> int:
        """Steps from time 0 to the latest pose."""
        return int(self.sim.state["grid"][0])

    @property
    def rests(self) -> bool:
        """Whether the rock rests in the latest pose."""
        return bool(self.sim.state["rests"][0])

    @property
    def engine_steps(self) -> int:
        """Steps that the engine took, repeated ones included."""
        return int(self.sim.state["engine_steps"][0])

    def time_and_pose(self) -> tuple[Array, Array]:
        """Times (n,) and poses (n, 7) so far."""
        return self.sim.time_s[: self.last + 1], self.sim.pose[: self.last + 1]

    def penetration_m(self) -> float:
        """Deepest that a contact point has been below the surface."""
        return max(self._deepest_m, -lowest_gap_m(self.sim, 0), 0.0)

    def rest_until(self, since: int, grid: int) -> None:
        """Let the rock rest in a pose up to a step; what comes then depends on that pose alone."""
        self.make_room_for(ROOM)
        if since < self.last:
            self._deepest_m = max(self._deepest_m, -lowest_gap_m(self.sim, since))
            self.sim.state["last"], self.sim.state["rests"] = since, 0
        rest_until(self.sim, grid)

    def make_room_for(self, poses: int) -> None:
        """Make sure that so many poses may be added."""
        if self.last + poses > len(self.sim.time_s):
            self.make_room()

    def make_room(self) -> None:
        """Take arrays of twice the length."""
        longer = _track(2 * len(self.sim.time_s))
        for name, array in longer.items():
            array[: self.last + 1] = getattr(self.sim, name)[: self.last + 1]
        self.sim = self.sim._replace(**longer)


def _track(room: int) -> dict[str, Any]:
    """Empty arrays of a trajectory."""
    columns = {"time_s": (room,), "velocity_time_s": (room,), "pose": (room, 7), "velocity": (room, 6)}
    return {name: np.zeros(shape) for name, shape in columns.items()}
