"""A scene from files of foreign formats: body, garment, and what they leave out (collider, pins)."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.geometry.boundary import boundary_loops
from garment_jax.io.content_hash import garment_hash
from garment_jax.io.npz import load_collider
from garment_jax.io.obj import read_group
from garment_jax.io.scene_files import load_pins, nearest_weights
from garment_jax.io.sequence import open_sequence
from garment_jax.structs import Collider, Garment, Pins, RiggedBody, Scene

_WAIST = (
    0.76  # of the body's height: a garment that ends below hangs from the waist, others from the shoulders
)


class DressedScene(NamedTuple):
    """A scene and what was decided for the user."""

    scene: Scene
    notes: tuple[str, ...]


def dress(
    garment: Garment,
    body: RiggedBody,
    *,
    garment_path: Path,
    body_path: Path,
    collider: Path | None = None,
    pins: str | None = None,
) -> DressedScene:
    """Return the scene of a garment on a body, both in metres, Y up, canonical pose.

    Without `collider` (.npz) the cloth touches what it touches in the sequence file that the body is from, or
    the whole body where that is closed, otherwise nothing. `pins` as in `load_pins`, or "group:NAME"; without
    it those of that sequence file if its garment is this one, else "top" for a garment that hangs from the
    waist and "none" for one that hangs from the shoulders. Raises `ValueError` for what belongs to another
    body or garment.
    """
    known = {
        "n": (len(garment.template), str(garment_path)),
        "b": (len(body.vertices), str(body_path)),
        "j": (len(body.joints), str(body_path)),
    }
    notes, like = [], _scene_of(body_path, body)
    if collider is not None:
        solid = load_collider(collider, known)
    elif like is not None and like.collider is not None:
        solid = like.collider
        notes.append(f"collider: that of {body_path}; --collider NPZ names another")
    else:
        solid = whole_body(body)
        touched = "the whole body" if solid else "none, the body is not closed"
        notes.append(f"collider: {touched}; --collider NPZ names a closed part")
    if pins is None and like is not None and garment_hash(like.garment) == garment_hash(garment):
        notes.append(f"pins: those of {body_path}; --pins says otherwise")
        return DressedScene(Scene(garment, body, solid, like.pins), tuple(notes))
    if pins is None:
        pins, reason = _default_pins(garment, body)
        notes.append(f"pins: {pins}, {reason}; --pins says otherwise")
    return DressedScene(
        Scene(garment, body, solid, _pins(pins, garment, body, garment_path, known)), tuple(notes)
    )


def _scene_of(path: Path, body: RiggedBody) -> Scene | None:
    """Return the scene of the sequence file that `body` is from, None for a file of another kind or body."""
    if path.suffix.lower() != ".h5":
        return None
    with open_sequence(path) as sequence:
        return sequence.scene if len(sequence.scene.body.vertices) == len(body.vertices) else None


def whole_body(body: RiggedBody) -> Collider | None:
    """Return the whole body as a collider, or None where it is not closed and so has no inside."""
    if not is_closed(body.faces):
        return None
    used = np.unique(body.faces)
    number = np.zeros(len(body.vertices), np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    return Collider(used.astype(np.int32), np.zeros(0, np.int32), number[body.faces])


def is_closed(faces: np.ndarray) -> bool:
    """Return whether each edge of `faces` `[f, 3]` has exactly two faces of opposite direction."""
    if not len(faces):
        return False
    n = int(faces.max()) + 1
    a, b = faces.astype(np.int64), np.roll(faces, -1, axis=1).astype(np.int64)
    ahead, back = np.sort((a * n + b).ravel()), np.sort((b * n + a).ravel())
    return bool((ahead == back).all() and (np.diff(ahead) > 0).all())


def _default_pins(garment: Garment, body: RiggedBody) -> tuple[str, str]:
    low, high = float(body.vertices[:, 1].min()), float(body.vertices[:, 1].max())
    top = float(garment.template[:, 1].max())
    if top > low + _WAIST * (high - low):
        return "none", "the garment hangs from the shoulders"
    if not boundary_loops(garment.faces):
        return "none", "the garment has no boundary"
    return "top", "the garment hangs from the waist"


def _pins(spec: str, garment: Garment, body: RiggedBody, path: Path, known) -> Pins | None:
    if not spec.startswith("group:"):
        return load_pins(spec, garment, body, known)
    vertices = read_group(path, spec.removeprefix("group:"))
    return Pins(vertices, nearest_weights(garment.template[vertices], body))
