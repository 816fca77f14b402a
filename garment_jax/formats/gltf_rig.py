"""The skeleton of a glTF file: its skins as one tree of joints with world bind poses.

A vertex of a skinned mesh is at sum_j w_j G_j B_j^-1 v, with G_j the world matrix of joint j's node and
B_j^-1 its inverse bind matrix. The meshes' own space may have any unit and axes; glTF's world is in
metres, Y up. The placement A of that space in the world is G_j B_j^-1 of a joint in its bind pose, the
same for all of them. So the body is A v, and joint j's bind pose is A B_j.
"""

from typing import NamedTuple

import numpy as np

from garment_jax.formats.gltf_accessors import read_accessor
from garment_jax.formats.gltf_container import GltfFile, element, whole
from garment_jax.formats.gltf_nodes import Nodes, read_nodes, with_ancestors, world_matrices

_SAME = 1e-3  # parts of the skeleton's size by which equal placements may differ: exporters round
_FARTHEST = np.radians(60.0)  # mean tilt of the joints in a scene that shows another pose than the bind pose
_MOST_JOINTS = 4096


class Skin(NamedTuple):
    """One skin: which node its joints are, and where its meshes' space stands in the world."""

    joints: list[int]  # node of each joint, in the skin's own order
    placement: np.ndarray  # [4, 4] float64: A, the meshes' space to the world


class Skeleton(NamedTuple):
    """The joints of all skins, parents before children, one root."""

    joints: list[int]  # node of each joint
    parents: np.ndarray  # [j] int32, -1 for the root
    names: tuple[str, ...]  # j different names
    bind: np.ndarray  # [j, 4, 4] float64 world matrix of each joint in the bind pose
    skins: dict[int, Skin]
    meshes: list[tuple[int, int]]  # (mesh, skin) of every skinned node
    nodes: Nodes


def read_skeleton(file: GltfFile, mesh: str | None = None) -> Skeleton:
    """Return the skeleton of all skinned meshes of a file, or of those named `mesh`.

    A skeleton with several top joints gets the nearest node above them as its root. Raises `ValueError`
    when there is no skinned mesh, when there are several skeletons, and for bind poses that contradict one
    another or that no even scale brings into the world.
    """
    nodes = read_nodes(file)
    meshes = _skinned_meshes(file, nodes, mesh)
    skins, bind = {}, {}
    for index in sorted({skin for _, skin in meshes}):
        joints, inverse = _skin(file, index, nodes)
        skins[index] = Skin(joints, _placement(file, nodes, joints, inverse, index))
        _gather(file, bind, skins[index], inverse, nodes)
    order = _joint_order(file, nodes, bind, [skin.joints for skin in skins.values()])
    names = _unique([nodes.names[node] for node in order])
    matrices = np.stack([bind[node] for node in order])
    return Skeleton(order, _joint_parents(nodes, order), names, matrices, skins, meshes, nodes)


def _skinned_meshes(file: GltfFile, nodes: Nodes, mesh: str | None) -> list[tuple[int, int]]:
    found, names = [], []
    for k in range(len(nodes.names)):
        node = file.json["nodes"][k]
        if "mesh" not in node or "skin" not in node:
            continue
        index = whole(file, node["mesh"], f"the mesh of node {k}")
        title = str(element(file, "meshes", index).get("name", nodes.names[k]))
        names.append(title)
        if mesh is None or mesh in (title, nodes.names[k]):
            found.append((index, whole(file, node["skin"], f"the skin of node {k}")))
    if not names:
        raise ValueError(f"{file.path} holds no skinned mesh; export the body with its armature and skin.")
    if not found:
        raise ValueError(f"{file.path} has no skinned mesh {mesh!r}; it has {', '.join(names)}.")
    return list(dict.fromkeys(found))


def _skin(file: GltfFile, index: int, nodes: Nodes) -> tuple[list[int], np.ndarray]:
    """Return the nodes of a skin's joints and their inverse bind matrices `[j, 4, 4]`."""
    skin = element(file, "skins", index)
    listed = skin.get("joints")
    if not isinstance(listed, list) or not 0 < len(listed) <= _MOST_JOINTS:
        raise ValueError(f"{file.path}: skin {index} has no joints, or over {_MOST_JOINTS}; export it again.")
    joints = [whole(file, joint, f"a joint of skin {index}") for joint in listed]
    if max(joints) >= len(nodes.names) or len(set(joints)) < len(joints):
        raise ValueError(f"{file.path}: skin {index} names a joint twice or one that is not there.")
    if "inverseBindMatrices" not in skin:
        raise ValueError(
            f"{file.path}: skin {index} has no inverse bind matrices; export it with its rest pose."
        )
    columns = read_accessor(file, skin["inverseBindMatrices"], "MAT4").astype(np.float64)
    if len(columns) < len(joints):
        raise ValueError(
            f"{file.path}: skin {index} has {len(columns)} bind matrices for {len(joints)} joints."
        )
    inverse = np.swapaxes(columns[: len(joints)].reshape(-1, 4, 4), 1, 2)
    if (np.abs(np.linalg.det(inverse)) < 1e-12).any() or np.abs(inverse[:, 3] - [0, 0, 0, 1]).max() > 1e-4:
        raise ValueError(
            f"{file.path}: skin {index} has a bind matrix that cannot be inverted; export it again."
        )
    return joints, inverse


def _placement(file: GltfFile, nodes: Nodes, joints: list[int], inverse: np.ndarray, skin: int) -> np.ndarray:
    """Return A `[4, 4]` of a skin (see above)."""
    world = _scene_matrices(nodes, joints)
    found = np.stack([world[joint] for joint in joints]) @ inverse
    scales = np.linalg.svd(found[:, :3, :3], compute_uv=False)
    even = np.median(scales)
    if np.abs(scales / even - 1).max() > 0.02 or np.linalg.det(found[:, :3, :3]).min() < 0:
        raise ValueError(
            f"{file.path}: the joints of skin {skin} are scaled unevenly or mirrored; apply all scales to "
            "armature and mesh, then export it again."
        )
    size = even * max(float(np.ptp(np.linalg.inv(inverse)[:, :3, 3], axis=0).max()), 1e-9)
    off = np.abs(found - found[0])[:, :3] / [even, even, even, size]
    if off.max() < _SAME:
        return found[0]
    top = next(node for node in with_ancestors(nodes.parents, joints) if node in joints)
    return _from_above(file, nodes, top, found, float(even), skin)


def _from_above(
    file: GltfFile, nodes: Nodes, joint: int, found: np.ndarray, scale: float, skin: int
) -> np.ndarray:
    """Return A where the scene shows another pose: what stands above the joints, or nothing at all.

    Of both, that of the right scale from which the joints are tilted least. That most joints share a
    placement says nothing here: a body that has turned has turned as a whole.
    """
    parent = int(nodes.parents[joint])
    above = _scene_matrices(nodes, [parent])[parent] if parent >= 0 else np.eye(4)
    choices = []
    for candidate in (above, np.eye(4)):
        own = float(np.abs(np.linalg.det(candidate[:3, :3])) ** (1 / 3))
        if own > 0 and abs(scale / own - 1) < 0.02:
            upright = found[:, 1, :3] @ candidate[1, :3] / (scale * own)  # cosine with the world's Y
            choices.append((float(np.arccos(np.clip(upright, -1, 1)).mean()), candidate))
    angle, best = min(choices, key=lambda choice: choice[0], default=(np.inf, np.eye(4)))
    if angle > _FARTHEST:
        raise ValueError(
            f"{file.path}: the scene shows skin {skin} in another pose than its bind pose, and nothing says "
            "how that stands in the world; put the armature into its rest pose and export it again."
        )
    return best


def _scene_matrices(nodes: Nodes, wanted: list[int]) -> dict[int, np.ndarray]:
    order = with_ancestors(nodes.parents, wanted)
    return world_matrices(nodes.local[order], nodes.parents, order)


def _gather(
    file: GltfFile, bind: dict[int, np.ndarray], skin: Skin, inverse: np.ndarray, nodes: Nodes
) -> None:
    """Add a skin's world bind matrices to `bind`; skins that share a joint must agree on it."""
    world = skin.placement @ np.linalg.inv(inverse)
    size = max(float(np.ptp(world[:, :3, 3], axis=0).max()), 1e-9)
    for joint, matrix in zip(skin.joints, world, strict=True):
        before = bind.setdefault(joint, matrix)
        if np.abs(before - matrix)[:3, 3].max() > _SAME * size:
            raise ValueError(
                f"{file.path}: its skins disagree about the bind pose of joint {nodes.names[joint]!r}; join "
                "the meshes, or name one of them."
            )


def _joint_order(
    file: GltfFile, nodes: Nodes, bind: dict[int, np.ndarray], skins: list[list[int]]
) -> list[int]:
    """Return the joints, parents first and otherwise in the file's order; adds a missing root to `bind`."""
    together = set(skins[0])
    for _ in skins:
        for joints in skins:
            together |= set(joints) if together & set(joints) else set()
    if len(together) < len(bind):
        raise ValueError(f"{file.path} holds several skeletons; name the skinned mesh of one body.")
    order = [node for node in with_ancestors(nodes.parents, list(bind)) if node in bind]
    chains = [[node, *_above(nodes, node)] for node in order]
    if all(order[0] in chain for chain in chains):
        return order
    shared = next((node for node in chains[0] if all(node in chain for chain in chains)), None)
    if shared is None:
        raise ValueError(f"{file.path}: its joints have no common root; parent them to one bone.")
    bind[shared] = _scene_matrices(nodes, [shared])[shared]
    return [shared, *order]


def _above(nodes: Nodes, node: int) -> list[int]:
    chain = []
    while (node := int(nodes.parents[node])) >= 0:
        chain.append(node)
    return chain


def _joint_parents(nodes: Nodes, order: list[int]) -> np.ndarray:
    place = {node: k for k, node in enumerate(order)}
    nearest = [next((place[up] for up in _above(nodes, node) if up in place), -1) for node in order]
    return np.array(nearest, np.int32)


def _unique(names: list[str]) -> tuple[str, ...]:
    """Return the names, later ones of the same name numbered: a motion finds its joints by name."""
    taken: set[str] = set()
    for k, name in enumerate(names):
        number, fresh = 2, name
        while fresh in taken:
            fresh, number = f"{name}.{number}", number + 1
        taken.add(fresh)
        names[k] = fresh
    return tuple(names)
