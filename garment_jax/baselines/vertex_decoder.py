"""The auto-encoder of the paper's Fig. 4: a decoder symmetric to E_gen, positions from the whole of Z.

Our first stage without its decomposition, with all the rest alike: encoder, losses, principal components to
begin from, optimiser. It sees the truth.
"""

import dataclasses
from pathlib import Path

import jax
import numpy as np

from garment_jax.baselines.fitting import finish_model, fitted_model, open_baseline
from garment_jax.baselines.method import Method, Runner
from garment_jax.baselines.streaming import count
from garment_jax.body.root_frame import from_root, heading, to_root
from garment_jax.config import CollisionConfig, Config
from garment_jax.model.generative.network import decode, encode
from garment_jax.model.store import template_for
from garment_jax.structs import Motion, Scene
from garment_jax.training.generative_stage import train_generative

CHUNK = 64  # frames at a time


def single_decoder(config: Config) -> Config:
    """Return the configuration of the first stage with one decoder, for as long as `[baselines]` says."""
    settings = config.baselines
    generative = dataclasses.replace(
        config.generative,
        decomposition=False,
        skin_reach=0.0,
        steps=settings.decoder_steps,
        learning_rate=settings.decoder_rate,
    )
    return dataclasses.replace(config, generative=generative)


def fit(config: Config, run_dir: Path, data_dir: Path) -> None:
    """Train into `run_dir`; goes on from the newest checkpoint."""
    generative = single_decoder(config).generative
    with open_baseline(
        "vertex_decoder", ("decoder",), config, run_dir, data_dir, generative=generative
    ) as run:
        finish_model(run, train_generative(run))


def load(run_dir: Path, collision: CollisionConfig | None = None, lengths: bool = False) -> Runner:
    """Return the runner of a fitted folder."""
    model = fitted_model(run_dir)

    def run(scene: Scene, motion: Motion, V: np.ndarray, name: str) -> np.ndarray:
        template, _ = template_for(model, scene, name)
        root, yaw = motion.root.astype(np.float64), heading(motion.rotations[:, 0])

        @jax.jit
        def rebuilt(params: dict, V: jax.Array) -> jax.Array:
            Z = encode(params, V, template=template, config=model.config.generative).mean
            return decode(params, Z, template=template, config=model.config.generative).V

        out = np.zeros(V.shape, np.float32)
        for start in range(0, len(V), CHUNK):
            # the last window repeats its last frame: one compilation
            which = np.minimum(np.arange(start, start + CHUNK), len(V) - 1)
            local = to_root(V[which].astype(np.float64), root[which], yaw[which]).astype(np.float32)
            placed = np.asarray(rebuilt(model.params, local), np.float64)
            out[which] = from_root(placed, root[which], yaw[which])
        return out

    return Runner(model.params, count(model.params), reconstruct=run)


METHOD = Method("vertex_decoder", "auto-encoder with a single vertex decoder", "reconstruction", fit, load)
