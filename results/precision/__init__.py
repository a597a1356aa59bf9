"""A statement of stated precision from few jobs: the curve, what is asked of it, and which jobs tell most of it."""

__all__ = ["STATEMENT_FILE", "design", "probit", "statement", "target"]

STATEMENT_FILE = "statement.json"
"""Of a run: what it states, written again after every round."""
