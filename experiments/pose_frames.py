"""In which frame does a garment's shape carry over to motions that were not trained on?

    python experiments/pose_frames.py data/skirt --held martial_04 martial_06 indian_04 indian_15

One closed-form regression (ridge on random Fourier features of the motion and its running means) is fitted to
the training clips but the held ones and tried on these, its targets once the garment in the root frame and
then in canonical pose, by the inverse of linear blend skinning: with the weights of the closest body vertex
(Santesteban et al. 2019), with those averaged over so many metres of cloth, and with joints that count only
from so many degrees on (`garment_transforms`). RMSE in cm, in the root frame, principal components included.
Nothing is trained; a quarter of a minute a frame.
"""

import argparse
import dataclasses
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import jax
import numpy as np
from scipy.linalg import cho_factor, cho_solve

from garment_jax.baselines.features import columns
from garment_jax.baselines.principal import Components, coefficients, principal_components
from garment_jax.bench.figures import report
from garment_jax.body.garment_skinning import (
    FREE_ANGLE,
    closest_weights,
    garment_transforms,
    garment_weights,
)
from garment_jax.config import load_config
from garment_jax.dataset.prepared import DataSet, PreparedClip, frames_of, prepare
from garment_jax.geometry.skinning import skin, unskin_frames

SECONDS = (0.1, 0.3, 1.0)  # time constants of the motion's running means
FEATURES, WIDTH, PENALTY = 3_000, 2.0, 10.0
COMPONENTS, BASIS_FRAMES, CHUNK = 96, 2_400, 64


def running_mean(x: np.ndarray, seconds: float, fps: float) -> np.ndarray:
    """Return the causal exponential mean of `x` `[t, d]`, begun at its first frame."""
    keep, y = np.exp(-1.0 / (fps * seconds)), np.empty_like(x)
    state = x[0]
    for t, now in enumerate(x):
        state = y[t] = keep * state + (1 - keep) * now
    return y


def seen(x: np.ndarray, fps: float) -> np.ndarray:
    """Return what the regression sees of a clip's normalised motion `[t, d]`: all of it causal."""
    moved = np.tanh(np.cumsum(np.abs(x).mean(axis=1)) / fps / 10)  # how much has happened since the start
    means = [running_mean(x, seconds, fps) for seconds in SECONDS]
    return np.concatenate([x, *means, np.repeat(moved[:, None], 8, axis=1)], axis=1)


def in_chunks(f: Callable, V: np.ndarray, W: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return `f` of frames, windows of one length: one compilation."""
    out = np.empty_like(V)
    for start in range(0, len(V), CHUNK):
        window = np.minimum(np.arange(start, start + CHUNK), len(V) - 1)
        stop = min(start + CHUNK, len(V))
        out[start:stop] = np.asarray(f(V[window], W, R[window], t[window]))[: stop - start]
    return out


class Frames:
    """Garments of the clips in one frame: the root's (`W` None) or canonical pose by the weights `W`."""

    def __init__(self, data: DataSet, W: np.ndarray | None, angle: float) -> None:
        self.data, self.W, self.angle = data, W, angle
        self.pose = jax.jit(jax.vmap(skin, (0, None, 0, 0)))

    def transforms(self, clip: PreparedClip) -> tuple[np.ndarray, np.ndarray]:
        return garment_transforms(clip.motion, self.data.scene, free_angle=self.angle)

    def of(self, clip: PreparedClip, which: np.ndarray) -> np.ndarray:
        V = frames_of(clip, which, self.data)
        if self.W is None:
            return V
        R, t = self.transforms(clip)
        return in_chunks(unskin_frames, V, self.W, R[which], t[which])

    def back(self, clip: PreparedClip, U: np.ndarray) -> np.ndarray:
        return U if self.W is None else in_chunks(self.pose, U, self.W, *self.transforms(clip))


def components_of(frames: Frames, clips: list[PreparedClip]) -> Components:
    stride = max(sum(len(clip.V) for clip in clips) // BASIS_FRAMES, 1)
    picked = [frames.of(clip, np.arange(i % stride, len(clip.V), stride)) for i, clip in enumerate(clips)]
    return principal_components(np.concatenate(picked), COMPONENTS)


def regression(x: list[np.ndarray]) -> Callable[[list[np.ndarray]], Callable[[np.ndarray], np.ndarray]]:
    """Return a function of coefficients that fits the ridge regression from features `x` to them.

    What it returns takes features and predicts coefficients.
    """
    X = np.concatenate(x)
    factor = cho_factor((X.T @ X).astype(np.float64) + PENALTY * np.eye(X.shape[1]))

    def fitted(c: list[np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
        C = np.concatenate(c).astype(np.float64)
        mean = C.mean(axis=0)
        W = cho_solve(factor, (X.T @ (C - mean).astype(np.float32)).astype(np.float64))
        return lambda x: (x @ W + mean).astype(np.float32)

    return fitted


def random_features(x: list[np.ndarray], count: int) -> list[np.ndarray]:
    """Return cosines of random projections, and a little of the standardised input itself.

    Mean and deviation are those of the first `count` clips.
    """
    known = np.concatenate(x[:count])
    mean, deviation, d = known.mean(axis=0), known.std(axis=0) + 1e-6, known.shape[1]
    rng = np.random.default_rng(0)
    ways = rng.standard_normal((d, FEATURES)) / (WIDTH * np.sqrt(d))
    phase, out = rng.uniform(0, 2 * np.pi, FEATURES), []
    for clip in x:
        z = (clip - mean) / deviation
        waves = np.sqrt(20 / FEATURES) * np.cos(z @ ways + phase)
        out.append(np.concatenate([waves, 0.03 * z], axis=1).astype(np.float32))
    return out


def main() -> None:
    """Print and write one row a frame."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="folder with train/")
    parser.add_argument("--held", nargs="+", required=True, help="training clips to try on")
    parser.add_argument("--reaches", nargs="+", type=float, default=[0.18, 0.35, 0.7], help="metres")
    parser.add_argument("--angles", nargs="+", type=float, default=[0, 30, 60, 75, 90], help="degrees")
    parser.add_argument("--config", default="configs/skirt.toml")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    config = load_config(options.config)
    kept = dataclasses.replace(config.data, validation=tuple(options.held))
    with tempfile.TemporaryDirectory() as cache:
        data = prepare(options.data, dataclasses.replace(config, data=kept), Path(cache))
        chosen = columns(data.scene.body, config, "pose and velocities")
        rows = rows_of(data, chosen, frames_to_try(data, options.reaches, options.angles))
    report(rows, title="Frames to predict in", facts={"held": len(options.held)}, json_path=options.json)


def frames_to_try(data: DataSet, reaches: list[float], angles: list[float]) -> dict[str, Frames]:
    """Return the frames by name: every reach with the first angle and with 60, every angle with 0.35 m."""
    frames = {"root": Frames(data, None, 0.0)}
    frames["canonical, closest vertex"] = Frames(data, closest_weights(data.scene), 0.0)
    pairs = [(0.35, a) for a in angles] + [(r, a) for r in reaches for a in (angles[0], FREE_ANGLE)]
    for reach, angle in dict.fromkeys(pairs):
        W = garment_weights(data.scene, reach=reach, mirrored=True)
        frames[f"canonical, {reach:g} m, {angle:g} degrees"] = Frames(data, W, angle)
    return frames


def rows_of(data: DataSet, chosen: np.ndarray, frames: dict[str, Frames]) -> list[dict]:
    clips, known = [*data.train, *data.validation], len(data.train)
    M = [clip.input.x.M[:, chosen] for clip in clips]
    whole = np.concatenate(M[:known])
    mean, deviation = whole.mean(axis=0), np.maximum(whole.std(axis=0), 1e-3)
    motion = [seen(np.clip((m - mean) / deviation, -6, 6), data.fps) for m in M]
    x = random_features(motion, known)
    rows, fit = [], regression(x[:known])
    for name, held in frames.items():
        components = components_of(held, clips[:known])
        c = [coefficients(partial(held.of, clip), len(clip.V), components) for clip in clips[:known]]
        predict, row = fit(c), {"frame": name}
        for clip, features in zip(data.validation, x[known:], strict=True):
            U = predict(features) @ components.basis + components.mean
            E = held.back(clip, U.reshape(clip.V.shape)) - clip.V
            row[clip.name] = round(100 * float(np.sqrt(np.square(E).sum(axis=-1).mean())), 2)
        errors = [value for key, value in row.items() if key != "frame"]
        rows.append(row | {"mean": round(float(np.mean(errors)), 2)})
    return rows


if __name__ == "__main__":
    main()
