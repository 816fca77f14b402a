"""Which moving body a sequence's garment is kept out of, and what of it."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.geometry.boundary import boundary_edges
from garment_jax.io.npz import load_body
from garment_jax.io.sequence import Sequence, open_sequence
from garment_jax.io.validation import FPS_TOLERANCE, check_input
from garment_jax.structs import Collider, Motion, RiggedBody, Scene


class Solid(NamedTuple):
    """A body in motion and the closed surface of it that counts."""

    scene: Scene  # the sequence's garment and pins on that body, as it is to be written
    motion: Motion
    collider: Collider


def solid_for(sequence: Sequence, body: str | Path | None = None, *, whole_body: bool = False) -> Solid:
    """Return what the garment of `sequence` is kept out of.

    The scene's collider, or with `whole_body` all of its body. `body`: another sequence file of as many
    frames, whose body and motion take their place, or a rigged body (`.npz`), which moves like the
    sequence's own and is taken whole. Raises `ValueError` for what does not fit or has no inside.
    """
    scene, motion = sequence.scene, sequence.motion
    if body is None:
        return _solid(scene, motion, whole_body, str(sequence.path))
    if str(body).endswith(".npz"):
        other = load_body(Path(body))
        _check_skeleton(other, scene.body, body)
        scene = scene._replace(body=other, collider=everything(other))
        return _solid(scene, motion, False, f"--body {body}")
    with open_sequence(body) as clip:
        check_input(clip)
        if clip.frames != sequence.frames or abs(clip.fps / sequence.fps - 1) > FPS_TOLERANCE:
            raise ValueError(
                f"--body {body} has {clip.frames} frames at {clip.fps:g} fps and {sequence.path} "
                f"{sequence.frames} at {sequence.fps:g}; give the body of the same frames."
            )
        _check_skeleton(clip.scene.body, scene.body, body)
        scene = scene._replace(body=clip.scene.body, collider=clip.scene.collider)
        return _solid(scene, clip.motion, whole_body, f"--body {body}")


def everything(body: RiggedBody) -> Collider:
    """Return the whole of `body` as a collider."""
    vertices = np.arange(len(body.vertices), dtype=np.int32)
    return Collider(vertices, np.zeros(0, np.int32), np.asarray(body.faces, np.int32))


def _solid(scene: Scene, motion: Motion, whole_body: bool, name: str) -> Solid:
    collider = everything(scene.body) if whole_body else scene.collider
    if collider is None:
        raise ValueError(f"{name} has no collider; use --whole-body, or --body with a file that has one.")
    edges = len(boundary_edges(collider.faces))
    if edges:
        part = "body" if whole_body else "collider"
        raise ValueError(
            f"the {part} of {name} has {edges} open edges, so nothing is inside it; close its holes (a cap), "
            "or use --body with a closed one."
        )
    return Solid(scene, motion, collider)


def _check_skeleton(other: RiggedBody, body: RiggedBody, name: str | Path) -> None:
    if other.joint_names != body.joint_names:
        raise ValueError(
            f"--body {name} has other joints ({len(other.joint_names)}) than the sequence's body "
            f"({len(body.joint_names)}); give a body with the same skeleton."
        )
