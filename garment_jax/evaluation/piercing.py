"""Whether a limb runs through the cloth: what no vertex inside the body tells (host, NumPy, float64).

A leg that has passed through a skirt leaves every vertex outside of it, and the skirt on its wrong side.
Its bone then crosses a triangle of the cloth.
"""

import numpy as np

from garment_jax.evaluation.triangles import crosses


def pierced_bones(V: np.ndarray, bones: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return how many of the bones `[t, q, 2, 3]` cross the cloth `V` `[t, n, 3]` in each frame, `[t]`.

    Both in metres and one frame of reference; a bone that only touches a triangle does not count.
    """
    found = np.zeros(len(V), int)
    for t, (v, ends) in enumerate(zip(V.astype(np.float64), bones.astype(np.float64), strict=True)):
        low, high = v.min(axis=0), v.max(axis=0)
        for bone in ends:
            bottom, top = bone.min(axis=0), bone.max(axis=0)
            if (bottom > high).any() or (top < low).any():
                continue
            near = ((v[faces] <= top).any(axis=1) & (v[faces] >= bottom).any(axis=1)).all(axis=1)
            corners = v[faces[near]]
            found[t] += bool(crosses(np.broadcast_to(bone, (len(corners), 2, 3)), corners).any())
    return found
