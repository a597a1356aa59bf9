"""One shake on one core: contact points, engine, integrator, and the rules that end it."""

__all__ = ["compile_once", "job", "options", "outcome", "seating", "shake", "start", "unmeasured"]
