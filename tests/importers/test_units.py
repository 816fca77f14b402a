"""Units and axes: what is said, what is given, what is taken for metres."""

import numpy as np
import pytest

from garment_jax.importers.units import metres_per_unit, settle_unit, to_metres_y_up, turn_to_y_up


def test_z_up_is_turned_so_that_the_front_is_plus_z():
    """Blender: up is Z, the front view looks along +Y, so a body faces -Y."""
    found = to_metres_y_up(np.array([[0.0, 0.0, 200.0], [0.0, -100.0, 0.0], [100.0, 0.0, 0.0]]), "cm", "Z")
    np.testing.assert_allclose(found, [[0, 2, 0], [0, 0, 1], [1, 0, 0]], atol=1e-15)
    turn = turn_to_y_up("Z")
    np.testing.assert_allclose(np.linalg.det(turn), 1)
    np.testing.assert_allclose(turn @ [0, 0, 1], [0, 1, 0])


def test_y_up_stays_and_types_stay():
    points = np.random.default_rng(0).random((2, 5, 3)).astype(np.float32)
    found = to_metres_y_up(points, 1.0, "y")
    np.testing.assert_array_equal(found, points)
    assert found.dtype == np.float32


def test_units_by_name_and_number():
    assert metres_per_unit("cm") == metres_per_unit("0.01") == metres_per_unit(0.01) == 0.01
    assert metres_per_unit("IN") == 0.0254
    for wrong in ("ell", "nan", 0.0, -1.0):
        with pytest.raises(ValueError, match=r"--unit \S+ is no unit; give one of m, dm, cm, mm"):
            metres_per_unit(wrong)


def test_the_users_word_counts_most_then_the_files():
    assert settle_unit(0.01, "mm", 5.0, "it").metres == 0.001
    assert settle_unit(0.01, None, 5.0, "it").metres == 0.01
    taken = settle_unit(None, None, 1.2, "skirt.pc2")
    assert taken.metres == 1
    assert taken.note == "skirt.pc2 is 1.2 units large and its file does not say which: taken for metres"
    for size in (120.0, 0.012):
        with pytest.raises(ValueError, match=r"skirt\.pc2 is [\d.]+ units large, and its file does not say"):
            settle_unit(None, None, size, "skirt.pc2")
