"""What the compiled code of a shake works on, laid out once: arrays and records, and what is read off them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.workers.compiled import Array, Flags, Indices, Vector, compiled, inner
from toppling.workers.events import centripetal_m_s2, gaps_m
from toppling.workers.options import ContactOptions, ImpactOptions
from toppling.workers.quaternion import normal_in_body

NOT, RAISED, EXACT = 0, 1, 2
"""How a world has the rock in the latest pose: not; a little higher; as it is, with its velocity."""

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
        ("hovers_s", "f8"),  # points that carry stand off by the offset of a step of this duration
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
    worlds: Any  # (sets,) records of engine.WORLD, those without a client are still to be built
    contact: ContactOptions
    impact: ImpactOptions
    resolved_m_s: float
    allowed_m_s: float
    skips_rest: bool
    # the trajectory, in arrays that may be longer than it
    time_s: Array
    velocity_time_s: Array
    pose: Array
    velocity: Array
    # what the latest step leaves to the next
    carries: Flags  # points that carried
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
def hover_m(sim: Simulation) -> float:
    """Gap from which a point does not carry in an engine's step: those that do stand off by an offset at most."""
    largest = np.abs(_centripetal_m_s2(sim)).max()
    carrying_m = sim.contact.carrying_share * sim.half_diagonal_m
    return max(sim.contact.highest_offset * sim.step_s**2 * largest, carrying_m)


@inner
def hover_for(sim: Simulation, step_s: float) -> None:
    """Set the latest pose to the height that belongs to an engine's step of this duration; 0 is the surface.

    Such a step leads a point that carries off the plane along its tangent, by half of (step)^2 times its centripetal
    acceleration, and the next one takes that back. After a change of step the offset is another one.
    """
    state = sim.state[0]
    if state.hovers_s == step_s:
        return
    state.hovers_s = step_s
    pose = sim.pose[state.last]
    gap, offset = gaps_of(sim, pose), 0.5 * step_s**2 * _centripetal_m_s2(sim)
    if step_s > 0.0:  # the engine's points are small spheres
        gaps_m(sim.centres_m, pose, gap)
        gap -= sim.radius_m
    raised_m = -(gap - offset).min()
    # Else the rock is aloft, or a point has penetrated.
    if raised_m != 0.0 and -hover_m(sim) < raised_m < sim.contact.penetrating_share * sim.half_diagonal_m:
        pose[2] += raised_m
        state.placed = NOT
