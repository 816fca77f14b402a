"""How far a garment can get: what hangs on pins stays within its length of cloth from them.

Not in the paper. A vertex is joined to a pin by a way over the mesh's edges; while that way is stretched by
`stretch` at most, the vertex lies in the ball around the pin with the stretched way's length. Networks know
no such law, so a rollout that relies on it checks it in every frame (`beyond_reach`). Host, NumPy.
"""

from typing import NamedTuple

import numpy as np

from garment_jax.body.carried import Carried, pose_carried
from garment_jax.geometry.geodesics import geodesics_to_pins
from garment_jax.structs import Garment, Motion, Scene

STRETCH = 0.25  # part by which a way over the cloth may lengthen before a rollout is checked anew
_BALLS = 8  # that enclose those of all pins: each is compared with the whole collider
_FRAMES = 32  # compared at a time: memory stays bounded


class Reach(NamedTuple):
    """The balls that hold a garment (static)."""

    pin: np.ndarray  # [n] row of the pins that a vertex hangs on by the shortest way; 0 where on none
    length: np.ndarray  # [n] metres of that way, stretched; inf where a vertex hangs on no pin
    group: np.ndarray  # [p] of each pin: pins that lie together share one ball
    radius: np.ndarray  # [p] metres, the longest way of the vertices that hang on a pin


def cloth_reach(garment: Garment, pins: np.ndarray, *, stretch: float = STRETCH) -> Reach | None:
    """Return how far the vertices get from `pins` `[p]`, or None: a part that hangs on none has no bound."""
    if not len(pins):
        return None
    way, pin = geodesics_to_pins(garment, pins)
    length = (1.0 + stretch) * way
    if not np.isfinite(length).all():
        return None
    radius = np.zeros(len(pins))
    np.maximum.at(radius, pin, length)
    return Reach(pin, length, _grouped(garment.template[pins]), radius)


def _grouped(points: np.ndarray) -> np.ndarray:
    """Return the group of each of `points` `[p, 3]`: that of the nearest of a few spread ones."""
    from garment_jax.body.seeds import farthest_points

    points = points.astype(np.float64)
    centres = points[farthest_points(points, min(_BALLS, len(points)))]
    return np.linalg.norm(points[:, None] - centres[None], axis=-1).argmin(axis=1)


def beyond_reach(reach: Reach, V: np.ndarray, pins: np.ndarray) -> np.ndarray:
    """Return by how much each frame's worst vertex leaves its ball, `[k]` metres; at most 0: none does.

    `V` `[k, n, 3]`, `pins` `[k, p, 3]`, metres in one frame.
    """
    return (np.linalg.norm(V - pins[:, reach.pin], axis=-1) - reach.length[None]).max(axis=1)


def reach_balls(reach: Reach, pins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centres `[k, g, 3]` and radii `[k, g]` of balls that hold the garment at pins `[k, p, 3]`."""
    groups = range(int(reach.group.max()) + 1)
    members = [np.flatnonzero(reach.group == g) for g in groups]
    members = [m for m in members if len(m)]
    centres = np.stack([pins[:, m].mean(axis=1) for m in members], axis=1)
    apart = [
        (np.linalg.norm(pins[:, m] - centres[:, g, None], axis=-1) + reach.radius[m]).max(axis=1)
        for g, m in enumerate(members)
    ]
    return centres, np.stack(apart, axis=1)


def triangle_gaps(
    reach: Reach, pins: np.ndarray, collider: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, bool]:
    """Return how far each triangle is from the garment at least, `[f]` metres, and if it may be inside.

    The least over the frames of pins `[k, p, 3]` and collider `[k, c, 3]`, metres in one frame; negative
    where the balls reach the triangle. "Inside": a ball's centre is, in some frame, and no distance bound
    says that the cloth is not.
    """
    centres, radii = reach_balls(reach, pins.astype(np.float64))
    gaps, inside = np.full(len(faces), np.inf), False
    for k, vertices in enumerate(collider.astype(np.float64)):
        # a point of a triangle is no farther from its nearest corner than the longest edge
        away = np.linalg.norm(vertices[:, None] - centres[k][None], axis=-1) - radii[k][None]
        corners = vertices[faces]
        longest = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=-1).max(axis=1)
        gap = away.min(axis=1)[faces].min(axis=1) - longest
        gaps = np.minimum(gaps, gap)
        inside = inside or (bool(gap.min() > 0) and _inside(centres[k], vertices, faces))
    return gaps, inside


def _inside(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Return whether one of the points may be inside, cheaply where none is near."""
    from garment_jax.geometry.winding_number import winding_number

    near = ((points >= vertices.min(axis=0)) & (points <= vertices.max(axis=0))).all(axis=1)
    return bool(near.any()) and bool((np.abs(winding_number(points[near], vertices, faces)) > 0.4).any())


def motion_gaps(
    reach: Reach, carried: Carried, scene: Scene, motion: Motion, *, stop_below: float = -np.inf
) -> tuple[np.ndarray, bool]:
    """Return `triangle_gaps` over a whole motion; given up early once one is below `stop_below`, metres."""
    assert scene.collider is not None
    gaps, inside = np.full(len(scene.collider.faces), np.inf), False
    starts = [0, *range(1, len(motion.root), _FRAMES)]  # the first frame alone settles most scenes
    for start, stop in zip(starts, [*starts[1:], len(motion.root)], strict=True):
        pins, collider, _ = pose_carried(carried, scene, motion, slice(start, stop))
        more, within = triangle_gaps(reach, pins, collider, scene.collider.faces)
        gaps, inside = np.minimum(gaps, more), inside or within
        if inside or gaps.min() < stop_below:
            break
    return gaps, inside
