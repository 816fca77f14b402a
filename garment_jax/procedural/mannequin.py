"""The mannequin: a human body made in code, and the part of it that cloth can touch."""

import numpy as np

from garment_jax.procedural.bone_heat import bone_heat
from garment_jax.procedural.figure import figure
from garment_jax.procedural.holes import closed
from garment_jax.procedural.relaxing import mirrored, partners, relax, triangulated
from garment_jax.procedural.skeleton import JOINT_NAMES, JOINTS, PARENTS, PARTNERS
from garment_jax.procedural.slivers import without_slivers
from garment_jax.procedural.surface_nets import surface_nets
from garment_jax.structs import Collider, RiggedBody

_LOW, _HIGH = np.array([0.0, 0.0, -0.18]), np.array([0.56, 1.67, 0.24])
_FINEST, _COARSEST = 0.01, 0.03
# Where limbs leave the collider: a bone's joint, its child, how far along the bone the cut is. Arms and
# hands that pass through the hips would trap cloth between two body parts.
_CUTS = (("Neck", "Head", 0.45), ("LeftArm", "LeftForeArm", 0.3), ("RightArm", "RightForeArm", 0.3))


def make_mannequin(resolution: float = 0.02) -> RiggedBody:
    """Return a standing woman of 1.65 m in A-pose with the shared avatar's 22 joints.

    Canonical frame: metres, Y up, facing +Z, soles at y = 0. Watertight, outward, exactly symmetric in
    x; about 5,400 vertices at the default `resolution` (edge length, metres). Deterministic. Raises
    `ValueError` for a resolution outside 0.01 to 0.03, or one at which the mesh does not close.
    """
    if not _FINEST <= resolution <= _COARSEST:
        raise ValueError(f"resolution={resolution} must lie between {_FINEST} and {_COARSEST} m; try 0.02.")
    half, half_faces = _half_skin(resolution)
    vertices, faces = mirrored(half, half_faces)
    vertices[:, 1] -= vertices[:, 1].min()
    weights = bone_heat(vertices, faces)
    return RiggedBody(
        vertices.astype(np.float32),
        faces.astype(np.int32),
        JOINTS.copy(),
        PARENTS.copy(),
        JOINT_NAMES,
        _symmetric(weights, half).astype(np.float32),
    )


def mannequin_collider(body: RiggedBody) -> Collider:
    """Return the trunk with legs, shoulders and stubs of arms and neck: closed, outward, one piece.

    The three cuts are closed by triangles between their own vertices, so `cap_loop` is empty.
    """
    keep = np.ones(len(body.vertices), bool)
    for joint, child, along in _CUTS:
        j, k = body.joint_names.index(joint), body.joint_names.index(child)
        bone = (body.joints[k] - body.joints[j]).astype(np.float64)
        beyond = (body.vertices - body.joints[j]) @ bone > along * (bone @ bone)
        keep &= ~(beyond & (body.skin_weights[:, _below(body, j)].sum(axis=1) > 0.1))
    kept, faces = closed(body.faces, keep)
    return Collider(kept.astype(np.int32), np.zeros(0, np.int32), faces.astype(np.int32))


def _below(body: RiggedBody, joint: int) -> np.ndarray:
    """Return the joint and all its descendants (parents come before their children)."""
    found = [joint]
    for j, parent in enumerate(body.parents.tolist()):
        if parent in found:
            found.append(j)
    return np.array(found)


def _half_skin(resolution: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the half x >= 0 as a triangle mesh; the grid moves a little until the mesh is a manifold."""
    for shift in (0.0, 0.3, 0.6):
        low = _LOW - shift * resolution
        vertices, quads = surface_nets(figure, low, _HIGH, resolution)
        vertices = relax(vertices, quads, figure, rounds=8)
        faces = triangulated(vertices, quads)
        for rounds in (4, 3):
            vertices = relax(vertices, faces, figure, rounds=rounds)
            vertices, faces = without_slivers(vertices, faces)
        if _closes(vertices, faces):
            return vertices, faces
    raise ValueError(f"resolution={resolution} gives a skin that does not close; try 0.02.")


def _closes(vertices: np.ndarray, faces: np.ndarray) -> bool:
    whole, all_faces = mirrored(vertices, faces)
    pairs = np.concatenate([all_faces[:, [0, 1]], all_faces[:, [1, 2]], all_faces[:, [2, 0]]])
    directed = np.unique(pairs, axis=0)
    edges = np.unique(np.sort(pairs, axis=1), axis=0)
    manifold = len(directed) == len(pairs) == 2 * len(edges)
    return manifold and len(whole) - len(edges) + len(all_faces) == 2


def _symmetric(weights: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return `weights` `[n, j]`, the mean of both sides: rounding in the solver is not symmetric."""
    n, twin = len(half), partners(half)
    left = (weights[:n] + weights[twin][:, PARTNERS]) / 2
    return np.concatenate([left, left[half[:, 0] != 0][:, PARTNERS]])
