"""A garment carried by the body's joints: linear blend skinning with weights of the body (host).

`closest_weights` are what Santesteban et al. (2019) use. Where legs part they change from one vertex to the
next, and a garment unposed by them is torn there; `garment_weights` smooths them over the cloth.
"""

import numpy as np
from scipy.spatial import KDTree

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.mirror import joint_partners
from garment_jax.body.root_frame import heading, to_root, yaw_matrix
from garment_jax.geometry.extension import diffused
from garment_jax.geometry.symmetry import mirror_permutation
from garment_jax.structs import Motion, Scene


def closest_weights(scene: Scene) -> np.ndarray:
    """Return the skinning weights `[n, j]` of the body vertex closest to each vertex of the template.

    Of those that the collider has, where there is one: arms at rest hang nearer to a wide skirt than legs.
    """
    body = scene.body
    vertices = np.arange(len(body.vertices)) if scene.collider is None else scene.collider.body_vertices
    nearest = KDTree(body.vertices[vertices]).query(scene.garment.template)[1]
    return body.skin_weights[vertices[nearest]].astype(np.float32)


def garment_weights(scene: Scene, *, reach: float, mirrored: bool) -> np.ndarray:
    """Return the skinning weights `[n, j]` of a garment in canonical pose, float32, rows sum to 1.

    `closest_weights` averaged over `reach` metres of cloth. `mirrored`: of a garment and a skeleton that are
    symmetric, the same left and right, so that a mirrored clip has the mirror image of the clip's unposed
    garments; raises `ValueError` where they are not.
    """
    garment = scene.garment
    W = diffused(closest_weights(scene), garment.template, garment.faces, reach=reach)
    if mirrored:
        W = 0.5 * (W + W[mirror_permutation(garment)][:, joint_partners(scene.body)])
    return W.astype(np.float32)


def joint_transforms(motion: Motion, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return R `[t, j, 3, 3]` and t `[t, j, 3]` metres: canonical root frame -> posed root frame; float32."""
    body = scene.body
    rotations, root = motion.rotations.astype(np.float64), motion.root.astype(np.float64)
    yaw = heading(rotations[:, 0])
    positions = to_root(joint_positions(rotations, root, body), root, yaw)
    R = yaw_matrix(-yaw)[:, None] @ rotations
    rest = (body.joints - body.joints[0]).astype(np.float64)
    t = positions - np.einsum("tjab,jb->tja", R, rest)
    return R.astype(np.float32), t.astype(np.float32)
