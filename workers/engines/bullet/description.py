"""What the registry says of PyBullet."""

from toppling.workers.engines.protocol import Engine

BULLET = Engine(
    name="pybullet",
    title="PyBullet",
    authors="Coumans and Bai",
    reference=(
        "Coumans, E., and Bai, Y. PyBullet, a Python module for physics simulation for games, robotics and machine "
        "learning."
    ),
    module="toppling.workers.engines.bullet.checked_steps",
    imports="pybullet",
    step_shares={},
)
