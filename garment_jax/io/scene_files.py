"""A scene from files of its parts: rigged body, collider, garment and pins."""

from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from garment_jax.geometry.boundary import boundary_loops
from garment_jax.io.layout import GARMENT, Known, check_fields, check_uv
from garment_jax.io.npz import load_body, load_collider, load_pin_file
from garment_jax.io.obj import read_garment, read_group
from garment_jax.io.validation import check_size
from garment_jax.structs import Garment, Pins, RiggedBody, Scene

_PIN_NEIGHBOURS = 4  # body vertices whose weights a pin blends: the waist turns with all of them


def load_scene(
    garment: str | Path,
    body: str | Path,
    *,
    collider: str | Path | None = None,
    pins: str = "top",
    cloth: Garment | None = None,
    rigged: RiggedBody | None = None,
) -> Scene:
    """Return the scene of a garment (.obj) on a body (.npz).

    `cloth` and `rigged`: what was read from `garment` and `body` already (`importers.load_garment`,
    `importers.bodies.read_any_body`). `pins` as in `load_pins`, or
    "group:NAME" for a group of the OBJ file. Raises `FileNotFoundError`, `OSError` or `ValueError`, with the
    file's name, for what is not there, damaged, in another unit than metres, or of another garment or body.
    """
    rigged = load_body(Path(body)) if rigged is None else rigged
    cloth = read_garment(garment) if cloth is None else cloth
    _check_sizes(rigged, cloth, str(body), str(garment))
    known = {
        "n": (len(cloth.template), str(garment)),
        "b": (len(rigged.vertices), str(body)),
        "j": (len(rigged.joints), str(body)),
    }
    solid = None if collider is None else load_collider(Path(collider), known)
    if pins.startswith("group:"):
        vertices = read_group(garment, pins.removeprefix("group:"))
        return Scene(cloth, rigged, solid, Pins(vertices, nearest_weights(cloth.template[vertices], rigged)))
    return Scene(cloth, rigged, solid, load_pins(pins, cloth, rigged, known))


def _check_sizes(body: RiggedBody, garment: Garment, body_name: str, garment_name: str) -> None:
    check_fields(GARMENT, garment._asdict(), garment_name)
    check_uv(garment.uv, garment_name)
    check_size(body.vertices, f"{body_name}: the body")
    check_size(np.concatenate([body.vertices, body.joints]), f"{body_name}: the body with its joints")
    check_size(garment.template, f"{garment_name}: the garment")


def load_pins(spec: str, garment: Garment, body: RiggedBody, known: Known | None = None) -> Pins | None:
    """Return the garment's pins: "top", "none", "above:HEIGHT" in metres, or an `.npz` file.

    "top" is the highest boundary loop. Weights are those of the nearest body vertices; a file gives its own
    (arrays `pins` and `pin_weights`); it must fit the sizes `known` (`check_fields`). Raises `ValueError`
    for anything else, or when nothing is found.
    """
    if spec == "none":
        return None
    if spec.endswith(".npz"):
        return load_pin_file(Path(spec), known)
    if spec == "top":
        vertices = _top_loop(garment)
    elif spec.startswith("above:"):
        vertices = _above(spec, garment)
    else:
        raise ValueError(
            f"--pins {spec!r} is unknown; choose top, none, above:HEIGHT, group:NAME or a file .npz."
        )
    return Pins(vertices.astype(np.int32), nearest_weights(garment.template[vertices], body))


def nearest_weights(points: np.ndarray, body: RiggedBody) -> np.ndarray:
    """Return skinning weights `[p, j]` of `points` `[p, 3]`: the nearest body vertices', by 1 / distance."""
    distance, nearest = KDTree(body.vertices).query(points, k=_PIN_NEIGHBOURS)
    share = 1.0 / np.maximum(distance, 1e-4)
    blended = np.einsum("pk,pkj->pj", share, body.skin_weights[nearest].astype(np.float64))
    return (blended / blended.sum(axis=1, keepdims=True)).astype(np.float32)


def _top_loop(garment: Garment) -> np.ndarray:
    loops = boundary_loops(garment.faces)
    if not loops:
        raise ValueError("--pins top: the garment has no boundary; name its pins by above:HEIGHT or a file.")
    return np.sort(max(loops, key=lambda loop: garment.template[loop, 1].mean()))


def _above(spec: str, garment: Garment) -> np.ndarray:
    try:
        height = float(spec.removeprefix("above:"))
    except ValueError as error:
        raise ValueError(f"--pins {spec!r}: give a height in metres, such as above:1.02.") from error
    vertices = np.flatnonzero(garment.template[:, 1] > height)
    if not len(vertices):
        top = float(garment.template[:, 1].max())
        raise ValueError(f"--pins {spec!r} finds no vertex; the garment's highest is at {top:.3f} m.")
    return vertices
