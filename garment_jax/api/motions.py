"""What a user calls a motion, on the model's body and at its rate: a file, arrays, or nothing: the sample."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from garment_jax.api.arguments import a_flag, a_number, a_path, a_text, an_integer, optional, shown, takes
from garment_jax.api.model_argument import a_model

if TYPE_CHECKING:
    from garment_jax.api.loaded import LoadedModel
    from garment_jax.importers.sources import Options
    from garment_jax.model.scene_file import Sample
    from garment_jax.structs import Motion, Scene


class Moving(NamedTuple):
    """A motion in the scene that it moves."""

    scene: "Scene"
    motion: "Motion"
    name: str


@takes(
    model=a_model,
    file=a_path,
    joints=optional(a_path),
    source_fps=optional(a_number),
    skip=an_integer,
    rest_frame=optional(an_integer),
    floor=a_flag,
    unit=optional(a_text),
    up=optional(a_text),
    animation=optional(a_text),
)
def motion(
    model: "LoadedModel",
    file: str | Path,
    *,
    joints: str | Path | None = None,
    source_fps: float | None = None,
    skip: int | None = None,
    rest_frame: int | None = None,
    floor: bool = True,
    unit: str | None = None,
    up: str | None = None,
    animation: str | None = None,
) -> "Motion":
    """Return a motion file (BVH, glTF, AMASS, AIST++, a sequence file) on the model's body, at its rate.

    A NamedTuple of rotations `[t, j, 3, 3]` (world, from the canonical pose), root `[t, 3]` (metres, world, Y
    up) and fps. `joints`: a table of joint names, .toml. `source_fps`: the true rate, where the file does not
    say. `skip`: first frames to drop, by default a rest pose and the jump out of it; `rest_frame`: the frame
    that is a rest pose. `floor` lifts the feet to the floor. `unit` (m, cm, mm, in) and `up` (Y, Z): as the
    file's are not. `animation`: the one to take of several. Raises `ValueError` or `OSError` in one sentence.

        walk = gj.motion(model, "walk.bvh")
    """
    from garment_jax.importers.motion_clips import put_on
    from garment_jax.importers.sources import Options

    options = Options(
        joints=None if joints is None else Path(joints),
        source_fps=source_fps,
        skip=skip,
        rest_frame=rest_frame,
        floor=floor,
        unit={} if unit is None else {"motion": unit},
        up={} if up is None else {"motion": up},
        animation=animation,
    )
    return put_on(Path(file), model.scene, fps=model.fps, options=options).motion


def a_motion(name: str, value: Any) -> Any:
    """Return a path, or a tuple that may be a motion: `from_arrays` looks into it."""
    if isinstance(value, tuple | list) and len(value) in (2, 3):
        return tuple(value)
    if not isinstance(value, str | Path):
        raise ValueError(
            f"{name}={shown(value)} is no motion; give a file, (rotations, root), or (rotations, root, fps)."
        )
    return a_path(name, value)


def from_arrays(model: "LoadedModel", given: tuple) -> "Motion":
    """Return arrays as a motion of the model's body, at its rate without fps; `ValueError` for none."""
    from garment_jax.io.validation import check_motion, to_motion

    motion = to_motion(given, "the motion", fps=model.fps)
    check_motion(motion, "the motion", joints=model.scene.body.joint_names)
    return motion


def moving(model: "LoadedModel", given: "tuple | str | Path | None") -> Moving:
    """Return a motion in its scene: a file's, the sample for None; `ValueError` for what is no motion."""
    from garment_jax.importers.motion_clips import put_on
    from garment_jax.importers.sources import Options
    from garment_jax.io.sequence import open_sequence
    from garment_jax.model.scene_file import Sample

    if given is None:
        return Moving(model.scene, model.motion, model.name)
    if not isinstance(given, str | Path):
        return Moving(model.scene, from_arrays(model, given), model.name)
    path, own = Path(given), Options(floor=True, skip=None)
    if as_it_stands(path, Sample(model.scene, model.motion, model.name), model.fps, own):
        with open_sequence(path) as clip:
            return Moving(clip.scene, clip.motion, clip.name)
    return Moving(model.scene, put_on(path, model.scene, fps=model.fps, options=own).motion, path.stem)


def as_it_stands(path: Path, sample: "Sample | None", fps: float, own: "Options") -> bool:
    """Return whether a file is a sequence of the model's garment at its rate, of which nothing is said.

    It stands as it is, with its own body. So does any sequence file where the garment is not known.
    """
    from garment_jax.importers.motion_clips import of_same_garment

    untouched = own._replace(floor=True, skip=own.skip or 0) == type(own)(floor=True)
    if path.suffix.lower() != ".h5" or not untouched:
        return False
    return sample is None or of_same_garment(path, sample.scene.garment, fps)


def motion_file(
    folder: str, sample: "Sample | None", motion: Path | None, fps: float, own: "Options", place: Path
) -> tuple[Path, tuple[str, ...]]:
    """Return a sequence file of a motion in the scene of the model in `folder`, and what was decided.

    That is the model's own scene file for no motion, and a sequence file that stands as it is; any other
    motion is put on the model's body, written into `place`. Raises `ValueError` where the model keeps no
    scene, and for what cannot be read or put on its body.
    """
    from garment_jax.importers.motion_clips import put_on
    from garment_jax.io.sequence_writer import SequenceWriter
    from garment_jax.model.scene_file import SCENE

    if motion is None:
        if sample is not None:
            return Path(folder) / SCENE, ()
    elif as_it_stands(motion, sample, fps, own):
        return motion, ()
    if motion is None or sample is None:
        raise ValueError(
            f"{folder} holds no {SCENE}, so its garment and body are not known; give a sequence file of "
            f"them as the motion, or save the model again: garment-jax save {folder} --scene CLIP.h5."
        )
    clip = put_on(motion, sample.scene, fps=fps, options=own)
    path = place / f"{motion.stem}.motion.h5"
    with SequenceWriter(path, sample.scene, clip.motion, encoding="none", attributes={"name": motion.stem}):
        pass
    return path, clip.notes
