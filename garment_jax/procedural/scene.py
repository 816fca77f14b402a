"""The embedded scenes: the mannequin in one of the garments that the package makes."""

from collections.abc import Callable

import numpy as np

from garment_jax.procedural.cape import make_cape
from garment_jax.procedural.circle_skirt import make_circle_skirt
from garment_jax.procedural.cone_skirt import make_cone_skirt
from garment_jax.procedural.dress import make_dress
from garment_jax.procedural.made import MadeGarment
from garment_jax.procedural.mannequin import make_mannequin, mannequin_collider
from garment_jax.structs import Collider, RiggedBody, Scene

_MAKERS: dict[str, Callable[..., MadeGarment]] = {
    "skirt": make_cone_skirt,
    "circle_skirt": make_circle_skirt,
    "dress": make_dress,
    "cape": make_cape,
}
GARMENTS = tuple(_MAKERS)


def make_scene(garment: str = "skirt", *, vertices: int = 900) -> Scene:
    """Return the mannequin dressed in one of `GARMENTS` of about `vertices` vertices, canonical pose.

    Deterministic, no files. Raises `ValueError` for an unknown garment or a number out of range.
    """
    return make_outfit(garment, vertices=vertices)[0]


def make_outfit(
    garment: str = "skirt",
    *,
    vertices: int = 900,
    body: RiggedBody | None = None,
    collider: Collider | None = None,
) -> tuple[Scene, np.ndarray | None]:
    """Return the scene and the garment's flat pattern `[u, 2]` in metres, None where it has none.

    The pattern holds one point for each of the garment's UVs, counter-clockwise: the rest shape of a
    simulation. Without one the template is the rest shape. Another `body` in A-pose with the mannequin's
    joint names may wear it, with its own `collider`. Raises `ValueError` as `make_scene` does, and when
    the garment does not clear the body.
    """
    if garment not in _MAKERS:
        raise ValueError(f"garment {garment!r} is unknown; choose one of {', '.join(GARMENTS)}.")
    body = make_mannequin() if body is None else body
    collider = mannequin_collider(body) if collider is None else collider
    made = _MAKERS[garment](body, collider, vertices=vertices)
    return Scene(made.garment, body, collider, made.pins), made.pattern
