"""Contact of a rock with its pedestal: candidates, gaps, events, sticking, impacts, friction and rest. No engine."""
