"""Statics of a rock on a surface, followed from pose to pose along the path on which a growing acceleration tips it.

A rock leaves a pose where a rotation without slip gains energy (:mod:`toppling.models.pivots`) and friction does not
prevent it: contacts with other normals, or at other heights, may hold on. Friction holds what the contact solver of the
shakes keeps at rest (:mod:`toppling.models.ground.equilibrium`); where it holds less than rest without slip takes, the
rock slides. It rolls by small steps over smooth contacts, on one along its equilibria. Where no pose near by supports
more, it falls under a slightly larger acceleration, by the time steps and impacts of the shakes, until it rests again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.caching import cached
from toppling.models.compiled import Array
from toppling.models.frames import horizontal_unit_vector
from toppling.models.ground.body import GroundedBody
from toppling.models.ground.contacts import LEANING, MOST
from toppling.models.ground.equilibrium import held_up_to_m_s2, shortest
from toppling.models.ground.facet_path import NO_HULL, NO_SLIP, fall, falling_under, unfinished
from toppling.models.ground.pairs import REACH
from toppling.models.ground.rolling import FIRST_KEY as FIRST_SMOOTH_KEY
from toppling.models.ground.stepping import Grounded, contacts_at
from toppling.models.pivots import OPENS, Turn, crossed, on_one_line, tips_m_s2, turn_under
from toppling.models.statics import STEEP, TOPPLED_TILT_DEG, Limits

_STEP_SHARE = 0.008
"""Longest step, as a fraction of the half diagonal R."""

_LEAST_STEP_SHARE = 2e-4
"""Shortest step, as a fraction of R, towards the peak of a rolling rock."""

_CLOSED = 0.01
"""Gap over that up to which a contact carries below which nothing is left to close."""

_TOUCHING_SHARE, _PRESSED_SHARE = 1e-6, 1e-5
"""Gap over R up to which a contact carries, and length of the step that closes gaps, as of a rock that was let down."""

_TIPPED_COSINE = math.cos(math.radians(TOPPLED_TILT_DEG))

_FALLEN = 3e-3
"""Height over R by which a rock has sunk that has fallen: in a fall of 4 degrees about an edge it sinks by less."""

_UNSURE, _MORE = 1e-3, 1e-4
"""Shares of an acceleration, and of g: up to which two are equal, as contacts are known to some micrometres, and by
which the one that moves a rock on exceeds the largest at rest."""

_LONGEST_FALL = 100
"""Number of times sqrt(R / g) in which a falling rock comes to rest."""

_ROLLED_RAD, _BALANCED_RAD, _MOST_CORRECTIONS = 1e-3, 1e-4, 3
"""Angle by which a rock on one smooth contact is rolled to see how its balance changes; from its equilibrium, of one
that is in it; and rotations, at most, by which it gets there."""

_NEUTRAL = 2e-3
"""Change of that balance with the angle rolled, over g R, below which there is none: that of a ball's mesh."""

_ROUNDING = 1e-12  # acceleration over g
_MOST_GRAVITIES = 30.0  # acceleration, over g, beyond which a pose supports any
_MOST_STEPS = 1200  # of a path


@cached
def limits_on_surface(body: GroundedBody, azimuths_deg: tuple[float, ...]) -> list[Limits]:
    """Statics of a rock by azimuth of the ground's acceleration; both 0 for one that falls by itself."""
    stands = body.rests_nearby
    return [
        Limits(float(azimuth), *(_followed(body, float(azimuth)) if stands else (0.0, 0.0)))
        for azimuth in azimuths_deg
    ]


def _followed(body: GroundedBody, azimuth_deg: float) -> tuple[float, float]:
    """Accelerations at which the rock tips, and slides, on the path of one azimuth.

    Raises InputError if the path does not end.
    """
    path = _Path(body, azimuth_deg)
    if any(path.ends() for _ in range(_MOST_STEPS)):
        return path.best_m_s2, path.slides_m_s2
    raise unfinished(azimuth_deg, _MOST_STEPS)


class _Support(NamedTuple):
    """What carries a rock in a pose."""

    apart: np.ndarray  # contacts that a step may reach, of which none touches yet
    touching: np.ndarray
    rolls: bool  # on smooth contacts alone
    rests: bool
    held_m_s2: float  # largest acceleration at rest
    slides_m_s2: float  # the one from which on friction does not hold what is at rest without slip


class _Path:
    """A rock under an acceleration that grows slowly toward one azimuth.

    Where no pose near by supports more than the best so far, the rock falls as in a shake. The path ends where it does
    not come to rest within the largest tilt, or where what stands beside the rock catches it.
    """

    def __init__(self, body: GroundedBody, azimuth_deg: float) -> None:
        self.body, self.size_m, self.g, self.load = body, body.size_m, body.gravity_m_s2, body.load_m_s2()
        self.push = -horizontal_unit_vector(azimuth_deg) @ body.scene_from_support
        self.touching_m, self.travel_m = _TOUCHING_SHARE * self.size_m, 0.25 * _STEP_SHARE * self.size_m
        self.start, self.sim = body.resting_pose, body.clockless(body.resting_pose, 1.0)
        self.upright = Rotation.from_quat(self.start[3:]).inv().apply([0.0, 0.0, 1.0])
        shift_m = self.load * (_PRESSED_SHARE * self.size_m / self.g)
        self.pose = _pressed(body, self.start, _near(self.sim, self.start, self.travel_m), shift_m)
        self._looks()
        self.last = self.peak = self.prior = self.pose
        self.best_m_s2, self.slides_m_s2, self.borne_m_s2 = 0.0, np.inf, 0.0
        self.turn: Turn | None = None
        self.fell, self.rolled = False, False
        self.short = self.corrections = 0

    def ends(self) -> bool:
        """Take a step; whether there was none to take."""
        at, onward, off_rad = self._support(), None, np.inf
        if at.rolls and len(at.touching) == 1:
            onward, back, off_rad = _rolled_on(self.sim, self.pose, at.touching, self.push, self.turn)
            if _BALANCED_RAD < off_rad < _STEP_SHARE and self.corrections < _MOST_CORRECTIONS:
                self.corrections += 1
                self.pose = _about(self.pose, back, off_rad)
                self._closes()
                return False
        self.corrections = 0
        held_m_s2, self.borne_m_s2 = max(at.held_m_s2 if at.rests else 0.0, self.borne_m_s2), 0.0
        beyond, lost = self._is_beyond(), self.rolled and self.last is self.peak is not self.pose
        if held_m_s2 > self.best_m_s2 + _ROUNDING * self.g and not beyond:
            if self.fell and not _stands_on_what_is_below(self.body, at.touching, self.push):
                return True
            self.slides_m_s2 = min(self.slides_m_s2, at.slides_m_s2)
            self.best_m_s2 = held_m_s2 if held_m_s2 <= _MOST_GRAVITIES * self.g else np.inf
            if self.best_m_s2 == np.inf:
                return True
            self.fell, self.rolled = False, at.rolls
            self.peak, self.prior, self.short = self.pose, self.last, self.short - 1
        elif lost and self.travel_m > _LEAST_STEP_SHARE * self.size_m:
            # The largest lies between the pose before and this one: go back, and take shorter steps between them.
            self.pose = self.last = self.prior
            self._looks()
            at, self.short = self._support(), 8
            self.travel_m *= 0.25
            if len(at.touching) == 1:
                onward, _, off_rad = _rolled_on(self.sim, self.pose, at.touching, self.push, self.turn)
        else:
            return beyond or not self._falls()
        self.last = self.pose
        return not (self._turns(at, onward if off_rad < _STEP_SHARE else None) or self._falls())

    def _is_beyond(self) -> bool:
        """Whether the rock has tilted farther, or moved, than it may and count as standing."""
        away_m = float(np.linalg.norm(self.pose[:3] - self.start[:3]))
        return self._is_tilted() or away_m > self.size_m

    def _is_tilted(self) -> bool:
        return float(Rotation.from_quat(self.pose[3:]).apply(self.upright)[2]) < _TIPPED_COSINE

    def _more_m_s2(self) -> float:
        """An acceleration that moves the rock on from the best of its poses."""
        return self.best_m_s2 + _MORE * (self.best_m_s2 + self.g)

    def _falls(self) -> bool:
        """Let the rock go from its pose, by the steps of the shakes; whether it is at rest again, and near by."""
        body, (rock, ground) = self.body, self.body.moving
        force = self.load + self._more_m_s2() * self.push
        friction = body.friction[0] if self.slides_m_s2 == np.inf else NO_SLIP
        sim = self.sim._replace(rock=rock, ground=ground, friction=(friction, friction))
        sim.pose[0], sim.velocity[0], sim.counts[:] = self.pose, 0.0, 0
        up, hull = body.scene_from_support[2].copy(), NO_HULL._replace(upright=self.upright)
        rests, sunk_m = fall(falling_under(force, self.g, sim), hull, up, self.size_m, _LONGEST_FALL)
        before, self.pose = self.pose, sim.pose[0].copy()
        if not rests and not self._is_beyond():
            self.pose = body.settled(self.pose, force)
        elif not rests and not self._is_tilted() and self.slides_m_s2 == np.inf:
            # It slides off, so it goes on without slip.
            self.pose, self.slides_m_s2 = before, self.best_m_s2
            return self._falls()
        self.fell |= sunk_m > _FALLEN * self.size_m
        self.borne_m_s2 = self._more_m_s2()
        self.turn, self.rolled, self.travel_m = None, False, 0.25 * _STEP_SHARE * self.size_m
        self.touching_m = _PRESSED_SHARE * self.size_m  # the shakes leave gaps of some millionths of R
        self._looks()
        self._closes()
        return not self._is_beyond()

    def _looks(self) -> np.ndarray:
        """The contacts near by. The next step is no longer than what was looked at: beyond it others may land."""
        lists = self.sim.lists
        self.near = _near(self.sim, self.pose, self.travel_m)
        far_m = float(lists.pairs.lengths_m[lists.latest[0], REACH])
        if len(self.near) == MOST:
            far_m = min(far_m, float(self.near["gap_m"].max()))
        self.travel_m = min(self.travel_m, max(0.5 * far_m, _LEAST_STEP_SHARE * self.size_m))
        return self.near

    def _support(self) -> _Support:
        near = self.near
        smooth, touches = near["key"] >= FIRST_SMOOTH_KEY, near["gap_m"] < self.touching_m
        rolls = bool(touches.any() and smooth[touches].all())
        if rolls:  # one that pressing would close carries as well
            touches |= smooth & (near["gap_m"] < _PRESSED_SHARE * self.size_m)
        touching = near[touches]
        return _Support(near[~touches], touching, rolls, *self._held(touching, rolls))

    def _held(self, touching: np.ndarray, rolls: bool) -> tuple[bool, float, float]:
        """Whether a rock rests, up to which acceleration, and from which on it slides.

        It leaves its pose where a rotation without slip gains energy and friction does not prevent it.
        """
        most = tips_m_s2(touching["arm_m"], touching["normal"], self.size_m, self.load, self.push)
        grips, balances, highest = touching, rolls and most is None, _MOST_GRAVITIES * self.g
        sharp = (touching["key"] < FIRST_SMOOTH_KEY).all()
        if most is None and sharp and on_one_line(touching["arm_m"], self.size_m):  # balanced at most
            return False, self.best_m_s2, np.inf
        if balances:  # the moment of smooth contacts about the centre of mass is none but in this pose
            most = _balanced_m_s2(touching, self.load, self.push)
            grips, highest = touching.copy(), min(most, highest)
            grips["arm_m"] = 0.0
        between, inertia_m2 = (self.best_m_s2, max(self.best_m_s2, highest)), self._inertia_m2()

        def gripped(friction: float) -> float | None:
            return held_up_to_m_s2(grips, friction, inertia_m2, self.load, self.push, between)

        held = gripped(self.body.friction[0])
        if most is None:
            most = gripped(NO_SLIP)
        if most is None:
            return False, self.best_m_s2, np.inf
        slides = self.best_m_s2 if held is None else held
        unsure_m_s2 = _UNSURE * (min(most, highest) + self.g)
        if slides < most - unsure_m_s2:
            return True, most, slides
        return True, slides if slides > most + unsure_m_s2 and not balances else most, np.inf

    def _inertia_m2(self) -> Array:
        """Inertia (3, 3) over mass, in the axes of the support."""
        axes = Rotation.from_quat(self.pose[3:]).as_matrix()
        inertia_m2: Array = axes * self.body.inertia_m2 @ axes.T
        return inertia_m2

    def _turns(self, at: _Support, turn: Turn | None) -> bool:
        """Turn by a step, unless no rotation gains energy; whether it has."""
        if turn is None:
            force = self.load + self._more_m_s2() * self.push
            turn = turn_under(at.touching["arm_m"], at.touching["normal"], self.size_m, force)
        if turn is None:
            return False
        self.turn, self.touching_m = turn, _TOUCHING_SHARE * self.size_m
        arms_m, near = at.touching["arm_m"] - turn.arm_m, at.touching
        opening = (crossed(turn.axis, arms_m) * near["normal"]).sum(axis=1)
        stay = near["key"][(opening < OPENS * self.size_m) & (near["key"] >= FIRST_SMOOTH_KEY)]
        self.pose = _turned(self.body, self.pose, at.apart, turn, self.travel_m)
        if self.short <= 0:
            self.travel_m = min(2.0 * self.travel_m, _STEP_SHARE * self.size_m)
        self._closes(stay if len(stay) > 1 else ())
        return True

    def _closes(self, stay: Sequence[int] = ()) -> None:
        """Move a turned pose by what turning does beyond its first order: onto the nearest contacts, deep in none.

        Along their normals where they are smooth: a change of the pose that also turned the rock would let it slip. Of
        two smooth contacts about whose line it has turned both touch again, by Newton's method.
        """
        for _ in range(3 if len(stay) else 1):
            near = self._looks()
            nearest = near[near["gap_m"].argmin()] if len(near) else None
            if nearest is None or (len(stay) == 0 and abs(nearest["gap_m"]) < _CLOSED * self.touching_m):
                return
            least_m = 0.0 if nearest["key"] < FIRST_SMOOTH_KEY else -_PRESSED_SHARE * self.size_m
            close_m = np.clip(nearest["gap_m"], least_m, _PRESSED_SHARE * self.size_m)
            normals = near["normal"][near["gap_m"] <= max(nearest["gap_m"], 0.0)].sum(axis=0)
            free_m = -close_m * normals / max(float(np.linalg.norm(normals)), 1e-9)
            self.pose = _pressed(self.body, self.pose, near, free_m, stay)
        self._looks()


def _stands_on_what_is_below(body: GroundedBody, touching: np.ndarray, push: Array) -> bool:
    """Whether contacts that are not steep carry a rock without the others."""
    low = touching[touching["normal"] @ body.scene_from_support[2] > STEEP]
    return tips_m_s2(low["arm_m"], low["normal"], body.size_m, body.load_m_s2(), push) is not None


def _near(sim: Grounded, pose: Array, travel_m: float) -> np.ndarray:
    """Contacts that a step of some length may reach."""
    bodies = sim.rock, sim.ground, sim.facets
    return sim.trial[: contacts_at(bodies, pose, 2.0 * travel_m, LEANING, sim.lists, sim.trial)].copy()


def _balanced_m_s2(touching: np.ndarray, load: Array, push: Array) -> float:
    """Acceleration under which the line of action passes a line through contacts.

    That through two of them, where it passes between both; else the level one across the push through either.
    """

    def passes(start: Array, line: Array) -> float:
        return -float(line @ crossed(start, load)) / (float(line @ crossed(start, push)) or 1e-300)

    arms_m = touching["arm_m"]
    if len(touching) == 2:
        line = arms_m[1] - arms_m[0]
        force = load + (held := passes(arms_m[0], line)) * push
        first, second = arms_m @ crossed(crossed(line, force), force)
        if first * second < 0.0:
            return held
    return max(passes(arm_m, crossed(push, load)) for arm_m in arms_m)


def _rolled_on(
    sim: Grounded, pose: Array, contact: np.ndarray, push: Array, turn: Turn | None
) -> tuple[Turn, Turn, float]:
    """The rotations along the equilibria of a rock on one smooth contact and back to them, and how far back, rad.

    It is in equilibrium where the line of action passes the contact also seen along the push. How far it misses
    changes as the rock rolls about two axes; where it hardly does, as of a ball, the push alone decides.
    """
    load, arm, normal = sim.gravity_m_s2, contact["arm_m"][0], contact["normal"][0]
    across = crossed(push, load)
    axes = np.array([across, crossed(normal, across)])
    axes -= (axes @ normal)[:, None] * normal
    axes /= np.linalg.norm(axes, axis=1)[:, None]

    def missed(near: np.ndarray) -> float:
        force = load + _balanced_m_s2(near, load, push) * push
        return float(crossed(near["arm_m"][0], force) @ axes[1])

    now, changes = missed(contact), np.zeros(2)
    for k, axis in enumerate(axes):
        near = _near(sim, _about(pose, Turn(arm, axis), _ROLLED_RAD), _ROLLED_RAD * sim.size_m)
        near = near[near["key"] == contact["key"][0]]
        changes[k] = (missed(near) - now) / _ROLLED_RAD if len(near) else 0.0
    square = float(changes @ changes)
    if square < (_NEUTRAL * sim.size_m * float(np.linalg.norm(load))) ** 2:
        return Turn(arm, axes[0]), Turn(arm, axes[0]), 0.0
    along = np.array([changes[1], -changes[0]]) / math.sqrt(square)
    if (axes[0] if turn is None else turn.axis) @ (along @ axes) < 0.0:
        along = -along
    back = -now * changes / square @ axes
    return Turn(arm, along @ axes), Turn(arm, back / max(off := float(np.linalg.norm(back)), 1e-300)), off


def _turned(body: GroundedBody, pose: Array, apart: np.ndarray, turn: Turn, travel_m: float) -> Array:
    """A pose turned by a step, or by less to where, to the second order, one of the contacts that are apart lands."""
    apart, angle = apart[apart["key"] < FIRST_SMOOTH_KEY], travel_m / body.size_m
    moved = crossed(turn.axis, apart["arm_m"] - turn.arm_m)
    opens, turns = ((way * apart["normal"]).sum(axis=1) for way in (moved, crossed(turn.axis, moved)))
    with np.errstate(invalid="ignore", divide="ignore"):
        lands = 2.0 * apart["gap_m"] / (np.sqrt(opens**2 - 2.0 * turns * apart["gap_m"]) - opens)
    deep = opens * angle + 0.5 * turns * angle**2 < -apart["gap_m"] - _PRESSED_SHARE * body.size_m
    return _about(pose, turn, float(lands[deep & (lands >= 0.0)].min(initial=angle)))


def _pressed(
    body: GroundedBody, pose: Array, near: np.ndarray, travel_m: Array, stay: Sequence[int] = ()
) -> Array:
    """A pose moved along a short way (3,), changed by the least that lets none be deep, and none open that stays."""
    scale = np.repeat([1.0, math.sqrt(body.inertia_m2.mean())], 3)
    columns = np.hstack([near["normal"], crossed(near["arm_m"], near["normal"])]).T / scale[:, None]
    stays = np.isin(near["key"], stay)
    columns = np.hstack([columns, -columns[:, stays]])
    free, least = np.append(travel_m, np.zeros(3)), np.append(-near["gap_m"], near["gap_m"][stays])
    twist = (free + shortest(columns, least - free @ columns)) / scale
    return _placed(pose, twist[:3], twist[3:])


def _about(pose: Array, turn: Turn, angle_rad: float) -> Array:
    """A pose turned by an angle."""
    aside = crossed(turn.axis, turn.arm_m)
    arm_m = math.sin(angle_rad) * aside + (1.0 - math.cos(angle_rad)) * crossed(turn.axis, aside)
    return _placed(pose, -arm_m, angle_rad * turn.axis)


def _placed(pose: Array, moved_m: Array, turned_rad: Array) -> Array:
    half = 0.5 * float(np.linalg.norm(turned_rad))
    x, y, z = 0.5 * np.sinc(half / np.pi) * turned_rad
    (a, b, c, d), w = pose[3:], math.cos(half)
    attitude = (
        w * a + d * x + y * c - z * b, w * b + d * y + z * a - x * c,
        w * c + d * z + x * b - y * a, w * d - x * a - y * b - z * c,
    )  # fmt: skip
    return np.concatenate([pose[:3] + moved_m, attitude])
