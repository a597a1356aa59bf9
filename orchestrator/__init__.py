"""Campaigns and their jobs, execution on a cluster, storage of rows, and the command line."""

__all__ = ["campaign", "cli", "interrupt", "processes"]
