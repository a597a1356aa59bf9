"""Answers: the schema and the store of a run, queries, fragility, figures, hazard constraints."""
