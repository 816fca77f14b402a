"""A small rigged glTF written by hand: a strip of quads on a chain of three joints, and one animation.

The numbers are round so that tests can say what must come out. `document` returns the JSON and the binary
buffer; tests change what they like before `write_glb` or `write_gltf` puts them into a file.
"""

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

NAMES = ("Hips", "Spine", "Head")
JOINTS = np.array([[0.0, 1.0, 0.0], [0.0, 1.5, 0.0], [0.0, 2.0, 0.0]])  # metres, world
# two columns of four vertices; the second quad repeats the row that it shares with the first, as exporters do
POINTS = np.array(
    [[x, y, 0.1] for y in (1.0, 1.3) for x in (-0.2, 0.2)]
    + [[x, y, 0.1] for y in (1.3, 1.7) for x in (-0.2, 0.2)]
    + [[x, y, 0.1] for y in (1.7, 2.1) for x in (-0.2, 0.2)]
)
WEIGHTS = np.repeat(
    np.array([[1, 0, 0], [0.5, 0.5, 0], [0.5, 0.5, 0], [0, 0.75, 0.25], [0, 0.75, 0.25], [0, 0, 1.0]]),
    2,
    axis=0,
)
FACES = np.array([[0, 1, 2], [2, 1, 3], [4, 5, 6], [6, 5, 7], [8, 9, 10], [10, 9, 11]])
TIMES = np.array([0.0, 0.5, 1.0])
# unit quaternions x y z w: no turn, a quarter about z from the other side, a third of a turn about x
TURNS = np.array([[0, 0, 0, 1], [0, 0, -np.sqrt(0.5), -np.sqrt(0.5)], [np.sqrt(0.75), 0, 0, 0.5]])
MOVES = np.array([[0.0, 1.0, 0.0], [0.2, 1.0, 0.0], [0.2, 1.4, 0.0]])


class Parts:
    """Buffer views and accessors, appended one by one."""

    def __init__(self) -> None:
        self.data, self.views, self.accessors = b"", [], []

    def add(self, values: np.ndarray, kind: str, dtype: str, **more: Any) -> int:
        code = {"u1": 5121, "u2": 5123, "u4": 5125, "f4": 5126}[dtype]
        raw = values.astype("<" + dtype).tobytes()
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(raw)})
        self.data += raw + bytes(-len(raw) % 4)
        accessor = {
            "bufferView": len(self.views) - 1,
            "componentType": code,
            "count": len(values),
            "type": kind,
        }
        self.accessors.append(accessor | more)
        return len(self.accessors) - 1


def document(
    *,
    unit: float = 1.0,
    turned: np.ndarray | None = None,
    mode: str = "LINEAR",
    order: tuple[int, ...] = (0, 1, 2),
) -> tuple[dict[str, Any], bytes]:
    """Return the JSON and the buffer.

    `unit`: metres per unit of the mesh, and `turned` `[3, 3]`: its axes; both undone by the armature's node.
    `order`: the joints in the order of the skin's list.
    """
    turned = np.eye(3) if turned is None else turned
    parts = Parts()

    def into(points: np.ndarray) -> np.ndarray:
        return points @ turned / unit  # the inverse of turned, for rows

    place = np.argsort(order)
    index = np.zeros((len(POINTS), 4), int)
    index[:, :3] = place[None]
    weights = np.pad(WEIGHTS, ((0, 0), (0, 1)))
    index[weights == 0] = 0
    inverse = np.tile(np.eye(4), (3, 1, 1))
    inverse[:, 3, :3] = -into(JOINTS)
    attributes = {
        "POSITION": parts.add(into(POINTS), "VEC3", "f4"),
        "JOINTS_0": parts.add(index, "VEC4", "u1"),
        "WEIGHTS_0": parts.add(weights, "VEC4", "f4"),
    }
    faces = parts.add(FACES.reshape(-1), "SCALAR", "u2")
    matrices = parts.add(inverse[list(order)].reshape(-1, 16), "MAT4", "f4")
    times = parts.add(TIMES, "SCALAR", "f4")
    turns, moves = (TURNS, into(MOVES))
    if mode == "CUBICSPLINE":
        turns, moves = (
            np.stack([0.3 * v, v, -0.2 * v], axis=1).reshape(-1, v.shape[1]) for v in (turns, moves)
        )
    samplers = [
        {"input": times, "output": parts.add(turns, "VEC4", "f4"), "interpolation": mode},
        {"input": times, "output": parts.add(moves, "VEC3", "f4"), "interpolation": mode},
    ]
    channels = [
        {"sampler": 0, "target": {"node": 2, "path": "rotation"}},
        {"sampler": 1, "target": {"node": 1, "path": "translation"}},
    ]
    bones = into(np.diff(JOINTS, axis=0)).tolist()
    armature = np.eye(4)
    armature[:3, :3] = unit * turned
    nodes = [
        {"name": "Armature", "children": [1, 4], "matrix": armature.T.reshape(-1).tolist()},
        {"name": "Hips", "children": [2], "translation": into(JOINTS[0]).tolist()},
        {"name": "Spine", "children": [3], "translation": bones[0]},
        {"name": "Head", "translation": bones[1]},
        {"name": "Body", "mesh": 0, "skin": 0},
    ]
    built = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": [{"name": "Surface", "primitives": [{"attributes": attributes, "indices": faces}]}],
        "skins": [{"joints": [1 + k for k in order], "inverseBindMatrices": matrices}],
        "animations": [{"name": "nod", "channels": channels, "samplers": samplers}],
        "accessors": parts.accessors,
        "bufferViews": parts.views,
        "buffers": [{"byteLength": len(parts.data)}],
    }
    return built, parts.data


def write_glb(path: Path, built: dict[str, Any], data: bytes) -> Path:
    """Write a GLB, chunk by chunk."""
    text = json.dumps(built).encode()
    text += b" " * (-len(text) % 4)
    chunks = (
        struct.pack("<2I", len(text), 0x4E4F534A) + text + struct.pack("<2I", len(data), 0x004E4942) + data
    )
    path.write_bytes(struct.pack("<3I", 0x46546C67, 2, 12 + len(chunks)) + chunks)
    return path


def write_gltf(path: Path, built: dict[str, Any], data: bytes, uri: str | None = None) -> Path:
    """Write a .gltf whose buffer is a data URI, or the address `uri`."""
    coded = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    built["buffers"][0]["uri"] = coded if uri is None else uri
    path.write_text(json.dumps(built))
    return path
