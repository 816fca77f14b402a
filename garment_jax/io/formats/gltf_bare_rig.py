"""Skeletons of glTF files that hold motion alone: no mesh hangs on them, so the nodes say what they are."""

from collections.abc import Sequence

import numpy as np

from garment_jax.io.formats.gltf_accessors import read_accessor
from garment_jax.io.formats.gltf_animation import moved_nodes
from garment_jax.io.formats.gltf_container import GltfFile, element
from garment_jax.io.formats.gltf_nodes import Nodes, read_nodes, scene_matrices
from garment_jax.io.formats.gltf_parts import Choice, list_names, unique_names
from garment_jax.io.formats.gltf_rig import MOST_JOINTS, Skeleton, joint_parents

_TRAVEL = (
    0.01  # of the skeleton's size by which a joint's place in its parent must vary to be the one that travels
)
_MOST = 3  # times as many joints as any other: this is the skeleton that is meant


def read_bare_skeleton(
    file: GltfFile, animation: int, choice: Choice = Choice(), *, like: Sequence[str] = ()
) -> Skeleton:
    """Return the skeleton that an animation moves, its rest pose as the scene shows it.

    Its joints are all nodes below the root: `choice.skeleton`, else the one called as the root joint of the
    body with the joints `like`, else the topmost that moves or, below it, the one that travels. Raises
    `ValueError`, with the names, for several skeletons.
    """
    nodes = read_nodes(file)
    moved = moved_nodes(file, animation, len(nodes.names))
    if not moved:
        raise ValueError(
            f"{file.path}: animation {animation} moves no node; name another with --animation, or bake it."
        )
    names = unique_names(nodes.names)
    top, notes = _top(file, nodes, names, moved, choice)
    children = _children(nodes)
    found = _named(names, children, top, like) if choice.skeleton is None else top
    start = _travelling(file, animation, nodes, children, top) if found is None else found
    order = _below(children, start)
    if len(order) > MOST_JOINTS:
        raise ValueError(f"{file.path}: its skeleton has over {MOST_JOINTS} joints; export the body alone.")
    bind = scene_matrices(file, nodes, order)
    if not (np.abs(np.linalg.det(bind[:, :3, :3])) > 1e-12).all():
        bad = names[order[int(np.abs(np.linalg.det(bind[:, :3, :3])).argmin())]]
        raise ValueError(
            f"{file.path}: joint {bad!r} has no size in its scene; reset its scale and export again."
        )
    joints = tuple(names[node] for node in order)
    return Skeleton(order, joint_parents(nodes, order), joints, bind, {}, [], nodes, tuple(notes))


def _children(nodes: Nodes) -> list[list[int]]:
    children: list[list[int]] = [[] for _ in nodes.names]
    for node, parent in enumerate(nodes.parents):
        if parent >= 0:
            children[parent].append(node)
    return children


def _below(children: list[list[int]], top: int) -> list[int]:
    """Return a node and all below it, parents before children."""
    order, waiting = [], [top]
    while waiting:
        node = waiting.pop()
        order.append(node)
        waiting += reversed(children[node])
    return order


def _top(
    file: GltfFile, nodes: Nodes, names: tuple[str, ...], moved: list[int], choice: Choice
) -> tuple[int, list[str]]:
    """Return the node above all that move, or the one that is chosen, and what is to be said."""
    if choice.skeleton is not None:
        if choice.skeleton not in names:
            listed = list_names(names[node] for node in moved)
            raise ValueError(
                f"{file.path} has no joint {choice.skeleton!r}; {choice.option('skeleton')} takes the root "
                f"joint of one, such as {listed}."
            )
        return names.index(choice.skeleton), []
    trees: dict[int, list[int]] = {}
    for node in moved:
        trees.setdefault(([node, *nodes.above(node)])[-1], []).append(node)
    shared = {tree: _shared(nodes, each) for tree, each in trees.items()}
    sizes = sorted(map(len, trees.values()))
    largest = max(trees, key=lambda tree: len(trees[tree]))
    if len(trees) == 1:
        return shared[largest], []
    listed = list_names(names[node] for node in shared.values())
    if sizes[-1] < _MOST * sizes[-2]:
        raise ValueError(
            f"{file.path} holds several skeletons ({listed}); name one with {choice.option('skeleton')}."
        )
    return shared[largest], [f"of {listed} that move, {names[shared[largest]]} is taken for the body"]


def _shared(nodes: Nodes, moved: list[int]) -> int:
    """Return the lowest node that is each of `moved` or above it."""
    chains = [[node, *nodes.above(node)][::-1] for node in moved]
    depth = 0
    while all(len(chain) > depth + 1 and chain[depth + 1] == chains[0][depth + 1] for chain in chains):
        depth += 1
    return chains[0][depth]


def joints_of_body(skeleton: Skeleton, like: Sequence[str]) -> np.ndarray:
    """Return which joints are those of the body with the joints `like`, or above one of them, `[j]`.

    All of them where hardly any is: then the names are another skeleton's. Helpers that animators leave in
    a rig (targets of inverse kinematics) are none.
    """
    plain = set(map(_plain, like))
    found = np.array([_plain(name) in plain for name in skeleton.names])
    if not found.any() or 2 * found.sum() < min(len(plain), len(found)):
        return np.ones(len(found), bool)
    for j in range(len(found) - 1, 0, -1):
        found[skeleton.parents[j]] |= found[j]
    return found


def _named(names: tuple[str, ...], children: list[list[int]], top: int, like: Sequence[str]) -> int | None:
    """Return the node under `top` that is called as the body's root joint, whatever prefix it has."""
    wanted = [_plain(name) for name in like[:1]]
    return next((node for node in _below(children, top) if _plain(names[node]) in wanted), None)


def _plain(name: str) -> str:
    return name.replace("|", ":").rpartition(":")[2].lower()


def _travelling(file: GltfFile, animation: int, nodes: Nodes, children: list[list[int]], top: int) -> int:
    """Return the joint below `top` that carries the body about: its place in its parent varies."""
    travel = _travels(file, animation)
    size = float(np.ptp(scene_matrices(file, nodes, _below(children, top))[:, :3, 3], axis=0).max())
    below = {node: len(_below(children, node)) for node in children[top]}
    while below:
        largest = max(below, key=lambda node: below[node])
        scale = float(np.linalg.norm(scene_matrices(file, nodes, [top])[0, :3, 0]))
        if travel.get(largest, 0.0) * scale <= _TRAVEL * size:
            break
        top, below = largest, {node: len(_below(children, node)) for node in children[largest]}
    return top


def _travels(file: GltfFile, animation: int) -> dict[int, float]:
    """Return how far each node's translation keys are apart, in its parent's unit."""
    found = {}
    moving = element(file, "animations", animation)
    for channel in moving.get("channels", []):
        target = channel.get("target", {}) if isinstance(channel, dict) else {}
        if target.get("path") == "translation" and isinstance(target.get("node"), int):
            sampler = moving["samplers"][channel["sampler"]]
            keys = read_accessor(file, sampler.get("output"), "VEC3")
            if sampler.get("interpolation") == "CUBICSPLINE":
                keys = keys[1::3]
            found[target["node"]] = float(np.ptp(keys, axis=0).max()) if len(keys) else 0.0
    return found
