"""Broken and malicious meshes, mesh caches, motions and rigs, as `broken_archives` has archives."""

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.importers.broken_archives import Spoil, bytes_of
from tests.importers.glb_files import glb_parts, pack_glb
from tests.importers.good_files import MOTION, SCENE, V, ply, write_mdd, write_pc2, write_usd
from tests.reference.files import write_obj


def pc2(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Write the PC2 file of changed frames."""
    return lambda folder: write_pc2(folder / "walk.pc2", change(V.copy()))


def mdd(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Write the MDD file of changed frames."""
    return lambda folder: write_mdd(folder / "walk.mdd", change(V.copy()))


def glb(change: Callable[[dict], object]) -> Spoil:
    """Change the JSON of the rigged body."""

    def spoil(folder: Path) -> None:
        content, data = glb_parts(SCENE.body, MOTION)
        change(content)
        (folder / "me.glb").write_bytes(pack_glb(content, data))

    return spoil


def text(name: str, old: str, new: str) -> Spoil:
    """Replace the first place of a text in a file."""

    def spoil(folder: Path) -> None:
        content = (folder / name).read_text()
        assert old in content
        (folder / name).write_text(content.replace(old, new, 1))

    return spoil


def usd(change: Callable[[str], str]) -> Spoil:
    """Write the stage with its text changed."""

    def spoil(folder: Path) -> None:
        path = write_usd(folder / "walk.usda", V)
        path.write_text(change(path.read_text()))

    return spoil


def nan(frames: np.ndarray) -> np.ndarray:
    frames[3, 7, 1] = np.nan
    return frames


def nested_bvh(depth: int) -> bytes:
    """Return a hierarchy deeper than Python's stack."""
    joint = "{\nOFFSET 0 1 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
    return (
        "HIERARCHY\nROOT a\n"
        + joint
        + "".join(f"JOINT b{k}\n{joint}" for k in range(depth))
        + "}\n" * (depth + 1)
        + "MOTION\nFrames: 1\nFrame Time: 0.03\n0 0 0"
    ).encode()


INCHES = SCENE.garment._replace(template=SCENE.garment.template / np.float32(0.0254))
SHUFFLE = np.random.default_rng(0).permutation(V.shape[1])
CACHES: dict[str, tuple[Spoil, str]] = {
    "PC2 that is text": (bytes_of("walk.pc2", b"hello"), "walk.pc2"),
    "PC2 with 2^31 points": (
        bytes_of("walk.pc2", struct.pack("<12siiffi", b"POINTCACHE2\0", 1, 2**31 - 1, 0.0, 1.0, 2**31 - 1)),
        "walk.pc2",
    ),
    "PC2 with -1 frames": (
        bytes_of("walk.pc2", struct.pack("<12siiffi", b"POINTCACHE2\0", 1, 128, 0.0, 1.0, -1)),
        "walk.pc2",
    ),
    "PC2 of another garment": (pc2(lambda frames: frames[:, :-1]), "walk.pc2"),
    "PC2 in another vertex order": (pc2(lambda frames: frames[:, SHUFFLE]), "walk.pc2"),
    "PC2 with NaN": (pc2(nan), "walk.pc2"),
    "PC2 longer than its motion": (pc2(lambda frames: np.concatenate([frames, frames])), "walk.pc2"),
    "PC2 in centimetres": (pc2(lambda frames: frames * 100), "walk.pc2"),
    "PC2 lying down": (pc2(lambda frames: frames[..., [0, 2, 1]] * 1), "walk.pc2"),
    "MDD with 2^31 frames": (bytes_of("walk.mdd", struct.pack(">ii", 2**31 - 1, 2**31 - 1)), "walk.mdd"),
    "MDD cut off": (
        lambda folder: (folder / "walk.mdd").write_bytes((folder / "walk.mdd").read_bytes()[:-9]),
        "walk.mdd",
    ),
    "MDD with infinity": (mdd(lambda frames: np.where(frames == frames.max(), np.inf, frames)), "walk.mdd"),
    "OBJ frame without a vertex": (text("walk/walk_4.obj", "v ", "# "), "walk_4.obj"),
    "OBJ frame with other faces": (
        text("walk/walk_4.obj", "f 1/1 17/18 2/2", "f 1/1 2/2 17/18"),
        "walk_4.obj",
    ),
    "OBJ frame with words": (text("walk/walk_4.obj", "v ", "v one "), "walk_4.obj"),
    "OBJ frame with 1e400": (text("walk/walk_1.obj", "v ", "v 1e400 0 0\nv "), "walk_1.obj"),
    "PLY with 4e9 vertices": (
        bytes_of(
            "walk.ply/0.ply", ply(V[0], SCENE.garment.faces).replace(b"vertex 128", b"vertex 4000000000")
        ),
        "0.ply",
    ),
    "PLY cut off": (bytes_of("walk.ply/1.ply", ply(V[0], SCENE.garment.faces)[:-40]), "1.ply"),
    "USD that is text": (bytes_of("walk.usda", b"hello"), "walk.usda"),
    "USD cut off": (usd(lambda stage: stage[: len(stage) // 2]), "walk.usda"),
    "USD without a mesh": (usd(lambda stage: stage.replace("def Mesh", "def Xform")), "walk.usda"),
    "USD with faces out of range": (usd(lambda stage: stage.replace("[0, ", "[999999, ", 1)), "walk.usda"),
}
GARMENTS: dict[str, tuple[Spoil, str]] = {
    "garment without faces": (bytes_of("skirt.obj", b"v 0 0 0\nvt 0 0\n"), "skirt.obj"),
    "garment with vertex 0": (text("skirt.obj", "f 1/1", "f 0/1"), "skirt.obj"),
    "garment with vertex 10^18": (text("skirt.obj", "f 1/1", f"f {10**18}/1"), "skirt.obj"),
    "garment with NaN": (text("skirt.obj", "v ", "v nan 0 0\nv "), "skirt.obj"),
    "garment in inches": (
        lambda folder: write_obj(folder / "skirt.obj", INCHES),
        "skirt.obj",
    ),
    "garment of bytes": (bytes_of("skirt.obj", bytes(range(256)) * 64), "skirt.obj"),
}
MOTIONS: dict[str, tuple[Spoil, str]] = {
    "BVH cut off": (
        lambda folder: (folder / "walk.bvh").write_text((folder / "walk.bvh").read_text()[:900]),
        "walk.bvh",
    ),
    "BVH that announces 10^9 frames": (text("walk.bvh", "Frames: 6", "Frames: 999999999"), "walk.bvh"),
    "BVH with a frame time of 0": (text("walk.bvh", "Frame Time: 0.033333", "Frame Time: 0"), "walk.bvh"),
    "BVH with NaN": (
        lambda folder: (folder / "walk.bvh").write_text((folder / "walk.bvh").read_text()[:-9] + " nan nan"),
        "walk.bvh",
    ),
    "BVH 5,000 joints deep": (bytes_of("walk.bvh", nested_bvh(5_000)), "walk.bvh"),
}
RIGS: dict[str, tuple[Spoil, str]] = {
    "GLB cut off": (
        lambda folder: (folder / "me.glb").write_bytes((folder / "me.glb").read_bytes()[:-999]),
        "me.glb",
    ),
    "GLB with a chunk of 4 GB": (
        bytes_of("me.glb", struct.pack("<4sIII4s", b"glTF", 2, 2**32 - 1, 2**32 - 21, b"JSON") + b"{}"),
        "me.glb",
    ),
    "GLB of deep JSON": (
        bytes_of(
            "me.glb",
            struct.pack("<4sII", b"glTF", 2, 20 + 200_000)
            + struct.pack("<I4s", 200_000, b"JSON")
            + b"[" * 200_000,
        ),
        "me.glb",
    ),
    "GLB with 4e9 vertices": (glb(lambda c: c["accessors"][0].update(count=4_000_000_000)), "me.glb"),
    "GLB with a view beyond its end": (glb(lambda c: c["bufferViews"][0].update(byteOffset=10**9)), "me.glb"),
    "GLB that reads another file": (
        glb(lambda c: c["buffers"][0].update(uri="../../../../etc/passwd")),
        "me.glb",
    ),
    "GLB that reads the network": (
        glb(lambda c: c["buffers"][0].update(uri="http://localhost/x.bin")),
        "me.glb",
    ),
    "GLB without a skin": (glb(lambda c: c.pop("skins")), "me.glb"),
    "GLB with joints in a circle": (glb(lambda c: c["nodes"][5].update(children=[0])), "me.glb"),
    "GLB with joint 999": (glb(lambda c: c["skins"][0]["joints"].append(999)), "me.glb"),
    "GLB with NaN bones": (glb(lambda c: c["nodes"][3].update(translation=[float("nan"), 0, 0])), "me.glb"),
    "GLB whose nodes are numbers": (glb(lambda c: c.update(nodes=[1, 2, 3])), "me.glb"),
    "GLB that is a list": (bytes_of("me.glb", pack_glb(json.loads("[]"), b"")), "me.glb"),
}
