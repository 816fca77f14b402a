"""The surface of a glTF body: skinned and rigid parts joined, and welded where exporters split them."""

from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from garment_jax.io.formats.gltf_container import GltfFile
from garment_jax.io.formats.gltf_nodes import scene_matrices
from garment_jax.io.formats.gltf_parts import Part
from garment_jax.io.formats.gltf_primitives import Primitive, primitives_of, read_primitive, size_of
from garment_jax.io.formats.gltf_rig import Skeleton

_MOST_VERTICES = 2**20  # of all primitives together: many may name one accessor
_MOST_PRIMITIVES = 2**12
_MOST_WEIGHTS = 2**25  # vertices x joints, 128 MB


class SkinnedMesh(NamedTuple):
    """A surface in the bind pose, metres, Y up."""

    vertices: np.ndarray  # [b, 3] float32
    faces: np.ndarray  # [f, 3] int32
    weights: np.ndarray  # [b, j] float32, rows sum to 1


def read_surface(file: GltfFile, skeleton: Skeleton) -> SkinnedMesh:
    """Return all parts of a skeleton's body as one surface in the bind pose.

    Exporters give a vertex several times where its UV or normal changes: vertices of the same place and
    weights become one, in order of first appearance, and triangles that collapse are dropped. Morph targets
    are read over. Raises `ValueError` for primitives that do not fit, indices out of range and vertices
    without weight.
    """
    points, faces, pairs, total, corners = [], [], [], 0, 0
    each = ((part, primitive) for part in skeleton.parts for primitive in primitives_of(file, part.mesh))
    wanted = list(islice(each, _MOST_PRIMITIVES + 1))
    if len(wanted) > _MOST_PRIMITIVES:
        raise ValueError(f"{file.path}: its body has over {_MOST_PRIMITIVES} primitives; join them.")
    for part, primitive in wanted:
        announced, around = size_of(file, primitive)
        corners += around
        if max(total + announced, corners // 8) > _MOST_VERTICES:
            raise ValueError(f"{file.path} has over {_MOST_VERTICES} vertices; export a coarser body.")
        v, triangles, pair = _placed(file, skeleton, part, primitive)
        points.append(v)
        faces.append(triangles + total)
        pairs.append(pair)
        total += len(v)
    if not faces or not sum(map(len, faces)):
        raise ValueError(f"{file.path}: its skinned mesh holds no triangles; export the body again.")
    return _weld(file, np.concatenate(points), np.concatenate(faces), _widened(pairs), len(skeleton.joints))


def _placed(
    file: GltfFile, skeleton: Skeleton, part: Part, primitive: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points `[v, 3]` in the world, triangles `[f, 3]` and (joint, weight) pairs `[v, k, 2]`."""
    place = {node: joint for joint, node in enumerate(skeleton.joints)}
    where = f"{file.path}: mesh {part.mesh}"
    if part.skin is None:
        found, joint = read_primitive(file, primitive, 0, where), place[part.joint or 0]
        A = _hanging(file, skeleton, part, joint)
        pair = np.broadcast_to([float(joint), 1.0], (len(found.points), 1, 2))
        turned = found.triangles[:, ::-1] if np.linalg.det(A[:3, :3]) < 0 else found.triangles
        return found.points @ A[:3, :3].T + A[:3, 3], turned, pair
    skin = skeleton.skins[part.skin]
    found = read_primitive(file, primitive, len(skin.joints), where)
    joints = np.array([place[node] for node in skin.joints])
    return _skinned(found, skin.placements), found.triangles, _pairs(found.weights, joints[found.index])


def _hanging(file: GltfFile, skeleton: Skeleton, part: Part, joint: int) -> np.ndarray:
    """Return the matrix that puts a mesh which hangs on a joint into the bind pose."""
    above, own = scene_matrices(file, skeleton.nodes, [skeleton.joints[joint], part.node])
    if abs(np.linalg.det(above)) < 1e-12:
        raise ValueError(
            f"{file.path}: joint {skeleton.names[joint]!r} has no size in its scene; reset its scale and "
            "export it again."
        )
    return skeleton.bind[joint] @ np.linalg.inv(above) @ own


def _skinned(found: Primitive, placements: np.ndarray) -> np.ndarray:
    """Return sum_j w_j A_j v for the points `[v, 3]`."""
    if (placements == placements[:1]).all():
        return found.points @ placements[0, :3, :3].T + placements[0, :3, 3]
    points = np.zeros_like(found.points)
    for k in range(found.index.shape[1]):
        A = placements[found.index[:, k]]
        moved = (A[:, :3, :3] @ found.points[:, :, None])[..., 0] + A[:, :3, 3]
        points += found.weights[:, k, None] * moved
    return points


def _pairs(weights: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Return (joint of the skeleton, weight) `[v, k, 2]` by joint, unused pairs last and 0."""
    used = weights > 0
    order = np.argsort(np.where(used, joints, np.iinfo(np.int64).max), axis=1, kind="stable")
    ours = np.where(used, joints, 0)
    return np.stack([np.take_along_axis(part, order, axis=1) for part in (ours, weights)], axis=2)


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
