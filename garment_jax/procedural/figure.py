"""The mannequin's shape: an implicit surface in the canonical pose, symmetric in x."""

import numpy as np

from garment_jax.procedural.implicit import column, ellipsoid, limb, resampled, smooth_union

# height, half width, back z, front z
_TORSO = np.array(
    [
        [0.780, 0.115, -0.075, 0.060],
        [0.820, 0.156, -0.098, 0.082],
        [0.880, 0.166, -0.096, 0.090],
        [0.940, 0.150, -0.084, 0.096],
        [1.000, 0.126, -0.068, 0.098],
        [1.055, 0.115, -0.060, 0.095],
        [1.110, 0.121, -0.066, 0.096],
        [1.170, 0.133, -0.078, 0.099],
        [1.230, 0.143, -0.090, 0.096],
        [1.290, 0.143, -0.095, 0.078],
        [1.340, 0.118, -0.088, 0.052],
        [1.385, 0.062, -0.072, 0.030],
    ]
)
# height, centre x, centre z, half width, half depth
_LEG = np.array(
    [
        [0.060, 0.169, 0.002, 0.031, 0.037],
        [0.110, 0.167, -0.002, 0.030, 0.036],
        [0.200, 0.161, -0.009, 0.038, 0.043],
        [0.300, 0.152, -0.010, 0.049, 0.054],
        [0.360, 0.146, -0.003, 0.052, 0.056],
        [0.430, 0.138, 0.016, 0.050, 0.053],
        [0.475, 0.132, 0.026, 0.052, 0.056],
        [0.540, 0.124, 0.026, 0.060, 0.064],
        [0.640, 0.112, 0.018, 0.074, 0.077],
        [0.740, 0.104, 0.005, 0.086, 0.089],
        [0.800, 0.099, -0.002, 0.088, 0.094],
        [0.860, 0.090, -0.002, 0.080, 0.090],
        [0.920, 0.074, 0.000, 0.066, 0.076],
        [0.980, 0.054, 0.006, 0.042, 0.050],
    ]
)
_ARM = np.array(
    [
        [0.150, 1.310, -0.010, 0.052],
        [0.205, 1.252, -0.009, 0.045],
        [0.265, 1.190, -0.006, 0.040],
        [0.322, 1.128, -0.002, 0.036],
        [0.358, 1.083, 0.023, 0.037],
        [0.402, 1.028, 0.055, 0.030],
        [0.446, 0.972, 0.088, 0.024],
    ]
)
_HAND = np.array(
    [
        [0.446, 0.972, 0.088, 0.022],
        [0.468, 0.938, 0.109, 0.036],
        [0.486, 0.909, 0.126, 0.035],
        [0.512, 0.868, 0.150, 0.019],
    ]
)
_THUMB = np.array([[0.448, 0.950, 0.112, 0.016], [0.446, 0.922, 0.150, 0.012]])
_FOOT = np.array(
    [
        [0.166, 0.036, -0.022, 0.033],
        [0.170, 0.050, 0.030, 0.036],
        [0.178, 0.030, 0.115, 0.039],
        [0.184, 0.020, 0.172, 0.026],
    ]
)
_NECK = np.array([[0.0, 1.350, -0.028, 0.060], [0.0, 1.405, -0.018, 0.047], [0.0, 1.490, 0.004, 0.045]])
_SLOPE = np.array([[0.020, 1.405, -0.028, 0.030], [0.140, 1.332, -0.014, 0.036]])
_BONE = _HAND[-1, :3] - _HAND[0, :3]


def figure(points: np.ndarray) -> np.ndarray:
    """Return the mannequin's field `[q]` at `points` `[q, 3]`: negative inside, zero on the skin, metres."""
    left = points.copy()
    left[:, 0] = np.abs(left[:, 0])
    trunk = smooth_union(_torso(left), _neck(left), width=0.05)
    trunk = smooth_union(trunk, _leg(left), width=0.06)
    trunk = smooth_union(trunk, _arm(left), width=0.045)
    return smooth_union(trunk, _head(left), width=0.03)


def _torso(points: np.ndarray) -> np.ndarray:
    height, width, back, front = _TORSO.T
    profile = np.stack([height, 0 * height, (back + front) / 2, width, (front - back) / 2], axis=1)
    body = column(points, profile, power=2.25)
    bust = ellipsoid(points, (0.064, 1.208, 0.066), (0.060, 0.062, 0.058))
    seat = ellipsoid(points, (0.074, 0.850, -0.058), (0.082, 0.086, 0.074))
    return smooth_union(smooth_union(body, bust, width=0.06), seat, width=0.05)


def _neck(points: np.ndarray) -> np.ndarray:
    return smooth_union(limb(points, resampled(_NECK)), limb(points, _SLOPE), width=0.05)


def _head(points: np.ndarray) -> np.ndarray:
    skull = ellipsoid(points, (0.0, 1.560, 0.012), (0.074, 0.090, 0.094))
    jaw = ellipsoid(points, (0.0, 1.503, 0.046), (0.050, 0.056, 0.058))
    nose = ellipsoid(points, (0.0, 1.530, 0.108), (0.012, 0.024, 0.018))
    bun = ellipsoid(points, (0.0, 1.600, -0.088), (0.042, 0.040, 0.038))
    face = smooth_union(skull, jaw, width=0.06)
    return smooth_union(smooth_union(face, nose, width=0.012), bun, width=0.015)


def _leg(points: np.ndarray) -> np.ndarray:
    foot = limb(points, resampled(_FOOT), np.diag([1.0, 1.25, 1.0]))
    foot = np.maximum(foot, -points[:, 1])  # a flat sole
    return smooth_union(column(points, _LEG), foot, width=0.03)


def _arm(points: np.ndarray) -> np.ndarray:
    arm = limb(points, resampled(_ARM))
    # The hand is a thick mitten: half as thick across the palm, whose normal is square to its axis.
    palm = np.cross(_BONE, [0.35, 0.0, 1.0])
    palm /= np.linalg.norm(palm)
    hand = limb(points, resampled(_HAND), np.eye(3) + 0.9 * np.outer(palm, palm))
    hand = smooth_union(hand, limb(points, _THUMB), width=0.015)
    return smooth_union(arm, hand, width=0.02)
