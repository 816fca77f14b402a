"""Rigid transforms that carry points to where they went: weighted Procrustes in closed form (host, NumPy)."""

import numpy as np

_PRIOR = (
    1e-7  # pull towards a known rotation, as a part of the points' spread; decides only what is undetermined
)


def nearest_rotations(C: np.ndarray) -> np.ndarray:
    """Return the rotations `[..., 3, 3]` that maximise tr(R^T C) for `C` `[..., 3, 3]`; never a reflection.

    For C = sum q u^T this is the R with the least sum |q - R u|^2. Where C leaves a turn open (points on a
    line, a single point) any of the best is returned; add a known rotation to C to choose.
    """
    U, _, Vt = np.linalg.svd(C)
    sign = np.sign(np.linalg.det(U @ Vt))
    U[..., :, 2] *= sign[..., None]
    return U @ Vt


def towards(C: np.ndarray, spread: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Return `C` `[..., 3, 3]` with a little of the rotations `prior`, scaled by the points' `spread`.

    As a step from `prior` it still never raises the error: a proximal term is zero where it stands.
    """
    return C + (_PRIOR * spread + 1e-30)[..., None, None] * prior


def rigid_transforms(
    rest: np.ndarray, frames: np.ndarray, weights: np.ndarray, prior: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return `R` `[t, b, 3, 3]` and `T` `[t, b, 3]` with least sum_i weights_ib |frames_i - R rest_i - T|^2.

    `rest` `[n, 3]`, `frames` `[t, n, 3]` (best near the origin), `weights` `[n, b]` non-negative. `prior`
    `[t, 3, 3]` decides turns that the points leave open (identity without it); a bone without weight takes
    it whole. Computed in float64.
    """
    mass = np.maximum(weights.sum(axis=0), 1e-12)
    share = weights / mass
    centre = share.T @ rest
    arrived = share.T @ frames.astype(np.float64)
    moments = (share[:, :, None] * rest[:, None]).reshape(len(rest), -1).T @ frames
    C = np.swapaxes(moments.reshape(len(frames), -1, 3, 3), -1, -2)
    C = C - arrived[..., :, None] * centre[:, None, :]
    spread = share.T @ np.square(rest).sum(axis=1) - np.square(centre).sum(axis=1)
    known = np.eye(3)[None] if prior is None else prior
    C = towards(C, np.maximum(spread, 0.0)[None], known[:, None])
    R = nearest_rotations(C)
    return R, arrived - (R @ centre[:, :, None])[..., 0]
