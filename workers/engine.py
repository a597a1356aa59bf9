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
"""Radius of a contact point over R. The sphere's lowest point is the contact point, so this is a fillet, not an offset."""

SPECULATIVE_SHARE = 5e-3
"""Contacts are prepared within this share of R, so that a landing stops at the surface and not below it."""

SOLVER_ITERATIONS = 50

RESIDUAL_SHARE = 1e-3
"""The solver stops before its last iteration once no impulse (at unit mass) changes by more than this share of gravity's
in a step: overturning thresholds then agree with fifty iterations within 0.02 %, at half the cost at rest."""

ROCK_ON_GROUND, EDGE_ON_FACE = 1, 2


class Engine:
    """One rock in one world, in the support frame. One engine at a time lives in a process.

    Parameters
    ----------
    contact : ContactModel
    friction : float
        Coefficient of the pair.
    impulse_m_s : float
        Velocity that gravity gives in one step: what the solver's residual is measured against.
    """

    def __init__(self, contact: ContactModel, friction: float, impulse_m_s: float) -> None:
        self._client = _client()
        self._contact = contact
        pybullet.resetSimulation(physicsClientId=self._client)
        pybullet.setPhysicsEngineParameter(
            numSubSteps=0,
            numSolverIterations=SOLVER_ITERATIONS,
            solverResidualThreshold=(RESIDUAL_SHARE * impulse_m_s) ** 2,
            deterministicOverlappingPairs=1,
            enableConeFriction=1,
            contactSlop=0.0,
            contactBreakingThreshold=SPECULATIVE_SHARE,
            physicsClientId=self._client,
        )
        self._time_step_s = 0.0
        self._rock = self._add_rock()
        self._grounds = self._add_pedestal()
        self.set_friction(friction)

    def set_friction(self, friction: float) -> None:
        """Replace the coefficient of friction of the pair."""
        for ground in self._grounds:  # Bullet multiplies the two bodies' coefficients; the rock's is 1
            pybullet.changeDynamics(ground, -1, lateralFriction=friction, physicsClientId=self._client)

    def set_state(self, pose: Pose, velocity_m_s: Array, angular_velocity_rad_s: Array) -> None:
        """Place the rock and set it going; forgets all contacts."""
        pybullet.resetBasePositionAndOrientation(self._rock, *pose, physicsClientId=self._client)
        pybullet.resetBaseVelocity(
            self._rock, velocity_m_s.tolist(), angular_velocity_rad_s.tolist(), physicsClientId=self._client
        )

    def step(self, duration_s: float, pull_m_s2: tuple[float, float, float]) -> Pose:
        """Advance by one step under a constant pull (gravity less ground acceleration), support frame."""
        if duration_s != self._time_step_s:
            pybullet.setPhysicsEngineParameter(fixedTimeStep=duration_s, physicsClientId=self._client)
            self._time_step_s = duration_s
        pybullet.setGravity(*pull_m_s2, self._client)
        pybullet.stepSimulation(self._client)
        return pybullet.getBasePositionAndOrientation(self._rock, self._client)

    def run(self, duration_s: float, pulls_m_s2: list[list[float]], poses: list[Pose]) -> None:
        """Advance by one step for each pull and append the poses: the inner loop, as bare as Python allows."""
        if duration_s != self._time_step_s:
            pybullet.setPhysicsEngineParameter(fixedTimeStep=duration_s, physicsClientId=self._client)
            self._time_step_s = duration_s
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
            file.write(_urdf(contact.points_body_m + radius * up_body, radius, contact))
            file.flush()
            rock = pybullet.loadURDF(
                file.name,
                basePosition=contact.com_m.tolist(),
                baseOrientation=contact.start_quaternion_xyzw.tolist(),
                useMaximalCoordinates=0,
                physicsClientId=self._client,
            )
        for link in range(-1, pybullet.getNumJoints(rock, physicsClientId=self._client)):
            pybullet.changeDynamics(
                rock,
                link,
                lateralFriction=1.0,
                spinningFriction=0.0,
                rollingFriction=0.0,
                restitution=0.0,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
                physicsClientId=self._client,
            )
        pybullet.changeDynamics(
            rock,
            -1,
            mass=1.0,
            localInertiaDiagonal=contact.principal_inertia_m2.tolist(),
            maxJointVelocity=1e9,
            physicsClientId=self._client,
        )
        self._filter(rock, -1, ROCK_ON_GROUND)
        return rock

    def _add_pedestal(self) -> list[int]:
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=self._client)
        ground = pybullet.createMultiBody(0.0, plane, physicsClientId=self._client)
        pybullet.changeDynamics(ground, -1, restitution=0.0, physicsClientId=self._client)
        self._filter(ground, -1, ROCK_ON_GROUND)
        return [ground]

    def _filter(self, body: int, link: int, group: int) -> None:
        pybullet.setCollisionFilterGroupMask(body, link, group, group, physicsClientId=self._client)



def _urdf(centres_body_m: Array, radius_m: float, contact: ContactModel) -> str:
    """Spheres as one compound body: the other ways to make one keep sixteen shapes at most. One short line each."""
    spheres = "\n".join(
        f'<collision><origin xyz="{x!r} {y!r} {z!r}"/><geometry><sphere radius="{radius_m!r}"/></geometry></collision>'
        for x, y, z in centres_body_m.tolist()
    )
    ixx, iyy, izz = contact.principal_inertia_m2.tolist()
    return (
        '<robot name="rock">\n<link name="base">\n<inertial>\n<mass value="1"/>\n'
        f'<inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>\n</inertial>\n'
        f"{spheres}\n</link>\n</robot>\n"
    )


_CLIENTS: list[int] = []


def _client() -> int:
    """The process's one connection to Bullet; worlds are reset, not made anew, since only that frees their memory."""
    if not _CLIENTS:
        _CLIENTS.append(pybullet.connect(pybullet.DIRECT))
        atexit.register(pybullet.disconnect, _CLIENTS[0])
    return _CLIENTS[0]
