"""Physics engines: a registry of what each is called, which limits it has, and how it steps a shake.

An engine is an entry here, without importing it; its module is imported by what shakes.
"""

from __future__ import annotations

from toppling.models.errors import InputError
from toppling.workers.engines.protocol import Engine
from toppling.workers.options import PRESETS, NumericalOptions

__all__ = ["DEFAULT", "ENGINES", "engine_named", "options_of", "protocol"]


_BULLET = Engine(
    name="pybullet",
    title="PyBullet",
    authors="Coumans and Bai",
    reference=(
        "Coumans, E., and Bai, Y. PyBullet, a Python module for physics simulation for games, robotics and machine "
        "learning."
    ),
    module="toppling.workers.engines.bullet",
    imports="pybullet",
    relative_steps={},
)
_MUJOCO = Engine(
    name="mujoco",
    title="MuJoCo",
    authors="Todorov et al., 2012",
    reference=(
        "Todorov, E., Erez, T., and Tassa, Y. (2012). MuJoCo: A physics engine for model-based control. "
        "2012 IEEE/RSJ International Conference on Intelligent Robots and Systems, 5026-5033."
    ),
    module="toppling.workers.engines.mujoco",
    imports="mujoco",
    # Its contacts converge with the first order, so the same names are finer steps.
    relative_steps={"fast": 1 / 128, "standard": 1 / 256, "reference": 1 / 512},
    restitution=False,
    kinetic_friction=False,
    extra="mujoco",
)

ENGINES: dict[str, Engine] = {engine.name: engine for engine in (_BULLET, _MUJOCO)}
"""Engines by name; the first is the judge, the others are extras."""

DEFAULT = next(iter(ENGINES))
"""Name of the engine that shakes unless another is asked for."""


def engine_named(name: str) -> Engine:
    """The engine of a name.

    Raises
    ------
    InputError
        If there is none.
    """
    if name not in ENGINES:
        raise InputError(
            "engine.unknown",
            f"no engine {name!r}",
            where="engine",
            expected=", ".join(ENGINES),
            remedy=f"leave it out: {DEFAULT!r} does all",
        )
    return ENGINES[name]


def options_of(preset: str | NumericalOptions, engine: str = DEFAULT) -> NumericalOptions:
    """Options of a preset with an engine; options of one's own as they are.

    Raises
    ------
    InputError
        If there is no preset or engine of this name.
    """
    presets = engine_named(engine).presets
    if isinstance(preset, NumericalOptions):
        return preset
    if not isinstance(preset, str) or preset not in presets:
        raise InputError(
            "engine.preset_unknown",
            f"no preset {preset!r}",
            where="preset",
            expected=", ".join(PRESETS),
            remedy="'standard' suits most runs",
        )
    return presets[preset]
