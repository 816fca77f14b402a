"""Which garment vertices are inside the body, measured before the page is made."""

from collections.abc import Callable

import numpy as np

from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.evaluation.pair import read_finite
from garment_jax.evaluation.penetration import (
    closed_surface,
    is_inside,
    neighbour_faces,
    signed_distance,
)
from garment_jax.io.sequence import Sequence


def inside_bits(
    clip: Sequence, frames: np.ndarray, report: Callable[[int], None] = lambda done: None
) -> np.ndarray:
    """Return `[t, ceil(n / 8)]` uint8, a bit a vertex (lowest first): inside the collider at `frames`.

    Inside is a signed distance below -0.1 mm, as `garment-jax evaluate` counts. `report` is called
    with the number of frames done. Raises ValueError for a clip without a collider.
    """
    collider = clip.scene.collider
    if collider is None:
        raise ValueError(
            f"{clip.path} has no collider, so nothing says what is inside; leave --penetration out."
        )
    neighbours = neighbour_faces(collider.faces)
    rows = []
    for done, frame in enumerate(frames.tolist()):
        root = clip.motion.root[frame]
        body = pose_body(clip.scene.body, clip.motion, np.array([frame]))[0].astype(np.float64) - root
        V = read_finite(clip, frame, frame + 1)[0] - root
        distance = signed_distance(
            V, closed_surface(collider_points(collider, body), collider.faces, neighbours)
        )
        rows.append(np.packbits(is_inside(distance), bitorder="little"))
        report(done + 1)
    return np.stack(rows)
