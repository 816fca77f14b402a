"""Skins without inverse bind matrices: glTF 2.0 makes them optional, and identity where they are absent.

Each joint's vertices are then in the joint's own space, and the body's rest pose is what the scene shows.
Some writers leave the matrices out of a mesh that stands in the world like any other: then its vertices
are near their joints as they are, and far from them by the specification.
"""

from typing import NamedTuple

import numpy as np

from garment_jax.io.formats.gltf_container import GltfFile
from garment_jax.io.formats.gltf_primitives import primitives_of, read_primitive, size_of

_ENOUGH = 2**18  # vertices to judge by


class Unbound(NamedTuple):
    """Where the vertices of a skin without bind matrices stand."""

    placements: np.ndarray  # [j, 4, 4] float64 from each joint's vertices to the world
    note: str


def place_unbound(file: GltfFile, world: np.ndarray, meshes: list[int], skin: int) -> Unbound:
    """Return where the vertices of `meshes` stand; `world` `[j, 4, 4]`: the joints in the scene."""
    own, standing, count, seen = 0.0, 0.0, 0, 0
    for mesh in meshes:
        for primitive in primitives_of(file, mesh):
            seen += size_of(file, primitive)[0]
            if seen > _ENOUGH:
                break
            part = read_primitive(file, primitive, len(world), f"{file.path}: mesh {mesh}")
            joint = np.take_along_axis(part.index, part.weights.argmax(axis=1)[:, None], axis=1)[:, 0]
            own += np.linalg.norm((world[joint, :3, :3] @ part.points[:, :, None])[..., 0], axis=1).sum()
            standing += np.linalg.norm(part.points - world[joint, :3, 3], axis=1).sum()
            count += len(part.points)
    absent = f"skin {skin} has no inverse bind matrices"
    if own <= standing:
        return Unbound(world, f"{absent}: the rest pose is the one that the scene shows")
    apart = own / max(count, 1)
    return Unbound(
        np.repeat(np.eye(4)[None], len(world), axis=0),
        f"{absent}: by the specification its vertices would be {apart:.2g} m from their joints, so they are "
        "taken where they stand, about the joints as the scene shows them",
    )
