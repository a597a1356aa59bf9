"""Time stepping of second order over landings: staggered kicks, and steps that end where a point touches down.

Bullet's step adds the pull to the velocity, solves the contacts at the positions of the step's start, and moves the
rock with the new velocity. Read as a leapfrog scheme, with velocities that belong to the middles of the steps, it is
of second order where the pull of step n is the mean over the time from middle to middle, and that is what is imposed.

A landing spoils the order: the contact solver lets a point that would sink in arrive just at the surface, and so
moves the rock's weight to the new support at the start of the step in which it lands, half a step too early on the
average. The energy lost in an impact is then too large in proportion to the step, and a base of many corners rolls as
if braked. Therefore steps are taken in small chunks, the clearances of the chunk are looked at together, and where a
point has landed fast the chunk is taken back to the step before. It is replaced by steps that end at the moment of
touch, a short one for the impact, as many such groups as other points land at once, and one that leads to the grid.

The impact must meet the velocity at the touch, and the feet that carry until then must give what they hold up: the pull
is therefore imposed up to the touch before the impact's step. That moves the rock too fast, so a step of second order
leads nearly there and only a last bit has the velocity of its end.

Steps of unequal length need care: in a steady step a foot that carries leaves its arc by half of (step)^2 times its
centripetal acceleration, and the next step takes that back. After a change of step the feet are therefore set to the
height that belongs to the new one (some 1e-6 of R). Left out, each landing jolts the rock by half a step's arc, which
on a polygon of 48 sides raised the energy lost in an impact by a third.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from toppling.models.scene import ContactProperties
from toppling.workers.contact import REACH_DEG, ContactModel, Pose
from toppling.workers.engine import Engine
from toppling.workers.friction import LEAN_OF_IMPACT_RAD, Foot, feet_of, least_leaning_rad, squared_lean
from toppling.workers.presets import Solver
from toppling.workers.way import SUNK_SHARE, Vector, Way

Array = NDArray[np.float64]

SHORT_CHUNK, LONG_CHUNK = 6, 64
"""Steps between two looks at the clearances: a landing costs half of it in repeated steps, a look costs some steps. The
chunks are short after a landing and double in length while none comes, but end where the next one is expected."""

PULLS_AT_ONCE = 1024
"""Steps whose pulls are made together."""

FEWEST_STEPS = 4
"""Of a chunk: the points are changed where the rock may leave their reach within so many steps."""

PARTS_OF_A_REPEATED_STEP = 4
"""A step in which a point sank is taken again in so many parts: what is left is the arc that a point leaves its tangent
by, half of (rotation in a step)^2 times its lever arm."""

SHORT_OF_TOUCH = 0.013
"""A step to a touch stops short of it by this share, or the solver would already act."""

PULLED_BIT = 0.1
"""Share of a step: the last bit of the way to a touch, on which the rock has its velocity at the touch itself, so that
the impact meets that one. With it the whole way, the rock came early by half of its pull times the way's time squared
over its speed: swings of a few steps lost too much energy, in proportion to the square of the step."""

LEAST_BIT = 0.2
"""Share of that bit. The touch is foretold once more where it begins: it takes what is left, but no less than this."""

LEFT_OUT = 0.5
"""Share of the clearance of the nearest foot that comes down, beyond which no contact is prepared in the step that ends
short of its landing. In the solver's first iterations such a foot may take weight from one that carries. As that one
takes it back, Bullet no longer looks at the friction of a foot without weight, and leaves it as it is: a rock that
rolled from foot to foot lost up to twice the energy of its impacts."""

CARRYING_SHARE = 3e-6
"""Feet that carry are within this share of R."""

HIGHEST_ARC = 1.5
"""Of a foot, over (step)^2 times its centripetal acceleration: half the square of the longest step, one and a half."""

NEAREST_TOUCH_SHARE = 1e-9
"""Of R: a foot that comes down is at least so far off, also where a step happens to end at its touch."""

TRIES_TO_TOUCH = 4
"""A step that came too late is taken again, shorter by twice that share."""

AHEAD = 1.5
"""Around a landing contacts are prepared this many times as far ahead as the rock's present speed takes its points."""

SOON = 0.02
"""Share of a step: a touch that comes sooner counts as one at the start. At .1 small swings lost up to 2 % too much."""

IMPACT_STEP = 0.06
"""Share of a step that follows a touch: it tells where the impact sends the other points. Points that land within it
carry from its start; at a quarter of a step the errors of a rock that rattles round its rim are twice as large."""

TRIES_AT_IMPACT = 3
"""Of axes for the friction in it: other axes turn the slip that they are chosen for."""

MOST_IMPACTS_AT_ONCE = 40
"""Points that land within about a step of one another; what comes later is left to the steps after."""

LOW_TILT_DEG = 0.1
"""A rock that has tilted by less since it rested has hardly lifted: it goes round its rim from foot to foot within a
few steps. Whole steps of 1/96 and 1/128 of sqrt(R / g) let it rest then where shorter ones let it rock on, in one of
fifty jobs up to a degree and more, and answers leaned toward standing. Of 16 such jobs `fast` lifts 10 with .02,
12 with .05, and 14 with .1 and with .3 degrees; the last takes a tenth to a fifth longer. Cut at its landings of 1e-3
of sqrt(g R) all along, it still rocked less far by a tenth than with landings divided as the steps are."""


class Stepper:
    """A rock on its way through a motion.

    Parameters
    ----------
    contact : ContactModel
    surface : ContactProperties
    gravity_m_s2 : (3,) array
        Support frame.
    ground_velocity_m_s : callable
        Ground velocity (k, 3), support frame, at times (k,); its differences are imposed.
    time_step_s : float
        A whole step.
    parts_when_low : int
        A power of two: steps are divided by it from rest until the rock has lifted. The times of whole steps stay the
        same to the bit. A rock that starts in motion, or inside the ground, takes whole steps until it rests.
    resolved_landing_m_s : float
        Whole steps are cut at landings that are faster than this, divided ones at those faster than that part of it.
    solver : Solver
    pose, velocity_m_s, angular_velocity_rad_s
        State at time 0, support frame; the velocities belong to the start itself, not to a step's middle.
    """

    def __init__(
        self,
        contact: ContactModel,
        surface: ContactProperties,
        gravity_m_s2: Array,
        ground_velocity_m_s: Callable[[Array], Array],
        time_step_s: float,
        parts_when_low: int,
        resolved_landing_m_s: float,
        solver: Solver,
        pose: Pose,
        velocity_m_s: Vector,
        angular_velocity_rad_s: Vector,
    ) -> None:
        self._contact = contact
        self._surface = surface
        self._gravity = gravity_m_s2
        self._ground_velocity = ground_velocity_m_s
        self._whole_step, self._whole_fast = time_step_s, resolved_landing_m_s
        self._parts_when_low = parts_when_low
        self._nearest_m = NEAREST_TOUCH_SHARE * contact.half_diagonal_m
        self._solver = solver
        self._grid, self._parts = 0, 1
        """Present steps from time 0 to the latest pose, and how many of them make a whole one."""
        self._pulls: list[list[float]] = []
        self._pulls_from = -1
        self.steps = 0
        """Engine steps taken, repeated ones included."""
        self.way = Way(contact, pose, velocity_m_s, angular_velocity_rad_s)
        counts = [contact.points_within(tilt) for tilt in REACH_DEG]
        self._reaches = [i for i, count in enumerate(counts) if count not in counts[i + 1 :]]
        """Of each number of points, the farthest reach."""
        self._farthest = self._reaches[0]
        moves = any((*velocity_m_s, *angular_velocity_rad_s))
        sunk = contact.lowest_m(pose) < -SUNK_SHARE * contact.half_diagonal_m
        self._begin(1 if moves or sunk else parts_when_low)

    @property
    def time_s(self) -> float:
        """Time of the latest pose."""
        return self.way.times_s[-1]

    @property
    def grid(self) -> int:
        """Whole steps from time 0 to the latest pose."""
        return self._grid // self._parts

    def advance(self, steps: int) -> None:
        """Go on by about this many whole steps."""
        goal = self.grid + steps
        while (to_whole := -self._grid % self._parts) or self.grid < goal:
            left = max(goal * self._parts - self._grid, to_whole)
            if self._parts > 1 and self._has_lifted():
                if not to_whole:
                    self._take_whole_steps()
                left = to_whole or goal - self.grid
            self._chunk(min(self._ahead, left))

    def rest_until(self, grid: int) -> None:
        """Let the rock rest where it is up to a whole step; what comes then depends on that pose alone."""
        self.way.stay(grid * self._whole_step)
        self._grid = grid * self._parts_when_low
        self._begin(self._parts_when_low)

    def _has_lifted(self) -> bool:
        return self.way.tilt_deg(self._rested, self.way.last) > LOW_TILT_DEG

    def _take_whole_steps(self) -> None:
        """Go on with whole steps; the latest pose is one of them."""
        self._grid = self.grid
        self._divide(1)
        self._smooth_from, self._ahead = self.way.last, SHORT_CHUNK
        self._take_over()
        self._set_state(self._step)

    def _divide(self, parts: int) -> None:
        """Set the length of the present steps, and with it the slowest landing at which they are cut."""
        if parts != self._parts:
            self._pulls_from = -1
        self._parts, self._step, self._fast = parts, self._whole_step / parts, self._whole_fast / parts

    def _begin(self, parts: int) -> None:
        """Give the latest pose to an engine that remembers nothing."""
        self._divide(parts)
        self._rested = self.way.last
        self._narrow_from, self._smooth_from, self._ahead = 0, self.way.last, SHORT_CHUNK
        self._axes_rad = self._prepared_share = 0.0
        self._reach = self._reaches[0]
        self._widen(self.way.largest_tilt_deg(self.way.last))
        self._engine = self._engine_in_reach()
        self._engine.let_stick()
        self._set_state(self._step)

    def gaps_m(self, positions_m: Array, quaternions_xyzw: Array) -> Array:
        """Clearances (m, points) of all points that were in reach so far."""
        points = self._contact.points_within(REACH_DEG[self._farthest])
        return self._contact.gaps_m(positions_m, quaternions_xyzw, points)

    def _room_steps(self) -> int:
        """Steps for which the rock stays within reach of its points at twice its spin; changes the points for that.

        To fewer points only below half their reach, and where they leave ample room, or the sets would change to and
        fro.
        """
        way, last = self.way, len(REACH_DEG) - 1
        tilt_deg = way.largest_tilt_deg(way.last)
        turned_deg = math.degrees(2.0 * math.hypot(*way.velocities(way.last)[1]) * self._step) + 1e-9

        def room(reach: int) -> int:
            return LONG_CHUNK if reach == last else int((REACH_DEG[reach] - tilt_deg) / turned_deg)

        before = self._reach
        self._widen(tilt_deg + FEWEST_STEPS * turned_deg)
        if self._reach == before and way.last >= self._narrow_from:
            for reach in self._reaches:
                if reach < before and tilt_deg < 0.5 * REACH_DEG[reach] and room(reach) > 2 * SHORT_CHUNK:
                    self._reach = reach
                    break
        if self._reach != before:
            self._change_engine()
        return room(self._reach)

    def _widen(self, tilt_deg: float) -> None:
        """Reach at least as far as this tilt."""
        reached = [reach for reach in self._reaches if REACH_DEG[reach] >= tilt_deg] or self._reaches[-1:]
        self._reach = max(self._reach, reached[0])
        self._farthest = max(self._farthest, self._reach)

    def _change_engine(self) -> None:
        """Go on with the engine that has the points of the present reach."""
        self._take_over()
        self._place(self._engine.near_share)

    def _take_over(self) -> None:
        """Choose the engine of the present reach and step; it holds the rock as the one before did."""
        before = self._engine
        self._engine = self._engine_in_reach()
        self._engine.hold_as(before)

    def _engine_in_reach(self) -> Engine:
        reach, divided = self._reach, self._parts > 1
        impulse_m_s = float(np.linalg.norm(self._gravity)) * self._step
        engine = engine_for(
            self._contact,
            REACH_DEG[reach],
            self._surface,
            impulse_m_s,
            impulse_m_s * self._step,
            self._fast,
            self._solver,
            reach + divided * len(REACH_DEG),
        )
        self.way.look_at(engine.points)
        return engine

    def _set_state(
        self,
        next_step_s: float,
        *,
        kicked_share: float = 0.5,
        ahead_s: float = 0.0,
        carrying_only: bool = False,
        axes_rad: float | None = None,
    ) -> None:
        """Give the engine the latest pose, its feet at the height that belongs to a step of that duration.

        That step's velocity is the one at `kicked_share` of it. Contacts are prepared for what the rock may do in
        `ahead_s`, or only those of the feet that carry. The axes of friction are those that serve unless given.
        """
        way, index = self.way, self.way.last
        centripetal = way.centripetal_m_s2(index)
        arcs = kicked_share * next_step_s**2 * centripetal
        way.lift(way.lift_m(index, arcs, self._aloft_m(centripetal)))
        prepared = AHEAD * ahead_s * way.speed_1_s(index)
        left_out = LEFT_OUT * self._nearest_coming_share() if carrying_only else math.inf
        self._place(min(max(prepared, self._engine.near_share), left_out), axes_rad)

    def _aloft_m(self, centripetal_m_s2: Array) -> float:
        """Height over its rest from which a rock is aloft: feet that carry stand off by an arc at most."""
        arc_m = HIGHEST_ARC * self._step**2 * float(np.abs(centripetal_m_s2).max())
        return max(arc_m, CARRYING_SHARE * self._contact.half_diagonal_m)

    def _place(self, within_share: float, axes_rad: float | None = None) -> None:
        """Give the engine the latest pose, with contacts prepared within a share of R, and axes for their friction."""
        self._prepared_share = within_share
        if axes_rad is None:
            axes_rad = least_leaning_rad(self._feet(self.way.last, self.way.last), self._axes_rad)
        self._axes_rad = axes_rad
        pose, (velocity, spin) = self.way.lifted_pose(), self.way.velocities(self.way.last)
        self._engine.set_state(pose, velocity, spin, within_share=within_share, axes_rad=axes_rad)

    def _feet(self, index: int, moving: int) -> list[Foot]:
        """Feet for which contacts are prepared in pose `index`, with the velocities of the step to pose `moving`."""
        near = self.way.gaps_m(index) < self._prepared_share * self._contact.half_diagonal_m
        velocity, spin = self.way.velocities(moving)
        return feet_of(
            self._contact, near.nonzero()[0].tolist(), self.way.poses[index], velocity, spin, self._fast
        )

    def _nearest_coming_share(self) -> float:
        """Clearance, over R, of the nearest foot that is about to land in the latest pose."""
        gaps = self.way.gaps_m(self.way.last) / self._contact.half_diagonal_m
        coming = (self.way.closing_m_s(self.way.last) > 0.5 * self._fast) & (gaps > CARRYING_SHARE)
        return float(gaps[coming].min(initial=math.inf))

    def _chunk(self, steps: int) -> None:
        way, first, grid = self.way, self.way.last, self._grid
        steps = min(steps, self._room_steps())
        expected = (self._grid - 0.5) * self._step
        if abs(way.kicked_s[-1] - expected) > 1e-9 * self._step:
            self._single(self._step, self.time_s + 0.5 * self._step)
            self._grid += 1
            steps -= 1
        if steps > 0:
            self._turn_axes()
            self._engine.run(self._step, self._pulls_of(steps), way.poses)
            coming = range(self._grid + 1, self._grid + steps + 1)
            way.date([n * self._step for n in coming], [(n - 0.5) * self._step for n in coming])
            self._grid += steps
            self.steps += steps
        if not self._left_reach(first, grid):
            self._mend(first)

    def _turn_axes(self) -> None:
        """Place the rock anew where friction along the present axes would lean."""
        self._prepared_share = self._engine.near_share
        last = self.way.last
        if least_leaning_rad(self._feet(last, last), self._axes_rad) != self._axes_rad:
            self._place(self._prepared_share)

    def _left_reach(self, first: int, grid: int) -> bool:
        """Whether the rock left its points' reach after pose `first`: at rest it does not tell how fast it will turn.

        Goes back to that pose then, with points that reach as far as the rock did.
        """
        if self._reach == len(REACH_DEG) - 1:
            return False
        farthest_deg = self.way.largest_tilt_deg(first)
        if farthest_deg <= REACH_DEG[self._reach]:
            return False
        self._narrow_from, self._ahead = self.way.last, SHORT_CHUNK
        self.way.back_to(first)
        self._grid = grid
        self._widen(farthest_deg)
        self._change_engine()
        return True

    def _single(self, duration_s: float, kick_until_s: float, *, rebounds: bool = False) -> None:
        """One step of any duration whose kick covers the time from the last kick's end to `kick_until_s`."""
        kicked = self.way.kicked_s[-1]
        before, after = self._ground_velocity(np.array([kicked, kick_until_s]))
        pull = (self._gravity * (kick_until_s - kicked) - (after - before)) / duration_s
        step = self._engine.rebound if rebounds else self._engine.step
        self.way.append(step(duration_s, tuple(pull.tolist())), self.time_s + duration_s, kick_until_s)
        self.steps += 1

    def _pulls_of(self, steps: int) -> list[list[float]]:
        """Pulls of the next whole steps.

        They come from a table that starts at a multiple of its length, whichever step is asked for: matrix products
        of other lengths differ in their last bits.
        """
        start = self._grid - self._grid % PULLS_AT_ONCE
        if self._pulls_from != start:
            self._pulls_from = start
            rows = np.arange(PULLS_AT_ONCE + LONG_CHUNK + 1, dtype=np.float64)
            kicks = np.diff(self._ground_velocity((start - 0.5 + rows) * self._step), axis=0) / self._step
            self._pulls = (self._gravity - kicks).tolist()
        return self._pulls[self._grid - start : self._grid - start + steps]

    def _mend(self, first: int) -> None:
        """Look at the clearances since pose `first`; take back what a landing or a sinking point has spoilt."""
        back = max(first - 3, 0)
        gaps = self.way.gaps_since_m(back)
        sunk = gaps.min(axis=1) < -SUNK_SHARE * self._contact.half_diagonal_m
        sinks = np.flatnonzero(sunk[1:] & ~sunk[:-1]) + back
        sinks = sinks[sinks >= first]
        smooth = max(back, self._smooth_from)
        landing = self._first_landing(gaps[smooth - back :], smooth, first)
        if landing is None:
            self._ahead = min(2 * self._ahead, LONG_CHUNK, self._steps_to_touch())
        else:
            self._ahead = SHORT_CHUNK
        if landing is not None and not (len(sinks) and sinks[0] < landing[0]):
            self._cut_at(*landing)
        elif len(sinks):
            self._repeat(int(sinks[0]))

    def _steps_to_touch(self) -> int:
        """Steps by whose end the next fast landing will be seen, if the points go on at their speeds."""
        gaps, closing = self.way.gaps_m(self.way.last), self.way.closing_m_s(self.way.last)
        coming = (closing > self._fast) & (gaps > 0.0)
        if not coming.any():
            return LONG_CHUNK
        return max(math.ceil(float((gaps[coming] / closing[coming]).min()) / self._step) + 1, FEWEST_STEPS)

    def _first_landing(self, gaps: Array, back: int, first: int) -> tuple[int, float] | None:
        """Pose, not before pose `first`, ahead of the first fast landing, and the time from it to the touch."""
        if len(gaps) < 3:
            return None
        times_s = self.way.times_s[back:]
        closing = self.way.closing_since_m_s(back, gaps)
        # In interval i (pose i to i + 1) a point lands if the speed and its change before carry it through.
        predicted = closing[:-1].copy()
        predicted[1:] += closing[1:-1] - closing[:-2]
        before = gaps[1:-1]
        lands = (closing[:-1] > self._fast) & (before > -self._nearest_m)
        lands &= before < predicted * np.diff(times_s[1:])[:, None]
        lands[: max(first - back - 1, 0)] = False
        rows = np.flatnonzero(lands.any(axis=1))
        if not len(rows):
            return None
        here = int(rows[0]) + 1
        points = np.flatnonzero(lands[here - 1])
        touch = self._time_to_touch(back + here, points, back)
        if touch < 0.5 * self._step and back + here - 1 > first and here > 2:
            durations = np.diff(times_s[here - 2 : here + 1])
            if abs(durations - self._step).max() < 1e-9 * self._step:  # from a whole step further back
                here -= 1
                touch = self._time_to_touch(back + here, points, back)
        # A landing that the next one and a half steps do not bring was an extrapolation's error.
        return (back + here, touch) if touch <= 1.6 * self._step else None

    def _time_to_touch(self, index: int, points: NDArray[np.intp], smooth_from: int) -> float:
        """Time from pose `index` to the first touch, for a step whose last bit has the velocity at the touch itself.

        Such a step moves points along their tangents at its start: what the mean speeds of the steps before have lost
        or gained by the turning of the tangent is taken out of their change, and half a step's of it is put back.
        Unknown changes, those across pose `smooth_from`, are taken as zero.
        """
        way = self.way
        gap, speed = np.maximum(way.gaps_m(index)[points], self._nearest_m), way.closing_m_s(index)[points]
        arcs = way.centripetal_m_s2(index)
        arc = arcs[points]
        before_s = way.times_s[index] - way.times_s[index - 1]
        growth = arc
        if index - 2 >= smooth_from:
            middle_to_middle = 0.5 * (way.times_s[index] - way.times_s[index - 2])
            growth = arc + (speed - way.closing_m_s(index - 1)[points]) / middle_to_middle
        tangent = speed - 0.5 * before_s * arc
        soonest, aloft_m = float((gap / speed).min()), self._aloft_m(arcs)
        for _ in range(4):
            bit = self._bit_s(soonest, gap)
            last = float(bit.min())
            lifted = gap + way.lift_m(index, arcs * (0.5 * (soonest - last) ** 2 + last**2), aloft_m)
            pulled = 0.5 * (soonest**2 + bit**2) / max(soonest, 1e-300)  # a lift may leave none
            on_the_way = np.maximum(tangent + growth * (0.5 * before_s + pulled), 0.5 * speed)
            soonest = (1.0 - SHORT_OF_TOUCH) * float((lifted / on_the_way).min())
        return soonest

    def _bit_s(self, touch_s: float, gaps_m: Array) -> Array:
        """Last bit of the way of points (n,) that touch down, in which they can still be told from feet that carry."""
        told_apart = 2.0 * CARRYING_SHARE * self._contact.half_diagonal_m * touch_s / gaps_m
        return np.minimum(np.maximum(PULLED_BIT * self._step, told_apart), touch_s)

    def _repeat(self, index: int) -> None:
        """Take the step from pose `index` again, in parts and with contacts prepared far ahead."""
        end_s = self.way.times_s[index + 1]
        self.way.back_to(index)
        part = (end_s - self.time_s) / PARTS_OF_A_REPEATED_STEP
        self._set_state(part, ahead_s=end_s - self.time_s)
        for _ in range(PARTS_OF_A_REPEATED_STEP):
            self._single(part, self.time_s + 0.5 * part)
        self.way.end_at(end_s)
        self._grid = round(end_s / self._step)
        self._smooth_from = self.way.last
        self._set_state(self._step)

    def _cut_at(self, index: int, touch_s: float) -> None:
        """Go back to pose `index`, step to the touch, to those that follow at once, and from there to the grid."""
        self.way.back_to(index)
        for _ in range(MOST_IMPACTS_AT_ONCE):
            if touch_s > SOON * self._step:
                self._step_to_touch(touch_s)
            if self._surface.restitution > 0.0:  # only a point that touches rebounds
                left_s = self._next_touch_s()
                if 1e-6 < left_s / self._step < SOON:
                    self._step_to_touch(left_s)
            self._impact(IMPACT_STEP * self._step)
            self._smooth_from = self.way.last
            self._grid = math.ceil(self.time_s / self._step + 0.5)  # leaves half a step to one and a half
            rest = self._grid * self._step - self.time_s
            touch_s = self._next_touch_s()
            if touch_s > rest:
                break
        self._set_state(rest, ahead_s=rest)
        self._single(rest, self.time_s + 0.5 * rest)
        self.way.end_at(self._grid * self._step)
        self._set_state(self._step)

    def _impact(self, duration_s: float) -> None:
        """Step over a touch, again where it turns the slip of the feet away from the axes of their friction.

        Friction opposes the slip with which the feet leave an impact. Along the axes that served the slip before it the
        impulse of a block that landed on an edge leaned by up to 16 degrees, at any step.
        """
        touch, axes_rad = self.way.last, None
        for _ in range(TRIES_AT_IMPACT):
            self.way.back_to(touch)
            self._set_state(duration_s, ahead_s=duration_s, axes_rad=axes_rad)
            self._single(duration_s, self.time_s + 0.5 * duration_s, rebounds=True)
            slipping = [foot for foot in self._feet(touch, self.way.last) if foot[1]]
            axes_rad = least_leaning_rad(slipping, self._axes_rad)
            leaned, least = (squared_lean(slipping, axes) for axes in (self._axes_rad, axes_rad))
            if leaned - least <= LEAN_OF_IMPACT_RAD**2 * len(slipping):
                return

    def _step_to_touch(self, touch_s: float) -> None:
        """Steps that end as a point touches down, and not so late that the point already carries."""
        way, index = self.way, self.way.last
        nearest_m = self._nearest_coming_share() * self._contact.half_diagonal_m
        for tries_left in reversed(range(TRIES_TO_TOUCH)):
            bit_s = float(self._bit_s(touch_s, np.array([nearest_m]))[0])
            if bit_s < touch_s:
                before_s = touch_s - bit_s
                self._set_state(before_s, ahead_s=before_s, carrying_only=True)
                self._single(before_s, self.time_s + 0.5 * before_s)
                left_s = self._next_touch_s()
                if left_s < 2.0 * bit_s:
                    bit_s = max(left_s, LEAST_BIT * bit_s)
            self._set_state(bit_s, kicked_share=1.0, ahead_s=bit_s, carrying_only=True)
            self._single(bit_s, self.time_s + bit_s)
            closing = way.closing_m_s(way.last)
            arcs = 0.5 * bit_s**2 * way.centripetal_m_s2(way.last)
            # A point that the engine stopped is left with its arc alone.
            late = way.gaps_m(way.last) - arcs < 0.6 * SHORT_OF_TOUCH * bit_s * closing
            if tries_left == 0 or not ((closing > self._fast) & late).any():
                return
            way.back_to(index)
            touch_s *= 1.0 - 2.0 * SHORT_OF_TOUCH

    def _next_touch_s(self) -> float:
        """Time from the latest pose to the next fast touch; infinite if none comes."""
        index = self.way.last
        coming = (self.way.closing_m_s(index) > self._fast) & (self.way.gaps_m(index) > 0.0)
        points = np.flatnonzero(coming)
        return self._time_to_touch(index, points, self._smooth_from) if len(points) else math.inf


def forget_worlds() -> None:
    """Make all worlds anew: one that a rock has left in no finite state holds no rock any more."""
    _IN_SLOT.clear()


def engine_for(
    contact: ContactModel,
    tilt_deg: float,
    surface: ContactProperties,
    impulse_m_s: float,
    fall_m: float,
    rebound_from_m_s: float,
    solver: Solver,
    slot: int,
) -> Engine:
    """A world for the tilts up to `tilt_deg`, kept while the same rock is shaken again; one at a time in a slot."""
    wanted = (contact, tilt_deg, surface, impulse_m_s, fall_m, rebound_from_m_s, solver)
    if slot not in _IN_SLOT or _IN_SLOT[slot][0] != wanted:  # making a world destroys the slot's former one
        points = contact.points_within(tilt_deg)
        _IN_SLOT[slot] = wanted, Engine(contact, points, *wanted[2:], slot)
    return _IN_SLOT[slot][1]


_IN_SLOT: dict[
    int, tuple[tuple[ContactModel, float, ContactProperties, float, float, float, Solver], Engine]
] = {}
