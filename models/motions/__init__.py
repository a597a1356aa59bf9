"""Records: read, process, measure, scale, turn, make."""
