"""Contact of a rock with its pedestal: candidates, gaps, events, sticking, impacts, friction and rest. No engine."""

__all__ = [
    "active_set", "contact_points", "events", "friction", "gaps", "impact", "offset", "resting_contact", "sticking",
]  # fmt: skip
