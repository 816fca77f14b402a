"""Virtual bones of a garment: found once per data set (SSDR), and their motion in any frame.

A bone turns about its centre, the weighted mean of its vertices at rest: six numbers a bone and frame,
the rotation vector and the centre's displacement.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial.transform import Rotation

from garment_jax.dataset.batches import spread_frames
from garment_jax.dataset.cached_arrays import Arrays, cached_arrays
from garment_jax.geometry.bone_errors import homogeneous
from garment_jax.geometry.bone_sweep import bone_system, sweep
from garment_jax.geometry.rigid_fit import rigid_transforms
from garment_jax.geometry.ssdr import decompose
from garment_jax.training.run import Run, say

FRAMES = 200  # spread over the training clips, that the decomposition sees
INFLUENCES = 4  # bones a vertex
ITERATIONS = 10
TOLERANCE = 1e-3  # relative; an iteration that gains less is the last
SWEEPS = 3  # of a frame's transforms under known weights
_WINDOW = 256  # frames in memory as float64


class Bones(NamedTuple):
    """Virtual bones (static)."""

    weights: np.ndarray  # [n, b] float32, rows sum to 1, at most 4 above zero
    centres: np.ndarray  # [b, 3] metres, canonical root frame


def find_bones(run: Run) -> Bones:
    """Return the bones of the training frames, mirror images included; cached in the run's folder."""
    count = run.config.baselines.bones
    path = run.folder / "cache" / f"bones-{count}-{run.data.content}.npz"

    def weights() -> dict[str, np.ndarray]:
        V, rest = spread_frames(run.data, FRAMES).astype(np.float64), run.template.T.astype(np.float64)
        say(f"bones: decomposing {len(V)} frames into {count} bones")
        found = decompose(rest, V, count, INFLUENCES, ITERATIONS, TOLERANCE)[0]
        return {"weights": found.astype(np.float32)}

    def fits(arrays: Arrays) -> bool:
        return "weights" in arrays and len(arrays["weights"]) == len(run.template.T)

    stored = cached_arrays(path, weights, fits=fits)
    return bones_of(run.template.T, stored["weights"])


def bones_of(T: np.ndarray, weights: np.ndarray) -> Bones:
    """Return the bones of `weights` `[n, b]` on the template `T` `[n, 3]`."""
    mass = np.maximum(weights.sum(axis=0, dtype=np.float64), 1e-12)
    return Bones(weights, (weights.T.astype(np.float64) @ T / mass[:, None]).astype(np.float32))


def bone_transforms(rest: np.ndarray, V: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least-squares rigid R `[k, b, 3, 3]`, T `[k, b, 3]` of frames `V` `[k, n, 3]`, metres.

    Each frame by itself, `weights` `[n, b]` known: every bone from its own vertices, then sweeps in which
    each is solved with the others fixed (Le & Deng 2012, section 4.3). `V` may lie anywhere in the world.
    """
    rest, weights = rest.astype(np.float64), weights.astype(np.float64)
    parts = []
    for start in range(0, len(V), _WINDOW):
        piece = V[start : start + _WINDOW].astype(np.float64)
        middle = piece.mean(axis=1, keepdims=True)
        piece = piece - middle
        whole, _ = rigid_transforms(rest, piece, np.ones((len(rest), 1)))
        R, T = rigid_transforms(rest, piece, weights, whole[:, 0])
        system = bone_system(rest, weights, piece)
        for _ in range(SWEEPS):
            R, T = sweep(system, R, T)
        parts.append((R, T + middle))
    return np.concatenate([R for R, _ in parts]), np.concatenate([T for _, T in parts])


def carried(rest: np.ndarray, weights: np.ndarray, R: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return the rest positions `[n, 3]` carried by the bones, `[k, n, 3]` float64 (host)."""
    y = (weights[:, :, None] * homogeneous(rest)[:, None]).reshape(len(rest), -1)
    M = np.concatenate([R, T[..., None]], axis=3)  # [k, b, 3, 4]
    return y @ M.transpose(0, 1, 3, 2).reshape(len(R), -1, 3)


def as_numbers(R: np.ndarray, T: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Return rotation vectors and displacements of the centres `[k, b, 6]` float32 (radians, metres)."""
    turn = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(T.shape)
    shift = T + (R @ centres.astype(np.float64)[:, :, None])[..., 0] - centres
    return np.concatenate([turn, shift], axis=-1).astype(np.float32)


def rotation_matrices(r: Float[Array, "*b 3"]) -> Float[Array, "*b 3 3"]:
    """Return the rotations of vectors `r` (radians) by Rodrigues' formula; smooth at 0, the identity."""
    square = jnp.square(r).sum(axis=-1)
    small = square < 1e-8
    safe = jnp.where(small, 1.0, square)
    angle = jnp.sqrt(safe)
    sine = jnp.where(small, 1.0 - square / 6, jnp.sin(angle) / angle)[..., None, None]
    cosine = jnp.where(small, 0.5 - square / 24, (1 - jnp.cos(angle)) / safe)[..., None, None]
    x, y, z = r[..., 0], r[..., 1], r[..., 2]
    o = jnp.zeros_like(x)
    K = jnp.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*r.shape, 3)
    eye = jnp.eye(3).reshape((1,) * (r.ndim - 1) + (3, 3))
    return eye + sine * K + cosine * (K[..., :, :, None] * K[..., None, :, :]).sum(axis=-2)


def transforms(numbers: Float[Array, "*t b 6"]) -> Float[Array, "*t b 4 3"]:
    """Return each bone's [R^T; displacement], so that (x - centre, 1) @ it is its part but for the centre."""
    R = rotation_matrices(numbers[..., :3])
    return jnp.concatenate([jnp.swapaxes(R, -1, -2), numbers[..., None, 3:]], axis=-2)


def weighted_rest(T: np.ndarray, bones: Bones) -> np.ndarray:
    """Return y `[n, 4 b]`: each vertex about each bone's centre and a one, times the weight (host)."""
    about = T[:, None] - bones.centres[None]
    h = np.concatenate([about, np.ones((*about.shape[:2], 1))], axis=2)
    return (bones.weights[:, :, None] * h).reshape(len(T), -1).astype(np.float32)


def skinned(
    numbers: Float[Array, "*t b 6"], y: Float[Array, "n k"], rest_centres: Float[Array, "n 3"]
) -> Float[Array, "*t n 3"]:
    """Return the low-frequency mesh of bone motions, metres; `rest_centres` = weights @ centres."""
    M = transforms(numbers)
    V = jnp.einsum("nk,...kc->...nc", y, M.reshape(*M.shape[:-3], -1, 3))
    return V + rest_centres.reshape((1,) * (V.ndim - 2) + rest_centres.shape)
