"""Training of Pan's high-frequency part: on single frames, each with the window of bone motions before it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from garment_jax.animation.clips import stack_motions
from garment_jax.baselines.pan_network import Rig, low_mesh, residual
from garment_jax.baselines.recurrent import dense, first_hidden, hidden_states, recur
from garment_jax.config import DetailConfig
from garment_jax.dataset.prepared import frames_of
from garment_jax.dataset.template import Template
from garment_jax.model.detail.losses import detail_terms
from garment_jax.structs import TrainState
from garment_jax.training.run import Run, optimise, say

BATCH = 8  # frames


class ResidualBatch(NamedTuple):
    """Frames to correct."""

    x: Any  # [W, B, 6 b] standardised bone motions of windows
    at: Any  # [B] the frame of each window that counts
    V_star: Any  # [B, n, 3] metres, root frame


def residual_loss(
    params: dict, batch: ResidualBatch, *, rig: Rig, template: Template, config: DetailConfig
) -> tuple[jax.Array, dict[str, jax.Array]]:
    """Return our detail stage's L1 and Laplacian terms of the corrected frames, and the metrics."""
    _, states = hidden_states(params["network"], jnp.zeros(_hidden_shape(params, batch)), batch.x)
    lanes = jnp.arange(len(batch.at))
    V = low_mesh(batch.x[batch.at, lanes], rig)
    features = dense(params["network"]["out"], states[batch.at, lanes])
    V_f = V + residual(params, V, features, template=template)
    terms = {
        k: t.mean() for k, t in detail_terms(V_f, batch.V_star, template=template, config=config).items()
    }
    loss = terms["vertex"] + terms["laplacian"]
    before, after = (100 * jnp.sqrt(jnp.square(v - batch.V_star).sum(-1).mean()) for v in (V, V_f))
    return loss, {**terms, "loss": loss, "rmse_before_cm": before, "rmse_cm": after}


def _hidden_shape(params: dict, batch: ResidualBatch) -> tuple[int, int]:
    return batch.x.shape[1], params["network"]["gru_h"]["kernel"].shape[0]


def low_motions(low: dict, x: list[np.ndarray]) -> list[np.ndarray]:
    """Return the smooth part's rollout of each clip, standardised bone motions `[t, 6 b]`."""
    h = np.zeros((len(x), len(first_hidden(low))), np.float32)
    out = np.asarray(jax.jit(recur)(low, h, stack_motions(x, 1))[1])
    return [out[: len(clip), i] for i, clip in enumerate(x)]


def train_residual(
    run: Run,
    rig: Rig,
    low: dict,
    x: list[np.ndarray],
    params: dict,
    *,
    validate: Callable[[dict], dict[str, float]] | None,
) -> dict:
    """Return the trained high-frequency part; the smooth part `low` is not touched."""
    say("residual: rolling out the bones of the training clips")
    motions, settings = low_motions(low, x), run.config.baselines
    window = run.config.motion.window

    def batch_at(step: int) -> ResidualBatch:
        rng = np.random.default_rng([run.config.training.seed + 60, step])
        lengths = np.array([len(m) if len(m) >= window else 0 for m in motions], float)
        clips = rng.choice(len(motions), BATCH, p=lengths / lengths.sum())
        starts = [int(rng.integers(0, len(motions[c]) - window + 1)) for c in clips]
        # late in the window, where the state has seen enough; anywhere where the clip begins
        at = np.array([int(rng.integers(window // 2 if s else 0, window)) for s in starts])
        picks = list(zip(clips, starts, at, strict=True))
        V = [frames_of(run.data.train[c], np.array([s + k]), run.data)[0] for c, s, k in picks]
        return ResidualBatch(
            np.stack([motions[c][s : s + window] for c, s, _ in picks], axis=1), at, np.stack(V)
        )

    def step_of(optimiser: optax.GradientTransformation):
        def step(state: TrainState, batch: ResidualBatch):
            gradient, metrics = jax.grad(residual_loss, has_aux=True)(
                state.params, batch, rig=rig, template=run.template, config=run.config.detail
            )
            updates, opt_state = optimiser.update(gradient, state.opt_state, state.params)
            params = optax.apply_updates(state.params, updates)
            return TrainState(params, opt_state, state.key, state.step + 1), metrics

        return jax.jit(step, donate_argnums=0)

    return optimise(
        run,
        "residual",
        params,
        step_of,
        batch_at,
        steps=settings.pan_residual_steps,
        learning_rate=settings.pan_residual_rate,
        weight_decay=run.config.detail.weight_decay,
        seed=0,
        frames_per_step=BATCH,
        validate=validate,
    )
