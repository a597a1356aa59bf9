"""One shake on one core: contact, engine, stepping, and the rules that end it."""

from workers.shake import ShakeResult, State, Trajectory, shake

__all__ = ["ShakeResult", "State", "Trajectory", "shake"]
