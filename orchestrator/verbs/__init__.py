"""Commands of the command line, one module each, which import what they need when they are called."""

__all__ = []
