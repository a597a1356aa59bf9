"""One shake on one core: contact, engine, stepping, and the rules that end it."""

from workers.shake import ShakeResult, Trajectory, shake
from workers.start import State

__all__ = ["ShakeResult", "State", "Trajectory", "shake"]
