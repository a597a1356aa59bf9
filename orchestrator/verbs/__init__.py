"""One module a verb of the command line; each imports the rooms it needs when it is called."""

__all__ = []
