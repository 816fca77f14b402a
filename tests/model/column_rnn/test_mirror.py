"""The ring and its mirror image: reflected in the world, what both agree on, and the mirrored motion."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.mirror import mirror_motion
from garment_jax.model.column_rnn.mirror import agreed, frame_with_image, own, reflected, with_image
from garment_jax.model.column_rnn.motion import column_frames
from garment_jax.model.column_rnn.network import at_rest, roll_columns
from garment_jax.structs import ColumnCarry, ColumnFrame
from tests.animation.tiny_model import SCENE
from tests.reference.tiny_column_rnn import COLUMNS, frames, motion, params, tables

FLIP = np.array([-1.0, 1.0, 1.0])


def drawn(seed: int = 0) -> np.ndarray:
    shape = (COLUMNS.columns, COLUMNS.rows, 3)
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def world(x: np.ndarray) -> np.ndarray:
    """Return vectors of the columns' frames in the root frame."""
    return np.einsum("aij,ahi->ahj", tables().frames, x)


def test_reflected_vectors_are_those_of_the_opposite_column_with_x_negated():
    x = drawn()
    there = world(np.asarray(reflected(jnp.asarray(x))))
    for a in range(COLUMNS.columns):
        np.testing.assert_allclose(there[-a % COLUMNS.columns], world(x)[a] * FLIP, atol=1e-5)
    np.testing.assert_array_equal(reflected(reflected(jnp.asarray(x))), x)


def test_both_go_on_from_their_mean():
    one, other = drawn(1), drawn(2)
    both = np.asarray(agreed(jnp.stack([jnp.asarray(one), reflected(jnp.asarray(other))])))
    np.testing.assert_allclose(both[0], (one + other) / 2, atol=1e-6)
    np.testing.assert_array_equal(both[1], reflected(jnp.asarray(both[0])))
    np.testing.assert_array_equal(own(jnp.asarray(both), mirrored=True), both[0])
    np.testing.assert_array_equal(own(jnp.asarray(one), mirrored=False), one)


def test_a_frames_image_is_the_frame_of_the_mirrored_motion():
    expected = column_frames(mirror_motion(motion(12), SCENE.body), SCENE, tables())
    looked = frame_with_image(frames(12), tables())
    for name in ("seen", "way", "turn"):
        np.testing.assert_array_equal(getattr(looked, name)[:, 0], getattr(frames(12), name))
        np.testing.assert_allclose(getattr(looked, name)[:, 1], getattr(expected, name), atol=1e-5)
        assert np.abs(getattr(looked, name)[:, 1] - getattr(frames(12), name)).max() > 0.01


def rolled(looked: ColumnFrame) -> np.ndarray:
    rest = at_rest(tables(), (2,), config=COLUMNS)
    carry = ColumnCarry(with_image(rest.X[0]), rest.moved, rest.h)
    roll = jax.jit(partial(roll_columns, tables=tables(), config=COLUMNS, mirrored=True))
    return np.asarray(roll(params(), carry, looked)[1])


def test_the_mirrored_motion_gives_the_mirrored_cloth():
    """Exactly, whatever the parameters: a frame and its image change places, and so do both rings."""
    looked = frame_with_image(frames(12), tables())
    X = rolled(looked)
    changed = {name: jnp.flip(getattr(looked, name), 1) for name in ("seen", "way", "turn")}
    there = rolled(looked._replace(**changed))
    rest = jnp.asarray(tables().rest)
    assert np.abs(X - np.asarray(with_image(rest))).max() > 0.01
    assert float(np.abs(rest - reflected(rest)).max()) < 1e-5  # else both would begin from other templates
    np.testing.assert_allclose(there[:, 0], X[:, 1], atol=1e-4)


def test_a_ring_alone_is_neither_but_near_their_mean():
    seen = frames(12)
    alone = np.asarray(
        roll_columns(params(), at_rest(tables(), (), config=COLUMNS), seen, tables=tables(), config=COLUMNS)[
            1
        ]
    )
    both = rolled(frame_with_image(seen, tables()))
    assert np.abs(both[:, 0] - alone).max() > 1e-3
    np.testing.assert_allclose(both[:, 1], reflected(jnp.asarray(both[:, 0])), atol=1e-6)
