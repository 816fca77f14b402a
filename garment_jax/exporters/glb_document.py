"""The JSON of an animated GLB, as the parts of the scene are added to it."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.evaluation.colours import BODY, linear
from garment_jax.geometry.normals import vertex_normals


def new_document(clip: str, frames: range, fps: float, cloth: np.ndarray) -> dict[str, Any]:
    """Return the JSON with its animation and materials, still without meshes; `cloth` `[3]` sRGB."""
    extras = {"clip": clip, "fps": fps, "start": frames.start, "every": frames.step}
    return {
        "asset": {"version": "2.0", "generator": "garment_jax", "extras": extras},
        "scene": 0,
        "scenes": [{"nodes": []}],
        "nodes": [],
        "meshes": [],
        "materials": [_material("cloth", cloth), _material("skin", BODY)],
        "skins": [],
        "animations": [{"name": clip, "channels": [], "samplers": []}],
    }


def _material(name: str, srgb: np.ndarray) -> dict[str, Any]:
    surface = {
        "baseColorFactor": [*linear(srgb).tolist(), 1.0],
        "metallicFactor": 0.0,
        "roughnessFactor": 0.8,
    }
    return {"name": name, "pbrMetallicRoughness": surface, "doubleSided": True}


def tidy(document: dict[str, Any]) -> None:
    """Drop what stayed empty: glTF has no empty lists, nor materials that nothing wears."""
    document["materials"] = document["materials"][: len(document["meshes"])]
    if not document["animations"][0]["channels"]:
        del document["animations"]
    if not document["skins"]:
        del document["skins"]


def add_channel(document: dict[str, Any], times: int, values: int, node: int, path: str) -> None:
    """Animate a node's property: key times and values are accessors, linear in between."""
    animation = document["animations"][0]
    animation["samplers"].append({"input": times, "output": values, "interpolation": "LINEAR"})
    target = {"node": node, "path": path}
    animation["channels"].append({"sampler": len(animation["samplers"]) - 1, "target": target})


def smooth_normals(faces: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function from vertices `[n, 3]` to unit normals `[n, 3]`.

    glTF allows no other length: a vertex that belongs to no triangle with an area points up.
    """
    compiled = jax.jit(lambda vertices: vertex_normals(vertices, jnp.asarray(faces)))

    def normals(vertices: np.ndarray) -> np.ndarray:
        found = np.asarray(compiled(vertices))
        return np.where(found.any(axis=1, keepdims=True), found, np.array([0, 1, 0], np.float32))

    return normals
