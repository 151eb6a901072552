import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from instdrive_core.maths.morton import AXIS_BITS, compute_morton_codes

CELLS = (1 << AXIS_BITS) - 1


@given(st.lists(st.tuples(*[st.integers(0, CELLS)] * 3), min_size=1, max_size=20))
def test_codes_interleave_the_bits_of_the_cells(cells):
    points = np.array(cells, np.float64)
    codes = compute_morton_codes(points, np.zeros(3), np.full(3, float(CELLS)))
    for code, cell in zip(codes.tolist(), cells, strict=True):
        bits = [cell[axis] >> place & 1 for place in reversed(range(AXIS_BITS)) for axis in (2, 1, 0)]
        assert code == int("".join(map(str, bits)), 2)


def test_a_flat_box_and_points_outside_are_fine():
    points = np.array([[0, 5, 1], [-9, 5, 2], [99, 5, 3]], np.float32)
    codes = compute_morton_codes(points, np.array([0.0, 5, 1]), np.array([1.0, 5, 3]))
    assert codes[0] == codes.min() == 0
    assert codes[2] > codes[1]
