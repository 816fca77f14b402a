"""The latents of all training frames, once per trained generative model (paper 3.3, Z*)."""

import jax
import numpy as np

from garment_jax.dataset.cached_arrays import cached_list
from garment_jax.dataset.prepared import targets_of
from garment_jax.model.generative.network import encode
from garment_jax.progress import FrameProgress
from garment_jax.training.run import Run, say

CHUNK = 64  # frames


def true_latents(run: Run, generative: dict) -> list[np.ndarray]:
    """Return Z* `[t, latent]` of every training clip, mirror images included; cached in the run's folder."""
    lengths = [len(clip.V) for clip in run.data.train]
    path = run.folder / "cache" / "true_latents.npz"
    return run.devices.after_first(lambda: cached_list(path, lambda: _encoded(run, generative), lengths))


def _encoded(run: Run, generative: dict) -> list[np.ndarray]:
    @jax.jit
    def mean(params: dict, V: jax.Array) -> jax.Array:
        return encode(params, V, template=run.template, config=run.config.generative).mean

    latents: list[np.ndarray] = []
    done, frames = 0, sum(len(clip.V) for clip in run.data.train)
    say("motion: encoding the training clips")
    with FrameProgress("motion") as progress:
        progress.say("compiling")
        for clip in run.data.train:
            Z = np.zeros((len(clip.V), run.config.generative.latent_dim), np.float32)
            for start in range(0, len(clip.V), CHUNK):
                window = np.minimum(np.arange(start, start + CHUNK), len(clip.V) - 1)
                Z[window] = mean(generative, targets_of(clip, window, run.data))
            latents.append(Z)
            done += len(Z)
            progress(done, frames)
    return latents
