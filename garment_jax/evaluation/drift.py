"""Does the error grow? Last third of a clip against its first, relative to a model without memory."""

import numpy as np
from scipy.spatial import KDTree

from garment_jax.body.kinematics import joint_positions, pose_points
from garment_jax.structs import Motion, Scene


def thirds_ratio(rmse_per_frame: np.ndarray) -> float:
    """Return the RMSE of the last third over that of the first third, no unit.

    `rmse_per_frame` `[t]` in any unit, t >= 3. A third is t // 3 frames; the remainder stays in the
    middle. Both zero gives 1, only the first zero infinity.
    """
    third = len(rmse_per_frame) // 3
    if third < 1:
        raise ValueError(f"drift needs 3 frames or more, not {len(rmse_per_frame)}.")
    square = np.asarray(rmse_per_frame, np.float64) ** 2
    first, last = square[:third].mean(), square[-third:].mean()
    if first == 0:
        return 1.0 if last == 0 else float("inf")
    return float(np.sqrt(last / first))


def drift(rmse_per_frame: np.ndarray, rmse_per_frame_skinned: np.ndarray) -> float:
    """Return the thirds' ratio divided by that of the rigidly skinned template, no unit.

    The skinned template has no memory, so its ratio shows how much harder the clip's end is. Above
    1: the prediction drifts.
    """
    reference = thirds_ratio(rmse_per_frame_skinned)
    return thirds_ratio(rmse_per_frame) / reference if reference > 0 else float("inf")


def skinning_weights(scene: Scene) -> np.ndarray:
    """Return `[n, j]` weights of the garment: those of the nearest body vertex, pins their own."""
    body, garment = scene.body, scene.garment
    _, nearest = KDTree(body.vertices).query(garment.template)
    weights = body.skin_weights[nearest].copy()
    if scene.pins is not None:
        weights[scene.pins.vertices] = scene.pins.weights
    return weights


def skinned_template(scene: Scene, motion: Motion, weights: np.ndarray, frames: slice) -> np.ndarray:
    """Return the template skinned to the body at `frames`, `[k, n, 3]` float32 world metres."""
    rotations, root = motion.rotations[frames], motion.root[frames]
    positions = joint_positions(rotations, root, scene.body)
    posed = pose_points(scene.garment.template, weights, rotations, positions, scene.body.joints)
    return posed.astype(np.float32)
