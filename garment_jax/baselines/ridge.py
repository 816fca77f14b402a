"""Ridge regression from motion to principal components, frame by frame or fed with its own last two frames.

The cheapest references: closed form, linear. `ridge_static` sees the motion alone, `ridge` also the
coefficients of the two frames before, which in a rollout are its own. Not in the paper.
"""

from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.animation.frame_method import FrameMethod, in_chunks, step_of
from garment_jax.animation.network_method import make_motion_start
from garment_jax.baselines.features import columns, normalised, read_motion
from garment_jax.baselines.fitting import finish_model, open_baseline
from garment_jax.baselines.method import Method
from garment_jax.baselines.principal import coefficients, principal_components
from garment_jax.baselines.streaming import load_runner
from garment_jax.body.seeds import Seeds
from garment_jax.config import Config
from garment_jax.dataset.batches import spread_frames
from garment_jax.dataset.prepared import frames_of
from garment_jax.dataset.template import Template
from garment_jax.model.store import Model
from garment_jax.structs import Motion, Scene
from garment_jax.training.run import Run

START_FRAMES = 2_400  # frames whose principal components are taken
READS = "pose and velocities"


def fit_ridge(pairs: Iterable[tuple[np.ndarray, np.ndarray]], penalty: float) -> np.ndarray:
    """Return W `[d + 1, k]`, least |[x, 1] W - y|^2 + penalty |W|^2 over `pairs` of x `[f, d]`, y `[f, k]`.

    The last row, the constant, is not penalised. One pass, float64: memory does not grow with the frames.
    Raises `ValueError` without any frame.
    """
    gram, moment = None, None
    for x, y in pairs:
        design = np.concatenate([x, np.ones((len(x), 1))], axis=1).astype(np.float64)
        if gram is None or moment is None:
            gram, moment = np.zeros((design.shape[1],) * 2), np.zeros((design.shape[1], y.shape[1]))
        gram += design.T @ design
        moment += design.T @ y.astype(np.float64)
    if gram is None or moment is None:
        raise ValueError("no frames to fit a ridge regression to; add training clips.")
    gram += penalty * np.diag(np.append(np.ones(len(gram) - 1), 1e-9))
    return np.linalg.solve(gram, moment)


def with_past(x: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows (motion, last coefficients, those before) and the coefficients they lead to."""
    return np.concatenate([x[2:], c[1:-1], c[:-2]], axis=1), c[2:]


def rollout(
    params: dict, state: Float[Array, "two *b k"], x: Float[Array, "t *b d"]
) -> tuple[Float[Array, "two *b k"], Float[Array, "t *b n3"]]:
    """Return the last two frames' coefficients (in deviations) and every frame's flat mesh, metres.

    Without "past" in `params` the frames do not depend on each other and the state passes through.
    """
    known = x @ params["motion"] + params["constant"].reshape((1,) * (x.ndim - 1) + (-1,))
    if "past" in params:
        last, before = jnp.split(params["past"], 2)

        def frame(state: jax.Array, known: jax.Array):
            c = known + state[0] @ last + state[1] @ before
            return jnp.stack([c, state[0]]), c

        state, known = jax.lax.scan(frame, state, known)
    flat = (known * params["deviation"].reshape((1,) * (x.ndim - 1) + (-1,))) @ params["basis"]
    return state, flat + params["mean"].reshape((1,) * (x.ndim - 1) + (-1,))


def _parameters(run: Run, *, past: bool) -> dict[str, np.ndarray]:
    config = run.config.baselines
    components = principal_components(spread_frames(run.data, START_FRAMES), config.components)
    chosen = columns(run.data.scene.body, run.config, READS)
    x = [normalised(clip.input.x.M, run.template, chosen) for clip in run.data.train]
    c = [
        coefficients(lambda which, clip=clip: frames_of(clip, which, run.data), len(clip.V), components)
        for clip in run.data.train
    ]
    deviation = np.maximum(np.concatenate(c).std(axis=0), 1e-6)
    pairs = ((a, b / deviation) for a, b in zip(x, c, strict=True))
    W = fit_ridge((with_past(*pair) if past else pair for pair in pairs), config.ridge)
    split = {"motion": W[: len(chosen)], "constant": W[-1]} | ({"past": W[len(chosen) : -1]} if past else {})
    return {**split, "deviation": deviation, "basis": components.basis, "mean": components.mean}


def _fit(name: str, config: Config, run_dir: Path, data_dir: Path) -> None:
    with open_baseline(name, ("components", "ridge", "inputs"), config, run_dir, data_dir) as run:
        finish_model(run, _parameters(run, past=name == "ridge"))


def method_on(model: Model, scene: Scene, template: Template, seeds: Seeds) -> FrameMethod:
    """Return the method on a scene, begun from the skinned template as if it had hung so for two frames."""
    chosen = columns(scene.body, model.config, READS)
    params = jax.tree.map(np.asarray, model.params)
    start = make_motion_start(model, scene, template, seeds)

    def init(motion: Motion) -> np.ndarray:
        V = np.asarray(start(motion)).reshape(-1)
        c = (V - params["mean"]) @ params["basis"].T / params["deviation"]
        return np.stack([c, c])

    def inputs(motion: Motion) -> Iterator[np.ndarray]:
        x = read_motion(motion, scene, model, template, chosen)
        return in_chunks(x, model.config.rollout.chunk)

    def run(params: dict, state: jax.Array, x: jax.Array) -> tuple[jax.Array, jax.Array]:
        # motions are the first axis of a batch's state
        state, flat = rollout(params, jnp.moveaxis(state, -2, 0), x)
        return jnp.moveaxis(state, 0, -2), flat.reshape(*flat.shape[:-1], -1, 3)

    return FrameMethod(model.params, init, inputs, step_of(run), run)


load = partial(load_runner, method_on)
STATIC = Method(
    "ridge_static",
    "ridge regression, frame by frame",
    "rollout",
    lambda config, run_dir, data_dir: _fit("ridge_static", config, run_dir, data_dir),
    load,
)
METHOD = Method(
    "ridge",
    "ridge regression, auto-regressive",
    "rollout",
    lambda config, run_dir, data_dir: _fit("ridge", config, run_dir, data_dir),
    load,
)
