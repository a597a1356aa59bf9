"""A rock that rolls on a rounded base over a plane: the program's own steps, among what shakes on planes."""

from __future__ import annotations

import math

import numpy as np

from toppling.models.compiled import Array, compiled
from toppling.models.ground.contacts import CONTACT, MOST
from toppling.models.ground.curved import NO_CURVED
from toppling.models.ground.facets import NO_FACETS
from toppling.models.ground.mesh import NO_MESH
from toppling.models.ground.pairs import empty_lists
from toppling.models.ground.rolling import rolling_surface
from toppling.models.ground.stepping import Grounded, step, work_room
from toppling.models.ground.touching import DisagreementError
from toppling.workers import quaternion as quat
from toppling.workers.ground.stepping import steps_at_once
from toppling.workers.history import ROOM, StateHistory
from toppling.workers.observation import Watch, calls_for_look
from toppling.workers.problem import Problem
from toppling.workers.simulation import Simulation, append, copy
from toppling.workers.termination import unwatched


class RollingIntegrator:
    """A rock on its way through a motion: as on a surface, its contacts are solved by cones."""

    def __init__(self, problem: Problem) -> None:
        self._problem, contact, base = problem, problem.contact, problem.scene.rounded_base
        assert base is not None
        patches = base.patches
        self.history = StateHistory(problem)
        sim, properties = self.history.sim, problem.scene.contact
        sim.state["widest"] = len(sim.set_points) - 1
        scene_from_body = contact.scene_from_support @ contact.support_from_body
        farthest_m = float(np.linalg.norm(patches.vertices_m - problem.scene.rock.com_m, axis=1).max())
        self._rock = Grounded(
            rock=NO_MESH,
            ground=NO_MESH,
            curved=NO_CURVED,
            facets=NO_FACETS,
            rolling=rolling_surface(patches, problem.scene.rock.com_m, scene_from_body),
            lists=empty_lists(contact.half_diagonal_m, farthest_m, room=1),
            contacts=np.zeros(MOST, CONTACT),
            trial=np.zeros(MOST, CONTACT),
            counts=np.zeros(7, np.int64),
            inertia_m2=contact.principal_inertia_m2,
            size_m=contact.half_diagonal_m,
            friction=(properties.friction_static, properties.friction_kinetic),
            restitution=properties.restitution,
            resolved_m_s=problem.options.resolved_impact * problem.speed_m_s,
            gravity_m_s2=np.array([0.0, 0.0, -problem.scene.gravity_m_s2]) @ contact.scene_from_support,
            excitation=sim.ground,
            sample_s=problem.motion.time_step_s,
            step_s=problem.time_step_s,
            at_once=steps_at_once(problem),
            time_s=np.zeros(0),
            pose=np.zeros((0, 7)),
            velocity=np.zeros((0, 6)),
            work=work_room(),
        )

    def advance(self, steps: int, watch: Watch | None = None) -> int:
        """Go on by this many steps, and again until a look is called for; the pose in which the last of them began."""
        history, watch = self.history, watch or unwatched(self._problem)
        history.sim.state["since"], history.sim.state["goal"] = history.last, history.grid + steps
        while not roll(history.sim, self._rock, watch, steps):
            history.make_room()
        if self._rock.counts[4] > 0:
            raise DisagreementError(f"before {history.time_s:.4f} s")
        return int(history.sim.state["since"][0])

    def restart(self) -> None:
        """Nothing to forget: impulses are found from those of contacts that are still there."""


def rolled_back(seat: Array, pose: Array) -> Array:
    """The pose (7,) in which a rock comes to rest where it is, with its turn about the normal since its seat."""
    yaw = quat.yaw_between(seat, pose)
    attitude = quat.product(np.array([0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)]), seat[3:])
    return np.concatenate([pose[:2], seat[2:3], attitude])


@compiled
def roll(sim: Simulation, rock: Grounded, watch: Watch, steps: int) -> bool:
    """Go on to the goal, and by so many steps again until a look is called for; false where arrays are full."""
    state, step_s = sim.state[0], sim.fixed[0].step_s
    while True:
        while state.grid < state.goal:
            if state.last + ROOM > len(sim.time_s):
                return False
            last = state.last
            only_rolls = rock.counts[0] == 1 and rock.contacts[0].key < len(rock.rolling.lowest)
            new = append(sim, step_s, step_s)
            copy(sim.pose[last], sim.pose[new])
            copy(sim.velocity[last], sim.velocity[new])
            times = rock.at_once if only_rolls else 1
            rock.counts[6] = times - 1
            step(rock, state.grid * step_s, sim.pose[new], sim.velocity[new])
            state.grid, state.rests, state.steps = state.grid + times, 0, rock.counts[3]
            sim.time_s[new] = sim.velocity_time_s[new] = state.grid * step_s
        if rock.counts[4] > 0 or calls_for_look(sim, watch, state.since):
            return True
        state.since, state.goal = state.last, state.grid + steps
