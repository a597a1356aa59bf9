"""One shake on one core: what steps a rock, and the rules that end it."""

__all__ = ["compile_once", "job", "options", "outcome", "seating", "shaking", "start", "unmeasured"]
