"""Contact of a rock with its pedestal: candidates, gaps, events, sticking, impacts, friction and rest. No engine."""

__all__ = ["active_set", "candidates", "events", "friction", "gaps", "impact", "offset", "rest", "sticking"]
