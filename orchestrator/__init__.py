"""Campaign to jobs, jobs to a cluster, rows to the store; and the command line."""

__all__ = ["campaign", "cli", "interrupt", "safe_path"]
