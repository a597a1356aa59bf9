"""Rounded bases: the smooth surface that a mesh stands for, what topples a rock on it, and what is stated of it."""

__all__ = ["base"]
