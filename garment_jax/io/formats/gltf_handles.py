"""Joints above a skeleton that only carry it about: a rig's handle is no part of the body."""

import numpy as np

from garment_jax.io.formats.gltf_parts import list_names
from garment_jax.io.formats.gltf_rig import Skeleton

_FLOOR = 0.05  # of the skeleton's height above its lowest joint: nobody's hips are that low


def without_handle_parts(skeleton: Skeleton) -> Skeleton:
    """Return the skeleton without the rigid meshes on a top joint at the floor: a disk to grasp, no body."""
    heights = skeleton.bind[:, 1, 3]
    if heights[0] > heights.min() + _FLOOR * np.ptp(heights) or len(heights) < 2:
        return skeleton
    out = [p for p in skeleton.parts if p.skin is None and p.joint == skeleton.joints[0]]
    if not out or len(out) == len(skeleton.parts):
        return skeleton
    names = list_names(skeleton.nodes.names[part.node] for part in out)
    note = f"left out, as they are the handle of joint {skeleton.names[0]}: {names}"
    parts = [part for part in skeleton.parts if part not in out]
    return skeleton._replace(parts=parts, notes=(*skeleton.notes, note))


def carries_weight(skeleton: Skeleton, weights: np.ndarray) -> np.ndarray:
    """Return for every joint whether it or one below it moves a vertex, `[j]`; `weights` `[b, j]`."""
    carries = np.asarray(weights.max(axis=0) > 0)
    for j in range(len(carries) - 1, 0, -1):
        carries[skeleton.parents[j]] |= carries[j]
    return carries


def without_handles(skeleton: Skeleton, weights: np.ndarray) -> tuple[Skeleton, np.ndarray]:
    """Return skeleton and weights `[b, j]` without handles, and without the weightless joints at these.

    Many rigs have a bone on the floor ("root", "master") that no vertex follows, with the hips below it
    and controls beside them. The hips travel against it, while our root joint is the one that travels: as
    long as the top joint moves no vertex and all that move some hang on one of its children, that child
    becomes the root.
    """
    while True:
        carries, parents = carries_weight(skeleton, weights), skeleton.parents
        children = np.flatnonzero((parents == 0) & carries)
        if (weights[:, 0] > 0).any() or len(children) != 1:
            return skeleton, weights
        kept = _below(parents, int(children[0]))
        renumbered = np.cumsum(kept) - 1
        above = np.where(parents[kept] > 0, renumbered[parents[kept]], -1)
        above[0] = -1
        skeleton = skeleton._replace(
            joints=[node for node, stays in zip(skeleton.joints, kept, strict=True) if stays],
            parents=above.astype(np.int32),
            names=tuple(name for name, stays in zip(skeleton.names, kept, strict=True) if stays),
            bind=skeleton.bind[kept],
        )
        weights = weights[:, kept]


def _below(parents: np.ndarray, top: int) -> np.ndarray:
    """Return which joints are `top` or hang on it, `[j]`."""
    inside = np.zeros(len(parents), bool)
    inside[top] = True
    for j in range(top + 1, len(parents)):
        inside[j] = parents[j] >= 0 and inside[parents[j]]
    return inside
