"""Is a simulated clip fit to be learnt from? (pitfalls 3 and 6 of the ground truth)

Penetration, strain and NaN are seen in single frames. A skirt that bunched at the waist passes all of
them: it is found by the hem's height over time, spins apart, which lift a hem as they should.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.body.root_frame import headings
from garment_jax.evaluation.cloth import edge_strain, rest_lengths
from garment_jax.evaluation.penetration import (
    closed_surface,
    neighbour_faces,
    penetration,
    signed_distance,
)
from garment_jax.evaluation.self_intersections import self_intersections
from garment_jax.geometry.boundary import hem_vertices
from garment_jax.geometry.topology import unique_edges
from garment_jax.structs import Motion, Scene

SETTLED = 0.25  # part of the frames, at each end of a clip, whose hem heights are compared
SPIN = np.radians(90.0)  # a second: a body that turns faster lifts the hem itself
LOW = 10.0  # per cent of the heights that are lower than what counts as the lowest
FALL = 1.0  # seconds in which the hem has come down again


@dataclass(frozen=True)
class ScreenLimits:
    """What a clip may show and still be kept."""

    deepest_mm: float = 25.0  # kicks and splits of real dances reach 22
    inside_percent: float = 0.1  # of the vertices of the screened frames
    strain_p99_percent: float = 15.0  # of the edges, the worst screened frame
    hem_rise_cm: float = 6.0  # of the mean hem height for good: bunched at the waist, or caught


class Screen(NamedTuple):
    """What screening found; heights are the hem's mean above the root joint."""

    frames: int  # all, not only the screened
    deepest_mm: float
    inside_percent: float
    strain_mean_percent: float
    strain_p99_percent: float
    hem_lowest_cm: float
    hem_highest_cm: float
    hem_rise_cm: float  # of the last quarter's low heights over the first's median; 0 where all of it is spin
    crossing_edges: float  # self-intersections, mean per screened frame


def screen_clip(scene: Scene, motion: Motion, V: np.ndarray, *, every: int = 10) -> Screen:
    """Return the figures of a clip `V` `[t, n, 3]` world metres, on every `every`-th frame.

    Raises `ValueError` with the frame for a value that is not finite.
    """
    bad = ~np.isfinite(V).all(axis=(1, 2))
    if bad.any():
        raise ValueError(f"frame {int(bad.argmax())} is not finite; simulate with more substeps.")
    which = np.arange(0, len(V), every)
    garment = scene.garment
    edges = unique_edges(garment.faces)
    strain = edge_strain(V[which], edges, rest_lengths(garment.template, edges))
    inside = _penetration(scene, motion, V, which)
    height = _hem_height(scene, motion, V)
    rise = _rise(height, _hangs(motion))
    crossings = [self_intersections(V[t].astype(np.float64), garment.faces, edges).edges for t in which]
    return Screen(
        len(V),
        float(inside[:, 1].max(initial=0.0)),
        float(inside[:, 0].mean()) if len(inside) else 0.0,
        float(strain.mean()),
        float(np.percentile(strain, 99, axis=1).max()),
        float(height.min()),
        float(height.max()),
        rise,
        float(np.mean(crossings)),
    )


def faults(screen: Screen, limits: ScreenLimits = ScreenLimits()) -> list[str]:
    """Return in words what disqualifies a clip; empty for a clip to keep."""
    found = []
    if screen.deepest_mm > limits.deepest_mm:
        found.append(f"{screen.deepest_mm:.1f} mm inside the body (limit {limits.deepest_mm:g})")
    if screen.inside_percent > limits.inside_percent:
        found.append(f"{screen.inside_percent:.2f} % of vertices inside (limit {limits.inside_percent:g})")
    if screen.strain_p99_percent > limits.strain_p99_percent:
        found.append(f"strain {screen.strain_p99_percent:.0f} % (limit {limits.strain_p99_percent:g})")
    if screen.hem_rise_cm > limits.hem_rise_cm:
        found.append(f"hem rose {screen.hem_rise_cm:.1f} cm for good (limit {limits.hem_rise_cm:g})")
    return found


def _penetration(scene: Scene, motion: Motion, V: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Return per cent inside and depth in mm of every screened frame, `[k, 2]`; empty for an open body."""
    body = pose_body(scene.body, motion, which)
    if scene.collider is None:
        points, faces = body, scene.body.faces
    else:
        points, faces = collider_points(scene.collider, body), scene.collider.faces
    try:
        neighbours = neighbour_faces(faces)
    except ValueError:  # many bodies are open at eyes or mouth: they have no inside to be in
        return np.zeros((0, 2))
    rows = [
        penetration(signed_distance(V[t], closed_surface(p, faces, neighbours)))
        for t, p in zip(which, points, strict=True)
    ]
    return np.array([[row.inside_percent, row.deepest_mm] for row in rows])


def _rise(height: np.ndarray, hangs: np.ndarray) -> float:
    """Return how much higher heights `[t]` stay in their last quarter than they are in the first.

    Of the last quarter only the frames `hangs` `[t]` count, in which no spin holds the hem up, and of these
    the low ones: a cape that swings while its body walks comes down now and then.
    """
    quarter = max(int(SETTLED * len(height)), 1)
    last = height[-quarter:][hangs[-quarter:]]
    return float(np.percentile(last, LOW) - np.median(height[:quarter])) if len(last) else 0.0


def _hangs(motion: Motion) -> np.ndarray:
    """Return in which frames `[t]` the body has not turned quickly for a while, bool."""
    turned = np.abs(np.diff(np.unwrap(headings(motion)), prepend=0.0)) * motion.fps
    turned[:1] = 0.0
    since = max(round(FALL * motion.fps), 1)
    return maximum_filter1d(turned, since, origin=(since - 1) // 2, mode="nearest") < SPIN


def _hem_height(scene: Scene, motion: Motion, V: np.ndarray) -> np.ndarray:
    """Return the hem's mean height above the root by frame, `[t]` cm; without a hem all vertices'."""
    pins = None if scene.pins is None else scene.pins.vertices
    try:
        hem = hem_vertices(scene.garment.template, scene.garment.faces, pins)
    except ValueError:
        hem = np.arange(V.shape[1])
    return 100.0 * (V[:, hem, 1].mean(axis=1) - motion.root[:, 1])
