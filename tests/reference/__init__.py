"""Exact answers beside the engine: closed forms, plane rocking, plane sliding and rocking. No engine."""
