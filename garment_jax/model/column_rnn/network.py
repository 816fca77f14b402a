"""The ring behind pure functions: each column's cloth from what it was, its anchor and the body beside it.

Not in the paper, whose code sees the body's whole motion at once and knows the dances that it has seen. What
moves a column of cloth is near it, and is the same on all sides: columns share their weights, and see each
other through circular convolutions. Everything is in the columns' own frames, so a turn of body and cloth
about the up axis by a column turns what comes out.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import ColumnRnnConfig
from garment_jax.dataset.template import ColumnTables
from garment_jax.geometry.stencil import apply_stencil
from garment_jax.model.column_rnn.motion import FEATURES, LARGEST, MOVED
from garment_jax.model.generative.blocks import along_channels
from garment_jax.model.motion.network import gru_step
from garment_jax.structs import ColumnCarry, ColumnFrame


def init_column_rnn(key: jax.Array, *, config: ColumnRnnConfig) -> dict:
    """Return fresh parameters; the key is consumed."""
    c, w, k = config.hidden, config.width, config.around
    state = 6 * config.rows if config.previous_state else 0
    shapes = {
        "seen": (FEATURES, k * w, k * (FEATURES + state + c)),
        "state": (state + c, k * w, k * (FEATURES + state + c)),
        "all": (2 * w, w, 2 * w),
        "gates": (w, 3 * c, 2 * w),
        "gates_all": (w, 3 * c, 2 * w),
        "gates_h": (c, 3 * c, c),
        "around": (c, k * w, k * c),
        "out": (w, 3 * config.rows, 10 * w),
    }
    further = [f"{place}_{i}" for i in range(config.layers) for place in ("before", "after")]
    shapes |= {name: (w, k * w, k * w) for name in further}
    keys = jax.random.split(key, len(shapes))
    kernels = {
        name: jax.random.normal(one, (i, o)) / jnp.sqrt(fan)
        for one, (name, (i, o, fan)) in zip(keys, shapes.items(), strict=True)
    }
    widths = {"seen": w, "all": w, "gates": 3 * c, "gates_h": 3 * c, "around": w, "out": 3 * config.rows}
    widths |= dict.fromkeys(further, w)
    return {
        name: {"kernel": kernel} | ({"bias": jnp.zeros(widths[name])} if name in widths else {})
        for name, kernel in kernels.items()
    }


def at_rest(tables: ColumnTables, lanes: tuple[int, ...], *, config: ColumnRnnConfig) -> ColumnCarry:
    """Return the carry `lanes` times: the template hangs still."""
    rest = jnp.broadcast_to(jnp.asarray(tables.rest), (*lanes, *tables.rest.shape))
    return ColumnCarry(rest, jnp.zeros_like(rest), jnp.zeros((*lanes, len(tables.rest), config.hidden)))


def seen_gates(
    params: dict, seen: Float[Array, "*t a f"], *, config: ColumnRnnConfig
) -> Float[Array, "*t a w"]:
    """Return what the motion adds to the first layer, any leading axes: it does not wait for the carry."""
    y = _circular(seen @ params["seen"]["kernel"], config.around)
    return y + along_channels(params["seen"]["bias"], y)


def column_step(
    params: dict,
    carry: ColumnCarry,
    frame: ColumnFrame,
    gates: Float[Array, "*b a w"],
    *,
    tables: ColumnTables,
    config: ColumnRnnConfig,
    kept: Float[Array, "*b 1 w"] | None = None,
) -> ColumnCarry:
    """Return the carry after this frame, bounded whatever comes in; `gates`: `seen_gates` of `frame.seen`.

    `kept` is multiplied with the first layer (dropout while training).
    """
    turn = jnp.asarray(frame.turn)
    hung = turned(carry.X, turn) - frame.way[..., None, :]
    moved = turned(carry.moved, turn)
    flat = (*hung.shape[:-2], 3 * config.rows)
    typical, scale = (jnp.broadcast_to(x, hung.shape) for x in (tables.typical, tables.scale))
    state = carry.h
    if config.previous_state:
        place = (hung - typical) / scale
        cells = [jnp.clip(x, -LARGEST, LARGEST).reshape(flat) for x in (place, moved / MOVED)]
        state = jnp.concatenate([*cells, state], axis=-1)
    u = jax.nn.gelu(gates + _circular(state @ params["state"]["kernel"], config.around))
    if kept is not None:
        u = u * jnp.broadcast_to(kept, u.shape)
    for i in range(config.layers):
        u = u + _convolved(params[f"before_{i}"], u, config.around)
    everywhere = jnp.concatenate([u.mean(axis=-2), u.max(axis=-2)], axis=-1)
    everywhere = jax.nn.gelu(_dense(params["all"], everywhere))
    into = _dense(params["gates"], u) + (everywhere @ params["gates_all"]["kernel"])[..., None, :]
    h = gru_step({"gru_h": params["gates_h"]}, carry.h, into)
    y = _convolved(params["around"], h, config.around)
    for i in range(config.layers):
        y = y + _convolved(params[f"after_{i}"], y, config.around)
    X = _dense(params["out"], y).reshape(hung.shape) * scale + typical
    return ColumnCarry(X, X - hung, h)


def roll_columns(
    params: dict,
    carry: ColumnCarry,
    frames: ColumnFrame,
    *,
    tables: ColumnTables,
    config: ColumnRnnConfig,
    kept: Float[Array, "*b 1 w"] | None = None,
) -> tuple[ColumnCarry, Float[Array, "t *b a h 3"]]:
    """Return the carry after the frames (leaves `[t, *b, ...]`) and all cells, metres from their anchors.

    `kept`: as of `column_step`, the same for all frames.
    """

    def frame(carry: ColumnCarry, inputs: tuple[ColumnFrame, jax.Array]):
        carry = column_step(params, carry, *inputs, tables=tables, config=config, kept=kept)
        return carry, carry.X

    gates = seen_gates(params, jnp.asarray(frames.seen), config=config)
    return jax.lax.scan(frame, carry, (frames, gates))


def turned(x: Float[Array, "*b a h 3"], angle: Float[Array, "*b"]) -> Float[Array, "*b a h 3"]:
    """Return vectors of the columns' frames turned about the up axis."""
    c, s = (jnp.broadcast_to(f(angle)[..., None, None], x.shape[:-1]) for f in (jnp.cos, jnp.sin))
    return jnp.stack([c * x[..., 0] - s * x[..., 1], s * x[..., 0] + c * x[..., 1], x[..., 2]], axis=-1)


def cells_of(
    V: Float[Array, "*b n 3"], anchor: Float[Array, "*b a 3"], *, tables: ColumnTables
) -> Float[Array, "*b a h 3"]:
    """Return where the cells of a garment hang, from the anchors; metres, `V` and `anchor` in root frames.

    Cells without cloth hang where the others of their row do on the template.
    """
    a, h = tables.filled.shape
    cells = apply_stencil(V, tables.down).reshape(*V.shape[:-2], a, h, 3) - anchor[..., None, :]
    cells = jnp.einsum("aij,...ahj->...ahi", tables.frames, cells)
    typical, filled = (jnp.broadcast_to(x, cells.shape) for x in (tables.typical, tables.filled[..., None]))
    return jnp.where(filled > 0, cells, typical)


def corrected(
    V: Float[Array, "*b n 3"],
    X: Float[Array, "*b a h 3"],
    anchor: Float[Array, "*b a 3"],
    *,
    tables: ColumnTables,
    weight: float,
) -> Float[Array, "*b n 3"]:
    """Return `V` with `weight` of the way from its cells to `X` gone, smoothly in between; its folds stay."""
    return V + apply_stencil(cells_moved(V, X, anchor, tables=tables, weight=weight), tables.up)


def cells_moved(
    V: Float[Array, "*b n 3"],
    X: Float[Array, "*b a h 3"],
    anchor: Float[Array, "*b a 3"],
    *,
    tables: ColumnTables,
    weight: float,
) -> Float[Array, "*b ah 3"]:
    """Return how far `corrected` moves each cell, metres, root frame; a cell without cloth not at all."""
    away = weight * (X - cells_of(V, anchor, tables=tables))
    filled = jnp.broadcast_to(tables.filled[..., None], away.shape)
    away = jnp.einsum("aij,...ahi->...ahj", tables.frames, jnp.where(filled > 0, away, 0.0))
    return away.reshape(*away.shape[:-3], -1, 3)


def _dense(params: dict, x: jax.Array) -> jax.Array:
    y = x @ params["kernel"]
    return y + along_channels(params["bias"], y)


def _convolved(params: dict, x: jax.Array, around: int) -> jax.Array:
    y = _circular(x @ params["kernel"], around)
    return jax.nn.gelu(y + along_channels(params["bias"], y))


def _circular(y: Float[Array, "*b a kw"], around: int) -> Float[Array, "*b a w"]:
    """Return the circular convolution whose products with each neighbour's kernel are `y`, side by side."""
    pieces = jnp.split(y, around, axis=-1)
    return sum(  # type: ignore[return-value]
        jnp.roll(piece, k - around // 2, axis=-2) for k, piece in enumerate(pieces)
    )
