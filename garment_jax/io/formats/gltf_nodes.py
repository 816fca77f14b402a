"""The node tree of a glTF file: parents, local transforms, world transforms."""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.io.formats.gltf_container import GltfFile, whole

_MOST_NODES = 65_536
_FARTHEST = 1e9  # of a world matrix's numbers
_DEEPEST = 512  # nodes from the top to the bottom of a tree


class Nodes(NamedTuple):
    """All nodes of a file, k of them, as they stand without animation."""

    names: tuple[str, ...]
    parents: np.ndarray  # [k] int, -1 at the top
    translation: np.ndarray  # [k, 3] float64
    rotation: np.ndarray  # [k, 4] float64 unit quaternions x y z w
    scale: np.ndarray  # [k, 3] float64
    local: np.ndarray  # [k, 4, 4] float64 to the parent's space
    has_matrix: np.ndarray  # [k] bool: `local` was given as a matrix, the three above are not used

    def above(self, node: int) -> list[int]:
        """Return the nodes above one, the nearest first."""
        chain = []
        while (node := int(self.parents[node])) >= 0:
            chain.append(node)
        return chain


def read_nodes(file: GltfFile) -> Nodes:
    """Return the nodes of a file; ValueError for a tree that is none and for numbers that do not fit."""
    nodes = file.json.get("nodes", [])
    if not isinstance(nodes, list) or not all(isinstance(node, dict) for node in nodes):
        raise ValueError(f"{file.path}: `nodes` is no list of objects; export the file again.")
    if len(nodes) > _MOST_NODES:
        raise ValueError(
            f"{file.path} has {len(nodes)} nodes, more than {_MOST_NODES}; export the body alone."
        )
    names = tuple(str(node.get("name", f"node_{k}")) for k, node in enumerate(nodes))
    translation = _rows(file, nodes, "translation", (0, 0, 0))
    rotation = _rows(file, nodes, "rotation", (0, 0, 0, 1))
    scale = _rows(file, nodes, "scale", (1, 1, 1))
    length = np.linalg.norm(rotation, axis=1, keepdims=True)
    if (length < 1e-6).any():
        raise ValueError(
            f"{file.path}: node {int(length.argmin())} has a rotation of length 0; export again."
        )
    local = compose(translation, rotation / length, scale)
    has_matrix = np.array(["matrix" in node for node in nodes], bool)
    if has_matrix.any():
        columns = _rows(file, nodes, "matrix", np.eye(4).ravel().tolist()).reshape(-1, 4, 4)
        local[has_matrix] = np.swapaxes(columns, 1, 2)[has_matrix]
    return Nodes(names, _parents(file, nodes), translation, rotation / length, scale, local, has_matrix)


def compose(translation: np.ndarray, rotation: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return `[..., 4, 4]` matrices of translations `[..., 3]`, unit quaternions `[..., 4]`, scales."""
    matrix = np.zeros((*translation.shape[:-1], 4, 4))
    turn = Rotation.from_quat(rotation.reshape(-1, 4)).as_matrix().reshape(*rotation.shape[:-1], 3, 3)
    matrix[..., :3, :3] = turn * scale[..., None, :]
    matrix[..., :3, 3] = translation
    matrix[..., 3, 3] = 1.0
    return matrix


def with_ancestors(parents: np.ndarray, wanted: list[int]) -> list[int]:
    """Return the `wanted` nodes and all above them, parents before children."""
    order: list[int] = []
    seen: set[int] = set()
    for node in wanted:
        chain = []
        while node >= 0 and node not in seen:
            seen.add(node)
            chain.append(node)
            node = int(parents[node])
        order += reversed(chain)
    return order


def world_matrices(local: np.ndarray, parents: np.ndarray, order: list[int]) -> dict[int, np.ndarray]:
    """Return node -> world matrices `[..., 4, 4]` for the nodes of `order` (parents first).

    `local` `[..., len(order), 4, 4]` holds the nodes in that order.
    """
    world: dict[int, np.ndarray] = {}
    for place, node in enumerate(order):
        mine, parent = local[..., place, :, :], int(parents[node])
        world[node] = mine if parent < 0 else world[parent] @ mine
    return world


def scene_matrices(file: GltfFile, nodes: Nodes, wanted: list[int]) -> np.ndarray:
    """Return the world matrices `[len(wanted), 4, 4]` of nodes as the scene shows them.

    Raises `ValueError` for transforms that together leave the numbers there are.
    """
    order = with_ancestors(nodes.parents, wanted)
    with np.errstate(over="ignore", invalid="ignore"):
        world = world_matrices(nodes.local[order], nodes.parents, order)
    found = np.stack([world[node] for node in wanted])
    near = (np.abs(found) < _FARTHEST).all(axis=(1, 2))
    if not near.all():
        name = nodes.names[wanted[int(near.argmin())]]
        raise ValueError(f"{file.path}: node {name!r} is beyond {_FARTHEST:g} in its scene; export it again.")
    return found


def _rows(file: GltfFile, nodes: list[dict[str, Any]], key: str, default: Any) -> np.ndarray:
    rows = np.tile(np.array(default, np.float64), (len(nodes), 1))
    for k, node in enumerate(nodes):
        if key not in node:
            continue
        try:
            value = np.array(node[key], np.float64)
        except (TypeError, ValueError, OverflowError):
            value = np.zeros(0)
        if value.shape != rows[k].shape or not np.isfinite(value).all():
            raise ValueError(
                f"{file.path}: the {key} of node {k} is not {rows.shape[1]} finite numbers; export again."
            )
        rows[k] = value
    return rows


def _parents(file: GltfFile, nodes: list[dict[str, Any]]) -> np.ndarray:
    parents = np.full(len(nodes), -1)
    for k, node in enumerate(nodes):
        children = node.get("children", [])
        for child in children if isinstance(children, list) else [children]:
            if whole(file, child, f"a child of node {k}") >= len(nodes) or parents[child] >= 0:
                raise ValueError(
                    f"{file.path}: node {k} names child {child}, which is not there or has a parent already; "
                    "export it again."
                )
            parents[child] = k
    reached = parents.copy()  # the ancestor reached so far
    for _ in range(_DEEPEST):
        if (reached < 0).all():
            return parents
        reached = np.where(reached >= 0, parents[reached], -1)
    raise ValueError(
        f"{file.path}: its nodes form a circle, or a chain of more than {_DEEPEST}; export it again."
    )
