"""A garment carried by the body's joints: linear blend skinning with weights of the body (host).

`closest_weights` and `joint_transforms` are what Santesteban et al. (2019) use. Where legs part the weights
change from one vertex to the next, and a garment unposed by them is torn there: `garment_weights` smooths
them over the cloth. A leg that moves inside a loose skirt does not carry it: `garment_transforms` count
rotations from `FREE_ANGLE` on.
"""

import numpy as np
from scipy.spatial import KDTree

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.mirror import joint_partners
from garment_jax.body.root_frame import heading, to_root, yaw_matrix
from garment_jax.geometry.extension import diffused
from garment_jax.geometry.symmetry import mirror_permutation
from garment_jax.structs import Motion, Scene

FREE_ANGLE = (
    60.0  # degrees; on clips kept back 30 to 75 do as well, 0 and 90 worse (experiments/pose_frames.py)
)
_NO_AXIS = 1e-6  # sine of an angle below which the matrix does not tell its axis


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


def garment_transforms(
    motion: Motion, scene: Scene, *, free_angle: float = FREE_ANGLE
) -> tuple[np.ndarray, np.ndarray]:
    """Return `joint_transforms` of a body whose joints have turned by `free_angle` degrees less.

    Turned from where they are on the canonical body that faces the same way; a joint that has turned less is
    where it was. float32.
    """
    body = scene.body
    rotations = motion.rotations.astype(np.float64)
    R = turned_less(yaw_matrix(-heading(rotations[:, 0]))[:, None] @ rotations, np.radians(free_angle))
    positions = joint_positions(R, np.zeros((len(R), 3)), body)
    t = positions - np.einsum("tjab,jb->tja", R, (body.joints - body.joints[0]).astype(np.float64))
    return R.astype(np.float32), t.astype(np.float32)


def turned_less(R: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotations `R` `[..., 3, 3]` about their own axes by `angle` radians less, at least 0.

    Without inverse functions: cos and sin of the difference from those of the two angles. A turn by exactly
    180 degrees has no axis to tell its sign by; its antisymmetric part is left out.
    """
    odd = 0.5 * (R - np.swapaxes(R, -1, -2))  # sin times the axis' cross product
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)[..., None, None]
    sine = np.sqrt(0.5 * np.square(odd).sum(axis=(-1, -2)))[..., None, None]
    c, s = np.cos(angle), np.sin(angle)
    eye, told = np.eye(3), sine > _NO_AXIS
    even = 0.5 * (R + np.swapaxes(R, -1, -2)) - cosine * eye  # (1 - cos) times the axis' outer product
    beyond = cosine < c
    outer = even / np.where(beyond, 1.0 - cosine, 1.0)
    cross = np.where(told, odd / np.where(told, sine, 1.0), 0.0)
    less, across = cosine * c + sine * s, sine * c - cosine * s
    return np.where(beyond, less * eye + (1.0 - less) * outer + across * cross, eye)
