"""A rigged body, and a motion of it, as a GLB file: the least that a program exports."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.structs import Motion, RiggedBody

_TYPES = {"f4": 5126, "u2": 5123, "u4": 5125}
_SHAPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class _Buffer:
    """The binary chunk and the accessors into it."""

    def __init__(self) -> None:
        self.data = b""
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: np.ndarray, kind: str, **more: Any) -> int:
        rows = np.ascontiguousarray(values, f"<{kind}").reshape(len(values), -1)
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": rows.nbytes})
        self.data += rows.tobytes() + b"\0" * (-rows.nbytes % 4)
        accessor = {"bufferView": len(self.views) - 1, "componentType": _TYPES[kind], "count": len(rows)}
        self.accessors.append(accessor | {"type": _SHAPES[rows.shape[1]]} | more)
        return len(self.accessors) - 1


def write_glb(path: Path, body: RiggedBody, motion: Motion | None = None) -> Path:
    """Write a body, each vertex with its four largest weights, and the motion's keys at every frame."""
    path.write_bytes(pack_glb(*glb_parts(body, motion)))
    return path


def glb_parts(body: RiggedBody, motion: Motion | None = None) -> tuple[dict[str, Any], bytes]:
    """Return a GLB file's JSON and binary chunk."""
    buffer, x = _Buffer(), body.joints.astype(np.float64)
    order = np.argsort(-body.skin_weights, axis=1)[:, :4]
    weights = np.take_along_axis(body.skin_weights, order, axis=1)
    inverse = np.tile(np.eye(4), (len(x), 1, 1))
    inverse[:, 3, :3] = -x  # columns one after the other
    span = {"min": body.vertices.min(axis=0).tolist(), "max": body.vertices.max(axis=0).tolist()}
    attributes = {
        "POSITION": buffer.add(body.vertices, "f4", **span),
        "JOINTS_0": buffer.add(order, "u2"),
        "WEIGHTS_0": buffer.add(weights / weights.sum(axis=1, keepdims=True), "f4"),
    }
    primitive = {"attributes": attributes, "indices": buffer.add(body.faces.ravel(), "u4")}
    nodes: list[dict[str, Any]] = []
    for j, name in enumerate(body.joint_names):
        above = x[body.parents[j]] if j else np.zeros(3)
        children = np.flatnonzero(body.parents == j).tolist()
        nodes.append(
            {"name": name, "translation": (x[j] - above).tolist()}
            | ({"children": children} if children else {})
        )
    skin = {"joints": list(range(len(x))), "inverseBindMatrices": buffer.add(inverse.reshape(-1, 16), "f4")}
    content: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, len(nodes)]}],
        "nodes": [*nodes, {"name": "Body", "mesh": 0, "skin": 0}],
        "meshes": [{"primitives": [primitive]}],
        "skins": [skin],
    }
    if motion is not None:
        content["animations"] = [_animation(buffer, body, motion)]
    content |= {"buffers": [{"byteLength": len(buffer.data)}]}
    return content | {"bufferViews": buffer.views, "accessors": buffer.accessors}, buffer.data


def pack_glb(content: dict[str, Any], data: bytes) -> bytes:
    """Return the bytes of a GLB file."""
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _animation(buffer: _Buffer, body: RiggedBody, motion: Motion) -> dict[str, Any]:
    t = len(motion.root)
    times = np.arange(t) / motion.fps
    key = buffer.add(times, "f4", min=[0.0], max=[float(np.float32(times[-1]))])
    R = motion.rotations.astype(np.float64)
    samplers = [{"input": key, "output": buffer.add(motion.root, "f4")}]
    channels = [{"sampler": 0, "target": {"node": 0, "path": "translation"}}]
    for j, parent in enumerate(body.parents.tolist()):
        local = R[:, j] if parent < 0 else np.swapaxes(R[:, parent], -1, -2) @ R[:, j]
        quaternions = Rotation.from_matrix(local).as_quat()
        samplers.append({"input": key, "output": buffer.add(quaternions, "f4")})
        channels.append({"sampler": j + 1, "target": {"node": j, "path": "rotation"}})
    return {"name": "Walk", "samplers": samplers, "channels": channels}
