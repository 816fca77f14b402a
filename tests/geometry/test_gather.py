import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.geometry.gather import coordinates_of, gathered, scattered

PLACES = np.array([4, 0, 2], np.int32)


def test_places_of_every_array_are_read_and_written_alone():
    rng = np.random.default_rng(0)
    whole = {"x": rng.normal(size=(3, 5)).astype(np.float32), "kept": np.arange(5)}
    part = jax.jit(gathered)(whole, PLACES)
    np.testing.assert_array_equal(part["x"], whole["x"][:, PLACES])
    np.testing.assert_array_equal(part["kept"], PLACES)
    to = jnp.asarray([4, 5, 2])  # the second is beyond the last
    written = jax.jit(scattered)(whole, jax.tree.map(lambda leaf: -leaf - 1, part), to)
    for name, leaf in whole.items():
        expected = leaf.copy()
        expected[..., [4, 2]] = -leaf[..., [4, 2]] - 1
        np.testing.assert_array_equal(written[name], expected)


def test_coordinates_of_tables_and_of_traced_rows():
    points = np.random.default_rng(1).normal(size=(3, 6)).astype(np.float32)
    rows = np.array([[5, 1], [0, 3]], np.int32)
    of_tables = jax.jit(lambda flat: coordinates_of(rows, flat))(points.reshape(-1))
    np.testing.assert_array_equal(of_tables, points[:, rows])
    np.testing.assert_array_equal(jax.jit(coordinates_of)(rows, points.reshape(-1)), of_tables)
