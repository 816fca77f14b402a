"""A rig for a body that is known only as vertices: parts, a skeleton between them, weights and a motion.

Near-rigid parts come from the smooth skinning decomposition (`geometry/ssdr.py`), whose bones move freely; a
rigged body's joints hang on each other. So a tree is laid through the parts (`part_tree.py`), and rotations,
joints and weights are fitted under forward kinematics (`rig_building.py`) on some of the frames; then every
frame gets its pose.
"""

from typing import Any, NamedTuple

import numpy as np

from garment_jax.body.kinematics import pose_body
from garment_jax.body.pose_fit import fit_pose, pose_terms
from garment_jax.body.residual import Residual, ResidualCounter
from garment_jax.body.rig_building import build_rig
from garment_jax.geometry.ssdr import spread_frames
from garment_jax.structs import Motion, RiggedBody

JOINTS = 24
_WINDOW = 64  # frames in memory at a time


class FittedRig(NamedTuple):
    """A rigged body, its motion, and how far the two are from the vertices."""

    body: RiggedBody
    motion: Motion
    residual_cm: Residual


def rig_from_vertices(
    faces: np.ndarray,
    vertices: Any,
    rest: np.ndarray,
    *,
    fps: float,
    joints: int = JOINTS,
    influences: int = 4,
    rig: RiggedBody | None = None,
    seed: int = 0,
    most_frames: int = 240,
) -> FittedRig:
    """Return a rigged body that follows `vertices` `[t, n, 3]`, its motion and the residual.

    World metres, Y up; `vertices` is an array or an object with a shape that is sliced by frames. `rest`
    `[n, 3]` is the same mesh in its canonical pose, facing +Z, `faces` `[f, 3]` outward. With `rig` (a body
    fitted before) only rotations and the root are fitted, so that clips share one body. Joints are named
    p0, p1, …; p0, the part nearest to the body's middle, is the root. Raises `ValueError` for shapes that do
    not fit, values that are not finite, and fewer vertices than joints.
    """
    _check(faces, tuple(vertices.shape), rest, joints, rig)
    if rig is None:
        chosen = spread_frames(len(vertices), most_frames, seed)
        frames = np.stack([_read(vertices, int(k), int(k) + 1)[0] for k in chosen])
        rig = build_rig(faces, frames, rest, joints=joints, influences=influences, seed=seed)
    motion, residual = follow(rig, vertices, fps)
    return FittedRig(rig, motion, residual)


def follow(body: RiggedBody, vertices: Any, fps: float) -> tuple[Motion, Residual]:
    """Return the motion with which `body` follows `vertices` `[t, b, 3]`, by windows, and the residual."""
    terms, counter = pose_terms(body), ResidualCounter()
    rotations, root = [], []
    for start in range(0, len(vertices), _WINDOW):
        V = _read(vertices, start, min(start + _WINDOW, len(vertices)))
        R, p = fit_pose(body, V, terms=terms)
        piece = Motion(R.astype(np.float32), p, fps)
        rotations.append(piece.rotations)
        root.append(p)
        counter.add(np.linalg.norm(pose_body(body, piece, slice(None)) - V, axis=2))
    return Motion(np.concatenate(rotations), np.concatenate(root), fps), counter.result()


def _read(vertices: Any, start: int, stop: int) -> np.ndarray:
    """Return frames `start … stop - 1`, `[k, n, 3]` float32; `ValueError` for values that are not finite."""
    V = np.asarray(vertices[start:stop], np.float32)
    bad = ~np.isfinite(V).all(axis=(1, 2))
    if bad.any():
        frame = start + int(bad.argmax())
        raise ValueError(
            f"the body's frame {frame} holds values that are not finite; cut the clip before it."
        )
    return V


def _check(
    faces: np.ndarray, shape: tuple[int, ...], rest: np.ndarray, joints: int, rig: RiggedBody | None
) -> None:
    n = len(rest)
    if len(shape) != 3 or shape[0] == 0 or shape[1:] != (n, 3):
        raise ValueError(
            f"the body moves with shape {shape} and its rest mesh has {n} vertices; give [frames, {n}, 3] in "
            "the rest mesh's vertex order."
        )
    if faces.size and (faces.min() < 0 or faces.max() >= n):
        raise ValueError(f"the body's faces name vertex {faces.max()} of {n}; export the rest mesh again.")
    if not np.isfinite(rest).all():
        raise ValueError("the body's rest positions are not finite numbers; export the rest mesh again.")
    if rig is not None and (
        rig.vertices.shape != rest.shape or not np.allclose(rig.vertices, rest, atol=1e-4)
    ):
        raise ValueError(
            f"the rig has {len(rig.vertices)} vertices and the rest mesh {n}, or they lie elsewhere; use the "
            "rest mesh that the rig was fitted to."
        )
    if rig is None and not 1 <= joints <= n:
        raise ValueError(f"joints={joints} does not fit {n} vertices; choose 1 to {n}.")
