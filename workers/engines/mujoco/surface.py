"""A rock on a surface in MuJoCo: both as convex pieces, each contact along the normal that the engine finds."""

from __future__ import annotations

from typing import Any

from toppling.models.errors import InputError
from toppling.models.ground.plane import FLAT_SHARE
from toppling.models.kept import kept
from toppling.models.scene import Scene
from toppling.workers.engines.mujoco.free_body import hull, touch, world
from toppling.workers.engines.mujoco.pieces import ground_pieces, hollow_m, rock_pieces

_MOST_PIECES = {"rock": 100, "ground": 3000}
"""Of what is to be collided: more take minutes to prepare, and seconds a step."""


@kept
def surface_world(scene: Scene, step_s: float) -> tuple[Any, Any]:
    """A scene on its surface as MuJoCo's model and data: support frame, body axes.

    Raises
    ------
    InputError
        If the rock or its ground is not of convex pieces, or of too many.
    """
    import mujoco

    grounded = scene.grounded
    spec, body = world(step_s, grounded.pose[:3], grounded.inertia_m2)
    flat_m = FLAT_SHARE * scene.rock.height_m
    hollow = hollow_m(grounded.rock, 0.01 * flat_m)
    if hollow <= flat_m:
        rock = [grounded.rock.vertices_m]
    else:
        wedges = rock_pieces(grounded.rock)
        if wedges is None or len(wedges) > _MOST_PIECES["rock"]:
            raise _too_hollow(hollow / scene.rock.height_m, wedges)
        rock = wedges
    ground = ground_pieces(grounded.ground, 2.0 * grounded.size_m)
    if len(ground) > _MOST_PIECES["ground"]:
        raise InputError(
            "engine.too_many_pieces",
            f"the pedestal's surface is of {len(ground)} convex pieces",
            where="engine mujoco",
            expected=f"at most {_MOST_PIECES['ground']} near the rock",
            remedy="leave the engine out, or give a surface of fewer triangles",
        )
    for where, pieces in ((body, rock), (spec.worldbody, ground)):
        for number, points in enumerate(pieces):
            name = f"{'rock' if where is body else 'ground'} {number}"
            touch(where.add_geom(**hull(spec, name, points)), step_s, scene.contact.friction_static)
    model = spec.compile()
    return model, mujoco.MjData(model)


def _too_hollow(share: float, wedges: list[Any] | None) -> InputError:
    what = "no point sees all of it" if wedges is None else f"it is of {len(wedges)} convex pieces"
    return InputError(
        "engine.rock_hollow",
        f"the rock is hollow by {share:.2g} of its height, and {what}",
        where="engine mujoco",
        expected=f"a convex rock, or one of at most {_MOST_PIECES['rock']} convex pieces that meet in a point",
        remedy="leave the engine out: the default knows any closed mesh",
    )
