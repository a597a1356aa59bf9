"""A rock on ground that is no plane: contacts at their place, each with its own normal."""

__all__ = ["extent", "rolling", "shaking", "stepping"]
