"""Results: schema and store of a run, queries, fragility, figures, hazard constraints."""

__all__ = ["queries", "reader", "replayed_job", "run_integrity", "schema", "store", "weights"]
