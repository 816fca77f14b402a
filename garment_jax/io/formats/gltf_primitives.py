"""The primitives of glTF's meshes: points, triangles, and which joints move them."""

from typing import Any, NamedTuple

import numpy as np

from garment_jax.io.formats.gltf_accessors import read_accessor
from garment_jax.io.formats.gltf_container import GltfFile, element

_MOST_ANNOUNCED = 2**22  # elements that an accessor may have without bytes of its own
_MOST_SETS = 8  # of four joints each that may move a vertex
_TRIANGLES, _STRIP, _FAN = _SURFACES = 4, 5, 6


class Primitive(NamedTuple):
    """One primitive in its mesh's own space."""

    points: np.ndarray  # [v, 3] float64
    triangles: np.ndarray  # [f, 3] int64
    index: np.ndarray  # [v, k] int64 places in the skin's list of joints; k = 0 where there is no skin
    weights: np.ndarray  # [v, k] float64, rows sum to 1


def has_surface(file: GltfFile, mesh: int) -> bool:
    """Return whether a mesh has a primitive that is a surface; raises as `primitives_of` for no list."""
    return any(part.get("mode", _TRIANGLES) in _SURFACES for part in _listed(file, mesh))


def primitives_of(file: GltfFile, mesh: int) -> list[dict[str, Any]]:
    """Return the primitives of a mesh that are surfaces: points and lines are not.

    Raises `ValueError` for a list that is none and for a mesh that has no surface at all.
    """
    found = _listed(file, mesh)
    if found and not has_surface(file, mesh):
        raise ValueError(f"{file.path}: mesh {mesh} is not made of triangles; export it triangulated.")
    return [part for part in found if part.get("mode", _TRIANGLES) in _SURFACES]


def _listed(file: GltfFile, mesh: int) -> list[dict[str, Any]]:
    found = element(file, "meshes", mesh).get("primitives", [])
    if not isinstance(found, list) or not all(isinstance(part, dict) for part in found):
        raise ValueError(f"{file.path}: mesh {mesh} has no list of primitives; export it again.")
    return found


def size_of(file: GltfFile, primitive: dict[str, Any]) -> tuple[int, int]:
    """Return the vertices and the corners that a primitive announces, before they are read.

    0 for what no file could hold: reading it says so.
    """
    given = primitive.get("attributes", {})
    named = [given.get("POSITION") if isinstance(given, dict) else None, primitive.get("indices")]
    most = _MOST_ANNOUNCED + sum(map(len, file.buffers))
    counts = [None if k is None else element(file, "accessors", k).get("count") for k in named]
    points, corners = (n if type(n) is int and 0 <= n <= most else 0 for n in counts)
    return points, corners or points


def read_primitive(file: GltfFile, primitive: dict[str, Any], joints: int, where: str) -> Primitive:
    """Return a primitive that is skinned to a list of `joints` joints, or to none where that is 0.

    Raises `ValueError` for attributes that are missing or do not fit one another.
    """
    given = primitive.get("attributes", {})
    needed = {"POSITION", "JOINTS_0", "WEIGHTS_0"} if joints else {"POSITION"}
    if not isinstance(given, dict) or not needed <= set(given):
        raise ValueError(
            f"{where} lacks positions or skin weights; skin it to the armature, or leave it out."
        )
    points = read_accessor(file, given["POSITION"], "VEC3").astype(np.float64)
    if not joints:
        none = np.zeros((len(points), 0))
        return Primitive(points, _triangles(file, primitive, len(points), where), none.astype(np.int64), none)
    sets = [k for k in range(len(given)) if f"JOINTS_{k}" in given]
    if len(sets) > _MOST_SETS:
        raise ValueError(
            f"{where} has over {4 * _MOST_SETS} joints a vertex; limit them and export it again."
        )
    index = [read_accessor(file, given[f"JOINTS_{k}"], "VEC4") for k in sets]
    weights = [_weights(file, given.get(f"WEIGHTS_{k}")) for k in sets]
    if any(len(part) != len(points) for part in index + weights):
        raise ValueError(f"{where}: positions, joints and weights differ in number; export it again.")
    if any(part.dtype.kind != "u" for part in index):
        raise ValueError(f"{where}: its joints are no whole numbers; export it again.")
    hung = _hung(np.concatenate(index, axis=1), np.concatenate(weights, axis=1), joints, where)
    return Primitive(points, _triangles(file, primitive, len(points), where), *hung)


def _weights(file: GltfFile, index: Any) -> np.ndarray:
    values = read_accessor(file, index, "VEC4")
    return values.astype(np.float64) / (np.iinfo(values.dtype).max if values.dtype.kind == "u" else 1)


def _hung(index: np.ndarray, weights: np.ndarray, joints: int, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return joints and weights `[v, k]`: weights sum to 1, unused pairs are 0."""
    total = weights.sum(axis=1, keepdims=True)
    if (weights < -1e-6).any() or (total < 1e-6).any():
        bad = int(np.argmin(np.minimum(weights.min(axis=1), total[:, 0])))
        raise ValueError(f"{where}: vertex {bad} has no skin weight; weight all vertices and export again.")
    used = weights > 0
    if (index[used] >= joints).any():
        raise ValueError(
            f"{where}: a vertex hangs on joint {int(index[used].max())} of {joints}; export it again."
        )
    return np.where(used, index, 0).astype(np.int64), np.where(used, weights / total, 0.0)


def _triangles(file: GltfFile, primitive: dict[str, Any], count: int, where: str) -> np.ndarray:
    """Return the triangles `[f, 3]` int64 of a list, a strip or a fan."""
    if "indices" in primitive:
        corners = read_accessor(file, primitive["indices"], "SCALAR")[:, 0]
    else:
        corners = np.arange(count, dtype=np.uint32)
    mode = primitive.get("mode", _TRIANGLES)
    if corners.dtype.kind != "u" or (mode == _TRIANGLES and len(corners) % 3):
        raise ValueError(f"{where}: its {len(corners)} corners make no triangles; export it again.")
    if len(corners) and int(corners.max()) >= count:
        raise ValueError(
            f"{where} holds index {int(corners.max())}, outside its {count} vertices; export it again."
        )
    corners = corners.astype(np.int64)
    if mode == _TRIANGLES:
        return corners.reshape(-1, 3)
    k = np.arange(max(len(corners) - 2, 0))
    if mode == _FAN:
        return np.stack(
            [corners[k + 1], corners[k + 2], np.full(len(k), corners[0] if len(k) else 0)], axis=1
        )
    odd = k % 2  # each second triangle of a strip is turned round
    return np.stack([corners[k], corners[k + 1 + odd], corners[k + 2 - odd]], axis=1)
