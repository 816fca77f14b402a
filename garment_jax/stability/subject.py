"""What the report is about: a garment on a body, motions for it, and perhaps a trained model."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.body.root_frame import heading, to_root
from garment_jax.body.vary import LEGS
from garment_jax.io.sequence import open_sequence
from garment_jax.io.validation import check_input
from garment_jax.model.store import Model
from garment_jax.procedural.motions import make_dance, make_motion
from garment_jax.procedural.scene import make_scene
from garment_jax.procedural.skeleton import JOINT_NAMES
from garment_jax.structs import Motion, Scene
from garment_jax.training.pipeline import trained_model


class Subject(NamedTuple):
    """What is tested; host arrays, metres."""

    name: str
    scene: Scene
    motions: tuple[tuple[str, Motion], ...]  # by name; may be empty where nobody gave any
    model: Model | None
    full: bool  # the long cases too


def load_subject(
    run: str | Path | None,
    *,
    garment: str | None,
    clips: Sequence[str | Path],
    full: bool,
    vertices: int = 900,
) -> Subject:
    """Return what the command line names: the clips' garment and body, or an embedded garment.

    `clips` are sequence files or folders of them. Raises `ValueError` where they are of several garments,
    or where an embedded garment and clips are both named.
    """
    model = None if run is None else trained_model(run)
    if not clips:
        name = garment or "skirt"
        scene = make_scene(name, vertices=vertices)
        return Subject(f"embedded {name}", scene, embedded_motions(scene), model, full)
    if garment is not None:
        raise ValueError(f"--garment {garment} and --clips name two garments; leave one out.")
    paths = clip_paths(clips)
    found, scene, n = [], None, 0
    for path in paths:
        with open_sequence(path) as sequence:
            check_input(sequence)
            scene = sequence.scene if scene is None else scene
            n = len(scene.garment.template)
            if len(sequence.scene.garment.template) != n:
                raise ValueError(
                    f"{path} has a garment of {len(sequence.scene.garment.template)} vertices and {paths[0]} "
                    f"of {n}; name clips of one garment."
                )
            found.append((sequence.name, sequence.motion))
    assert scene is not None  # clip_paths returns one at least
    return Subject(f"the clips' garment of {n} vertices", scene, tuple(found), model, full)


def clip_paths(clips: Sequence[str | Path]) -> list[Path]:
    """Return the sequence files among `clips` and in the folders among them."""
    paths: list[Path] = []
    for clip in map(Path, clips):
        inside = sorted(clip.glob("*.h5")) if clip.is_dir() else [clip]
        if not inside:
            raise ValueError(f"--clips {clip} holds no sequence files (*.h5); import or simulate some first.")
        paths += inside
    return paths


def embedded_motions(scene: Scene) -> tuple[tuple[str, Motion], ...]:
    """Return motions made in code for a body with the mannequin's joints; none for another body."""
    if not set(JOINT_NAMES) <= set(scene.body.joint_names):
        return ()
    kick = make_motion("kick", scene.body, seconds=5.0)
    twirl = make_motion("twirl", scene.body, seconds=6.0)
    return (("kick", kick), ("twirl", twirl), ("dance", make_dance(scene.body, seconds=12.0)))


def hardest_pose(subject: Subject) -> tuple[str, Motion]:
    """Return the frame in which hips or knees bend most, as a motion of one frame, and its name.

    For a body without the usual leg joints any joint but the root counts. The canonical pose, where there
    is no motion.
    """
    body, best = subject.scene.body, (-1.0, "canonical pose", canonical_pose(subject.scene))
    named = [body.joint_names.index(name) for name in LEGS if name in body.joint_names]
    joints = np.array(named or range(1, len(body.joint_names)), int)
    for name, motion in subject.motions:
        angle = relative_angles(motion, body.parents, joints).max(axis=1)
        t = int(angle.argmax())
        if angle[t] > best[0]:
            one = Motion(motion.rotations[t : t + 1], motion.root[t : t + 1], motion.fps)
            best = (float(angle[t]), f"{name}, frame {t}, {np.degrees(angle[t]):.0f}°", one)
    return best[1], best[2]


def relative_angles(motion: Motion, parents: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Return the angles `[t, k]` (radians) of `joints` against their parents."""
    R = motion.rotations.astype(np.float64)
    local = np.swapaxes(R[:, parents[joints]], -1, -2) @ R[:, joints]
    cosine = (np.trace(local, axis1=-2, axis2=-1) - 1.0) / 2.0
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def canonical_pose(scene: Scene) -> Motion:
    """Return the canonical pose as a motion of one frame."""
    joints = scene.body.joints
    return Motion(
        np.tile(np.eye(3, dtype=np.float32), (1, len(joints), 1, 1)), joints[:1].astype(float), 30.0
    )


def root_frame_collider(scene: Scene, motion: Motion) -> np.ndarray:
    """Return the collider's vertices `[t, c, 3]` float32 metres in the motion's root frames."""
    assert scene.collider is not None
    body = pose_body(scene.body, motion, slice(None)).astype(np.float64)
    posed = to_root(body, motion.root.astype(np.float64), heading(motion.rotations[:, 0]))
    return collider_points(scene.collider, posed).astype(np.float32)
