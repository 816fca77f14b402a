"""Where the root goes so that the feet stand on the floor and stay where they stand."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from garment_jax.body.kinematics import joint_positions, pose_points
from garment_jax.structs import RiggedBody

SOLE = 0.03  # metres above the floor up to which the canonical body counts as sole
SOFTNESS = 0.006  # metres: the lower foot takes over this gradually, or the root's speed would jump
GRIP = 0.006  # metres: a point of a sole this much above the floor holds e times less than one on it
SMOOTHING = 0.06  # seconds, of the travel
CUSHION = 0.04  # seconds, of the height: the weight changes feet at 3 to 5 m/s², not at 16


def ground(rotations: np.ndarray, body: RiggedBody, fps: float) -> np.ndarray:
    """Return the root's path `[t, 3]` (world metres) for world `rotations` `[t, j, 3, 3]`.

    Height: the lower sole is on the floor y = 0, within about a centimetre where the weight changes feet.
    Travel: the foot that stands does not move, as near as smoothing allows; frame 0 is at x = z = 0.
    """
    soles = [_sole_points(rotations, body, side) for side in ("Left", "Right")]
    lowest = np.stack([sole[..., 1].min(axis=1) for sole in soles], axis=1)
    height = gaussian_filter1d(-_soft_minimum(lowest), CUSHION * fps, mode="nearest")
    travel = _travel(np.concatenate(soles, axis=1))
    travel = gaussian_filter1d(travel, SMOOTHING * fps, axis=0, mode="nearest")
    travel = travel - travel[0]
    return np.stack([travel[:, 0], height, travel[:, 1]], axis=1)


def _soft_minimum(x: np.ndarray) -> np.ndarray:
    """Return a smooth lower bound of the rows' minima `[t]`, at most `SOFTNESS` log 2 below them."""
    least = x.min(axis=1)
    return least - SOFTNESS * np.log(np.exp(-(x - least[:, None]) / SOFTNESS).sum(axis=1))


def _sole_points(rotations: np.ndarray, body: RiggedBody, side: str) -> np.ndarray:
    """Return the sole's points posed with the root at the origin, `[t, q, 3]`."""
    foot = [body.joint_names.index(side + name) for name in ("Foot", "ToeBase")]
    low = body.vertices[:, 1] - body.vertices[:, 1].min() < SOLE
    chosen = np.flatnonzero(low & (body.skin_weights[:, foot].sum(axis=1) > 0.5))
    if not len(chosen):
        raise ValueError(
            f"no body vertex within {SOLE} m of the floor follows {side}Foot; check the body's skin weights."
        )
    positions = joint_positions(rotations, np.zeros((len(rotations), 3)), body)
    weights = body.skin_weights[chosen]
    return pose_points(body.vertices[chosen], weights, rotations, positions, body.joints)


def _travel(soles: np.ndarray) -> np.ndarray:
    """Return the root's x and z `[t, 2]`: against the movement of those points that touch the floor."""
    above = soles[..., 1] - soles[..., 1].min(axis=1)[:, None]
    hold = np.exp(-above / GRIP)
    hold = (hold[1:] + hold[:-1])[..., None]
    step = np.diff(soles[..., [0, 2]], axis=0)
    step = -(step * hold).sum(axis=1) / hold.sum(axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])
