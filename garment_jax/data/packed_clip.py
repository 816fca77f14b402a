"""Clips packed for transport: what is in them, what they refer to, and how they are decoded.

A packed clip holds int16 double differences of its vertices (over vertices and over frames), which
compress well and read badly. Body, collider and pins are files of their own.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from garment_jax.body.kinematics import joint_positions, pose_points
from garment_jax.data.attributes import check_units
from garment_jax.data.hdf5 import dataset, plain
from garment_jax.data.npz import load_body, load_collider, load_pin_file
from garment_jax.structs import Garment, Motion, Scene

_NEEDED = ("vertices_delta", "root", "rotations", "template", "faces", "uv", "faces_uv")
_PIN_TOLERANCE = 1e-3  # metres; the shared clips agree within 0.1 mm, another body's pins miss by cm
_WINDOW = 64  # frames; the packed clips' own chunk


class Assets(NamedTuple):
    """The files that a packed clip refers to."""

    body: Path
    collider: Path | None
    pins: Path | None


def decode_steps(delta: h5py.Dataset | np.ndarray, *, window: int = _WINDOW) -> Iterator[np.ndarray]:
    """Yield the positions relative to the root, int32 `[k, n, 3]` in steps of the clip's scale.

    The sum over vertices, then over frames, in 32-bit integers; the last frame is carried from window to
    window, so that decoding is exact and a clip's length costs no memory.
    """
    last = np.zeros(delta.shape[1:], np.int32)
    for start in range(0, len(delta), window):
        rows = np.cumsum(delta[start : start + window], axis=1, dtype=np.int32)
        steps = np.cumsum(rows, axis=0, dtype=np.int32) + last
        last = steps[-1]
        yield steps


def check_packed(file: h5py.File, where: str) -> dict:
    """Return a packed clip's attributes, or raise ValueError if it is none or in an unread unit."""
    if "vertices" in file and "vertices_delta" not in file:
        raise ValueError(f"{where} is a sequence file already; use it as it is.")
    missing = [name for name in _NEEDED if name not in file]
    if missing:
        raise ValueError(
            f"{where}: dataset `{missing[0]}` is missing; a packed clip needs {', '.join(_NEEDED)}."
        )
    if "scale" not in dataset(file, "vertices_delta", where).attrs:
        raise ValueError(f"{where}: attribute scale of `vertices_delta` is missing; give metres per step.")
    attributes = {key: plain(value) for key, value in file.attrs.items()}
    check_units(attributes, where)
    return attributes


def find_assets(file: h5py.File, source: Path, attributes: dict, body: str | Path | None) -> Assets:
    """Return the files that belong to a clip, or raise FileNotFoundError with the place to put them.

    `body` overrides the clip's own `body` attribute, which is followed from the folder above the clip's.
    The body's `collider.npz` is beside it, `pins.npz` beside the clip; both only if the clip had them.
    """
    named = str(attributes.get("body", "avatar/avatar.npz"))
    path = Path(body) if body is not None else source.parent.parent / named
    if not path.is_file():
        raise FileNotFoundError(f"{source}: its body {path} is not there; name it with --body FILE.npz.")
    collider = _beside(path.parent / "collider.npz", "collider_body_vertices" in file, source)
    pins = _beside(source.parent / "pins.npz", "pins" in file, source)
    return Assets(path, collider, pins)


def _beside(path: Path, wanted: bool, source: Path) -> Path | None:
    if wanted and not path.is_file():
        raise FileNotFoundError(f"{source} was simulated with a {path.stem} file; put it at {path}.")
    return path if wanted else None


def read_scene(file: h5py.File, assets: Assets, where: str) -> Scene:
    """Return garment, body, collider and pins of a packed clip; the indices in clip and files must agree."""
    garment = Garment(*(dataset(file, name, where)[()] for name in ("template", "faces", "uv", "faces_uv")))
    body = load_body(assets.body)
    collider = pins = None
    if assets.collider is not None:
        collider = load_collider(assets.collider)
        named = dataset(file, "collider_body_vertices", where)
        _check_equal(collider.body_vertices, named, assets.collider, where)
    if assets.pins is not None:
        pins = load_pin_file(assets.pins)
        _check_equal(pins.vertices, dataset(file, "pins", where), assets.pins, where)
    return Scene(garment, body, collider, pins)


def _check_equal(indices: np.ndarray, named: h5py.Dataset, path: Path, where: str) -> None:
    if not np.array_equal(indices, named[()]):
        raise ValueError(
            f"{where} was simulated with other vertices ({len(named)}) than {path} names ({len(indices)}); "
            "use the file that belongs to the clip."
        )


def check_pins(world: np.ndarray, scene: Scene, motion: Motion, window: slice, where: str) -> None:
    """Raise ValueError where `world` `[k, n, 3]`, the frames of `window`, leaves the pins behind."""
    if scene.pins is None:
        return
    body, pins, rotations = scene.body, scene.pins, motion.rotations[window]
    positions = joint_positions(rotations, motion.root[window], body)
    points = scene.garment.template[pins.vertices]
    posed = pose_points(points, pins.weights, rotations, positions, body.joints)
    far = np.linalg.norm(posed - world[:, pins.vertices], axis=2).max(axis=1)
    if far.max() > _PIN_TOLERANCE:
        raise ValueError(
            f"{where}: in frame {window.start + int(far.argmax())} a pin is {far.max() * 1e3:.1f} mm from "
            "where the body carries it; use the body and the pins that belong to the clip."
        )
