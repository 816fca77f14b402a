"""Broken and malicious pickles and archives, each a function that spoils a file of a good folder."""

import io
import os
import pickle
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

Spoil = Callable[[Path], object]
CLIP = "skirt/simulations/walk.pkl"


class Runs:
    """An object whose unpickling would run a command that leaves a file behind."""

    def __reduce__(self) -> tuple:
        return os.system, ("touch executed",)


def vto(**changes) -> Spoil:
    """Change the dict of the vto clip; None takes a key away, a function changes its value."""

    def spoil(folder: Path) -> None:
        path = folder / CLIP
        clip = pickle.loads(path.read_bytes())  # the test's own file
        for key, change in changes.items():
            clip[key] = change(clip[key]) if callable(change) else change
        path.write_bytes(pickle.dumps({key: value for key, value in clip.items() if value is not None}))

    return spoil


def bytes_of(name: str, data: bytes) -> Spoil:
    """Replace a file's content."""

    def spoil(folder: Path) -> None:
        (folder / name).write_bytes(data)

    return spoil


def cut(name: str, part: float = 0.5) -> Spoil:
    """Keep the first part of a file."""

    def spoil(folder: Path) -> None:
        path = folder / name
        path.write_bytes(path.read_bytes()[: int(path.stat().st_size * part)])

    return spoil


def npz(name: str, **changes) -> Spoil:
    """Change the arrays of an archive as `vto` does the clip's."""

    def spoil(folder: Path) -> None:
        with np.load(folder / name) as file:
            arrays = dict(file)
        for key, change in changes.items():
            arrays[key] = change(arrays[key]) if callable(change) else change
        np.savez(folder / name, **{key: value for key, value in arrays.items() if value is not None})

    return spoil


def member(name: str, inside: str, data: bytes, *, packed: bool = True) -> Spoil:
    """Replace or add one member of an archive."""

    def spoil(folder: Path) -> None:
        path = folder / name
        with zipfile.ZipFile(path) as archive:
            kept = {other: archive.read(other) for other in archive.namelist() if other != inside}
        way = zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED
        with zipfile.ZipFile(path, "w", way) as archive:
            for other, content in (kept | {inside: data}).items():
                archive.writestr(other, content)

    return spoil


def bomb(name: str, inside: str, shape: tuple[int, ...]) -> Spoil:
    """Put an array of zeros that unpacks to far more than the file has into an archive, in pieces."""

    def spoil(folder: Path) -> None:
        path = folder / name
        with zipfile.ZipFile(path) as archive:
            kept = {other: archive.read(other) for other in archive.namelist() if other != inside}
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for other, content in kept.items():
                archive.writestr(other, content)
            with archive.open(inside, "w", force_zip64=True) as file:
                file.write(array_header(shape))
                left, block = 8 * int(np.prod(shape)), bytes(2**20)
                while left > 0:
                    file.write(block[: min(left, len(block))])
                    left -= len(block)

    return spoil


def array_header(shape: tuple[int, ...]) -> bytes:
    """Return the header of a float64 array that claims `shape`."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return header.getvalue()


def objects() -> bytes:
    """Return an array of pickled objects as a member's bytes."""
    data = io.BytesIO()
    np.save(data, np.array([Runs()], object), allow_pickle=True)
    return data.getvalue()


DEEP = b"\x80\x04" + b"]" * 100_000 + b"a" * 99_999 + b"."  # lists in lists
DOUBLED = (
    b"\x80\x04]q\x00" + b"".join(b"0(" + b"h\x00" * 10 + b"lq\x00" for _ in range(40)) + b"."
)  # 10^40 items
LONG_BYTES = b"\x80\x04}\x8c\x08vertices\x8e" + struct.pack("<Q", 2**40) + b"short" + b"s."

PICKLES: dict[str, tuple[Spoil, str]] = {
    "runs a command": (bytes_of(CLIP, pickle.dumps({"vertices": Runs()})), "walk.pkl"),
    "calls eval by name": (bytes_of(CLIP, b"c__builtin__\neval\n(S'vertices'\ntR."), "walk.pkl"),
    "calls through an attribute": (
        bytes_of(CLIP, b"\x80\x04\x8c\x02os\x8c\x06system\x93\x8c\x08vertices\x85R."),
        "walk.pkl",
    ),
    "makes an instance": (bytes_of(CLIP, b"(S'vertices'\nisubprocess\nPopen\n."), "walk.pkl"),
    "points outside the file": (bytes_of(CLIP, b"\x80\x04}\x8c\x08verticesBQ\x00s."), "walk.pkl"),
    "an extension code": (bytes_of(CLIP, b"\x80\x02}U\x08vertices\x82\x01s."), "walk.pkl"),
    "cut off": (cut(CLIP), "walk.pkl"),
    "text": (bytes_of(CLIP, b"vertices: none\n"), "walk.pkl"),
    "empty": (bytes_of(CLIP, b""), "walk.pkl"),
    "announces 1 TB": (bytes_of(CLIP, LONG_BYTES), "walk.pkl"),
    "lists in lists": (bytes_of(CLIP, DEEP), "walk.pkl"),
    "a list that doubles": (bytes_of(CLIP, DOUBLED), "walk.pkl"),
    "objects in the garment": (vto(vertices=np.array([None] * 4, object)), "walk.pkl"),
    "a frame too few": (vto(vertices=lambda V: V[:-1]), "walk.pkl"),
    "another garment's vertices": (vto(vertices=lambda V: V[:, :-3]), "walk.pkl"),
    "vertices in another order": (
        vto(vertices=lambda V: V[:, np.random.default_rng(0).permutation(V.shape[1])]),
        "walk.pkl",
    ),
    "faces out of range": (vto(faces=lambda f: f + 5_000), "walk.pkl"),
    "NaN in a frame": (
        vto(vertices=lambda V: np.where(np.arange(V.size).reshape(V.shape) == 400, np.nan, V)),
        "walk.pkl",
    ),
    "an infinite pose": (
        vto(pose=lambda p: np.where(np.arange(p.size).reshape(p.shape) == 99, np.inf, p)),
        "walk.pkl",
    ),
    "a pose of 71 values": (vto(pose=lambda p: p[:, :71]), "walk.pkl"),
    "centimetres": (vto(vertices=lambda V: V * 100), "walk.pkl"),
    "a body that runs a command": (bytes_of("smpl.pkl", pickle.dumps({"v_template": Runs()})), "smpl.pkl"),
    "half a body": (cut("smpl.pkl"), "smpl.pkl"),
}
FLAT = array_header((2_000_000_000, 3))  # claims 48 GB, holds nothing
ARCHIVES: dict[str, tuple[Spoil, str]] = {
    "AMASS zip bomb": (bomb("amass.npz", "poses.npy", (500_000, 156)), "amass.npz"),
    "AMASS claims 48 GB": (member("amass.npz", "poses.npy", FLAT), "amass.npz"),
    "AMASS with a negative shape": (member("amass.npz", "trans.npy", array_header((-5, 3))), "amass.npz"),
    "AMASS with objects": (member("amass.npz", "poses.npy", objects()), "amass.npz"),
    "AMASS that climbs out": (member("amass.npz", "../../poses.npy", array_header((0, 3))), "amass.npz"),
    "AMASS with an absolute name": (member("amass.npz", "/etc/poses.npy", array_header((0, 3))), "amass.npz"),
    "AMASS cut off": (cut("amass.npz"), "amass.npz"),
    "AMASS of another sort": (bytes_of("amass.npz", b"PK\x03\x04 no archive"), "amass.npz"),
    "AMASS without a frame rate": (npz("amass.npz", mocap_framerate=None), "amass.npz"),
    "AMASS with NaN": (npz("amass.npz", poses=lambda p: p * np.nan), "amass.npz"),
    "AMASS without frames": (npz("amass.npz", poses=lambda p: p[:0], trans=lambda x: x[:0]), "amass.npz"),
    "AMASS with other frames": (npz("amass.npz", trans=lambda x: x[:-2]), "amass.npz"),
    "AMASS of 70 values": (npz("amass.npz", poses=lambda p: p[:, :70]), "amass.npz"),
    "AMASS of text": (npz("amass.npz", poses=np.array([["a"] * 156] * 6)), "amass.npz"),
}
AIST: dict[str, tuple[Spoil, str]] = {
    "AIST++ that runs a command": (bytes_of("aist.pkl", pickle.dumps({"smpl_poses": Runs()})), "aist.pkl"),
    "AIST++ with a scale of 0": (
        bytes_of(
            "aist.pkl",
            pickle.dumps(
                {"smpl_poses": np.zeros((6, 72)), "smpl_trans": np.ones((6, 3)), "smpl_scaling": np.zeros(1)}
            ),
        ),
        "aist.pkl",
    ),
    "AIST++ without a translation": (
        bytes_of("aist.pkl", pickle.dumps({"smpl_poses": np.zeros((6, 72))})),
        "aist.pkl",
    ),
}
VIRTUAL_BONES: dict[str, tuple[Spoil, str]] = {
    "VirtualBones bomb": (bomb("dress02/1.npz", "sim_res.npy", (25_000, 1_000, 3)), "1.npz"),
    "VirtualBones of another dress": (npz("dress02/1.npz", sim_res=lambda V: V[:, :-1]), "1.npz"),
    "VirtualBones with a frame too few": (npz("dress02/1.npz", sim_res=lambda V: V[:-1]), "1.npz"),
    "VirtualBones with NaN": (npz("dress02/1.npz", sim_res=lambda V: V * np.nan), "1.npz"),
}
BODIES: dict[str, tuple[Spoil, str]] = {
    "body zip bomb": (bomb("me.npz", "vertices.npy", (30_000_000, 3)), "me.npz"),
    "body claims 48 GB": (member("me.npz", "vertices.npy", FLAT), "me.npz"),
    "body with joints in a circle": (npz("me.npz", parents=lambda p: np.roll(p, 1)), "me.npz"),
    "body with weights of 2": (npz("me.npz", skin_weights=lambda w: w * 2), "me.npz"),
    "body with objects": (member("me.npz", "joints.npy", objects()), "me.npz"),
}
