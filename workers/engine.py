"""PyBullet, and the only module that imports it: a rock of contact points over a plane, stepped one step at a time.

The engine's world may be turned about the normal against the support frame, which puts the axes of friction where they
serve (:mod:`workers.friction`); what goes in and comes out is in the support frame.
"""

from __future__ import annotations

import atexit
import math
import tempfile
from collections.abc import Sequence
from typing import Any

import numpy as np
import pybullet
from numpy.typing import NDArray

from toppling.models.scene import ContactProperties
from toppling.workers.contact import ContactModel, Pose
from toppling.workers.presets import Solver

Array = NDArray[np.float64]

NEAR_STEPS = 0.8
"""Contacts are prepared within this share of g (step)^2, what gravity adds to a way in a step, so that a landing too
slow to cut a step at stops at the surface and not below it. Points farther off only add to the solver's work."""

NEAREST_SHARE = 2e-5
"""Of R: within so much contacts are prepared however short the step, as feet at rest stand off by a tenth of it."""

COLD_ITERATIONS = 200
"""Of the first step in a new state: around a landing many contacts are prepared, and take longer to agree."""

STARTS_TO_SLIP, STILL_SLIPS = 0.999, 0.7
"""Shares of the limit of friction from which a contact that stuck slips, and down to which one that slipped still does:
the solver's iterations leave the friction of a sliding contact a little below what its normal force allows."""

STILL_MOVES = 1e-2
"""Share of gravity's velocity in a step: a contact whose points all move along the plane by less has stopped, however
much its friction holds up. The solver leaves a contact that sticks up to a tenth of it."""


def slip_m_s(velocity_m_s: Sequence[float], spin_rad_s: Sequence[float], arm_m: Sequence[float]) -> float:
    """Speed along the plane of the point of a rock that is so far from its centre of mass; z is the normal."""
    (u, v, _), (p, q, r), (x, y, z) = velocity_m_s, spin_rad_s, arm_m
    return math.hypot(u + q * z - r * y, v + r * x - p * z)


class _Axes:
    """Turns vectors and poses of the support frame into a world that is turned about the normal, and back."""

    def __init__(self, turned_rad: float) -> None:
        self.turned_rad = turned_rad
        self._cos, self._sin = math.cos(turned_rad), math.sin(turned_rad)
        self._half_cos, self._half_sin = math.cos(0.5 * turned_rad), math.sin(0.5 * turned_rad)

    def into(self, vector: Sequence[float]) -> tuple[float, float, float]:
        (x, y, z), cos, sin = vector, self._cos, self._sin
        return cos * x + sin * y, cos * y - sin * x, z

    def out(self, vector: Sequence[float]) -> tuple[float, float, float]:
        (x, y, z), cos, sin = vector, self._cos, self._sin
        return cos * x - sin * y, cos * y + sin * x, z

    def pose_into(self, pose: Pose) -> Pose:
        (x, y, z, w), cos, sin = pose[1], self._half_cos, self._half_sin
        attitude = cos * x + sin * y, cos * y - sin * x, cos * z - sin * w, cos * w + sin * z
        return self.into(pose[0]), attitude

    def pose_out(self, pose: Pose) -> Pose:
        (x, y, z, w), cos, sin = pose[1], self._half_cos, self._half_sin
        attitude = cos * x - sin * y, cos * y + sin * x, cos * z + sin * w, cos * w - sin * z
        return self.out(pose[0]), attitude


class Engine:
    """One rock in a world of its own, in the support frame.

    Parameters
    ----------
    contact : ContactModel
    points : int
        How many of the rock's contact points the world holds, from the first.
    surface : ContactProperties
    impulse_m_s : float
        Velocity that gravity gives in one step: what the solver's residual is measured against.
    fall_m : float
        What gravity moves in one step, g (step)^2.
    rebound_from_m_s : float
        Landings slower than this do not rebound.
    solver : Solver
    slot : int
        Which of the process's worlds to use; an earlier engine in it is lost.
    """

    def __init__(
        self,
        contact: ContactModel,
        points: int,
        surface: ContactProperties,
        impulse_m_s: float,
        fall_m: float,
        rebound_from_m_s: float,
        solver: Solver,
        slot: int,
    ) -> None:
        self._client = _client(slot)
        self._contact = contact
        self._surface = surface
        self._follows_slip = surface.friction_kinetic != surface.friction_static
        self._impulse = impulse_m_s
        self._iterations = solver.iterations
        self.near_share = max(NEAR_STEPS * fall_m / contact.half_diagonal_m, NEAREST_SHARE)
        """Contacts are prepared within this share of R, unless told otherwise."""
        self.points = points
        pybullet.resetSimulation(physicsClientId=self._client)
        pybullet.setPhysicsEngineParameter(
            numSubSteps=0,
            numSolverIterations=self._iterations,
            solverResidualThreshold=(solver.residual_share * impulse_m_s) ** 2,
            deterministicOverlappingPairs=1,
            enableConeFriction=1,
            contactSlop=0.0,
            restitutionVelocityThreshold=rebound_from_m_s,
            physicsClientId=self._client,
        )
        self._time_step_s, self._cold = 0.0, True
        self._axes = _Axes(0.0)
        self._rock = self._add_rock()
        self._ground = self._add_pedestal()
        self.let_stick()

    def let_stick(self) -> None:
        """Give the contact its static friction, as it has before it slips."""
        self._grip = [0.0, 0.0, 0.0]
        self._set_friction(self._surface.friction_static)

    def hold_as(self, other: Engine) -> None:
        """Let the contact stick or slip as in another engine, from which this one takes the rock over."""
        self._grip = other._grip
        self._set_friction(other._friction)

    def _set_friction(self, friction: float) -> None:
        # Bullet multiplies the two bodies' coefficients; the rock's is 1.
        pybullet.changeDynamics(self._ground, -1, lateralFriction=friction, physicsClientId=self._client)
        self._friction = friction

    def _follow_slip(self) -> None:
        """Choose the coefficient of the next step: the kinetic one while the contact as a whole slips.

        It slips where the resultant of its friction uses up what the present coefficient allows, and once it does
        until its points stand still. One state for all points: they belong to one rigid body, and differ only while it
        turns on the spot. A rock in the air lands as one that slips if its lowest point moves along the plane by more
        than a step in which the solver let go of a foot can give it.
        """
        contacts = pybullet.getContactPoints(physicsClientId=self._client)
        touching = [point for point in contacts if point[9] > 0.0]
        if not touching:
            self._grip = [0.0, 0.0, 0.0]
            slips = slip_m_s(*self._velocities(), self._lowest_arm_m()) > self._impulse
        else:
            slips = self._slips_on(touching)
        static, kinetic = self._surface.friction_static, self._surface.friction_kinetic
        wanted = kinetic if slips else static
        if touching and slips and self._friction == static:
            # Slip began within the step that is over, which held it with static friction to its end, on the average
            # half a step too long: the next one takes that back. Left out, every slip came out a step short.
            wanted = max(kinetic - 0.5 * (static - kinetic), 0.0)
        if wanted != self._friction:
            self._set_friction(wanted)

    def _slips_on(self, touching: list[Any]) -> bool:
        pressing, along = 0.0, [0.0, 0.0, 0.0]
        for point in touching:
            pressing += point[9]
            for i in range(3):
                along[i] += point[10] * point[11][i] + point[12] * point[13][i]
        along = list(self._axes.out(along))
        turned = (
            sum(a * b for a, b in zip(along, self._grip, strict=True)) < 0.0
        )  # slip came to a halt on the way
        self._grip = along
        sticks = self._friction == self._surface.friction_static
        share = STARTS_TO_SLIP if sticks else STILL_SLIPS
        if turned or math.hypot(*along) < share * self._friction * pressing:
            return False
        return sticks or self._moves_on(touching)

    def _moves_on(self, touching: list[Any]) -> bool:
        """Whether a point that touches moves along the plane after the step, which took it from where it touched."""
        (x, y, z), _ = pybullet.getBasePositionAndOrientation(self._rock, self._client)
        velocity, spin = self._velocities()
        step_s = self._time_step_s
        before = x - velocity[0] * step_s, y - velocity[1] * step_s, z - velocity[2] * step_s
        arms = ([a - b for a, b in zip(point[5], before, strict=True)] for point in touching)
        return any(slip_m_s(velocity, spin, arm) > STILL_MOVES * self._impulse for arm in arms)

    def _velocities(self) -> tuple[Sequence[float], Sequence[float]]:
        """Velocity and angular velocity of the rock, in the engine's world."""
        velocity, spin = pybullet.getBaseVelocity(self._rock, self._client)
        return velocity, spin

    def _lowest_arm_m(self) -> list[float]:
        """From the centre of mass to the lowest contact point."""
        _, attitude = pybullet.getBasePositionAndOrientation(self._rock, self._client)
        turn = np.array(pybullet.getMatrixFromQuaternion(attitude)).reshape(3, 3)
        arms = self._contact.centres_body_m[: self.points] @ turn.T
        return list(arms[arms[:, 2].argmin()].tolist())

    def set_state(
        self,
        pose: Pose,
        velocity_m_s: tuple[float, float, float],
        angular_velocity_rad_s: tuple[float, float, float],
        *,
        within_share: float | None = None,
        axes_rad: float = 0.0,
    ) -> None:
        """Place the rock and set it going; forgets all contacts.

        From here on contacts are prepared within a share of R, `near_share` if not given, and friction acts along axes
        that are turned by `axes_rad` from the support frame's.
        """
        if axes_rad != self._axes.turned_rad:
            self._axes = _Axes(axes_rad)
        pybullet.setPhysicsEngineParameter(
            contactBreakingThreshold=self.near_share if within_share is None else within_share,
            numSolverIterations=max(COLD_ITERATIONS, self._iterations),
            physicsClientId=self._client,
        )
        self._cold = True
        axes = self._axes
        pybullet.resetBasePositionAndOrientation(
            self._rock, *axes.pose_into(pose), physicsClientId=self._client
        )
        pybullet.resetBaseVelocity(
            self._rock,
            axes.into(velocity_m_s),
            axes.into(angular_velocity_rad_s),
            physicsClientId=self._client,
        )
        # Takes the rock out of the broad phase and back: only so do contacts get the new threshold.
        pybullet.setCollisionFilterGroupMask(self._rock, -1, 1, -1, physicsClientId=self._client)

    def rebound(self, duration_s: float, pull_m_s2: tuple[float, float, float]) -> Pose:
        """Advance by the step that begins as points touch down: they leave with Newton's share of their speed.

        Contacts that are only prepared must not rebound: Bullet would give them e times their speed less what closes
        the gap, and so take speed from the fall.
        """
        restitution, client = self._surface.restitution, self._client
        if restitution == 0.0:
            return self.step(duration_s, pull_m_s2)
        # Bullet multiplies the two bodies' coefficients; the rock's is 1.
        pybullet.changeDynamics(self._ground, -1, restitution=restitution, physicsClientId=client)
        pose = self.step(duration_s, pull_m_s2)
        pybullet.changeDynamics(self._ground, -1, restitution=0.0, physicsClientId=client)
        return pose

    def step(self, duration_s: float, pull_m_s2: tuple[float, float, float]) -> Pose:
        """Advance by one step under a constant pull (gravity less ground acceleration), support frame."""
        if duration_s != self._time_step_s:
            pybullet.setPhysicsEngineParameter(fixedTimeStep=duration_s, physicsClientId=self._client)
            self._time_step_s = duration_s
        pybullet.setGravity(*self._axes.into(pull_m_s2), self._client)
        pybullet.stepSimulation(self._client)
        if self._cold:
            self._cold = False
            pybullet.setPhysicsEngineParameter(
                numSolverIterations=self._iterations, physicsClientId=self._client
            )
        if self._follows_slip:
            self._follow_slip()
        return self._axes.pose_out(pybullet.getBasePositionAndOrientation(self._rock, self._client))

    def run(self, duration_s: float, pulls_m_s2: list[list[float]], poses: list[Pose]) -> None:
        """Advance by one step for each pull and append the poses: the inner loop, as bare as Python allows."""
        if self._cold or duration_s != self._time_step_s:
            x, y, z = pulls_m_s2[0]
            poses.append(self.step(duration_s, (x, y, z)))
            pulls_m_s2 = pulls_m_s2[1:]
        if self._follows_slip:
            poses += [self.step(duration_s, (x, y, z)) for x, y, z in pulls_m_s2]
            return
        client, rock, axes = self._client, self._rock, self._axes
        set_gravity, step = pybullet.setGravity, pybullet.stepSimulation
        seen: list[Pose] = []
        pose, append = pybullet.getBasePositionAndOrientation, seen.append
        for x, y, z in map(axes.into, pulls_m_s2):
            set_gravity(x, y, z, client)
            step(client)
            append(pose(rock, client))
        poses += map(axes.pose_out, seen)

    def _add_rock(self) -> int:
        contact = self._contact
        with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
            file.write(_urdf(contact.centres_body_m[: self.points], contact.radius_m, contact))
            file.flush()
            rock = pybullet.loadURDF(
                file.name,
                basePosition=contact.com_m.tolist(),
                baseOrientation=contact.start_quaternion_xyzw.tolist(),
                flags=pybullet.URDF_USE_INERTIA_FROM_FILE,  # else that of the shapes' bounding boxes
                physicsClientId=self._client,
            )
        pybullet.changeDynamics(
            rock,
            -1,
            mass=1.0,
            localInertiaDiagonal=contact.principal_inertia_m2.tolist(),
            lateralFriction=1.0,
            spinningFriction=0.0,
            rollingFriction=0.0,
            restitution=1.0,
            linearDamping=0.0,
            angularDamping=0.0,
            jointDamping=0.0,
            maxJointVelocity=1e9,
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            physicsClientId=self._client,
        )
        return rock

    def _add_pedestal(self) -> int:
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=self._client)
        ground = pybullet.createMultiBody(0.0, plane, physicsClientId=self._client)
        pybullet.changeDynamics(ground, -1, restitution=0.0, physicsClientId=self._client)
        return ground


def _urdf(centres_m: Array, radius_m: float, contact: ContactModel) -> str:
    """Spheres as one compound body: the other ways to make one keep sixteen shapes at most. One short line each."""
    spheres = "\n".join(
        f'<collision><origin xyz="{x!r} {y!r} {z!r}"/><geometry><sphere radius="{radius_m!r}"/></geometry></collision>'
        for x, y, z in centres_m.tolist()
    )
    ixx, iyy, izz = contact.principal_inertia_m2.tolist()
    return (
        '<robot name="rock">\n<link name="base">\n<inertial>\n<mass value="1"/>\n'
        f'<inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>\n</inertial>\n'
        f"{spheres}\n</link>\n</robot>\n"
    )


_CLIENTS: dict[int, int] = {}


def _client(slot: int) -> int:
    """The process's connections to Bullet; worlds are reset, not made anew, since only that frees their memory."""
    if slot not in _CLIENTS:
        _CLIENTS[slot] = pybullet.connect(pybullet.DIRECT)
        atexit.register(pybullet.disconnect, _CLIENTS[slot])
    return _CLIENTS[slot]
