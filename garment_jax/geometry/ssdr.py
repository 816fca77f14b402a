"""Smooth skinning decomposition with rigid bones (Le & Deng 2012): weights and motions from vertices alone.

Departures from the paper: weights are the exact best over the bones in hand (`sparse_weights`), not an
active-set solution cut to its largest entries, so that no step raises the error; transforms are solved from
sums over vertices, so that a sweep's cost does not depend on the mesh; a long sequence is fitted on some of
its frames and all frames follow in a last pass.
"""

from typing import NamedTuple

import numpy as np

from garment_jax.geometry.bone_errors import bone_moments, homogeneous
from garment_jax.geometry.bone_sweep import bone_system, joined, rmse_of, squared_error, sweep
from garment_jax.geometry.motion_clusters import motion_clusters
from garment_jax.geometry.rigid_fit import rigid_transforms
from garment_jax.geometry.sparse_weights import fit_weights

_WINDOW = 64  # frames in memory as float64
_ROUNDING = 1e-8  # of the mesh's size: the square root of what sums of squares resolve
_LAST_SWEEPS = 12  # of the pass over all frames


class SkinningDecomposition(NamedTuple):
    """Bones that carry the vertices: x_i(t) = sum_b weights_ib (rotations_tb rest_i + translations_tb)."""

    weights: np.ndarray  # [n, b] float32, rows sum to 1, at most `influences` above zero
    rotations: np.ndarray  # [t, b, 3, 3] float32, determinant 1
    translations: np.ndarray  # [t, b, 3] float64, the frames' unit
    rmse: float  # root mean squared distance of a vertex, over all frames
    history: np.ndarray  # [k] the same over the frames fitted, after each half step; never rises


def ssdr(
    rest: np.ndarray,
    frames: np.ndarray,
    *,
    bones: int,
    influences: int = 4,
    iterations: int = 20,
    seed: int = 0,
    most_frames: int = 300,
    tolerance: float = 1e-4,
) -> SkinningDecomposition:
    """Decompose `frames` `[t, n, 3]` of the mesh at `rest` `[n, 3]` into `bones` rigid bones.

    Stops after `iterations` or when one lowers the error by less than `tolerance` of it. A sequence longer
    than `most_frames` is fitted on as many (drawn by `seed`, one of each stretch); `frames` may be a memory
    map, is read in order by windows and may lie anywhere in the world. Raises `ValueError` for shapes that
    do not fit, values that are not finite, or more bones than vertices.
    """
    _check(rest, frames, bones, influences)
    chosen = spread_frames(len(frames), most_frames, seed)
    rest = rest.astype(np.float64)
    V = np.stack([frames[k] for k in chosen]).astype(np.float64)
    V -= V.mean(axis=1, keepdims=True)
    weights, R, T, history = decompose(rest, V, bones, influences, iterations, tolerance)
    whole_R, whole_T, rmse = _all_frames(rest, frames, weights, (chosen, R, T))
    return SkinningDecomposition(
        weights.astype(np.float32), whole_R.astype(np.float32), whole_T, rmse, np.array(history)
    )


def spread_frames(count: int, most: int, seed: int) -> np.ndarray:
    """Return at most `most` of `count` frames, ascending: one drawn from each of equal stretches."""
    if count <= most:
        return np.arange(count)
    edges = np.linspace(0, count, most + 1)
    return (edges[:-1] + np.random.default_rng(seed).random(most) * np.diff(edges)).astype(np.int64)


def decompose(
    rest: np.ndarray, V: np.ndarray, bones: int, influences: int, iterations: int, tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[float]]:
    """Return weights, rotations, translations and history for `V` `[t, n, 3]` float64 near the origin."""
    labels = motion_clusters(rest, V, bones)
    weights = np.eye(bones)[labels]
    whole, _ = rigid_transforms(rest, V, np.ones((len(rest), 1)))
    R, T = rigid_transforms(rest, V, weights, whole[:, 0])
    system = bone_system(rest, weights, V)
    history = [rmse_of(system, R, T, len(rest))]
    exact = _ROUNDING * float(np.sqrt(system.square.mean() / len(rest)))
    for _ in range(iterations):
        R, T = _revive(rest, V, weights, R, T)
        weights = fit_weights(bone_moments(rest, V, R, T), weights, influences=influences)
        system = bone_system(rest, weights, V)
        history.append(rmse_of(system, R, T, len(rest)))
        R, T = sweep(system, R, T)
        history.append(rmse_of(system, R, T, len(rest)))
        if history[-3] - history[-1] <= max(tolerance * history[-3], exact):
            break
    return weights, R, T, history


def _revive(
    rest: np.ndarray, V: np.ndarray, weights: np.ndarray, R: np.ndarray, T: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Put a bone that lost its vertices on the worst-carried vertex and its nearest; it has no weight yet."""
    idle = np.flatnonzero(np.square(weights).sum(axis=0) < 1e-10)
    if not len(idle):
        return R, T
    R, T = R.copy(), T.copy()
    own = (np.square(_posed(rest, weights, R, T) - V)).sum(axis=(0, 2))
    for j in idle:
        near = np.argsort(np.linalg.norm(rest - rest[own.argmax()], axis=1), kind="stable")[:8]
        fit_R, fit_T = rigid_transforms(rest[near], V[:, near], np.ones((len(near), 1)), R[:, j])
        R[:, j], T[:, j] = fit_R[:, 0], fit_T[:, 0]
        own[near] = -1.0
    return R, T


def _posed(rest: np.ndarray, weights: np.ndarray, R: np.ndarray, T: np.ndarray) -> np.ndarray:
    y = (weights[:, :, None] * homogeneous(rest)[:, None]).reshape(len(rest), -1)
    return (joined(R, T) @ y.T).transpose(0, 2, 1)


def _all_frames(
    rest: np.ndarray,
    frames: np.ndarray,
    weights: np.ndarray,
    fitted: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, float]:
    """Fit the transforms of every frame under `weights`, by windows; fitted frames begin from theirs."""
    chosen, known_R, known_T = fitted
    t, b = len(frames), weights.shape[1]
    whole_R, whole_T, total = np.zeros((t, b, 3, 3), np.float32), np.zeros((t, b, 3)), 0.0
    for start in range(0, t, _WINDOW):
        window = slice(start, min(start + _WINDOW, t))
        V = frames[window].astype(np.float64)
        middle = V.mean(axis=1, keepdims=True)
        V = V - middle
        # From the nearest fitted frame: a bone's turn may be poorly told by its own vertices alone.
        nearest = np.abs(chosen[None, :] - np.arange(window.start, window.stop)[:, None]).argmin(axis=1)
        R, T = known_R[nearest], known_T[nearest]
        exact = chosen[nearest] == np.arange(window.start, window.stop)
        fresh_R, fresh_T = rigid_transforms(rest, V, weights, R.mean(axis=1))
        R, T = np.where(exact[:, None, None, None], R, fresh_R), np.where(exact[:, None, None], T, fresh_T)
        system = bone_system(rest, weights, V)
        for _ in range(_LAST_SWEEPS):
            R, T = sweep(system, R, T)
        total += float(squared_error(system, R, T).sum())
        whole_R[window], whole_T[window] = R, T + middle
    return whole_R, whole_T, float(np.sqrt(total / (t * len(rest))))


def _check(rest: np.ndarray, frames: np.ndarray, bones: int, influences: int) -> None:
    if frames.ndim != 3 or not len(frames) or frames.shape[1:] != rest.shape or rest.shape[1:] != (3,):
        raise ValueError(
            f"frames of shape {frames.shape} do not fit {rest.shape} rest positions; "
            "give [t, n, 3] and [n, 3]."
        )
    if not 0 < bones <= len(rest):
        raise ValueError(f"{bones} bones do not fit {len(rest)} vertices; choose 1 to {len(rest)}.")
    if influences < 1:
        raise ValueError(f"influences={influences} leaves a vertex without a bone; choose 1 or more.")
    if not np.isfinite(rest).all():
        raise ValueError("the rest positions are not finite numbers; export the rest mesh again.")
    for start in range(0, len(frames), _WINDOW):
        bad = ~np.isfinite(frames[start : start + _WINDOW]).all(axis=(1, 2))
        if bad.any():
            raise ValueError(
                f"frame {start + int(bad.argmax())} holds values that are not finite; cut it out."
            )
