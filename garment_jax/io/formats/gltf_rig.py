"""The skeleton of a glTF file: its skins as one tree of joints with world bind poses.

A vertex of a skinned mesh is at sum_j w_j G_j B_j^-1 v, with G_j the world matrix of joint j's node and
B_j^-1 its inverse bind matrix. The meshes' own space may have any unit and axes; glTF's world is in
metres, Y up. The placement A of that space in the world is G_j B_j^-1 of a joint in its bind pose, the
same for all of them. So the body is A v, and joint j's bind pose is A B_j.
"""

from typing import NamedTuple

import numpy as np

from garment_jax.io.formats.gltf_accessors import read_accessor
from garment_jax.io.formats.gltf_container import GltfFile, count_of, element, whole
from garment_jax.io.formats.gltf_nodes import Nodes, read_nodes, scene_matrices, with_ancestors
from garment_jax.io.formats.gltf_parts import Choice, Part, choose_parts, unique_names
from garment_jax.io.formats.gltf_unbound import place_unbound

_SAME = 1e-3  # parts of the skeleton's size by which equal placements may differ: exporters round
_FARTHEST = np.radians(60.0)  # mean tilt of the joints in a scene that shows another pose than the bind pose
MOST_JOINTS = 4096


class Skin(NamedTuple):
    """One skin: which node its joints are, and where its meshes' space stands in the world."""

    joints: list[int]  # node of each joint, in the skin's own order
    placements: (
        np.ndarray
    )  # [j, 4, 4] float64: A of each joint; the same for all where there are bind matrices


class Skeleton(NamedTuple):
    """The joints of all skins, parents before children, one root."""

    joints: list[int]  # node of each joint
    parents: np.ndarray  # [j] int32, -1 for the root
    names: tuple[str, ...]  # j different names
    bind: np.ndarray  # [j, 4, 4] float64 world matrix of each joint in the bind pose
    skins: dict[int, Skin]
    parts: list[Part]
    nodes: Nodes
    notes: tuple[str, ...]  # what was chosen and what was left out, a phrase each


def read_skeleton(file: GltfFile, choice: Choice = Choice()) -> Skeleton:
    """Return the skeleton of the skinned meshes of a file that are chosen.

    A skeleton with several top joints gets the nearest node above them as its root. Raises `ValueError`
    when there is no skinned mesh, when there are several skeletons, and for bind poses that contradict one
    another or that no even scale brings into the world.
    """
    nodes = read_nodes(file)
    joints = {k: _joints_of(file, k, nodes) for k in range(count_of(file, "skins"))}
    chosen = choose_parts(file, nodes, joints, choice)
    skins, bind, notes = {}, {}, []
    for index in chosen.skins:
        inverse = _inverse_bind(file, index, len(joints[index]))
        if inverse is None:
            world = scene_matrices(file, nodes, joints[index])
            _even_scale(file, world, index)
            meshes = [part.mesh for part in chosen.parts if part.skin == index]
            placements, note = place_unbound(file, world, meshes, index)
            notes.append(note)
        else:
            place = _placement(file, nodes, joints[index], inverse, index)
            placements = np.repeat(place[None], len(inverse), axis=0)
            world = place @ np.linalg.inv(inverse)
        skins[index] = Skin(joints[index], placements)
        _gather(file, bind, skins[index], world, nodes, choice)
        if len(bind) > MOST_JOINTS:
            raise ValueError(f"{file.path}: its skins have over {MOST_JOINTS} joints; export the body alone.")
    order = _joint_order(file, nodes, bind)
    names = unique_names(nodes.names[node] for node in order)
    matrices = np.stack([bind[node] for node in order])
    parents = joint_parents(nodes, order)
    return Skeleton(order, parents, names, matrices, skins, chosen.parts, nodes, (*notes, *chosen.notes))


def _joints_of(file: GltfFile, index: int, nodes: Nodes) -> list[int]:
    """Return the nodes of a skin's joints."""
    listed = element(file, "skins", index).get("joints")
    if not isinstance(listed, list) or not 0 < len(listed) <= MOST_JOINTS:
        raise ValueError(f"{file.path}: skin {index} has no joints, or over {MOST_JOINTS}; export it again.")
    joints = [whole(file, joint, f"a joint of skin {index}") for joint in listed]
    if max(joints) >= len(nodes.names) or len(set(joints)) < len(joints):
        raise ValueError(
            f"{file.path}: skin {index} names a joint twice or one that is not there; export it again."
        )
    return joints


def _inverse_bind(file: GltfFile, index: int, joints: int) -> np.ndarray | None:
    """Return a skin's inverse bind matrices `[j, 4, 4]`, None where it has none: they are optional."""
    skin = element(file, "skins", index)
    if "inverseBindMatrices" not in skin:
        return None
    columns = read_accessor(file, skin["inverseBindMatrices"], "MAT4").astype(np.float64)
    if len(columns) < joints:
        raise ValueError(
            f"{file.path}: skin {index} has {len(columns)} bind matrices for {joints} joints; export again."
        )
    inverse = np.swapaxes(columns[:joints].reshape(-1, 4, 4), 1, 2)
    if (np.abs(np.linalg.det(inverse)) < 1e-12).any() or np.abs(inverse[:, 3] - [0, 0, 0, 1]).max() > 1e-4:
        raise ValueError(
            f"{file.path}: skin {index} has a bind matrix that cannot be inverted; export it again."
        )
    return inverse


def _placement(file: GltfFile, nodes: Nodes, joints: list[int], inverse: np.ndarray, skin: int) -> np.ndarray:
    """Return A `[4, 4]` of a skin (see above)."""
    found = scene_matrices(file, nodes, joints) @ inverse
    even = _even_scale(file, found, skin)
    size = even * max(float(np.ptp(np.linalg.inv(inverse)[:, :3, 3], axis=0).max()), 1e-9)
    off = np.abs(found - found[0])[:, :3] / [even, even, even, size]
    if off.max() < _SAME:
        return found[0]
    top = next(node for node in with_ancestors(nodes.parents, joints) if node in joints)
    return _from_above(file, nodes, top, found, even, skin)


def _even_scale(file: GltfFile, matrices: np.ndarray, skin: int) -> float:
    """Return the scale of matrices `[j, 4, 4]`; `ValueError` where it is uneven, mirrored or none."""
    scales = np.linalg.svd(matrices[:, :3, :3], compute_uv=False)
    even = float(np.median(scales))
    if not even > 0 or np.abs(scales / even - 1).max() > 0.02 or np.linalg.det(matrices[:, :3, :3]).min() < 0:
        raise ValueError(
            f"{file.path}: the joints of skin {skin} are scaled unevenly or mirrored; apply all scales to "
            "armature and mesh, then export it again."
        )
    return even


def _from_above(
    file: GltfFile, nodes: Nodes, joint: int, found: np.ndarray, scale: float, skin: int
) -> np.ndarray:
    """Return A where the scene shows another pose: what stands above the joints, or nothing at all.

    Of both, that of the right scale from which the joints are tilted least. That most joints share a
    placement says nothing here: a body that has turned has turned as a whole.
    """
    parent = int(nodes.parents[joint])
    above = scene_matrices(file, nodes, [parent])[0] if parent >= 0 else np.eye(4)
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


def _gather(
    file: GltfFile, bind: dict[int, np.ndarray], skin: Skin, world: np.ndarray, nodes: Nodes, choice: Choice
) -> None:
    """Add a skin's world bind matrices `[j, 4, 4]` to `bind`; skins that share a joint must agree on it."""
    size = max(float(np.ptp(world[:, :3, 3], axis=0).max()), 1e-9)
    for joint, matrix in zip(skin.joints, world, strict=True):
        before = bind.setdefault(joint, matrix)
        if np.abs(before - matrix)[:3, 3].max() > _SAME * size:
            raise ValueError(
                f"{file.path}: its skins disagree about the bind pose of joint {nodes.names[joint]!r}; join "
                f"the meshes, or name one of them with {choice.option('mesh')}."
            )


def _joint_order(file: GltfFile, nodes: Nodes, bind: dict[int, np.ndarray]) -> list[int]:
    """Return the joints, parents first and otherwise in the file's order; adds a missing root to `bind`."""
    order = [node for node in with_ancestors(nodes.parents, list(bind)) if node in bind]
    chains = [[node, *nodes.above(node)] for node in order]
    if all(order[0] in chain for chain in chains):
        return order
    shared = next((node for node in chains[0] if all(node in chain for chain in chains)), None)
    if shared is None:
        raise ValueError(f"{file.path}: its joints have no common root; parent them to one bone.")
    bind[shared] = scene_matrices(file, nodes, [shared])[0]
    return [shared, *order]


def joint_parents(nodes: Nodes, order: list[int]) -> np.ndarray:
    """Return each joint's place of the nearest joint above it `[j]` int32, -1 for the root."""
    place = {node: k for k, node in enumerate(order)}
    nearest = [next((place[up] for up in nodes.above(node) if up in place), -1) for node in order]
    return np.array(nearest, np.int32)
