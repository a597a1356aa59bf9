"""The pedestal's own surface: where a rock touches it, along which normals, and what holds it there.

Used where one plane is not enough (:mod:`toppling.models.ground.kind`); what moves a rock through a motion on it is
here too, since statics follows a tipping rock with the same contacts.
"""

__all__ = [
    "body", "contacts", "creeping", "curved", "equilibrium", "excitation", "facets", "holding", "interface",
    "kind", "mesh", "pairs", "rigid", "rolling", "stepping", "touching", "vectors",
]  # fmt: skip
