"""A recurrent regressor, motion in and numbers out, and its truncated back-propagation through time.

Santesteban's and Pan's networks are both a GRU and a dense layer; neither reads its own last frame. So a
window's outputs come at once, and the state alone crosses into the next window, its gradient cut.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from garment_jax.dataset.batches import lane_schedule
from garment_jax.dataset.lanes import LaneWindow, frame_weights
from garment_jax.model.motion.network import gru_step
from garment_jax.structs import TrainState
from garment_jax.training.run import Run, optimise


class WindowBatch(NamedTuple):
    """One window of every lane; W frames, L lanes."""

    x: Any  # [W, L, d] normalised motion
    target: Any  # leaves [W, L, ...]
    weight: Any  # [W, L] how much each frame's error counts
    fresh: Any  # [L] bool, the lane begins here


# (outputs [W, L, k], target leaves [W, L, ...]) -> squared cm [W, L], mean over vertices
FrameError = Callable[[jax.Array, Any], jax.Array]


def init_recurrent(key: jax.Array, *, inputs: int, width: int, outputs: int) -> dict:
    """Return fresh parameters of a GRU of `width` and a dense layer; the key is consumed.

    The dense layer begins small: every output at its mean.
    """
    keys = jax.random.split(key, 3)
    return {
        "gru_x": _fresh(keys[0], inputs, 3 * width),
        "gru_h": _fresh(keys[1], width, 3 * width),
        "out": _fresh(keys[2], width, outputs, scale=0.1),
    }


def _fresh(key: jax.Array, inputs: int, width: int, *, scale: float = 1.0) -> dict:
    kernel = scale * jax.random.normal(key, (inputs, width)) / np.sqrt(inputs)
    return {"kernel": kernel, "bias": jnp.zeros(width)}


def dense(params: dict, x: Float[Array, "*b d"]) -> Float[Array, "*b k"]:
    """Return the dense layer of `x`."""
    return x @ params["kernel"] + params["bias"].reshape((1,) * (x.ndim - 1) + (-1,))


def first_hidden(params: dict) -> np.ndarray:
    """Return the state before a motion's first frame."""
    return np.zeros(params["gru_h"]["kernel"].shape[0], np.float32)


def recur(
    params: dict, h: Float[Array, "*b s"], x: Float[Array, "t *b d"]
) -> tuple[Float[Array, "*b s"], Float[Array, "t *b k"]]:
    """Return the state after the frames and every frame's outputs; all but the recurrence at once."""
    h, states = hidden_states(params, h, x)
    return h, dense(params["out"], states)


def hidden_states(
    params: dict, h: Float[Array, "*b s"], x: Float[Array, "t *b d"]
) -> tuple[Float[Array, "*b s"], Float[Array, "t *b s"]]:
    """Return the state after the frames and after each of them."""

    def frame(h: jax.Array, gates: jax.Array):
        h = gru_step(params, h, gates)
        return h, h

    return jax.lax.scan(frame, h, dense(params["gru_x"], x))


def window_loss(
    params: dict, h: jax.Array, batch: WindowBatch, *, error: FrameError
) -> tuple[jax.Array, tuple[jax.Array, dict[str, jax.Array]]]:
    """Return the weighted mean squared error of a window, the state after it and the metrics."""
    h = jax.lax.stop_gradient(jnp.where(batch.fresh[:, None], 0.0, h))
    h, outputs = recur(params, h, batch.x)
    loss = (batch.weight * error(outputs, batch.target)).sum() / batch.weight.sum()
    return loss, (h, {"loss": loss, "rmse_cm": jnp.sqrt(loss)})


def make_window_step(
    error: FrameError, optimiser: optax.GradientTransformation
) -> Callable[[TrainState, WindowBatch], tuple[TrainState, dict[str, jax.Array]]]:
    """Return the jitted step (state, batch) -> (state, metrics); `state.carry` is the lanes' `h`."""

    def step(state: TrainState, batch: WindowBatch):
        gradient, (h, metrics) = jax.grad(window_loss, has_aux=True)(
            state.params, state.carry, batch, error=error
        )
        updates, opt_state = optimiser.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        return TrainState(params, opt_state, state.key, state.step + 1, h), metrics

    return jax.jit(step, donate_argnums=0)


def train_recurrent(
    run: Run,
    stage: str,
    params: dict,
    inputs: list[np.ndarray],
    targets: list[Any],
    error: FrameError,
    *,
    steps: int,
    rate: float,
    seed: int,
    validate: Callable[[dict], dict[str, float]] | None,
) -> dict:
    """Return the trained parameters; goes on from the newest checkpoint.

    `inputs` `[t, d]` and `targets` (leaves `[t, ...]`) are of each training clip. Lanes, windows and the
    weights of their first frames are those of our own motion encoder (`[motion]`).
    """
    lanes_at, batch_at = windows(run, inputs, targets, steps=steps, seed=seed)
    lanes, width = len(lanes_at[0].clip), len(first_hidden(params))

    return optimise(
        run,
        stage,
        params,
        partial(make_window_step, error),
        batch_at,
        steps=steps,
        learning_rate=rate,
        weight_decay=run.config.motion.weight_decay,
        seed=seed,
        frames_per_step=lanes * run.config.motion.window,
        carry=jnp.zeros((lanes, width)),
        validate=validate,
    )


def windows(
    run: Run, inputs: list[np.ndarray], targets: list[Any], *, steps: int, seed: int
) -> tuple[list[LaneWindow], Callable[[int], WindowBatch]]:
    """Return which frames every lane sees in each of `steps` windows, and the batch of a step."""
    config = run.config.motion
    lanes_at = lane_schedule(
        run.data, config, lanes=run.config.baselines.lanes, steps=steps, seed=run.config.training.seed + seed
    )

    def batch_at(step: int) -> WindowBatch:
        lanes = lanes_at[step]
        # a state that knows no frame: every lane within a clip begins unknowing, as ours from a skinned start
        unknowing = lanes._replace(true_start=np.zeros_like(lanes.true_start))
        return WindowBatch(
            lane_slices(inputs, lanes, config.window),
            lane_slices(targets, lanes, config.window),
            frame_weights(unknowing, config.window, config.grace),
            lanes.fresh,
        )

    return lanes_at, batch_at


def lane_slices(clips: list[Any], lanes: LaneWindow, window: int) -> Any:
    """Return every lane's window of per-clip trees (leaves `[t, ...]`), leaves `[W, L, ...]`."""
    picks = list(zip(lanes.clip, lanes.start, strict=True))
    return jax.tree.map(
        lambda *leaves: np.stack([leaves[c][s : s + window] for c, s in picks], axis=1), *clips
    )
