"""Rounded bases: the smooth surface that a mesh stands for, and what is stated of it."""

__all__ = ["base", "smooth_mesh"]
