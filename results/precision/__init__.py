"""Sequential design: a statement of given precision from few jobs (curve, target, and choice of informative jobs)."""

__all__ = ["STATEMENT_FILE", "design", "probit"]

STATEMENT_FILE = "statement.json"
"""File of a run's statement, rewritten after every round."""
