"""Motions alone: files of kind "motion", to be animated by a trained model."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.retarget import read_joint_table
from garment_jax.importers.import_checks import check_clip
from garment_jax.importers.motions import read_motion
from garment_jax.importers.own_files import Wardrobe
from garment_jax.importers.sources import ForeignClip, Options, Source
from garment_jax.io.sequence import open_sequence
from garment_jax.io.validation import FASTEST, FPS_TOLERANCE, check_same_garment
from garment_jax.structs import Garment, Motion, RiggedBody, Scene


def motion_sources(paths: Sequence[Path], options: Options) -> list[Source]:
    """Return the motions at `paths` on the body and in the garment that the options name.

    `ValueError` where either is not named.
    """
    wardrobe = Wardrobe(options, motions=paths)

    def read(path: Path) -> ForeignClip:
        motion, notes = wardrobe.motion(path, fps=options.fps, centre=True)
        return ForeignClip(wardrobe.dressed().scene, motion, None, (*notes, *wardrobe.dressed().notes))

    def source(path: Path) -> Source:
        return Source(path.stem, path, (path, *wardrobe.files()), lambda: read(path))

    return [source(path) for path in paths]


def put_on(path: Path, scene: Scene, *, fps: float, options: Options) -> ForeignClip:
    """Return the motion of a file on the body of `scene`, at `fps`; its notes say what was decided.

    Of `options` what concerns motions counts. Raises `FileNotFoundError`, `OSError` or `ValueError` in one
    sentence, also for joints that jump: a rest pose before the motion.
    """
    o, notes = options, []
    motion = read_motion(
        path,
        scene.body,
        fps=fps,
        source_fps=o.source_fps,
        joints=None if o.joints is None else read_joint_table(o.joints),
        skip=o.skip,
        floor=o.floor,
        unit=o.unit.get("motion"),
        up=o.up.get("motion"),
        animation=o.animation,
        mesh=o.mesh.get("motion"),
        skeleton=o.skeleton.get("motion"),
        rest_frame=o.rest_frame,
        say=notes.append,
    )
    clip = ForeignClip(scene, motion, None, tuple(notes))
    check_clip(clip, str(path))
    _check_jumps(motion, scene.body, path)
    return clip


def _check_jumps(motion: Motion, body: RiggedBody, path: Path) -> None:
    """Raise `ValueError` for a joint faster than any: files often begin with a rest pose and a jump."""
    places = joint_positions(motion.rotations, motion.root, body)
    speed = np.linalg.norm(np.diff(places, axis=0), axis=2) * motion.fps
    if speed.size and speed.max() > FASTEST:
        frame, joint = np.unravel_index(int(speed.argmax()), speed.shape)
        name, seconds = body.joint_names[joint], (frame + 1) / motion.fps
        raise ValueError(
            f"{path}: {name} moves at {speed.max():.3g} m/s at {seconds:.2f} s; drop a rest pose before the "
            "motion with --skip (in the file's frames), or cut the jump out."
        )


def of_same_garment(path: Path, garment: Garment, fps: float) -> bool:
    """Return whether a sequence file shows `garment` (to 0.1 mm) at the rate `fps`."""
    with open_sequence(path) as clip:
        try:
            check_same_garment(garment, clip.scene.garment)
        except ValueError:
            return False
        return abs(clip.fps / fps - 1) <= FPS_TOLERANCE
