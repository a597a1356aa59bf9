"""The pedestal's own surface: where a rock touches it, along which normals, and what holds it there.

What moves a rock through a motion on it is here too, since statics follows a tipping rock with the same contacts.
"""

__all__ = [
    "body", "contacts", "equilibrium", "facet_path", "interface", "mesh", "pairs", "plane",
    "points", "rigid", "rolling", "stepping",
]  # fmt: skip
