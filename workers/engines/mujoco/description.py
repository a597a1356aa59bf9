"""What the registry says of MuJoCo."""

from toppling.workers.engines.protocol import Engine

MUJOCO = Engine(
    name="mujoco",
    title="MuJoCo",
    authors="Todorov et al., 2012",
    reference=(
        "Todorov, E., Erez, T., and Tassa, Y. (2012). MuJoCo: A physics engine for model-based control. "
        "2012 IEEE/RSJ International Conference on Intelligent Robots and Systems, 5026-5033."
    ),
    module="toppling.workers.engines.mujoco.integrator",
    imports="mujoco.rollout",
    # Its contacts converge with the first order, so the same names are finer steps.
    step_shares={"draft": 1 / 64, "fast": 1 / 128, "standard": 1 / 256, "reference": 1 / 512},
    restitution=False,
    kinetic_friction=False,
    extra="mujoco",
)
