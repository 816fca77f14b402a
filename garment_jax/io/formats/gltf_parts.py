"""Which meshes of a glTF file are the body: those skinned to one skeleton or hanging on its joints."""

from collections.abc import Iterable
from typing import NamedTuple

from garment_jax.io.formats.gltf_container import GltfFile, element, whole
from garment_jax.io.formats.gltf_nodes import Nodes, with_ancestors
from garment_jax.io.formats.gltf_primitives import has_surface, primitives_of

_FEW = 12  # names that a sentence lists


class Part(NamedTuple):
    """A mesh as a node of the scene shows it."""

    node: int
    mesh: int
    name: str  # of the mesh, or of the node where that has none
    skin: int | None  # None for a mesh that is not skinned
    joint: int | None  # node of the nearest joint above one that is not skinned


class Choice(NamedTuple):
    """What the user names of a file that holds several; `part` as in `--body-mesh`."""

    mesh: str | None = None
    skeleton: str | None = None
    part: str = ""

    def option(self, what: str) -> str:
        """Return the option that names a mesh or a skeleton of this file."""
        return f"--{self.part}-{what}" if self.part else f"--{what}"


class Chosen(NamedTuple):
    """The parts of one body, the skins that they hang on, and what is to be said of them."""

    parts: list[Part]
    skins: list[int]
    notes: tuple[str, ...]


def choose_parts(file: GltfFile, nodes: Nodes, joints: dict[int, list[int]], choice: Choice) -> Chosen:
    """Return the parts of the body; `joints`: the nodes of each skin's joints.

    All meshes of one skeleton are one body, the rigid ones with weight 1 on the joint that they hang on.
    Raises `ValueError`, with the names and the options, where there is none, or several skeletons.
    """
    first = _first_skins(joints)
    above = _nearest_joints(nodes, first)
    parts = _all_parts(file, nodes, first, above)
    hanging = {part: first.get(part.joint, -1) if part.skin is None else part.skin for part in parts}
    able = [part for part in parts if hanging[part] >= 0]
    flat = {mesh for mesh in {part.mesh for part in able} if not has_surface(file, mesh)}
    able = [part for part in able if part.mesh not in flat] or able
    if not able:
        raise ValueError(f"{file.path} holds no skinned mesh; export the body with its armature and skin.")
    wanted = [part for part in able if choice.mesh in (None, part.name, nodes.names[part.node])]
    if not wanted:
        names = list_names(part.name for part in able)
        raise ValueError(
            f"{file.path} has no skinned mesh {choice.mesh!r}; {choice.option('mesh')} takes one of {names}."
        )
    skeletons = _skeletons(joints, first, above)
    wanted = _of_one_skeleton(file, wanted, {part: skeletons[hanging[part]] for part in wanted}, choice)
    used = sorted({hanging[part] for part in wanted})
    return Chosen(wanted, used, _notes(file, nodes, parts, wanted, flat, choice))


def holds_skinned_mesh(file: GltfFile) -> bool:
    """Return whether a node of the scene shows a mesh with a skin."""
    nodes = file.json.get("nodes", [])
    return any("mesh" in node and "skin" in node for node in nodes if isinstance(node, dict))


def list_names(names: Iterable[str]) -> str:
    """Return different names as a list for a sentence, no longer than it can be read."""
    listed = list(dict.fromkeys(names))
    return ", ".join(name[:60] for name in listed[:_FEW]) + (", …" if len(listed) > _FEW else "")


def unique_names(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names, later ones of the same name numbered: a motion finds its joints by name."""
    taken: set[str] = set()
    found = []
    for name in names:
        number, fresh = 2, name
        while fresh in taken:
            fresh, number = f"{name}.{number}", number + 1
        taken.add(fresh)
        found.append(fresh)
    return tuple(found)


def _first_skins(joints: dict[int, list[int]]) -> dict[int | None, int]:
    """Return the first skin that each joint's node is in."""
    found: dict[int | None, int] = {}
    for skin, listed in joints.items():
        for node in listed:
            found.setdefault(node, skin)
    return found


def _nearest_joints(nodes: Nodes, joints: dict[int | None, int]) -> list[int | None]:
    """Return for every node the nearest joint above it."""
    found: list[int | None] = [None] * len(nodes.names)
    for node in with_ancestors(nodes.parents, list(range(len(nodes.names)))):
        parent = int(nodes.parents[node])
        found[node] = parent if parent in joints else None if parent < 0 else found[parent]
    return found


def _all_parts(
    file: GltfFile, nodes: Nodes, joints: dict[int | None, int], above: list[int | None]
) -> list[Part]:
    found = []
    for k, name in enumerate(nodes.names):
        node = file.json["nodes"][k]
        if "mesh" not in node:
            continue
        index = whole(file, node["mesh"], f"the mesh of node {k}")
        title = str(element(file, "meshes", index).get("name", name))
        skin = whole(file, node["skin"], f"the skin of node {k}") if "skin" in node else None
        if skin is not None:
            element(file, "skins", skin)
        hangs_on = None if skin is not None else k if k in joints else above[k]
        found.append(Part(k, index, title, skin, hangs_on))
    return found


def _skeletons(
    joints: dict[int, list[int]], first: dict[int | None, int], above: list[int | None]
) -> dict[int, int]:
    """Return each skin's skeleton, named by its first skin.

    Skins are of one skeleton that share a joint, or of which one hangs on the other's joints.
    """
    same = {skin: skin for skin in joints}

    def top(skin: int) -> int:
        while same[skin] != skin:
            skin = same[skin]
        return skin

    for skin, listed in joints.items():
        for node in listed:
            over = above[node]
            for other in (first[node], first[node if over is None else over]):
                a, b = sorted((top(skin), top(other)))
                same[b] = a
    return {skin: top(skin) for skin in joints}


def _of_one_skeleton(
    file: GltfFile, parts: list[Part], skeletons: dict[Part, int], choice: Choice
) -> list[Part]:
    by_skeleton: dict[int, list[Part]] = {}
    for part in parts:
        by_skeleton.setdefault(skeletons[part], []).append(part)
    names = _skeleton_names(file, list(by_skeleton))
    if choice.skeleton is not None:
        by_skeleton = {k: v for k, v in by_skeleton.items() if choice.skeleton in names[k]}
        if not by_skeleton:
            listed = list_names(each[0] for each in names.values())
            raise ValueError(
                f"{file.path} has no skeleton {choice.skeleton!r} with a mesh; {choice.option('skeleton')} "
                f"takes one of {listed}."
            )
    if len(by_skeleton) > 1:
        listed = "; ".join(
            f"{names[k][0]} with {list_names(p.name for p in each)}" for k, each in by_skeleton.items()
        )
        raise ValueError(
            f"{file.path} holds several skeletons ({listed[:400]}); name the body's with "
            f"{choice.option('skeleton')}, or its mesh with {choice.option('mesh')}."
        )
    return next(iter(by_skeleton.values()))


def _skeleton_names(file: GltfFile, skins: list[int]) -> dict[int, tuple[str, ...]]:
    """Return the names that each skeleton is chosen by: its first joint's, its skin's."""
    nodes, found = file.json["nodes"], {}
    tops = [element(file, "skins", skin)["joints"][0] for skin in skins]
    firsts = unique_names(str(nodes[top].get("name", f"node_{top}")) for top in tops)
    for skin, first in zip(skins, firsts, strict=True):
        title = element(file, "skins", skin).get("name")
        found[skin] = (first, *([] if title is None else [str(title)]))
    return found


def _notes(
    file: GltfFile, nodes: Nodes, parts: list[Part], taken: list[Part], flat: set[int], choice: Choice
) -> tuple[str, ...]:
    """Return what was joined and what was left out, each in a phrase."""
    skinned = list(dict.fromkeys(part.name for part in taken if part.skin is not None))
    rigid = [part for part in taken if part.skin is None]
    out = set(parts) - set(taken)
    loose = {part for part in out if part.skin is None and part.joint is None}
    lines = {part for part in out - loose if part.mesh in flat}
    other = out - loose - lines
    morphed = {part.mesh for part in taken}
    morphed = {mesh for mesh in morphed if any("targets" in each for each in primitives_of(file, mesh))}
    notes = {
        f"are one body; {choice.option('mesh')} takes one alone": skinned if len(skinned) > 1 else [],
        "have no skin and move with the joint that they hang on": [
            f"{nodes.names[part.node]} on {nodes.names[part.joint or 0]}" for part in rigid
        ],
        "are left out, as they hang on no joint": [nodes.names[part.node] for part in parts if part in loose],
        "are left out, as they are no surfaces": [nodes.names[part.node] for part in parts if part in lines],
        "are left out, as they are not what is named": [part.name for part in parts if part in other],
        "are taken without their morph targets": [part.name for part in taken if part.mesh in morphed],
    }
    return tuple(f"meshes {list_names(names)} {what}" for what, names in notes.items() if names)
