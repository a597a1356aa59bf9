"""PyBullet: its binding, its worlds, and the steps that it carries out and checks."""

__all__ = ["description"]
