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
from garment_jax.io.attributes import check_units
from garment_jax.io.hdf5 import attributes_of, dataset, has, read_all, read_window
from garment_jax.io.layout import GARMENT, MOTION, Field, bind_shape, cast
from garment_jax.io.npz import load_body, load_collider, load_pin_file
from garment_jax.structs import Garment, Motion, Scene

_DELTA = Field("vertices_delta", "i2", ("t", "n", 3))
_FIELDS = {field.name: field for field in (*MOTION, *GARMENT)}
_NEEDED = (_DELTA.name, *_FIELDS)
_INDICES = {name: Field(name, "i4", ("c",)) for name in ("collider_body_vertices", "pins")}
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
        stop = min(start + window, len(delta))
        stored = isinstance(delta, h5py.Dataset)
        rows = read_window(delta, start, stop, Path(delta.file.filename)) if stored else delta[start:stop]
        rows = np.cumsum(rows, axis=1, dtype=np.int32)
        steps = np.cumsum(rows, axis=0, dtype=np.int32) + last
        last = steps[-1]
        yield steps


def check_packed(file: h5py.File, where: str) -> dict:
    """Return a packed clip's attributes, or raise ValueError if it is none or in an unread unit."""
    if has(file, "vertices", where) and not has(file, "vertices_delta", where):
        raise ValueError(f"{where} is a sequence file already; use it as it is.")
    missing = [name for name in _NEEDED if not has(file, name, where)]
    if missing:
        raise ValueError(
            f"{where}: dataset `{missing[0]}` is missing; a packed clip needs {', '.join(_NEEDED)}."
        )
    _check_delta(file, where)
    attributes = attributes_of(file, where)
    check_units(attributes, where)
    return attributes


def _check_delta(file: h5py.File, where: str) -> None:
    """Raise ValueError unless the steps are whole, have a scale, and as many as root and template say."""
    sizes: dict[str, int] = {}
    data = {name: dataset(file, name, where) for name in ("root", "template", _DELTA.name)}
    for name, found in data.items():
        bind_shape(_FIELDS.get(name, _DELTA), found.shape, sizes, {"t": "root", "n": "template"}, where)
    delta = data[_DELTA.name]
    if delta.dtype.kind not in "iu":
        raise ValueError(f"{where}: `{_DELTA.name}` has type {delta.dtype}; store int16.")
    scale = attributes_of(delta, where).get("scale")
    if not isinstance(scale, float) or not 0 < scale < 1:
        raise ValueError(f"{where}: attribute scale of `{_DELTA.name}` is {scale!r}; give metres per step.")


def read_motion(file: h5py.File, fps: float, where: str) -> Motion:
    """Return a packed clip's motion; OSError where the file is damaged, ValueError for what does not fit."""
    rotations, root = (_read(file, field, where) for field in MOTION)
    return Motion(rotations, root, fps)


def _read(file: h5py.File, field: Field, where: str) -> np.ndarray:
    return cast(field, read_all(dataset(file, field.name, where), where), where)


def find_assets(file: h5py.File, source: Path, attributes: dict, body: str | Path | None) -> Assets:
    """Return the files that belong to a clip, or raise FileNotFoundError with the place to put them.

    Raises ValueError for a body outside that folder.

    `body` overrides the clip's own `body` attribute, which is followed from the folder above the clip's.
    The body's `collider.npz` is beside it, `pins.npz` beside the clip; both only if the clip had them.
    """
    named = Path(str(attributes.get("body", "avatar/avatar.npz")))
    if body is None and (
        named.is_absolute() or ".." in named.parts
    ):  # a stranger's clip names no other's file
        raise ValueError(f"{source} names its body {str(named)!r}, elsewhere; name it with --body FILE.npz.")
    path = Path(body) if body is not None else source.parent.parent / named
    if not path.is_file():
        raise FileNotFoundError(f"{source}: its body {path} is not there; name it with --body FILE.npz.")
    collider = _beside(path.parent / "collider.npz", has(file, "collider_body_vertices", str(source)), source)
    pins = _beside(source.parent / "pins.npz", has(file, "pins", str(source)), source)
    return Assets(path, collider, pins)


def _beside(path: Path, wanted: bool, source: Path) -> Path | None:
    if wanted and not path.is_file():
        raise FileNotFoundError(f"{source} was simulated with a {path.stem} file; put it at {path}.")
    return path if wanted else None


def read_scene(file: h5py.File, assets: Assets, where: str) -> Scene:
    """Return garment, body, collider and pins of a packed clip; the indices in clip and files must agree."""
    garment = Garment(*(_read(file, field, where) for field in GARMENT))
    body = load_body(assets.body)
    collider = pins = None
    if assets.collider is not None:
        collider = load_collider(assets.collider)
        named = _read(file, _INDICES["collider_body_vertices"], where)
        _check_equal(collider.body_vertices, named, assets.collider, where)
    if assets.pins is not None:
        pins = load_pin_file(assets.pins)
        _check_equal(pins.vertices, _read(file, _INDICES["pins"], where), assets.pins, where)
    return Scene(garment, body, collider, pins)


def _check_equal(indices: np.ndarray, named: np.ndarray, path: Path, where: str) -> None:
    if not np.array_equal(indices, named):
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
