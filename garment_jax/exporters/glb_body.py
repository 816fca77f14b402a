"""The body of an animated GLB: a skin on joints that turn, as every viewer can play it."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.kinematics import pose_body
from garment_jax.evaluation.colours import BODY, body_colours, linear
from garment_jax.exporters.glb_document import add_channel, smooth_normals
from garment_jax.io.formats.gltf_writer import INDICES, VERTICES, GlbWriter
from garment_jax.io.sequence import Sequence
from garment_jax.structs import Motion, RiggedBody

_KEPT = 4  # weights of a vertex
_COMPARED = 16  # frames in which the vertices are compared with those of all weights


def add_body(
    writer: GlbWriter, document: dict[str, Any], sequence: Sequence, frames: range, times: int
) -> float:
    """Add the skinned body and its motion to `document`; return its largest error in metres.

    The error is that of leaving out all but four weights, in up to 16 of the frames.
    """
    body, picked = sequence.scene.body, np.array(frames)
    motion = Motion(sequence.motion.rotations[picked], sequence.motion.root[picked], sequence.fps)
    first_joint = len(document["nodes"]) + 1
    joints, weights = largest_weights(body.skin_weights)
    error = _error(body, joints, weights, motion)
    document["nodes"].append({"name": "body", "mesh": len(document["meshes"]), "skin": 0})
    document["meshes"].append(_mesh(writer, body, joints, weights, error))
    _add_joints(writer, document, body, motion, times)
    document["skins"].append(_skin(writer, body, first_joint))
    document["scenes"][0]["nodes"] += [first_joint - 1, first_joint]
    return error


def largest_weights(skin_weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the joints `[b, 4]` of the largest weights `[b, j]` and these, normalised; joint 0 where 0."""
    short = max(0, _KEPT - skin_weights.shape[1])
    padded = np.pad(skin_weights.astype(np.float64), ((0, 0), (0, short)))
    joints = np.argsort(-padded, axis=1, kind="stable")[:, :_KEPT]
    weights = np.take_along_axis(padded, joints, axis=1)
    weights = (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)
    return np.where(weights > 0, joints, 0), weights


def _error(body: RiggedBody, joints: np.ndarray, weights: np.ndarray, motion: Motion) -> float:
    reduced = np.zeros_like(body.skin_weights)
    np.add.at(reduced, (np.arange(len(joints))[:, None], joints), weights)
    frames = np.unique(np.linspace(0, len(motion.root) - 1, _COMPARED).astype(int))
    worst = 0.0
    for frame in frames:
        whole = pose_body(body, motion, slice(frame, frame + 1))
        kept = pose_body(body._replace(skin_weights=reduced), motion, slice(frame, frame + 1))
        worst = max(worst, float(np.linalg.norm(whole - kept, axis=-1).max()))
    return worst


def _mesh(
    writer: GlbWriter, body: RiggedBody, joints: np.ndarray, weights: np.ndarray, error: float
) -> dict[str, Any]:
    normals = smooth_normals(body.faces)(body.vertices)
    index = joints.astype(np.uint8 if len(body.joints) <= 256 else np.uint16)
    attributes = {
        "POSITION": writer.add(body.vertices, target=VERTICES, bounds=True),
        "NORMAL": writer.add(normals, target=VERTICES),
        # the material's colour is multiplied by it
        "COLOR_0": writer.add(
            (linear(body_colours(body)) / linear(BODY)).astype(np.float32), target=VERTICES
        ),
        "JOINTS_0": writer.add(index, target=VERTICES),
        "WEIGHTS_0": writer.add(weights, target=VERTICES),
    }
    indices = writer.add(body.faces.astype(np.uint32).reshape(-1), target=INDICES)
    primitive = {"attributes": attributes, "indices": indices, "material": 1}
    return {"name": "body", "primitives": [primitive], "extras": {"largest_error_metres": error}}


def _add_joints(
    writer: GlbWriter, document: dict[str, Any], body: RiggedBody, motion: Motion, times: int
) -> None:
    """Add the joints' nodes in the first frame's pose, and their motion when there are more frames."""
    first = len(document["nodes"])
    bones = body.joints.astype(np.float64)
    bones[1:] -= body.joints[body.parents[1:]]
    for j, name in enumerate(body.joint_names):
        turns = _local_quaternions(motion.rotations, body.parents, j)
        place = motion.root[0] if j == 0 else bones[j]
        node = {"name": name, "translation": place.tolist(), "rotation": turns[0].tolist()}
        children = np.flatnonzero(body.parents == j) + first
        document["nodes"].append(node | ({"children": children.tolist()} if len(children) else {}))
        if len(turns) > 1:
            add_channel(document, times, writer.add(turns), first + j, "rotation")
    if len(motion.root) > 1:
        add_channel(document, times, writer.add(motion.root.astype(np.float32)), first, "translation")


def _local_quaternions(rotations: np.ndarray, parents: np.ndarray, j: int) -> np.ndarray:
    """Return joint `j`'s rotations against its parent's `[t, 4]` float32, each on the last one's side.

    All joints' axes are the world's in the canonical pose, so that a world rotation is R_parent L.
    """
    world = rotations[:, j].astype(np.float64)
    parent = int(parents[j])
    above = np.eye(3) if parent < 0 else np.swapaxes(rotations[:, parent].astype(np.float64), 1, 2)
    turns = Rotation.from_matrix(above @ world).as_quat()
    flips = np.sign((turns[1:] * turns[:-1]).sum(axis=1))
    turns[1:] *= np.cumprod(np.where(flips < 0, -1.0, 1.0))[:, None]
    return turns.astype(np.float32)


def _skin(writer: GlbWriter, body: RiggedBody, first_joint: int) -> dict[str, Any]:
    inverse = np.tile(np.eye(4, dtype=np.float32), (len(body.joints), 1, 1))
    inverse[:, 3, :3] = -body.joints  # columns first
    joints = list(range(first_joint, first_joint + len(body.joints)))
    matrices = writer.add(inverse.reshape(-1, 16))
    return {"name": "skeleton", "joints": joints, "skeleton": first_joint, "inverseBindMatrices": matrices}
