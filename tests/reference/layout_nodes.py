"""glTF files in the layouts of Mixamo and Unreal, written from one person's motion."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tests.importers.glb_files import _Buffer, pack_glb
from tests.reference.layout_files import joint_worlds, local_frames
from tests.reference.layouts import Joint
from tests.reference.person import Performance, about, forward


def write_nodes(
    path: Path,
    joints: tuple[Joint, ...],
    truth: Performance,
    *,
    skin: bool = True,
    bind: np.ndarray | None = None,
) -> Path:
    """Write a GLB as Blender and Mixamo do: an armature in cm, Z up; the joints' nodes, ends first.

    `bind` `[j, 3, 3]` are the segments' rotations in the bind pose (the T-pose without it). Without `skin`
    the file holds the animation alone.
    """
    person, t = truth.person, len(truth.positions)
    turns = np.tile(np.eye(3), (len(person.names), 1, 1)) if bind is None else bind
    still = Performance(person, turns[None], forward(person, turns[None], person.rest[:1]), 1.0)
    armature = about("x", 90.0)
    R, p = joint_worlds(joints, truth)
    R0, p0 = joint_worlds(joints, still)
    local, places = _under(armature, joints, R, p)
    local0, places0 = _under(armature, joints, R0, p0)
    count, buffer = len(joints), _Buffer()
    place = {joint.name: count - 1 - k for k, joint in enumerate(joints)}
    nodes: list[dict[str, Any]] = [{} for _ in joints]
    for k, joint in enumerate(joints):
        nodes[place[joint.name]] = {
            "name": joint.name,
            "translation": places0[0, k].tolist(),
            "rotation": Rotation.from_matrix(local0[0, k]).as_quat().tolist(),
        }
        children = [place[other.name] for other in joints if other.parent == joint.name]
        if children:
            nodes[place[joint.name]]["children"] = children
    roots = [place[joint.name] for joint in joints if not joint.parent]
    quaternion = Rotation.from_matrix(armature).as_quat().tolist()
    nodes.append({"name": "Armature", "children": roots, "rotation": quaternion, "scale": [0.01] * 3})
    content: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [count]}]}
    content["nodes"] = nodes
    if skin:
        _add_skin(content, buffer, joints, R0[0], p0[0])
    times = np.arange(t) / truth.fps
    key = buffer.add(times, "f4", min=[0.0], max=[float(np.float32(times[-1]))])
    samplers, channels = [], []
    for k, joint in enumerate(joints):
        tracks = [("rotation", Rotation.from_matrix(local[:, k]).as_quat())]
        if np.ptp(places[:, k], axis=0).max() > 1e-3:
            tracks.append(("translation", places[:, k]))
        for kind, values in tracks:
            samplers.append({"input": key, "output": buffer.add(values, "f4")})
            target = {"node": place[joint.name], "path": kind}
            channels.append({"sampler": len(samplers) - 1, "target": target})
    name = "Armature|mixamo.com|Layer0"
    content["animations"] = [{"name": name, "samplers": samplers, "channels": channels}]
    content |= {"buffers": [{"byteLength": len(buffer.data)}]}
    content |= {"bufferViews": buffer.views, "accessors": buffer.accessors}
    path.write_bytes(pack_glb(content, buffer.data))
    return path


def _under(armature: np.ndarray, joints: tuple[Joint, ...], R: np.ndarray, p: np.ndarray) -> tuple:
    """Return the joints' matrices in their parents' frames, cm, the roots' in the armature's."""
    return local_frames(joints, armature.T @ R, 100 * p @ armature)


def _add_skin(
    content: dict[str, Any], buffer: _Buffer, joints: tuple[Joint, ...], R: np.ndarray, p: np.ndarray
) -> None:
    """A triangle at every joint, bound to it alone."""
    count = len(joints)
    corners = np.array([[0, 0, 0], [0.02, 0, 0], [0, 0.02, 0]])
    points = (p[:, None] + corners).reshape(-1, 3)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = 0.01 * R
    matrices[:, :3, 3] = p
    inverse = np.linalg.inv(matrices)[::-1].swapaxes(1, 2).reshape(-1, 16)
    bound = np.zeros((3 * count, 4), int)
    bound[:, 0] = np.repeat(np.arange(count)[::-1], 3)
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    attributes = {
        "POSITION": buffer.add(points, "f4", min=low, max=high),
        "JOINTS_0": buffer.add(bound, "u2"),
        "WEIGHTS_0": buffer.add(np.tile([1.0, 0, 0, 0], (3 * count, 1)), "f4"),
    }
    primitive = {"attributes": attributes, "indices": buffer.add(np.arange(3 * count)[:, None], "u4")}
    content["skins"] = [
        {"joints": list(range(count)), "inverseBindMatrices": buffer.add(inverse, "f4"), "name": "Armature"}
    ]
    content["meshes"] = [{"primitives": [primitive]}]
    content["nodes"].append({"name": "Surface", "mesh": 0, "skin": 0})
    content["nodes"][-2]["children"].append(len(content["nodes"]) - 1)
