"""Heights of surfaces below places: exact for triangles of any size."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from models.relief import height_below


def lattice(cells, height):
    """Unit square of small triangles at a height."""
    along = np.linspace(0.0, 1.0, cells)
    x, y = np.meshgrid(along, along, indexing="ij")
    number = np.arange(cells * cells).reshape(cells, cells)
    a, b, c, d = (
        each.ravel() for each in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    )
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)]), faces


@given(st.integers(2, 25), st.floats(0.001, 0.999), st.floats(0.001, 0.999))
def test_two_large_triangles_below_many_small_ones_are_found(cells, u, v):
    small, small_faces = lattice(cells, 1.0)
    large, large_faces = lattice(2, 0.0)
    large[:, 2] = 0.2 * large[:, 0]
    vertices, faces = np.vstack([small, large]), np.vstack([small_faces, large_faces + len(small)])
    places = np.array([[u, v]])
    # Differences of coordinates of size 1, in double precision.
    assert abs(height_below(places, vertices, faces, highest=False)[0] - 0.2 * u) < 1e-12
    assert abs(height_below(places, vertices, faces, highest=True)[0] - 1.0) < 1e-12


def test_no_places_have_no_heights():
    assert height_below(np.zeros((0, 2)), *lattice(3, 0.0), highest=True).shape == (0,)
