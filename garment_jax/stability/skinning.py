"""Softmax skinning and its inverse: length scales, distance, coincident seeds, opposite rotations.

A blended matrix with smallest singular value s gives back a part s² / (s² + d²) of a vertex' distance,
d = `DAMPING`. The condition κ that `unskin` reports bounds s from below by 1 / (√3 κ), hence the error: at
most 3 κ² d² of the distance by the damping and a few √3 κ of rounding. Below `WELL_POSED` that is
0.3 mm a metre, and whatever comes back worse must carry a larger κ.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.seeds import make_seeds
from garment_jax.dataset.motion_input import motion_input
from garment_jax.geometry.skinning import DAMPING, skin, softmax_weights, unskin
from garment_jax.stability.case import Case, Curve, Findings, at_least, at_most, finite
from garment_jax.stability.subject import Subject, hardest_pose

GROUP = "skinning"
TAUS = (1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0)  # metres
ANGLES = (90.0, 150.0, 170.0, 174.0, 177.0, 179.0, 179.9, 180.0)  # degrees between two blended rotations
WELL_POSED = 10.0  # condition up to which the inverse is promised
PROMISED_MM = 1e3 * 3 * WELL_POSED**2 * DAMPING**2  # error a metre of distance from the root, up to there
FLOAT32_MM = 0.002  # rounding: some 30 ulp of a metre, times the condition
SEEDS = 64

_weights = jax.jit(softmax_weights, static_argnames="tau")
_skin, _unskin = jax.jit(skin), jax.jit(unskin)


def skinning_cases(subject: Subject) -> Findings:
    """Return the cases of `geometry.skinning` on the subject's garment in its hardest pose."""
    scene = subject.scene
    T = (scene.garment.template.astype(np.float64) - scene.body.joints[0]).astype(np.float32)
    count = min(SEEDS, len(scene.body.vertices) // 8)
    seeds = make_seeds(scene, count)
    name, pose = hardest_pose(subject)
    joints = scene.body.joint_names[1:2]  # the features are not read
    posed = motion_input(pose, scene, seeds, joints)
    R, t = posed.R_seed[0], posed.t_seed[0]
    cases = list(_length_scales(name, T, seeds.points, R, t))
    cases += _coincident(T, seeds.points, R, t)
    opposite, curves = _opposite_rotations(T)
    return Findings(cases + opposite, curves)


def _length_scales(name: str, T, seeds, R, t) -> Iterator[Case]:
    """Yield the cases of τ, near the body and 10 m away, where exp(-d / τ) underflows to 0."""
    for label, x in ((name, T), ("10 m away", T + np.array([10.0, 0.0, 0.0], np.float32))):
        for tau in TAUS:
            case = f"τ = {tau:g} m, {label}"
            W = _weights(x, seeds, tau=tau)
            yield at_most(GROUP, case, "rows of W sum to 1 within", np.abs(W.sum(axis=1) - 1).max(), 1e-5, "")
            yield _well_posed(case, _there_and_back(x, W, R, t))


class _RoundTrip(NamedTuple):
    """What unskin(skin(x)) is worth, vertex by vertex (host)."""

    error: np.ndarray  # [n] mm a metre of distance from the root, of a metre at least; NaN if not finite
    condition: np.ndarray  # [n]


def _there_and_back(x, W, R, t) -> _RoundTrip:
    back, condition = (np.asarray(a, np.float64) for a in _unskin(_skin(x, W, R, t), W, R, t))
    reach = np.maximum(np.linalg.norm(x, axis=1), 1.0)
    error = 1e3 * np.linalg.norm(back - x, axis=1) / reach
    return _RoundTrip(np.where(np.isfinite(error * condition), error, np.nan), condition)


def _well_posed(case: str, trip: _RoundTrip) -> Case:
    """Return the largest error of unskin(skin(x)) where it is promised; one NaN anywhere is red."""
    good = trip.condition <= WELL_POSED
    worst = np.where(good, trip.error, 0.0 * trip.error).max()
    quantity = f"unskin(skin(x)) where κ <= {WELL_POSED:g} ({good.mean():.0%} of vertices)"
    return at_most(GROUP, case, quantity, worst, PROMISED_MM + FLOAT32_MM * WELL_POSED, "mm a metre")


def _coincident(T, seeds, R, t) -> Iterator[Case]:
    """Yield the cases of seeds that lie on each other and vertices that lie on seeds."""
    case, seeds, x = "coincident seeds", seeds.copy(), T.copy()
    seeds[1::2] = seeds[0::2][: len(seeds[1::2])]
    x[: len(seeds)] = seeds[: len(x)]
    W = _weights(x, seeds, tau=0.03)
    pairs = len(seeds) // 2
    apart = np.abs(W[:, 0 : 2 * pairs : 2] - W[:, 1 : 2 * pairs : 2]).max()
    yield at_most(GROUP, case, "twins' weights differ by", apart, 1e-6, "")
    twins = jnp.asarray(seeds)
    gradient = jax.jit(jax.grad(lambda x: (softmax_weights(x, twins, tau=0.03) ** 2).sum()))(x)
    yield finite(GROUP, case, "gradient of a vertex on a seed", gradient)
    yield _well_posed(case, _there_and_back(x, W, R, t))


def _opposite_rotations(T) -> tuple[list[Case], list[Curve]]:
    """Return the cases of two rotations blended half and half, 90° to 180° apart, over random axes."""
    rng = np.random.default_rng(0)
    n = min(len(T), 400)
    axes = rng.normal(size=(n, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    x, cases, rows = T[rng.permutation(len(T))[:n]], [], []
    W = np.concatenate([np.full((n, 1), 0.5), np.eye(n) / 2], axis=1).astype(np.float32)
    for angle in ANGLES:
        turned = Rotation.from_rotvec(np.radians(angle) * axes).as_matrix()
        R = np.concatenate([np.eye(3)[None], turned]).astype(np.float32)
        t = np.zeros((n + 1, 3), np.float32)
        case = f"two rotations {angle:g}° apart"
        trip, true = _there_and_back(x, W, R, t), _true_condition((np.eye(3) + turned) / 2)
        allowed = 1e3 * 3 * (trip.condition * DAMPING) ** 2 + FLOAT32_MM * trip.condition
        rows.append((angle, np.median(trip.condition), np.median(true), trip.error.max()))
        ratio = (trip.error / allowed).max()
        cases.append(at_most(GROUP, case, "error of unskin(skin(x)) ÷ what κ allows", ratio, 1.0, ""))
        if angle < 179.9:
            off = np.abs(trip.condition / true - 1).max()
            cases.append(at_most(GROUP, case, f"κ (median {np.median(true):.3g}) is off by", off, 0.05, ""))
        else:
            cases.append(at_least(GROUP, case, "flagged: least κ", trip.condition.min(), 100.0, ""))
    angles, reported, true, errors = zip(*rows, strict=True)
    return cases, [
        Curve("skinning", "κ reported", angles, reported),
        Curve("skinning", "κ exact", angles, true),
        Curve("skinning", "largest error, mm", angles, errors),
    ]


def _true_condition(A: np.ndarray) -> np.ndarray:
    """Return the Frobenius condition `[n]` of matrices `[n, 3, 3]`, 1 for a rotation, in float64."""
    s = np.maximum(np.linalg.svd(A, compute_uv=False), 1e-300)
    with np.errstate(over="ignore"):
        return np.sqrt(np.maximum((s**2).sum(axis=1), 3.0) * (s**-2.0).sum(axis=1)) / 3.0
