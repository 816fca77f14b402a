"""Santesteban et al. 2019: a recurrent wrinkle regressor in canonical pose, then linear blend skinning.

A GRU (1,500) on the pose, without the root's values, and a dense layer to each vertex' displacement of the
template; a garment vertex has the skinning weights of its closest body vertex at rest. Their body shape is
constant here. The dense layer's kernel is kept as a product with 256 principal components of the training
displacements: so the squared error is that of the coefficients, and training never touches the mesh.
Their last step, pushing collided vertices out along the nearest body vertex' normal, is left to our solver.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.animation.frame_method import FrameMethod, in_chunks, step_of
from garment_jax.baselines.clip_errors import clip_errors
from garment_jax.baselines.features import columns, normalised, read_motion
from garment_jax.baselines.fitting import finish_model, open_baseline
from garment_jax.baselines.method import Method
from garment_jax.baselines.principal import CHUNK, Components, coefficients, principal_components
from garment_jax.baselines.recurrent import first_hidden, init_recurrent, recur, train_recurrent
from garment_jax.baselines.streaming import load_runner
from garment_jax.body.garment_skinning import closest_weights, joint_transforms
from garment_jax.body.seeds import Seeds
from garment_jax.config import Config
from garment_jax.dataset.cached_arrays import cached_arrays
from garment_jax.dataset.prepared import frames_of
from garment_jax.dataset.template import Template
from garment_jax.geometry.skinning import skin, unskin_frames
from garment_jax.model.store import Model
from garment_jax.structs import Motion, Scene
from garment_jax.training.run import Run, say

READS = "pose"
COMPONENTS = 256  # rank of the dense layer's kernel
BASIS_FRAMES = 2_400  # frames that it is taken from


class PosedInput(NamedTuple):
    """What the method reads of a frame."""

    x: Any  # [d] normalised pose
    R: Any  # [j, 3, 3] joints, canonical -> posed, root frame
    t: Any  # [j, 3] metres


def rollout(
    params: dict,
    h: Float[Array, "*b s"],
    x: PosedInput,
    *,
    T: Float[Array, "n 3"],
    W: Float[Array, "n j"],
) -> tuple[Float[Array, "*b s"], Float[Array, "t *b n 3"]]:
    """Return the recurrent state after the frames `x` `[t, *b, ...]` and their garments, root frames."""
    h, out = recur(params["network"], h, x.x)
    offset = displacement(params, out)
    posed = skin
    for _ in range(out.ndim - 1):
        posed = jax.vmap(posed, (0, None, 0, 0))
    return h, posed(jnp.broadcast_to(T, offset.shape) + offset, W, x.R, x.t)


def displacement(params: dict, out: Float[Array, "*b k"]) -> Float[Array, "*b n 3"]:
    """Return the canonical displacements of the network's outputs (coefficients in deviations), metres."""
    lead = (1,) * (out.ndim - 1)
    flat = (out * params["deviation"].reshape(*lead, -1)) @ params["basis"]
    flat = flat + params["mean"].reshape(*lead, -1)
    return flat.reshape(*out.shape[:-1], -1, 3)


def fit(config: Config, run_dir: Path, data_dir: Path) -> None:
    """Train into `run_dir`; goes on from the newest checkpoint."""
    with open_baseline(
        "santesteban_2019", ("santesteban", "lanes", "inputs"), config, run_dir, data_dir
    ) as run:
        settings = run.config.baselines
        W = closest_weights(run.data.scene)
        components, c = _targets(run, W)
        deviation = np.maximum(np.concatenate(c).std(axis=0), 1e-6)
        fixed = {"basis": components.basis, "mean": components.mean, "deviation": deviation}
        chosen = columns(run.data.scene.body, run.config, READS)
        x = [normalised(clip.input.x.M, run.template, chosen) for clip in run.data.train]
        network = init_recurrent(
            jax.random.key(run.config.training.seed + 40),
            inputs=len(chosen),
            width=settings.santesteban_gru,
            outputs=len(deviation),
        )
        network = train_recurrent(
            run,
            "santesteban",
            network,
            x,
            c,
            coefficient_error(deviation, len(run.template.T)),
            steps=settings.santesteban_steps,
            rate=settings.santesteban_rate,
            seed=41,
            validate=_validation(run, fixed, W, chosen),
        )
        finish_model(run, {"network": network, **fixed, "weights": W})


def coefficient_error(deviation: np.ndarray, n: int) -> Any:
    """Return (outputs in deviations, true coefficients in metres) -> squared cm, mean over `n` vertices."""

    def error(out: jax.Array, c: jax.Array) -> jax.Array:
        E = out * jnp.asarray(deviation).reshape((1,) * (out.ndim - 1) + (-1,)) - c
        return 1e4 / n * jnp.square(E).sum(axis=-1)

    return error


def _targets(run: Run, W: np.ndarray) -> tuple[Components, list[np.ndarray]]:
    """Return the components of canonical displacements and every clip's coefficients; cached."""
    path = run.folder / "cache" / f"canonical-{run.data.content}.npz"
    lengths = [len(clip.V) for clip in run.data.train]
    names = {"mean", "basis", *(str(i) for i in range(len(lengths)))}
    stored = cached_arrays(
        path, lambda: _made_targets(run, W, lengths), fits=lambda arrays: names <= arrays.keys()
    )
    return Components(stored["mean"], stored["basis"]), [stored[str(i)] for i in range(len(lengths))]


def _made_targets(run: Run, W: np.ndarray, lengths: list[int]) -> dict[str, np.ndarray]:
    say("santesteban: displacements of the template in canonical pose")
    motions = [joint_transforms(clip.motion, run.data.scene) for clip in run.data.train]

    def of_clip(i: int):
        return partial(_displacements, run, i, motions[i], W)

    stride = max(sum(lengths) // BASIS_FRAMES, 1)
    spread = [of_clip(i)(np.arange(i % stride, length, stride)) for i, length in enumerate(lengths)]
    X = np.concatenate(spread)
    components = principal_components(X, min(COMPONENTS, len(X) - 1))
    c = [coefficients(of_clip(i), length, components) for i, length in enumerate(lengths)]
    return {str(i): x for i, x in enumerate(c)} | {"mean": components.mean, "basis": components.basis}


def _displacements(
    run: Run, clip: int, posed: tuple[np.ndarray, np.ndarray], W: np.ndarray, which: np.ndarray
) -> np.ndarray:
    """Return the displacements `[k, n, 3]` of the frames `which` of a training clip, metres, canonical."""
    out = np.zeros((len(which), *run.template.T.shape), np.float32)
    for start in range(0, len(which), CHUNK):
        # the last window repeats its last frame, so that every call has the same shape: one compilation
        window = which[np.minimum(np.arange(start, start + CHUNK), len(which) - 1)]
        V = frames_of(run.data.train[clip], window, run.data)
        T_tilde = np.asarray(unskin_frames(V, W, posed[0][window], posed[1][window]))
        stop = min(start + CHUNK, len(which))
        out[start:stop] = T_tilde[: stop - start] - run.template.T
    return out


def _validation(run: Run, fixed: dict, W: np.ndarray, chosen: np.ndarray) -> Any:
    """Return a function of the network that rolls out the clips kept back: RMSE in cm; None without any."""
    clips = run.data.validation
    if not clips:
        return None
    inputs = [
        PosedInput(
            normalised(clip.input.x.M, run.template, chosen), *joint_transforms(clip.motion, run.data.scene)
        )
        for clip in clips
    ]
    roll = jax.jit(partial(rollout, T=jnp.asarray(run.template.T), W=jnp.asarray(W)))

    def validate(network: dict) -> dict[str, float]:
        params = {"network": network, **fixed}
        V = [roll(params, first_hidden(network), x)[1] for x in inputs]
        return clip_errors(clips, [np.asarray(v) for v in V])

    return validate


def method_on(model: Model, scene: Scene, template: Template, seeds: Seeds) -> FrameMethod:
    """Return the method on a scene."""
    chosen = columns(scene.body, model.config, READS)
    roll = partial(rollout, T=jnp.asarray(template.T), W=jnp.asarray(model.params["weights"]))

    def inputs(motion: Motion) -> Iterator[PosedInput]:
        x = read_motion(motion, scene, model, template, chosen)
        return in_chunks(PosedInput(x, *joint_transforms(motion, scene)), model.config.rollout.chunk)

    def init(motion: Motion) -> np.ndarray:
        return first_hidden(model.params["network"])

    return FrameMethod(model.params, init, inputs, step_of(roll), roll)


load = partial(load_runner, method_on)
METHOD = Method("santesteban_2019", "Santesteban et al. 2019", "rollout", fit, load)
