"""The linear decoder of the paper's Fig. 4: fixed skinning weights, every frame's bones by least squares.

Bones and weights are fitted to the training clips; a frame is then as near to the truth as rigid bones can
carry the template. It sees the truth: a bound for skinning, not an animation.
"""

from pathlib import Path

import numpy as np

from garment_jax.baselines.bones import bone_transforms, carried, find_bones
from garment_jax.baselines.fitting import finish_model, fitted_model, open_baseline
from garment_jax.baselines.method import Method, Runner
from garment_jax.baselines.streaming import count
from garment_jax.config import CollisionConfig, Config
from garment_jax.model.store import template_for
from garment_jax.structs import Motion, Scene


def reconstruct(rest: np.ndarray, weights: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Return frames `V` `[t, n, 3]` as bones of `weights` `[n, b]` best carry `rest` `[n, 3]`, metres."""
    return carried(rest.astype(np.float64), weights.astype(np.float64), *bone_transforms(rest, V, weights))


def fit(config: Config, run_dir: Path, data_dir: Path) -> None:
    """Decompose the training clips into `run_dir`."""
    with open_baseline("ssdr_linear", ("bones",), config, run_dir, data_dir) as run:
        finish_model(run, {"weights": find_bones(run).weights})


def load(run_dir: Path, collision: CollisionConfig | None = None, lengths: bool = False) -> Runner:
    """Return the runner of a fitted folder."""
    model = fitted_model(run_dir)
    weights = np.asarray(model.params["weights"])

    def run(scene: Scene, motion: Motion, V: np.ndarray, name: str) -> np.ndarray:
        template, _ = template_for(model, scene, name)
        return reconstruct(template.T, weights, V).astype(np.float32)

    return Runner(model.params, count(model.params), reconstruct=run)


METHOD = Method("ssdr_linear", "SSDR, linear decoder of the truth", "reconstruction", fit, load)
