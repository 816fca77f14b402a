"""Content hashes: which garment and which body a file or a checkpoint belongs to."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from garment_jax.io.hdf5 import attributes_of, open_hdf5
from garment_jax.structs import Garment, RiggedBody, Scene


def garment_hash(garment: Garment) -> str:
    """Return 16 hexadecimal digits of the SHA-256 of template, faces and UVs."""
    return _digest(garment._asdict().items())


def body_hash(body: RiggedBody) -> str:
    """Return 16 hexadecimal digits of the SHA-256 of mesh, skeleton and skin weights."""
    return _digest(body._asdict().items())


def scene_hash(scene: Scene) -> str:
    """Return 16 hexadecimal digits that change when the garment or the body does."""
    text = garment_hash(scene.garment) + body_hash(scene.body)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def rollout_hash(scene: Scene) -> str:
    """Return 16 hexadecimal digits that change with all that a rollout is made of: pins and collider, too."""
    parts = [scene_hash(scene)]
    parts += [
        "" if part is None else _digest(part._asdict().items()) for part in (scene.pins, scene.collider)
    ]
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()[:16]


def mesh_hash(body: RiggedBody) -> str:
    """Return 16 hexadecimal digits that bodies share whose vertices have the same numbers."""
    return _digest([("vertices", np.array(len(body.vertices))), ("faces", body.faces)])


def _digest(items: Iterable[tuple[str, object]]) -> str:
    """Hash names, shapes and values in fixed types: int64 and int32 copies of a mesh are the same mesh."""
    digest = hashlib.sha256()
    for name, value in items:
        array = np.asarray(value)
        if array.dtype.kind == "U":
            data = "\n".join(array.tolist()).encode()
        else:
            data = np.ascontiguousarray(array.astype("<f4" if array.dtype.kind == "f" else "<i4")).tobytes()
        digest.update(f"{name}{array.shape}".encode())
        digest.update(data)
    return digest.hexdigest()[:16]


def stored_hash(path: Path) -> str | None:
    """Return a sequence file's attribute `content_hash`; None where there is no file or a damaged one."""
    return stored_attribute(path, "content_hash")


def stored_attribute(path: Path, name: str) -> str | None:
    """Return a text attribute of an HDF5 file; None where it, or a whole file, is not there."""
    try:
        with open_hdf5(path) as file:
            value = attributes_of(file, str(path)).get(name)
    except (OSError, ValueError):
        return None
    return None if value is None else str(value)
