"""The surface of a skinned glTF body: its primitives joined, and welded where exporters split it."""

from typing import Any, NamedTuple

import numpy as np

from garment_jax.formats.gltf_accessors import read_accessor
from garment_jax.formats.gltf_container import GltfFile, element
from garment_jax.formats.gltf_rig import Skeleton

_MOST_VERTICES = 2**21  # of all primitives together: many may name one accessor
_MOST_WEIGHTS = 2**26  # vertices x joints, 256 MB


class SkinnedMesh(NamedTuple):
    """A surface in the bind pose, metres, Y up."""

    vertices: np.ndarray  # [b, 3] float32
    faces: np.ndarray  # [f, 3] int32
    weights: np.ndarray  # [b, j] float32, rows sum to 1


def read_skinned_mesh(file: GltfFile, skeleton: Skeleton) -> SkinnedMesh:
    """Return all skinned primitives of a skeleton as one surface.

    Exporters give a vertex several times where its UV or normal changes: vertices of the same place and
    weights become one, in order of first appearance, and triangles that collapse are dropped. Morph targets
    are read over. Raises `ValueError` for primitives that are no triangles, indices out of range and
    vertices without weight.
    """
    points, faces, pairs, total, corners = [], [], [], 0, 0
    place = {node: joint for joint, node in enumerate(skeleton.joints)}
    for mesh, skin in skeleton.meshes:
        joints = np.array([place[node] for node in skeleton.skins[skin].joints])
        A = skeleton.skins[skin].placement
        for primitive in _primitives(file, mesh):
            v, triangles, pair = _read_primitive(file, primitive, joints, f"{file.path}: mesh {mesh}")
            points.append(v @ A[:3, :3].T + A[:3, 3])
            faces.append(triangles + total)
            pairs.append(pair)
            total += len(v)
            corners += triangles.size
            if max(total, corners // 8) > _MOST_VERTICES:
                raise ValueError(f"{file.path} has over {_MOST_VERTICES} vertices; export a coarser body.")
    if not faces or not sum(map(len, faces)):
        raise ValueError(f"{file.path}: its skinned mesh holds no triangles; export the body again.")
    return _weld(file, np.concatenate(points), np.concatenate(faces), _widened(pairs), len(skeleton.joints))


def _primitives(file: GltfFile, mesh: int) -> list[dict[str, Any]]:
    found = element(file, "meshes", mesh).get("primitives", [])
    if not isinstance(found, list) or not all(isinstance(part, dict) for part in found):
        raise ValueError(f"{file.path}: mesh {mesh} has no list of primitives; export it again.")
    return found


def _read_primitive(
    file: GltfFile, primitive: dict[str, Any], joints: np.ndarray, where: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points `[v, 3]`, triangles `[f, 3]` and (joint, weight) pairs `[v, k, 2]`, sorted by joint."""
    if primitive.get("mode", 4) != 4:
        raise ValueError(f"{where} is not made of triangles; export it triangulated.")
    given = primitive.get("attributes", {})
    if not isinstance(given, dict) or not {"POSITION", "JOINTS_0", "WEIGHTS_0"} <= set(given):
        raise ValueError(
            f"{where} lacks positions or skin weights; skin it to the armature, or leave it out."
        )
    points = read_accessor(file, given["POSITION"], "VEC3").astype(np.float64)
    sets = [k for k in range(len(given)) if f"JOINTS_{k}" in given]
    index = [read_accessor(file, given[f"JOINTS_{k}"], "VEC4") for k in sets]
    weights = [_weights(file, given.get(f"WEIGHTS_{k}")) for k in sets]
    if any(len(part) != len(points) or index[0].dtype.kind != "u" for part in index + weights):
        raise ValueError(f"{where}: positions, joints and weights differ in number; export it again.")
    pairs = _pairs(np.concatenate(index, axis=1), np.concatenate(weights, axis=1), joints, where)
    return points, _triangles(file, primitive, len(points), where), pairs


def _weights(file: GltfFile, index: Any) -> np.ndarray:
    values = read_accessor(file, index, "VEC4")
    return values.astype(np.float64) / (np.iinfo(values.dtype).max if values.dtype.kind == "u" else 1)


def _pairs(index: np.ndarray, weights: np.ndarray, joints: np.ndarray, where: str) -> np.ndarray:
    """Return (joint of the skeleton, weight) `[v, k, 2]` by joint; weights sum to 1, unused pairs are 0."""
    total = weights.sum(axis=1, keepdims=True)
    if (weights < -1e-6).any() or (total < 1e-6).any():
        bad = int(np.argmin(np.minimum(weights.min(axis=1), total[:, 0])))
        raise ValueError(f"{where}: vertex {bad} has no skin weight; weight all vertices and export again.")
    used = weights > 0
    if (index[used] >= len(joints)).any():
        raise ValueError(
            f"{where}: a vertex hangs on joint {int(index[used].max())} of {len(joints)}; export it again."
        )
    share = np.where(used, weights / total, 0.0)
    ours = np.where(used, joints[np.where(used, index, 0)], 0)
    order = np.argsort(np.where(used, ours, np.iinfo(np.int64).max), axis=1, kind="stable")
    return np.stack([np.take_along_axis(part, order, axis=1) for part in (ours, share)], axis=2)


def _triangles(file: GltfFile, primitive: dict[str, Any], count: int, where: str) -> np.ndarray:
    if "indices" in primitive:
        corners = read_accessor(file, primitive["indices"], "SCALAR")[:, 0]
    else:
        corners = np.arange(count, dtype=np.uint32)
    if len(corners) % 3 or corners.dtype.kind != "u":
        raise ValueError(f"{where}: its {len(corners)} corners make no triangles; export it again.")
    if len(corners) and int(corners.max()) >= count:
        raise ValueError(
            f"{where} holds index {int(corners.max())}, outside its {count} vertices; export it again."
        )
    return corners.astype(np.int64).reshape(-1, 3)


def _widened(pairs: list[np.ndarray]) -> np.ndarray:
    width = max(part.shape[1] for part in pairs)
    return np.concatenate([np.pad(p, ((0, 0), (0, width - p.shape[1]), (0, 0))) for p in pairs])


def _weld(
    file: GltfFile, points: np.ndarray, faces: np.ndarray, pairs: np.ndarray, joints: int
) -> SkinnedMesh:
    """Return the surface with vertices of equal place and weights joined; only used ones are kept."""
    used = np.zeros(len(points), bool)
    used[faces] = True
    rows = np.concatenate([points, pairs.reshape(len(pairs), -1)], axis=1).astype(np.float32) + 0.0
    rows = rows[used].view(np.dtype((np.void, rows.shape[1] * 4)))[:, 0]
    _, first, group = np.unique(rows, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    place = np.full(len(points), -1)
    place[used] = rank[group]
    keep = np.flatnonzero(used)[np.sort(first)]
    if len(keep) * joints > _MOST_WEIGHTS:
        raise ValueError(
            f"{file.path}: {len(keep)} vertices on {joints} joints are too many; export a coarser body."
        )
    weights = np.zeros((len(keep), joints), np.float32)
    np.add.at(weights, (np.arange(len(keep))[:, None], pairs[keep, :, 0].astype(int)), pairs[keep, :, 1])
    corners = place[faces].astype(np.int32)
    whole = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    return SkinnedMesh(points[keep].astype(np.float32), corners[whole], weights)
