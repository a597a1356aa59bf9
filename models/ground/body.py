"""A scene prepared for contacts with normals of their own: meshes, mass, where the rock rests, and statics on it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from toppling.models.caching import cached
from toppling.models.compiled import Array, Flags
from toppling.models.errors import InputError
from toppling.models.frames import plane_axes
from toppling.models.ground.contacts import CONTACT, LEANING, MOST
from toppling.models.ground.equilibrium import are_held, wrenches
from toppling.models.ground.facets import NO_FACETS, Facets, facets_below, not_looked_at
from toppling.models.ground.mesh import ContactMesh, contact_mesh, not_touching, smooth_parts
from toppling.models.ground.pairs import Lists, empty_lists
from toppling.models.ground.plane import FLAT_SHARE, NO_POINTS
from toppling.models.ground.rolling import FIRST_KEY, rolling_surface
from toppling.models.ground.stepping import Grounded, contacts_at, settle, unmoved
from toppling.models.pedestal import FARTHEST_SETTLING, TOPPLED_TILT_DEG, Pedestal
from toppling.models.pivots import Turn, balanced_on
from toppling.models.rock import Rock
from toppling.models.smooth_mesh import patches_of, smooth_mesh_of

GROUND_REACH = 4.0
"""Ground within this many R of the rock is looked at."""

FOUND_WITHIN = 0.1
"""Distance over R within which features are found."""

RESTING_SHARE = 1e-4
"""Gap over R up to which a contact may carry a rock at rest."""

_ALMOST_SHARE = 0.01
"""Search distance over R for the contacts of a shifted rock, to which twice its latest shift is added."""

_FOOT = 0.2
"""Share of the rock's height below which contacts are those of its base."""

SETTLING_STEP = 0.05
"""Time step over sqrt(R / g) with which a rock is let down."""

_SETTLING_STEPS, _ROLLING_STEPS = ((SETTLING_STEP, 4000),), ((0.3, 100), (1.0, 1000))
"""Time steps over sqrt(R / g), and their largest number, with which a rock that is let down, or rolls, comes to rest.

In the first a free fall goes by 10 R, farther than any rest that counts; the longer the last, the less is left to roll.
"""

_NO_SLOPE = 1e-8
"""Displacement over R in such a step below which a rolled rock is at rest."""

_NUDGE_RAD = 1e-3

_OF_POINT, _OF_EDGES = 0, 2
"""Kinds of contacts in their keys: of a point, and of an edge, of the rock that stand out."""

_ROLLS, _ROLLED_DEG = 8, 0.5
"""Number of directions, and the angle, in which a rounded base may roll until the rock stands."""


@dataclass(frozen=True, eq=False)
class GroundedBody:
    """A rock and the ground around it, support frame: origin in the interface plane, z its normal.

    What is smooth of a rounded base has triangles in the rock's mesh, but no points and edges that touch.
    """

    rock: ContactMesh  # body axes: those of the principal inertia, from the centre of mass
    rounded: Facets  # the rounded base over the ground's facets
    ground: ContactMesh
    inertia_m2: Array  # (3,): principal moments over mass
    pose: Array  # (7,) of the scene: centre of mass, attitude as a quaternion x, y, z, w
    scene_from_support: Array  # (3, 3)
    size_m: float  # R
    gravity_m_s2: float
    friction: tuple[float, float]  # static, kinetic

    @cached_property
    def farthest_m(self) -> float:
        """From the centre of mass to the rock's farthest vertex."""
        return float(np.linalg.norm(self.rock.vertices_m, axis=1).max())

    @cached_property
    def _lists(self) -> Lists:
        return self.empty_lists()

    def empty_lists(self) -> Lists:
        """Lists in which nothing is found yet of what may touch."""
        return empty_lists(self.size_m, self.farthest_m)

    def contacts(
        self, pose: Array, margin_m: float, leaning: float = LEANING, most: int = MOST
    ) -> np.ndarray:
        """Contacts (records of CONTACT) in a pose (7,), the nearest; margin and leaning as of :func:`contacts_in`."""
        pose, out = np.ascontiguousarray(pose), np.empty(most, CONTACT)
        # Where the place stays at a seam of patches, what is found depends on what the search begins with.
        self.rounded.angles[:], self.rounded.lowest[:] = 0.0, self.rounded.surface.lowest[:, None, None]
        bodies = self.rock, self.ground, self.rounded
        return out[: contacts_at(bodies, pose, margin_m, leaning, self._lists, out)]

    def wrenches(self, pose: Array) -> Array:
        """What the contacts that may carry in a pose can give, as :func:`equilibrium.wrenches`."""
        near = self.contacts(pose, RESTING_SHARE * self.size_m)
        return wrenches(near["arm_m"], near["normal"], self.friction[0])

    def near_contacts(self, pose: Array, within_m: float) -> np.ndarray:
        """Contacts with gaps up to some way, and those of a rounded base that has rolled a little in any direction."""
        near = self.contacts(pose, within_m)
        smooth = {int(contact["key"]): contact for contact in near if contact["key"] >= FIRST_KEY}
        more = [near]
        for turn in 2.0 * np.pi * np.arange(_ROLLS) / _ROLLS if smooth else ():
            roll = Rotation.from_rotvec(np.radians(_ROLLED_DEG) * np.array([np.cos(turn), np.sin(turn), 0.0]))
            attitude = (roll * Rotation.from_quat(pose[3:])).as_quat()
            margin_m = within_m + np.radians(_ROLLED_DEG) * self.farthest_m
            rolled = self.contacts(np.concatenate([pose[:3], attitude]), margin_m)
            rolled = rolled[np.isin(rolled["key"], list(smooth))]
            rolled["arm_m"] = roll.inv().apply(rolled["arm_m"])
            rolled["place_m"] = pose[:3] + rolled["arm_m"]
            for contact in rolled:
                contact["normal"] = smooth[int(contact["key"])]["normal"]
            more.append(rolled)
        return np.concatenate(more)

    def load_m_s2(self, acceleration_m_s2: Array | None = None) -> Array:
        """Gravity less a ground acceleration (3,) of the scene's axes, in those of the support."""
        force = np.array([0.0, 0.0, -self.gravity_m_s2])
        return (force if acceleration_m_s2 is None else force - acceleration_m_s2) @ self.scene_from_support

    def stands(self, pose: Array) -> bool:
        """Whether the rock rests in a pose, or in one that it would roll into: held, and not merely balanced."""
        near = self.near_contacts(pose, RESTING_SHARE * self.size_m)
        return bool(self.hold(near, self.load_m_s2()[None])[0]) and self._balanced_on(near) is None

    def _balanced_on(self, near: np.ndarray) -> Turn | None:
        """The rotation with which a rock that contacts hold falls at the least touch; None if it rests, or rolls."""
        if (near["key"] >= FIRST_KEY).any():
            return None
        return balanced_on(near["arm_m"], near["normal"], self.size_m, self.load_m_s2())

    def hold(self, contacts: np.ndarray, loads_m_s2: Array) -> Flags:
        """Which loads (n, 3), in the axes of the support, some contacts hold."""
        columns = wrenches(contacts["arm_m"], contacts["normal"], self.friction[0])
        return are_held(columns, loads_m_s2, self.size_m)

    @property
    def facets(self) -> Facets:
        """The rounded base over facets, with nothing looked up yet."""
        return not_looked_at(self.rounded)

    @property
    def rolls_on_facets(self) -> bool:
        """Whether the rock touches with a smooth surface."""
        return len(self.rounded.apart_m) > 0

    @cached_property
    def moving(self) -> tuple[ContactMesh, ContactMesh]:
        """Rock and ground with their smooth parts numbered, for a rock that gathers speed."""
        return smooth_parts(self.rock, self.size_m), smooth_parts(self.ground, self.size_m)

    def clockless(self, pose: Array, step_s: float) -> Grounded:
        """The rock in a pose, to be moved without a motion."""
        friction = self.friction[0], self.friction[0]
        return unmoved(NO_POINTS, self.farthest_m, self.inertia_m2, self.size_m, friction)._replace(
            rock=self.rock, ground=self.ground, facets=self.facets, lists=self.empty_lists(),
            gravity_m_s2=self.load_m_s2(), step_s=step_s, pose=np.array([pose]),
        )  # fmt: skip

    def touching(self, pose: Array) -> Array:
        """A pose shifted along the plumb line to where the rock just touches.

        Raises
        ------
        InputError
            If the rock is farther from the ground than a tenth of its size, or as deep in it.
        """
        pose, up = pose.copy(), self.scene_from_support[2]
        most_m = margin_m = FOUND_WITHIN * self.size_m
        for _ in range(20):
            near = self.contacts(pose, margin_m)
            carrying = near[near["normal"] @ up > 0.1]
            if len(carrying) == 0:
                raise not_touching(most_m)
            rise = -float((carrying["gap_m"] / (carrying["normal"] @ up)).min())
            rise = min(rise, most_m)  # along a steep contact it would leave all others
            pose[:3] += rise * up
            if abs(rise) < 1e-9 * self.size_m:
                break
            margin_m = min(2.0 * abs(rise) + _ALMOST_SHARE * self.size_m, most_m)
        return pose

    @cached_property
    def resting_pose(self) -> Array:
        """The pose in which the rock stands: that of the scene if its contacts hold it, else let down from it.

        One that is balanced, or may be, as it touches with its smooth surface and with no point or edge beside it, is
        turned a little, and goes back or falls.
        """
        pose = self.touching(self.pose)
        near = self.contacts(pose, RESTING_SHARE * self.size_m)
        own = np.isin(near["key"] >> 60, (_OF_POINT, _OF_EDGES)).any()
        turn = None if own or not self.rolls_on_facets else Turn(np.zeros(3), np.array([1.0, 0.0, 0.0]))
        if self.hold(near, self.load_m_s2()[None])[0]:
            turn = turn or self._balanced_on(near)
            if turn is None:
                return pose
        if turn is not None:
            nudge = Rotation.from_rotvec(_NUDGE_RAD * turn.axis)
            moved_m, attitude = turn.arm_m - nudge.apply(turn.arm_m), nudge * Rotation.from_quat(pose[3:])
            pose = np.concatenate([pose[:3] + moved_m, attitude.as_quat()])
        return self.rolled_to_rest(pose) if self.rolls_on_facets else self.settled(pose, self.load_m_s2())

    def settled(self, pose: Array, load_m_s2: Array) -> Array:
        """The pose in which a rock comes to rest under a load without gathering speed."""
        for step, sweeps in _ROLLING_STEPS if self.rolls_on_facets else _SETTLING_STEPS:
            sim = self.clockless(pose, step * math.sqrt(self.size_m / self.gravity_m_s2))
            settle(sim, load_m_s2, sweeps, _NO_SLOPE * self.size_m)
            pose = sim.pose[0].copy()
        return pose

    def rolled_to_rest(self, pose: Array) -> Array:
        """The pose in which a rock on a rounded base has no slope, rolled to without gathering speed."""
        pose = self.settled(pose, self.load_m_s2())
        near = self.contacts(pose, RESTING_SHARE * self.size_m)
        return self.touching(pose) if (near["normal"] @ self.scene_from_support[2] > 0.1).any() else pose

    @cached_property
    def rests_nearby(self) -> bool:
        """Whether it stands in the pose of the scene or, having settled, near it.

        One that rolls may move farther, by the rotation of its base.
        """
        pose = self.resting_pose
        upright = self._up_in_body(self.pose)
        tilt_rad = float(np.arccos(np.clip(upright @ self._up_in_body(pose), -1.0, 1.0)))
        most_m = FARTHEST_SETTLING * np.ptp(self.rock.vertices_m @ upright)
        if self.rolls_on_facets:
            most_m += tilt_rad * self.farthest_m
        near = np.linalg.norm(pose[:3] - self.pose[:3]) <= most_m and np.degrees(tilt_rad) <= TOPPLED_TILT_DEG
        return bool(near) and self.stands(pose)

    @cached_property
    def leans(self) -> bool:
        """Whether it stands, and would not on those contacts alone that lie at its foot."""
        pose = self.resting_pose
        near = self.near_contacts(pose, RESTING_SHARE * self.size_m)
        up = self.scene_from_support[2]
        over_m, height_m = near["place_m"] @ up, np.ptp(self.rock.vertices_m @ self._up_in_body(pose))
        bottom = near[over_m - over_m.min(initial=np.inf) < _FOOT * height_m]
        return self.stands(pose) and not self.hold(bottom, self.load_m_s2()[None])[0]

    def _up_in_body(self, pose: Array) -> Array:
        """The upward direction (3,) in body axes, in a pose."""
        return Rotation.from_quat(pose[3:]).inv().apply(self.scene_from_support[2])

    @classmethod
    def of(
        cls,
        rock: Rock,
        pedestal: Pedestal,
        gravity_m_s2: float,
        friction: tuple[float, float],
        *,
        smooth: bool = False,
        band_m: float = -np.inf,
    ) -> GroundedBody:
        """A rock on a pedestal; smooth: with the surface that a rounded base stands for.

        band_m: height over the interface plane up to which feet, if any, replace the rock's vertices.
        """
        turn = np.column_stack([*plane_axes(pedestal.normal), pedestal.normal])
        moments, axes = rock.principal_axes(turn)
        com, size = (rock.com_m - pedestal.point_m) @ turn, rock.half_diagonal_m
        # The clearances of feet tell the ground's relief, and so far it is the interface plane.
        off_m = 0.0 if rock.feet_m is None else FLAT_SHARE * rock.height_m
        if rock.feet_m is not None:  # drawn over the plane: on the mesh it stands on the hull of its feet
            own_m = rock.vertices_m[(rock.vertices_m - pedestal.point_m) @ pedestal.normal > band_m]
            hull = trimesh.convex.convex_hull(np.vstack([own_m, rock.feet_m]))
            rock = dataclasses.replace(
                rock, vertices_m=np.array(hull.vertices), faces=np.array(hull.faces, np.int64)
            )
        body_m = (rock.vertices_m - rock.com_m) @ turn @ axes
        reach, far = FOUND_WITHIN * size, GROUND_REACH * size
        vertices_m, ground_faces = pedestal.triangles(rock.com_m, 2.0 * far)
        ground_m = (vertices_m - pedestal.point_m) @ turn
        ground_m[:, 2] -= np.clip(ground_m[:, 2], -off_m, off_m)
        ground = contact_mesh(ground_m, ground_faces, com - far, com + far, reach)
        mesh, patches = (smooth_mesh_of(rock), patches_of(rock)) if smooth else (None, None)
        faces, touching, rounded = rock.faces, None, NO_FACETS
        if mesh is not None and patches is not None:
            body_m, faces, touching = (mesh.vertices_m - rock.com_m) @ turn @ axes, mesh.faces, ~mesh.inner
            rounded = facets_below(rolling_surface(patches, rock.com_m, turn @ axes), ground)
        return cls(
            rock=contact_mesh(body_m, faces, body_m.min(axis=0), body_m.max(axis=0), reach, touching),
            rounded=rounded,
            ground=ground,
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
        if not self.rests_nearby:
            raise InputError(
                "rock.does_not_stand",
                "left alone, the rock does not stand on its pedestal's surface",
                where=where,
                expected="a rock that stands by itself in the pose of the scene",
                remedy="check the frames of rock and pedestal, the friction, and the split of the two",
            )
        pose, turn = self.resting_pose, self.scene_from_support
        com = pose[:3] @ turn.T + pedestal.point_m
        moved = Rotation.from_quat(pose[3:]) * Rotation.from_quat(self.pose[3:]).inv()
        rotation = turn @ moved.as_matrix() @ turn.T
        return rock.moved(rotation, com - rotation @ rock.com_m)


@cached
def grounded_body(
    rock: Rock,
    pedestal: Pedestal,
    gravity_m_s2: float,
    friction: tuple[float, float],
    smooth: bool,
    band_m: float,
) -> GroundedBody:
    """As :meth:`GroundedBody.of`; the same one for all scenes that share rock and pedestal."""
    return GroundedBody.of(rock, pedestal, gravity_m_s2, friction, smooth=smooth, band_m=band_m)
