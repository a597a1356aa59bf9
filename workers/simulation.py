"""What the compiled code of a shake works on, laid out once, and what is read off it.

:class:`Simulation` is the one mutable struct of a shake. Each of its fields has one writer, named beside it: a module
that needs another value asks the writer.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from toppling.models.compiled import Array, Flags, Indices, Vector, compiled, inner
from toppling.models.ground import excitation
from toppling.workers.options import ContactOptions, ImpactOptions
from toppling.workers.quaternion import normal_in_body

NOT, RAISED, EXACT = 0, 1, 2
"""How an engine's world has the rock in the latest pose: not; a little higher; as it is, with its velocity."""

STATE = np.dtype(
    (
        np.record,
        [
            ("since", "i8"),  # index of the pose in which the present block of steps began: the integrator
            ("goal", "i8"),  # step that it goes on to: the same
            ("last", "i8"),  # index of the latest pose: `append`, and who takes a step back
            ("grid", "i8"),  # steps from time 0 to it: the integrator's loop, `rest_until`
            ("rests", "i8"),  # whether the rock rests in the latest pose: the same
            ("steps", "i8"),  # taken, repeated ones included: the integrator
            ("engine_steps", "i8"),  # those of them that the engine took or checked: the integrator
            ("set", "i8"),  # set of contact candidates, by the tilt that it serves: the integrator
            ("widest", "i8"),  # that of all so far: the same
            # least coefficient at which the latest step's contacts stick, 0 unless known: contact/sticking.py
            ("needed_friction", "f8"),
            # when slip began, in steps after the middle of the latest one; negative if it did not: the same
            ("slips_after", "f8"),
            (
                "offset_for_s",
                "f8",
            ),  # active points stand off as a step of this duration wants it: contact/offset.py
            ("world", "i8"),  # set whose world holds the rock, -1 for none: the engine
            ("placed", "i8"),  # how: whoever changes the latest pose or velocity
            ("axes_rad", "f8"),  # of the engine's friction: the engine
            ("near_share", "f8"),  # of R: within it the engine was told of contacts: the engine
            ("draw", "u8"),  # decides which of the own steps the engine repeats: the integrator
            (
                "unlike",
                "f8",
            ),  # by which its step differed from one of those, 0 where it agrees: the integrator
        ],
    )
)

_WHOLE = ("repeated_parts", "most", "engine_tries")

FIXED = np.dtype(
    (
        np.record,
        [
            *(
                (name, "i8" if name in _WHOLE else "f8")
                for name in (*ContactOptions._fields, *ImpactOptions._fields)
            ),
            ("step_s", "f8"),
            ("sample_s", "f8"),  # of the ground's motion
            ("half_diagonal_m", "f8"),
            ("radius_m", "f8"),  # of the spheres that stand for the candidates in an engine
            ("touching_m", "f8"),  # gap up to which a candidate touches
            ("carrying_m", "f8"),  # the same of candidates that an engine has left where they carry
            ("resting_m", "f8"),  # the same of a rock at rest
            ("resolved_m_s", "f8"),
            ("allowed_m_s", "f8"),
            ("friction_static", "f8"),
            ("restitution", "f8"),
            ("checked_steps", "f8"),  # share of the own steps that the engine repeats
            ("two_frictions", "i8"),  # whether the kinetic friction is another one
            ("own_steps", "i8"),  # whether steps on contacts that stick are taken without the engine
            ("skips_rest", "i8"),
            ("inertia_m2", "f8", 3),  # principal, over mass
            ("upright", "f8", 3),  # the normal in body axes in the pose of the scene
            ("gravity_m_s2", "f8", 3),
        ],
    )
)
"""What does not change in a shake: options, the rock, its contact."""

X, Y, Z, ARM_X, ARM_Y, ARM_Z, GAP, RATE, LEAST = range(9)
"""Rows of `Simulation.candidates`, of lengths in metres.

Given: a material point of the rock in body axes (X, Y, Z). Found by contact/gaps.py: the arm from the centre of mass to
the point in the latest pose looked at, the gap, and its rate. LEAST is the least normal velocity that a near point may
have, written by who asks for a velocity.
"""

CANDIDATE_ROWS = 9

ACTIVE, NEAR, TRIED, TOUCHES, SLIDES, DROPPED = range(6)
"""Rows of `Simulation.flags`: candidates that carry; that may; and of contact/active_set.py those that it tries."""

FLAG_ROWS = 6

ROTATION, MOBILITY, JACOBIAN, TURNED, GRAM = 0, 3, 6, 12, 18
IMPULSE, FREE, FOUND, ACCELERATION, MEAN = 24, 25, 26, 27, 28
"""First rows of `Simulation.work`.

Matrices: body to support axes; inverse of the inertia over mass in support axes; the active contacts' directions, what
they turn the rock with, what they do to each other. Vectors: impulses; velocity without contacts; the velocity found;
the rate at which the velocity changed in the latest step (zero where that says nothing of the next);
a mean velocity.
"""

WORK_ROWS = 29


class Simulation(NamedTuple):
    """A rock on its way through a motion, as arrays and records.

    Poses are (7,): centre of mass in the support frame, and attitude as a quaternion. Velocities are (6,): of the
    centre of mass, and angular. That of a pose is the one with which the rock came to it, or which an impact there has
    left; it belongs to `velocity_time_s`, up to which the specific force is in it.
    """

    state: NDArray[np.void]  # (1,) of STATE
    fixed: NDArray[np.void]  # (1,) of FIXED, written once
    # the trajectory, in arrays that may be longer than it: `append`, and the integrator that fills the new pose
    time_s: Array
    velocity_time_s: Array
    pose: Array
    velocity: Array
    candidates: Array  # (CANDIDATE_ROWS, n), in the order of the tilt from which they can touch
    flags: Flags  # (FLAG_ROWS, n): contact/sticking.py and active_set.py
    near: Indices  # (n,) candidates that are near: contact/sticking.py
    chosen: Indices  # (3,) active ones, those that stick first: contact/active_set.py
    work: Array  # (WORK_ROWS, 6)
    set_tilt_deg: Array  # sets of the first candidates, which serve up to these tilts
    set_points: Indices
    ground: Array  # (samples, 6): the ground's acceleration and velocity, support frame


@inner
def copy(source: Array, target: Array) -> None:
    """Copy one row into another; an assignment of arrays takes Numba's compiler long."""
    for k in range(len(target)):
        target[k] = source[k]


@inner
def append(sim: Simulation, step_s: float, velocity_s: float) -> int:
    """Add a pose after a step, still to be filled in, with its velocity so long after the latest one; its index."""
    last = sim.state[0].last
    sim.time_s[last + 1] = sim.time_s[last] + step_s
    sim.velocity_time_s[last + 1] = sim.time_s[last] + velocity_s
    sim.state[0].last = last + 1
    return last + 1


@inner
def points_in_use(sim: Simulation) -> int:
    """So many candidates are looked at, from the first."""
    return sim.set_points[sim.state[0].set]


@compiled
def largest_tilt_deg(sim: Simulation, since: int) -> float:
    """Largest angle, from a pose on, of the interface's normal carried along to where it was in the scene."""
    upright = sim.fixed[0].upright
    a, b, c = upright[0], upright[1], upright[2]
    cosine = 1.0
    for index in range(since, sim.state[0].last + 1):
        x, y, z = normal_in_body(sim.pose[index])
        cosine = min(cosine, x * a + y * b + z * c)
    return math.degrees(math.acos(max(cosine, -1.0)))


@inner
def velocity_increment_m_s(sim: Simulation, since_s: float, until_s: float) -> Vector:
    """What gravity less the ground's acceleration adds to a velocity between two times, support frame."""
    fixed = sim.fixed[0]
    return excitation.velocity_increment_m_s(sim.ground, fixed.sample_s, fixed.gravity_m_s2, since_s, until_s)


@inner
def note_acceleration(sim: Simulation, since: int) -> None:
    """Keep at what rate the velocity has changed since a pose."""
    last = sim.state[0].last
    lasting_s = sim.velocity_time_s[last] - sim.velocity_time_s[since]
    for k in range(6):
        sim.work[ACCELERATION, k] = (sim.velocity[last, k] - sim.velocity[since, k]) / lasting_s


@inner
def forget_acceleration(sim: Simulation) -> None:
    """The latest change of the velocity says nothing of the next."""
    for k in range(6):
        sim.work[ACCELERATION, k] = 0.0
