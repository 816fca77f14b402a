"""The ring's step: what it keeps, what it cannot tell apart, and that nothing throws it far away."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.config import ColumnRnnConfig
from garment_jax.model.column_rnn.motion import MOVED
from garment_jax.model.column_rnn.network import (
    ColumnCarry,
    at_rest,
    cells_of,
    column_step,
    init_column_rnn,
    roll_columns,
    seen_gates,
    turned,
)
from garment_jax.model.motion.network import gru_step
from garment_jax.structs import ColumnFrame
from tests.reference.tiny_column_rnn import COLUMNS, frames, params, tables


def stepped(carry: ColumnCarry, frame: ColumnFrame) -> ColumnCarry:
    gates = seen_gates(params(), frame.seen, config=COLUMNS)
    return column_step(params(), carry, frame, gates, tables=tables(), config=COLUMNS)


def frame_at(t: int) -> ColumnFrame:
    return jax.tree.map(lambda leaf: leaf[t], frames(10))


def anywhere(seed: int = 0) -> ColumnCarry:
    rng = np.random.default_rng(seed)
    rest = at_rest(tables(), (), config=COLUMNS)
    return jax.tree.map(lambda leaf: leaf + 0.03 * jnp.asarray(rng.normal(size=leaf.shape)), rest)


def test_columns_cannot_tell_where_on_the_ring_they_are():
    after = stepped(anywhere(), frame_at(4))
    for by in (1, 3):
        around = jax.tree.map(lambda leaf, by=by: jnp.roll(leaf, by, axis=0), anywhere())
        frame = frame_at(4)
        frame = frame._replace(seen=jnp.roll(frame.seen, by, axis=0), way=jnp.roll(frame.way, by, axis=0))
        for here, there in zip(after, stepped(around, frame), strict=True):
            np.testing.assert_allclose(jnp.roll(here, by, axis=0), there, atol=1e-5)


def test_a_column_feels_its_neighbours_and_what_is_everywhere():
    frame = frame_at(4)
    poked = frame._replace(seen=frame.seen.at[2, 0].add(1.0))
    change = np.abs(stepped(anywhere(), poked).X - stepped(anywhere(), frame).X).max(axis=(1, 2))
    assert (change > 0).all()  # by the mean over all columns
    assert change[:5].mean() > 2 * change[5:].mean()


def test_cloth_that_hangs_in_the_world_is_where_it_was():
    """Against positions in the world, before and after the body moves and turns."""
    angle, rng = 0.3, np.random.default_rng(2)
    c, s = np.cos(angle), np.sin(angle)
    yaw = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])  # of the root, this frame; before: none
    F = tables().frames
    anchor_before, anchor = rng.normal(size=(2, COLUMNS.columns, 3))  # world
    points = rng.normal(size=(COLUMNS.columns, COLUMNS.rows, 3))
    before = np.einsum("aij,ahj->ahi", F, points - anchor_before[:, None])
    now = np.einsum("aij,ahj->ahi", F @ yaw.T, points - anchor[:, None])
    way = np.einsum("aij,aj->ai", F @ yaw.T, anchor - anchor_before)
    # the root turned by +angle, so hanging cloth turns by -angle as seen from it
    np.testing.assert_allclose(
        np.asarray(turned(jnp.asarray(before), jnp.float32(-angle))) - way[:, None], now, atol=1e-5
    )


def test_its_turn_is_the_roots():
    from garment_jax.body.root_frame import heading
    from tests.reference.tiny_column_rnn import motion

    yaw = heading(motion(10).rotations[:, 0])
    np.testing.assert_allclose(frames(10).turn[1:], -np.diff(yaw), atol=1e-5)


def test_rollouts_side_by_side_are_rollouts_one_by_one():
    many = jax.tree.map(lambda leaf: jnp.stack([leaf[:4], leaf[4:8]], axis=1), frames(8))
    starts = jax.tree.map(lambda a, b: jnp.stack([a, b]), anywhere(0), anywhere(1))
    _, X = roll_columns(params(), starts, many, tables=tables(), config=COLUMNS)
    for lane, start in enumerate((anywhere(0), anywhere(1))):
        carry = start
        for t in range(4):
            carry = stepped(carry, jax.tree.map(lambda leaf, t=t, k=lane: leaf[t, k], many))
            np.testing.assert_allclose(X[t, lane], carry.X, atol=2e-5)


def test_the_cloth_moves_and_stays_within_bounds_whatever_comes():
    carry, X = roll_columns(
        params(), at_rest(tables(), (), config=COLUMNS), frames(10), tables=tables(), config=COLUMNS
    )
    assert np.abs(X[-1] - X[0]).max() > 0.005
    thrown = jax.tree.map(lambda leaf: leaf + 1e4, carry)
    thrown = thrown._replace(h=jnp.ones_like(carry.h))
    after = stepped(thrown, frame_at(3))
    out = params()["out"]["kernel"]
    most = (
        np.abs(out).sum() * np.abs(params()["around"]["kernel"]).sum() + np.abs(params()["out"]["bias"]).max()
    )
    assert np.abs((np.asarray(after.X) - tables().typical) / tables().scale).max() < most
    for _ in range(5):
        after = stepped(after, frame_at(3))
    calm = carry
    for _ in range(6):
        calm = stepped(calm, frame_at(3))
    assert np.abs(after.X - calm.X).max() < 0.5  # metres: it comes back


def test_cells_hang_from_their_anchors():
    rng = np.random.default_rng(4)
    V, anchor = rng.normal(size=(2, 128, 3)), rng.normal(size=(2, COLUMNS.columns, 3))
    cells, down = np.asarray(cells_of(jnp.asarray(V), jnp.asarray(anchor), tables=tables())), tables().down
    for b in range(2):
        for k in range(COLUMNS.columns * COLUMNS.rows):
            mean = sum(w * V[b, i] for i, w in zip(down.index[k], down.weight[k], strict=True))
            a, h = divmod(k, COLUMNS.rows)
            np.testing.assert_allclose(cells[b, a, h], tables().frames[a] @ (mean - anchor[b, a]), atol=1e-5)


def test_further_convolutions_are_added_around_the_recurrence():
    """Each is y + gelu(K y + b) of a column and its neighbours, by hand; a zero one changes nothing."""
    none = {name: jax.tree.map(jnp.zeros_like, params()[name]) for name in ("before_0", "after_0")}
    without = {k: v for k, v in params().items() if k not in none}
    plain = dataclasses.replace(COLUMNS, layers=0)
    frame, carry = frame_at(4), anywhere()

    def after(p: dict, config: ColumnRnnConfig) -> ColumnCarry:
        gates = seen_gates(p, frame.seen, config=config)
        return column_step(p, carry, frame, gates, tables=tables(), config=config)

    fewer, zero = after(without, plain), after(params() | none, COLUMNS)
    for a, b in zip(fewer, zero, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)
    last = after(params() | {"before_0": none["before_0"]}, COLUMNS)
    np.testing.assert_allclose(last.h, fewer.h, atol=1e-6)  # the one after does not reach the state
    y = jax.nn.gelu(neighbours(without["around"], np.asarray(fewer.h)))
    y = np.asarray(y + jax.nn.gelu(neighbours(params()["after_0"], np.asarray(y))))
    X = y @ np.asarray(params()["out"]["kernel"]) + np.asarray(params()["out"]["bias"])
    X = X.reshape(last.X.shape) * tables().scale + tables().typical
    np.testing.assert_allclose(last.X, X, atol=1e-5)
    # the one before, by the carry it makes: the same carry from a first layer to which it was added by hand
    first = {"kernel": without["state"]["kernel"], "bias": without["seen"]["bias"]}
    flat = (COLUMNS.columns, 3 * COLUMNS.rows)
    hung = np.asarray(turned(carry.X, frame.turn) - frame.way[..., None, :])
    place = ((hung - tables().typical) / tables().scale).reshape(flat)
    moved = np.asarray(turned(carry.moved, frame.turn)).reshape(flat) / MOVED
    state = np.concatenate([np.clip(x, -6, 6) for x in (place, moved)] + [np.asarray(carry.h)], axis=-1)
    seen = {"kernel": without["seen"]["kernel"], "bias": 0 * first["bias"]}
    u = np.asarray(jax.nn.gelu(neighbours(first, state) + neighbours(seen, np.asarray(frame.seen))))
    u = np.asarray(u + jax.nn.gelu(neighbours(params()["before_0"], u)))
    everywhere = np.concatenate([u.mean(axis=0), u.max(axis=0)]) @ np.asarray(without["all"]["kernel"])
    everywhere = np.asarray(jax.nn.gelu(everywhere + np.asarray(without["all"]["bias"])))
    into = u @ np.asarray(without["gates"]["kernel"]) + np.asarray(without["gates"]["bias"])
    into = into + everywhere @ np.asarray(without["gates_all"]["kernel"])
    h = gru_step({"gru_h": without["gates_h"]}, carry.h, jnp.asarray(into, jnp.float32))
    np.testing.assert_allclose(after(params(), COLUMNS).h, h, atol=1e-5)
    twice = params() | {name.replace("0", "1"): part for name, part in none.items()}
    for a, b in zip(
        after(twice, dataclasses.replace(COLUMNS, layers=2)), after(params(), COLUMNS), strict=True
    ):
        np.testing.assert_allclose(a, b, atol=1e-6)


def neighbours(layer: dict, x: np.ndarray) -> np.ndarray:
    """Return a column's sum over its neighbours' kernels, in a loop."""
    kernels = np.split(np.asarray(layer["kernel"]), COLUMNS.around, axis=-1)
    out = np.zeros((COLUMNS.columns, COLUMNS.width), np.float32)
    for a in range(COLUMNS.columns):
        for k, kernel in enumerate(kernels):
            out[a] += x[(a - k + COLUMNS.around // 2) % COLUMNS.columns] @ kernel
    return out + np.asarray(layer["bias"])


def test_without_previous_state_the_cells_before_do_not_matter():
    config = dataclasses.replace(COLUMNS, previous_state=False)
    p = init_column_rnn(jax.random.key(0), config=config)
    frame, here = frame_at(4), anywhere()
    gates = seen_gates(p, frame.seen, config=config)
    elsewhere = here._replace(X=here.X + 0.1, moved=here.moved - 0.1)
    a, b = (column_step(p, c, frame, gates, tables=tables(), config=config) for c in (here, elsewhere))
    np.testing.assert_array_equal(a.X, b.X)
    np.testing.assert_array_equal(a.h, b.h)
    other = column_step(p, here._replace(h=here.h + 0.1), frame, gates, tables=tables(), config=config)
    assert np.abs(other.X - a.X).max() > 1e-4
    assert np.abs(stepped(here, frame).X - stepped(elsewhere, frame).X).max() > 1e-4
