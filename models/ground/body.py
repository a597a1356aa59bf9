"""A scene prepared for contacts with normals of their own: meshes, mass, where the rock rests, and statics on it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.compiled import Array
from toppling.models.errors import InputError
from toppling.models.frames import horizontal_unit_vector, plane_axes
from toppling.models.ground.contacts import CONTACT, LEANING, MOST, contacts_at
from toppling.models.ground.creeping import largest_held_m_s2, settle
from toppling.models.ground.curved import NO_CURVED, CurvedGround, untouched
from toppling.models.ground.dome import curved_ground
from toppling.models.ground.equilibrium import are_held, held_polygon, wrenches
from toppling.models.ground.mesh import ContactMesh, contact_mesh
from toppling.models.ground.pairs import Pairs, no_pairs
from toppling.models.ground.rolling import NO_ROLLING
from toppling.models.ground.stepping import Grounded, work_room
from toppling.models.kept import kept
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock

_GROUND_REACH = 4.0
"""Ground within this many R of the rock is looked at."""

FOUND_WITHIN = 0.1
"""Of R: within it features are found."""

RESTING_SHARE = 1e-4
"""Of R: contacts so near a rock at rest may carry it."""

_QUASI_STATIC_STEP = 0.003
"""Of sqrt(R / g): time step of a rock that tips without gathering speed."""

_FOLLOWED_SHARE = 0.4
"""Of R: way on which a rock that tips is followed past the largest: over the facets of a coarse rounded base."""

_FOOT = 0.2
"""Of the rock's extent upward: contacts below are its foot."""

_FARTHEST_SETTLING = 0.1
"""Of the rock's height: a centre of mass that comes to rest farther from where the scene has it has fallen."""

PAIRS = 1 << 16
"""Room for pairs of features that may touch."""


@dataclass(frozen=True, eq=False)
class GroundedBody:
    """A rock and the ground around it, support frame: origin in the interface plane, z its normal.

    Parameters
    ----------
    rock : ContactMesh
        In body axes: those of the principal inertia, from the centre of mass.
    ground : ContactMesh
    inertia_m2 : (3,) array
        Principal moments over mass.
    pose : (7,) array
        Of the scene: centre of mass, attitude as a quaternion x, y, z, w.
    scene_from_support : (3, 3) array
    size_m : float
        R.
    gravity_m_s2 : float
    friction : (static, kinetic)
    """

    rock: ContactMesh
    ground: ContactMesh
    inertia_m2: Array
    pose: Array
    scene_from_support: Array
    size_m: float
    gravity_m_s2: float
    friction: tuple[float, float]

    @cached_property
    def farthest_m(self) -> float:
        """From the centre of mass to the rock's farthest vertex."""
        return float(np.linalg.norm(self.rock.vertices_m, axis=1).max())

    @cached_property
    def _room(self) -> Pairs:
        return no_pairs(PAIRS)

    def contacts(
        self, pose: Array, margin_m: float, leaning: float = LEANING, most: int = MOST
    ) -> np.ndarray:
        """Contacts (records of CONTACT) in a pose (7,), the nearest; margin and leaning as of :func:`contacts_in`."""
        room, out = (self.rock, self.ground, np.ascontiguousarray(pose)), np.empty(most, CONTACT)
        return out[: contacts_at(*room, margin_m, leaning, self._room, out)]

    def wrenches(self, pose: Array) -> Array:
        """What the contacts that may carry in a pose can give, as :func:`equilibrium.wrenches`."""
        near = self.contacts(pose, RESTING_SHARE * self.size_m)
        return wrenches(near["arm_m"], near["normal"], self.friction[0])

    def load_m_s2(self, acceleration_m_s2: Array | None = None) -> Array:
        """Gravity less a ground acceleration (3,) of the scene's axes, in those of the support."""
        force = np.array([0.0, 0.0, -self.gravity_m_s2])
        return (force if acceleration_m_s2 is None else force - acceleration_m_s2) @ self.scene_from_support

    def stands(self, pose: Array) -> bool:
        """Whether its contacts can hold the rock in a pose."""
        return bool(are_held(self.wrenches(pose), self.load_m_s2()[None], self.size_m)[0])

    @property
    def curved(self) -> CurvedGround:
        """The smooth dome on which a flat base rolls, with nothing looked up yet: answers depend on no other shake."""
        return untouched(self._dome)

    @property
    def rolls_on_dome(self) -> bool:
        """Whether the ground is a smooth dome below a flat base."""
        return len(self._dome.coefficients) > 0

    @cached_property
    def _dome(self) -> CurvedGround:
        pose = self.resting_pose
        placed = pose[:3], Rotation.from_quat(pose[3:]).as_matrix()
        return curved_ground(self.rock, self.ground, placed, self.size_m)

    def clockless(self, pose: Array, step_s: float, curved: CurvedGround = NO_CURVED) -> Grounded:
        """The rock in a pose, to be moved without a motion."""
        return Grounded(
            self.rock, self.ground, NO_ROLLING, curved, no_pairs(PAIRS), np.zeros(MOST, CONTACT),
            np.zeros(MOST, CONTACT), np.zeros(7, np.int64), self.inertia_m2, self.size_m, self.farthest_m,
            (self.friction[0],) * 2, 0.0, 0.0, self.load_m_s2(), np.zeros((2, 6)), 1.0, step_s, 1, np.zeros(1),
            np.array([pose]), np.zeros((1, 6)),
            work_room(),
        )  # fmt: skip

    def touching(self, pose: Array) -> Array:
        """A pose shifted along the plumb line to where the rock just touches.

        Raises
        ------
        InputError
            If the rock is farther from the ground than a tenth of its size, or as deep in it.
        """
        pose, up = pose.copy(), self.scene_from_support[2]
        margin = FOUND_WITHIN * self.size_m
        for _ in range(20):
            near = self.contacts(pose, margin)
            carrying = near[near["normal"] @ up > 0.1]
            if len(carrying) == 0:
                raise InputError(
                    "the rock does not touch the ground",
                    where="scene",
                    expected=f"a rock within {margin:.3g} m of its pedestal's surface",
                    remedy="give rock and pedestal in one frame, the rock as it stands",
                )
            rise = -float((carrying["gap_m"] / (carrying["normal"] @ up)).min())
            pose[:3] += rise * up
            if abs(rise) < 1e-9 * self.size_m:
                break
        return pose

    @cached_property
    def resting_pose(self) -> Array:
        """The pose in which the rock stands: that of the scene if its contacts hold it, else let down from it."""
        pose = self.touching(self.pose)
        if self.stands(pose):
            return pose
        step_s = 0.05 * math.sqrt(self.size_m / self.gravity_m_s2)
        sim = self.clockless(pose, step_s)
        for _ in range(200):
            settle(sim, self.load_m_s2(), 200, 1e-7 * self.size_m)
            if self.stands(sim.pose[0]):
                break
        return sim.pose[0].copy()

    @cached_property
    def leans(self) -> bool:
        """Whether it stands, and would not on those contacts alone that lie at its foot."""
        pose = self.resting_pose
        near = self.contacts(pose, RESTING_SHARE * self.size_m)
        up = self.scene_from_support[2]
        over_m, height_m = near["place_m"] @ up, np.ptp(self.rock.vertices_m @ self._up_in_body(pose))
        foot = near[over_m - over_m.min(initial=np.inf) < _FOOT * height_m]
        columns = wrenches(foot["arm_m"], foot["normal"], self.friction[0])
        return self.stands(pose) and not are_held(columns, self.load_m_s2()[None], self.size_m)[0]

    def _up_in_body(self, pose: Array) -> Array:
        """The upward direction (3,) in body axes, in a pose."""
        return Rotation.from_quat(pose[3:]).inv().apply(self.scene_from_support[2])

    @cached_property
    def ground_in_scene_m(self) -> Array:
        """Vertices (n, 3) of the ground in the axes of the scene, from the support's origin."""
        return self.ground.vertices_m @ self.scene_from_support.T

    @cached_property
    def held(self) -> Array:
        """Half planes of the loads that hold the rock where it rests (:func:`equilibrium.held_polygon`)."""
        columns = self.wrenches(self.resting_pose)
        turn = np.kron(np.eye(2), self.scene_from_support)
        return held_polygon(turn @ columns, self.size_m)

    def quasi_static_toppling_m_s2(self, azimuths_deg: list[float]) -> list[tuple[float, float]]:
        """Largest constant horizontal ground acceleration at which the rock is in equilibrium, by azimuth.

        In the pose in which it rests, or in one that it tips into without gathering speed.
        """
        return [(azimuth, self._largest_held(azimuth)) for azimuth in azimuths_deg]

    def _largest_held(self, azimuth_deg: float) -> float:
        push = -horizontal_unit_vector(azimuth_deg) @ self.scene_from_support
        step_s = _QUASI_STATIC_STEP * math.sqrt(self.size_m / self.gravity_m_s2)
        # Once off the wall, a rock that leaned gathers speed: that it would stand upright as well is no answer.
        followed_m = 0.0 if self.leans else _FOLLOWED_SHARE * self.size_m
        sim = self.clockless(self.resting_pose, step_s, self.curved)
        return largest_held_m_s2(sim, push, 30.0 * self.gravity_m_s2, followed_m)

    @classmethod
    def of(
        cls, rock: Rock, pedestal: Pedestal, gravity_m_s2: float, friction: tuple[float, float]
    ) -> GroundedBody:
        """A rock on a pedestal that is a surface."""
        assert pedestal.vertices_m is not None
        assert pedestal.faces is not None
        turn = np.column_stack([*plane_axes(pedestal.normal), pedestal.normal])
        moments, axes = rock.principal_axes(turn)
        com = (rock.com_m - pedestal.point_m) @ turn
        body_m = (rock.vertices_m - rock.com_m) @ turn @ axes
        size = rock.half_diagonal_m
        reach, far = FOUND_WITHIN * size, _GROUND_REACH * size
        ground_m = (pedestal.vertices_m - pedestal.point_m) @ turn
        return cls(
            rock=contact_mesh(body_m, rock.faces, body_m.min(axis=0), body_m.max(axis=0), reach),
            ground=contact_mesh(ground_m, pedestal.faces, com - far, com + far, reach),
            inertia_m2=moments,
            pose=np.concatenate([com, Rotation.from_matrix(axes).as_quat()]),
            scene_from_support=turn,
            size_m=size,
            gravity_m_s2=gravity_m_s2,
            friction=friction,
        )

    def rock_at_rest(self, rock: Rock, pedestal: Pedestal, where: str) -> Rock:
        """The rock where it rests.

        Raises
        ------
        InputError
            If it comes to rest nowhere near.
        """
        pose = self.resting_pose
        turn = self.scene_from_support
        com = pose[:3] @ turn.T + pedestal.point_m
        if not self.stands(pose) or np.linalg.norm(com - rock.com_m) > _FARTHEST_SETTLING * rock.height_m:
            raise InputError(
                "left alone, the rock does not stand on its pedestal's surface",
                where=where,
                expected="a rock that stands by itself in the pose of the scene",
                remedy="check the frames of rock and pedestal, the friction, and the split of the two",
            )
        moved = Rotation.from_quat(pose[3:]) * Rotation.from_quat(self.pose[3:]).inv()
        rotation = turn @ moved.as_matrix() @ turn.T
        return rock.moved(rotation, com - rotation @ rock.com_m)


@kept
def grounded_body(
    rock: Rock, pedestal: Pedestal, gravity_m_s2: float, friction: tuple[float, float]
) -> GroundedBody:
    """As :meth:`GroundedBody.of`; the same one for all scenes that share rock and pedestal."""
    return GroundedBody.of(rock, pedestal, gravity_m_s2, friction)
