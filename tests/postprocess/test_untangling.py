"""A fold that lies in itself opens, by an independent count; nothing else moves, and it fades."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.evaluation.self_intersections import self_intersections
from garment_jax.postprocess.untangling import (
    FADE,
    GONE,
    HOLD,
    STAYS,
    STILL,
    UntangleState,
    UntangleTables,
    faded,
    grown,
    init_untangle,
    make_untangle_tables,
    untangle,
)
from tests.postprocess.sheets import EDGE, FACES, SIDE, TWO_FACES, T, looped, two_sheets

PINS = np.arange(SIDE, dtype=np.int32)  # one border


@lru_cache
def tables() -> UntangleTables:
    return make_untangle_tables(T, FACES, PINS)


@lru_cache
def one():
    return jax.jit(lambda state, V: untangle(faded(state), V, tables()))


def flattened() -> UntangleState:
    return init_untangle(tables())._replace(weight=jnp.ones(len(T)))


def test_a_looped_sheet_no_longer_goes_through_itself():
    V = looped(0.05)
    _, x, left = one()(init_untangle(tables()), V)
    assert self_intersections(V, FACES).edges > 20
    assert self_intersections(np.asarray(x), FACES).edges == 0 == int(left)
    assert np.array_equal(x[PINS], V[PINS])
    assert np.linalg.norm(x - V, axis=1).max() < 0.05


def test_without_crossings_a_frame_comes_back_as_it_is():
    V = looped(0.03)
    state, x, left = one()(init_untangle(tables()), V)
    assert np.array_equal(x, V)
    assert int(left) == 0
    assert not state.weight.any()
    assert not state.push.any()


def test_what_was_flattened_comes_back_little_by_little():
    V, state = looped(0.03), flattened()
    departure = []
    for _ in range(int(HOLD + np.ceil(np.log(GONE) / np.log(FADE))) + 1):
        state, x, _ = one()(state, V)
        departure.append(float(np.linalg.norm(x - V, axis=1).max()))
    assert departure[0] > 0.01
    assert departure[-1] == 0
    assert np.all(np.diff(departure) <= 0)
    assert np.max(-np.diff(departure)) < 0.2 * departure[0]


def test_what_was_pushed_comes_back_little_by_little_and_pins_stay():
    pushed = init_untangle(tables())
    pushed = pushed._replace(push=jnp.full_like(pushed.push, 0.02))
    V, state, moved = looped(0.02), pushed, []
    for _ in range(int(HOLD + np.ceil(np.log(STILL / 0.02) / np.log(STAYS))) + 2):
        state, x, _ = one()(state, V)
        assert np.array_equal(x[PINS], V[PINS])
        moved.append(np.abs(x - V).max())
    np.testing.assert_allclose(moved[: int(HOLD)], 0.02, atol=1e-5)
    assert moved[-1] == 0
    assert np.all(np.diff(moved) < 1e-7)


def test_a_bump_through_another_sheet_is_pushed_out_and_stays_a_bump():
    made = make_untangle_tables(two_sheets(0.0), TWO_FACES, PINS[:0])
    V, state = two_sheets(0.035), init_untangle(made)
    step = jax.jit(lambda state, V: untangle(faded(state), V, made))
    for _ in range(10):
        state, x, left = step(state, V)
    assert self_intersections(V, TWO_FACES).edges > 20
    assert self_intersections(np.asarray(x), TWO_FACES).edges == 0 == int(left)
    height = [np.ptp(np.asarray(y)[len(T) :, 1]) for y in (V, x)]
    assert height[1] > 0.8 * height[0]  # flattened alone it would be half as high


def test_a_frame_that_is_not_finite_comes_back_and_is_forgotten():
    V = looped(0.05)
    V[100] = np.nan
    state, x, left = one()(flattened(), V)
    assert np.array_equal(x, V, equal_nan=True)
    assert int(left) == 0
    assert not state.weight.any()


def test_many_at_once_are_as_one_by_one():
    frames = jnp.stack([jnp.asarray(looped(size)) for size in (0.03, 0.05)])
    states = jax.tree.map(lambda x: jnp.stack([x, x]), init_untangle(tables()))
    state, x, left = jax.vmap(one())(states, frames)
    for k in range(2):
        alone = one()(init_untangle(tables()), frames[k])
        assert np.allclose(x[k], alone[1], atol=1e-6)
        assert int(left[k]) == int(alone[2])
    assert state.weight[1].any()
    assert not state.weight[0].any()


def test_the_border_of_a_flat_sheet_is_not_pulled_inwards():
    state = flattened()
    _, x, _ = one()(state, T)
    border = (T[:, 2] == T[:, 2].min()) & (np.abs(T[:, 0] - T[:, 0].mean()) < 0.1)  # far from the corners
    assert np.abs(np.asarray(x)[border, 2] - T[border, 2]).max() < 2e-3


def finer(parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the sheet with edges of `EDGE` / `parts`, and its faces."""
    side = parts * (SIDE - 1) + 1
    u, v = (x.ravel() for x in np.meshgrid(*[np.arange(side)] * 2, indexing="ij"))
    a = u * side + v
    a = a[(u < side - 1) & (v < side - 1)]
    sheet = np.stack([EDGE * u / parts, 0.0 * u, EDGE * v / parts], axis=1).astype(np.float32)
    first, second = np.stack([a, a + 1, a + side], 1), np.stack([a + 1, a + side + 1, a + side], 1)
    return sheet, np.concatenate([first, second]).astype(np.int32)


def test_weights_grow_around_a_crossing_as_far_on_a_finer_mesh():
    reached = []
    for parts in (1, 2):
        sheet, faces = finer(parts)
        made = make_untangle_tables(sheet, faces, PINS[:0])
        V, border = sheet.copy(), sheet[:, 0] == 0
        V[border, :2] = 0.15, 0.05  # its border bends over, and in the middle down through the sheet
        V[border & (np.abs(sheet[:, 2] - 0.24) < 0.03), 1] = -0.05
        state, left = grown(init_untangle(made), jnp.asarray(V), made, flatten=True)
        assert int(left) > 0
        middle = np.abs(sheet[:, 2] - 0.24) < 0.005
        along = np.linspace(0.18, 0.3, 7)
        reached.append(np.interp(along, sheet[middle, 0], np.asarray(state.weight)[middle]))
    assert reached[0].max() > 0.1
    np.testing.assert_allclose(reached[0], reached[1], atol=0.02)
