"""PyBullet, and the only module that imports it: a rock of contact points over a plane, stepped one step at a time."""

from __future__ import annotations

import atexit
import tempfile

import numpy as np
import pybullet
from numpy.typing import NDArray

from workers.contact import ContactModel

Array = NDArray[np.float64]
Pose = tuple[tuple[float, float, float], tuple[float, float, float, float]]

POINT_RADIUS_SHARE = 1e-5
"""Radius of a contact point over R. The sphere's lowest point is the contact point: a fillet, not an offset."""

NEAR_SHARE, FAR_SHARE = 3e-4, 3e-2
"""Contacts are prepared within these shares of R, so that a landing stops at the surface and not below it. The near one
catches every landing that is too slow to cut a step at, and keeps the solver's work small; the far one serves around a
cut."""

COLD_ITERATIONS = 100
"""Of the first step in a new state, which has no impulses of a step before to start from."""

RESIDUAL_SHARE = 1e-3
"""The solver stops before its last iteration once no impulse (at unit mass) changes by more than this share of
gravity's in a step."""


class Engine:
    """One rock in a world of its own, in the support frame.

    Parameters
    ----------
    contact : ContactModel
    points : int
        How many of the rock's contact points the world holds, from the first.
    friction : float
        Coefficient of the pair.
    impulse_m_s : float
        Velocity that gravity gives in one step: what the solver's residual is measured against.
    iterations : int
        Most iterations of the solver in a step.
    slot : int
        Which of the process's worlds to use; an earlier engine in it is lost.
    """

    def __init__(
        self,
        contact: ContactModel,
        points: int,
        friction: float,
        impulse_m_s: float,
        iterations: int,
        slot: int,
    ) -> None:
        self._client = _client(slot)
        self._contact = contact
        self._iterations = iterations
        self.points = points
        pybullet.resetSimulation(physicsClientId=self._client)
        pybullet.setPhysicsEngineParameter(
            numSubSteps=0,
            numSolverIterations=iterations,
            solverResidualThreshold=(RESIDUAL_SHARE * impulse_m_s) ** 2,
            deterministicOverlappingPairs=1,
            enableConeFriction=1,
            contactSlop=0.0,
            physicsClientId=self._client,
        )
        self._time_step_s, self._cold = 0.0, True
        self._aloft: Pose = ((0.0, 0.0, 100.0 * contact.half_diagonal_m), (0.0, 0.0, 0.0, 1.0))
        self._rock = self._add_rock()
        self._ground = self._add_pedestal()
        self.set_friction(friction)

    def set_friction(self, friction: float) -> None:
        """Replace the coefficient of friction of the pair."""
        # Bullet multiplies the two bodies' coefficients; the rock's is 1.
        pybullet.changeDynamics(self._ground, -1, lateralFriction=friction, physicsClientId=self._client)

    def set_state(
        self, pose: Pose, velocity_m_s: Array, angular_velocity_rad_s: Array, *, far: bool = False
    ) -> None:
        """Place the rock and set it going; forgets all contacts.

        From here on contacts are prepared within FAR_SHARE of R (`far`) or NEAR_SHARE.
        """
        pybullet.setPhysicsEngineParameter(
            contactBreakingThreshold=FAR_SHARE if far else NEAR_SHARE,
            numSolverIterations=max(COLD_ITERATIONS, self._iterations),
            physicsClientId=self._client,
        )
        self._cold = True
        # A step out of reach, or the solver starts from remains of the last one.
        pybullet.resetBasePositionAndOrientation(self._rock, *self._aloft, physicsClientId=self._client)
        pybullet.resetBaseVelocity(self._rock, [0.0] * 3, [0.0] * 3, physicsClientId=self._client)
        pybullet.setGravity(0.0, 0.0, 0.0, self._client)
        pybullet.stepSimulation(self._client)
        pybullet.resetBasePositionAndOrientation(self._rock, *pose, physicsClientId=self._client)
        pybullet.resetBaseVelocity(
            self._rock, velocity_m_s.tolist(), angular_velocity_rad_s.tolist(), physicsClientId=self._client
        )
        # Takes the rock out of the broad phase and back: only so do contacts get the new threshold.
        pybullet.setCollisionFilterGroupMask(self._rock, -1, 1, -1, physicsClientId=self._client)

    def step(self, duration_s: float, pull_m_s2: tuple[float, float, float]) -> Pose:
        """Advance by one step under a constant pull (gravity less ground acceleration), support frame."""
        if duration_s != self._time_step_s:
            pybullet.setPhysicsEngineParameter(fixedTimeStep=duration_s, physicsClientId=self._client)
            self._time_step_s = duration_s
        pybullet.setGravity(*pull_m_s2, self._client)
        pybullet.stepSimulation(self._client)
        if self._cold:
            self._cold = False
            pybullet.setPhysicsEngineParameter(
                numSolverIterations=self._iterations, physicsClientId=self._client
            )
        return pybullet.getBasePositionAndOrientation(self._rock, self._client)

    def run(self, duration_s: float, pulls_m_s2: list[list[float]], poses: list[Pose]) -> None:
        """Advance by one step for each pull and append the poses: the inner loop, as bare as Python allows."""
        if self._cold or duration_s != self._time_step_s:
            x, y, z = pulls_m_s2[0]
            poses.append(self.step(duration_s, (x, y, z)))
            pulls_m_s2 = pulls_m_s2[1:]
        client, rock = self._client, self._rock
        set_gravity, step = pybullet.setGravity, pybullet.stepSimulation
        pose, append = pybullet.getBasePositionAndOrientation, poses.append
        for x, y, z in pulls_m_s2:
            set_gravity(x, y, z, client)
            step(client)
            append(pose(rock, client))

    def _add_rock(self) -> int:
        contact = self._contact
        radius = POINT_RADIUS_SHARE * contact.half_diagonal_m
        up_body = contact.support_from_body.T @ np.array([0.0, 0.0, 1.0])
        with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
            centres = contact.points_body_m[: self.points] + radius * up_body
            file.write(_urdf(centres, radius, contact))
            file.flush()
            rock = pybullet.loadURDF(
                file.name,
                basePosition=contact.com_m.tolist(),
                baseOrientation=contact.start_quaternion_xyzw.tolist(),
                flags=pybullet.URDF_USE_INERTIA_FROM_FILE,  # else that of the shapes' bounding boxes
                useMaximalCoordinates=1,  # a rigid body: its rows cost a third of a multibody's, and creep less
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
            restitution=0.0,
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
        ground = pybullet.createMultiBody(0.0, plane, useMaximalCoordinates=1, physicsClientId=self._client)
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
