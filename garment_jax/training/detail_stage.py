"""Stage 3: the detail enhancement module against its discriminator (paper 3.4)."""

from functools import partial
from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.animation.clips import stack_motions
from garment_jax.dataset.cached_arrays import cached_list
from garment_jax.dataset.prepared import targets_of
from garment_jax.model.compose import init_state
from garment_jax.model.detail.train_step import (
    DetailBatch,
    init_players,
    make_detail_train_step,
    side_by_side,
)
from garment_jax.model.generative.network import decode
from garment_jax.model.scan import latent_rollout
from garment_jax.progress import FrameProgress
from garment_jax.structs import FrameInput
from garment_jax.training.latents import true_latents
from garment_jax.training.pretrained import load_pretrained
from garment_jax.training.run import Run, optimise, say

CHUNK = 50  # frames of a rollout at a time
AT_ONCE = 8  # clips rolled out side by side


def train_detail(run: Run, generative: dict, motion: dict) -> dict:
    """Return the trained generator's parameters; goes on from the newest checkpoint."""
    config, training = run.config.detail, run.config.training
    Z = _latents(run, generative, motion)
    rebuild = jax.jit(lambda Z: decode(generative, Z, template=run.template, config=run.config.generative).V)

    # a rollout's first frames are still on their way from the skinned template: nothing to learn there
    first = run.config.motion.grace if config.source == "rollout" else 0
    rows = run.devices.rows(config.batch)

    def batch_at(step: int) -> DetailBatch:
        rng = np.random.default_rng([training.seed + 30, step])
        lengths = np.array([len(z) for z in Z])
        clips = rng.choice(len(Z), config.batch, p=lengths / lengths.sum())
        frames = [int(rng.integers(min(first, lengths[c] - 1), lengths[c])) for c in clips]
        clips, frames = clips[rows], frames[rows]
        latents = np.stack([Z[c][f] for c, f in zip(clips, frames, strict=True)])
        truth = [
            targets_of(run.data.train[c], np.array([f]), run.data)[0]
            for c, f in zip(clips, frames, strict=True)
        ]
        return DetailBatch(rebuild(latents), jnp.asarray(latents), jnp.asarray(np.stack(truth)))

    params = init_players(
        jax.random.key(training.seed + 5), run.template, config=config, generative=run.config.generative
    )
    params["G"] = load_pretrained(training.begin_from, "detail", params["G"])
    trained = optimise(
        run,
        "detail",
        params,
        partial(make_detail_train_step, run.template, config),
        batch_at,
        steps=config.steps,
        learning_rate=config.learning_rate,
        weight_decay=config.weight_decay,
        seed=training.seed + 6,
        frames_per_step=config.batch,
        players=lambda player: side_by_side({"G": player, "D": player}),
    )
    return trained["G"]


def _latents(run: Run, generative: dict, motion: dict) -> list[np.ndarray]:
    """Return the latents `[t, latent]` of the frames to enhance, by clip: the truth's, or of rollouts."""
    if run.config.detail.source == "reconstruction":
        return true_latents(run, generative)

    def rolled_out() -> list[np.ndarray]:
        say("detail: rolling out the training clips")
        with FrameProgress("detail") as progress:
            progress.say("compiling")
            return _rollout_codes(run, {"generative": generative, "motion": motion}, progress)

    lengths = [len(clip.V) for clip in run.data.train]
    path = run.folder / "cache" / "rollout_codes.npz"
    return run.devices.after_first(lambda: cached_list(path, rolled_out, lengths))


def _rollout_codes(run: Run, params: dict, progress: FrameProgress) -> list[np.ndarray]:
    @jax.jit
    def roll(params: dict, state, x: FrameInput):
        state, Z, _ = latent_rollout(params, state, x, template=run.template, config=run.config)
        return state, Z

    latents, frames = [], sum(len(clip.V) for clip in run.data.train)
    for first in range(0, len(run.data.train), AT_ONCE):
        clips = run.data.train[first : first + AT_ONCE]
        clips = clips + clips[-1:] * (AT_ONCE - len(clips))  # one compiled width
        x = stack_motions([clip.input.x for clip in clips], CHUNK)
        start = run.skinned(
            np.stack([clip.input.R_seed[0] for clip in clips]),
            np.stack([clip.input.t_seed[0] for clip in clips]),
        )
        state, parts = init_state(params, start, template=run.template, config=run.config).motion, []
        for k in range(0, len(x.M), CHUNK):
            state, Z = roll(params, state, jax.tree.map(itemgetter(slice(k, k + CHUNK)), x))
            parts.append(np.asarray(Z))
        whole = np.concatenate(parts)
        latents += [whole[: len(clip.V), b] for b, clip in enumerate(clips)]
        progress(min(sum(map(len, latents)), frames), frames)
    return latents[: len(run.data.train)]
