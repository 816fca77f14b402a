import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.bitset import marked_up_to, pack, select


@pytest.mark.parametrize(
    ("rows", "places", "share"), [(1, 5, 0.5), (7, 70, 0.1), (300, 33, 0.02), (40, 64, 1.0)]
)
def test_marked_places_come_in_order(rows, places, share):
    mask = np.random.default_rng(0).random((rows, places)) < share
    words = pack(jnp.asarray(mask))
    up_to = marked_up_to(words)
    np.testing.assert_array_equal(up_to, np.cumsum(mask.sum(axis=1)))
    row, place = np.nonzero(mask)
    for first in (0, 64):
        got = jax.jit(select, static_argnums=1)(first, 64, words, up_to)
        count = int(got[2].sum())
        assert count == np.clip(len(row) - first, 0, 64)
        np.testing.assert_array_equal(got[0][:count], row[first : first + 64])
        np.testing.assert_array_equal(got[1][:count], place[first : first + 64])


def test_nothing_marked_gives_nothing_and_stays_in_range():
    words = pack(jnp.zeros((3, 40), bool))
    row, place, valid = select(0, 32, words, marked_up_to(words))
    assert not valid.any()
    assert row.max() < 3
    assert place.max() < 64


def test_sums_are_exact_over_many_rows():
    mask = np.random.default_rng(1).random((20_000, 32)) < 0.7
    np.testing.assert_array_equal(marked_up_to(pack(jnp.asarray(mask))), np.cumsum(mask.sum(axis=1)))
