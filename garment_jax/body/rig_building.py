"""From parts that move freely to a rigged body: rotations, joints and weights fitted in turn (host, NumPy).

Each step is a least-squares problem in one of the three, solved in closed form with the others fixed.
"""

import numpy as np
from scipy.spatial import KDTree

from garment_jax.body.joint_fit import fit_joints
from garment_jax.body.kinematics import joint_positions
from garment_jax.body.part_tree import PartTree, part_tree
from garment_jax.body.pose_fit import fit_pose
from garment_jax.body.vertex_sample import spread_vertices, surface_centre
from garment_jax.geometry.bone_errors import bone_moments
from garment_jax.geometry.sparse_weights import fit_weights
from garment_jax.geometry.ssdr import ssdr
from garment_jax.structs import RiggedBody

_SWEEPS = 8  # of rotations between steps of joints and weights; they come back to it
_NEAR = 2  # steps along the skeleton within which a vertex' bones lie: chance correlations end there


def build_rig(
    faces: np.ndarray,
    frames: np.ndarray,
    rest: np.ndarray,
    *,
    joints: int,
    influences: int = 4,
    most_vertices: int = 1500,
    rounds: int = 4,
    seed: int = 0,
) -> RiggedBody:
    """Return the rigged body that follows `frames` `[s, n, 3]` of the mesh `rest` `[n, 3]`, `faces` `[f, 3]`.

    Parts and skeleton come from at most `most_vertices`, spread evenly; then all vertices get weights.
    """
    # One origin for all frames: world positions far from 0 would cost digits.
    V = frames.astype(np.float64)
    V -= V.mean(axis=1, keepdims=True)
    some = spread_vertices(rest, max(most_vertices, joints))
    found = ssdr(rest[some], V[:, some], bones=joints, influences=influences, seed=seed)
    tree = part_tree(
        rest[some].astype(np.float64),
        found.weights.astype(np.float64),
        found.rotations.astype(np.float64),
        found.translations,
        surface_centre(rest, faces),
    )
    body = _first_body(rest[some], found.weights, tree)
    R, root = fit_pose(body, V[:, some], start=found.rotations[:, tree.order])
    for _ in range(rounds):
        body = body._replace(joints=fit_joints(body, V[:, some], R).astype(np.float32))
        R, root = fit_pose(body, V[:, some], start=R, sweeps=_SWEEPS)
        body = body._replace(skin_weights=_weights(body, V[:, some], R, root, influences))
        R, root = fit_pose(body, V[:, some], start=R, sweeps=_SWEEPS)
    nearest = KDTree(rest[some]).query(rest)[1]
    body = body._replace(
        vertices=rest.astype(np.float32),
        faces=faces.astype(np.int32),
        skin_weights=body.skin_weights[nearest],
    )
    body = body._replace(skin_weights=_weights(body, V, R, root, influences))
    # The weights of all vertices move the pose a little, and the pose the weights.
    R, root = fit_pose(body, V, start=R)
    return body._replace(skin_weights=_weights(body, V, R, root, influences))


def _first_body(rest: np.ndarray, weights: np.ndarray, tree: PartTree) -> RiggedBody:
    names = tuple(f"p{k}" for k in range(len(tree.order)))
    none = np.zeros((0, 3), np.int32)
    joints = tree.joints.astype(np.float32)
    return RiggedBody(rest.astype(np.float32), none, joints, tree.parents, names, weights[:, tree.order])


def _weights(body: RiggedBody, V: np.ndarray, R: np.ndarray, root: np.ndarray, influences: int) -> np.ndarray:
    """Return weights `[n, j]` float32 under the pose; a vertex' bones lie near its strongest one."""
    positions = joint_positions(R, root, body)
    T = positions - (R @ body.joints.astype(np.float64)[:, :, None])[..., 0]
    allowed = joints_near(body.parents, _NEAR)[body.skin_weights.argmax(axis=1)]
    start = np.where(allowed, body.skin_weights, 0.0).astype(np.float64)
    start /= start.sum(axis=1, keepdims=True)
    moments = bone_moments(body.vertices, V, R, T)
    return fit_weights(moments, start, influences=influences, allowed=allowed).astype(np.float32)


def joints_near(parents: np.ndarray, steps: int) -> np.ndarray:
    """Return which joints are at most `steps` apart along the skeleton, `[j, j]` bool."""
    linked = np.eye(len(parents), dtype=bool)
    linked[np.arange(1, len(parents)), parents[1:]] = True
    linked |= linked.T
    return np.linalg.matrix_power(linked.astype(np.int64), steps) > 0
