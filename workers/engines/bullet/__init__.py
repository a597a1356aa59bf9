"""PyBullet: its binding, a world, the pool of worlds, and the integrator that steps a rock with them."""

__all__ = ["description"]
