"""Any motion on a body as the package has it: world rotations from the canonical pose, metres, Y up.

Every format becomes a `SkeletonTrack`, a motion on the skeleton of its own file, and all of these are put on
the body in one way (`body.retarget`): by the joints' names and the directions of bones, with the up axis that
the posed skeleton shows and the size of its legs.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.bvh import read_bvh
from garment_jax.body.retarget import retarget, source_rate
from garment_jax.body.skeleton_track import SkeletonTrack
from garment_jax.importers.jumps import leading_frames, track_speeds
from garment_jax.importers.units import metres_per_unit, settle_unit
from garment_jax.io.formats.aist import is_aist, read_aist
from garment_jax.io.formats.amass import is_amass, read_amass
from garment_jax.io.formats.damage import reads_foreign
from garment_jax.io.formats.fbx import reads_fbx
from garment_jax.io.formats.gltf import read_animation
from garment_jax.io.formats.npz import npz_names
from garment_jax.io.formats.pickles import load_pickle
from garment_jax.io.formats.rotation_vectors import SmplMotion
from garment_jax.io.formats.smpl import standard_joints, standard_parents
from garment_jax.io.formats.virtual_bones import is_virtual_bones, read_virtual_bones
from garment_jax.io.formats.vto import is_vto, read_vto
from garment_jax.io.sequence import open_sequence
from garment_jax.storage.missing import not_a_file
from garment_jax.structs import Motion, RiggedBody

UNIT = "--motion-unit"  # of every command that reads motions
SUFFIXES = (".bvh", ".npz", ".pkl", ".glb", ".gltf", ".fbx", ".h5")
Say = Callable[[str], None]


class FoundTrack(NamedTuple):
    """A motion as its file has it, with what its format says."""

    track: SkeletonTrack
    rate: float | None  # frames a second; None where the file does not say
    up: str  # the axis that the format has up
    metres: float | None  # per unit of the track; None: by the legs' lengths alone


@reads_fbx
@reads_foreign
@reads_foreign
def read_motion(
    path: str | Path,
    body: RiggedBody,
    *,
    fps: float | None = None,
    source_fps: float | None = None,
    joints: Mapping[str, str] | None = None,
    skip: int | None = 0,
    floor: bool = False,
    centre: bool = True,
    rest_frame: int | None = None,
    unit: float | str | None = None,
    up: str | None = None,
    rest_up: str | None = None,
    origin: np.ndarray | None = None,
    animation: str | None = None,
    mesh: str | None = None,
    skeleton: str | None = None,
    say: Say | None = None,
) -> Motion:
    """Read a motion of `body` at `fps` (the file's own rate by default): rotations float32, root float64.

    BVH, AMASS and VirtualBones `.npz`, AIST++ and vto-dataset `.pkl`, glTF, FBX, or a sequence file.
    `source_fps`: the file's true rate, where it does not say or lies. `joints`: body joint -> file joint (by
    names without it). `skip`: frames to drop at the beginning, None: a rest pose and the jump out of it.
    `floor` lifts the motion by one constant: in the median frame the lowest joint is as high as in the
    canonical pose. `centre` begins a BVH at x = z = 0, the others stay where they are. `rest_frame`: that
    in which the file's skeleton stands in a T- or A-pose, where its rest pose does not. `unit` and `up`
    replace what the format says; `rest_up` is the axis that was up in the body's file: a glTF motion turns
    its joints from that rest pose, and has that axis without `up`. `origin` `[3]`: the body file's own origin
    (`LoadedBody.origin`), from which SMPL's translations count.
    `animation`, `mesh` and `skeleton` choose of a glTF that holds several (`formats.gltf.read_animation`).
    `say` takes what was decided for the user. Raises `FileNotFoundError`, `OSError` or `ValueError`, by file.
    """
    path, say = Path(path), say or (lambda _: None)
    if not path.is_file():
        raise not_a_file(path, f"name a motion ({', '.join(SUFFIXES)})")
    chosen = {"animation": animation, "motion-mesh": mesh, "motion-skeleton": skeleton}
    if path.suffix.lower() not in (".glb", ".gltf") and any(chosen.values()):
        option = next(name for name, value in chosen.items() if value)
        raise ValueError(f"{path} holds one motion; leave out --{option}.")
    bvh, gltf = path.suffix.lower() == ".bvh", path.suffix.lower() in (".glb", ".gltf")
    try:
        found = read_track(
            path,
            body,
            joints=joints,
            fps=fps,
            source_fps=source_fps,
            unit=unit,
            origin=origin,
            choice=(animation, mesh, skeleton),
            say=say,
        )
        if gltf:
            source_fps = None  # it has counted already
    except ValueError as error:
        raise ValueError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    rate = found.rate if source_fps is None else source_fps
    if rate is None:
        raise ValueError(f"{path}: the file does not say its frame rate; give --source-fps, for example 30.")
    dropped = skip or 0
    begins = leading_frames(track_speeds(found.track, rate)[dropped:])
    if begins and skip is None:
        say(f"{path}: {begins} rest-pose frame{'s' * (begins > 1)} left out (--skip 0 keeps them)")
    elif begins:
        say(f"{path}: it jumps out of a rest pose; --skip {dropped + begins} leaves that out")
    try:
        return retarget(
            found.track,
            body,
            joints=joints,
            fps=rate if fps is None else fps,
            source_fps=rate,
            skip=begins if skip is None else dropped,
            scale=found.metres if bvh else None,
            metres=None if bvh else found.metres,
            floor=floor,
            centre=centre and bvh,
            up=up or (rest_up if gltf else None),
            usual_up=found.up,
            rest_frame=rest_frame,
            say=lambda note: say(f"{path}: {note}"),
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def read_track(
    path: Path,
    body: RiggedBody,
    *,
    joints: Mapping[str, str] | None = None,
    fps: float | None = None,
    source_fps: float | None = None,
    unit: float | str | None = None,
    origin: np.ndarray | None = None,
    choice: tuple[str | None, str | None, str | None] = (None, None, None),
    say: Say = lambda _: None,
) -> FoundTrack:
    """Return the motion of a file on its own skeleton; the options and what is raised as in `read_motion`."""
    suffix = path.suffix.lower()
    if suffix == ".bvh":
        track = read_bvh(path, root=None if joints is None else joints.get(body.joint_names[0]))
        found = FoundTrack(
            track, source_rate(track), "Y", None if unit is None else metres_per_unit(unit, UNIT)
        )
    elif suffix in (".npz", ".pkl"):
        motion, size = read_smpl_motion(path)
        settled = settle_unit(motion.unit, unit, size, f"{path}: the garment", UNIT)
        if settled.note:
            say(settled.note)
        track = smpl_track(motion, body, unit=settled.metres, origin=origin)
        found = FoundTrack(track._replace(notes=motion.notes), motion.rate, motion.up, 1.0)
    elif suffix == ".h5":
        track, fps = _sequence(path)
        found = FoundTrack(track, fps, "Y", metres_per_unit(unit or 1.0, UNIT))
    elif suffix in (".glb", ".gltf"):
        track, fps = _gltf(path, body, fps, source_fps, choice)
        found = FoundTrack(track, fps, "Y", metres_per_unit(unit or 1.0, UNIT))
    else:
        raise ValueError(f"{path} is no motion that is known; give one of {', '.join(SUFFIXES)}.")
    for note in found.track.notes:
        say(f"{path}: {note}")
    return found


def _gltf(
    path: Path,
    body: RiggedBody,
    fps: float | None,
    source_fps: float | None,
    choice: tuple[str | None, str | None, str | None],
) -> tuple[SkeletonTrack, float]:
    name, mesh, skeleton = choice
    moved = read_animation(
        path,
        name=name,
        fps=fps,
        source_fps=source_fps,
        mesh=mesh,
        skeleton=skeleton,
        like=body.joint_names,
        part="motion",
    )
    return (
        _track(moved.joint_names, moved.parents, moved.rest, moved.rotations, moved.root)._replace(
            notes=tuple(moved.notes), moved=moved.moved
        ),
        moved.fps,
    )


def _track(
    names: tuple[str, ...], parents: np.ndarray, rest: np.ndarray, rotations: np.ndarray, root: np.ndarray
) -> SkeletonTrack:
    """Return a track on a skeleton whose joints stand at `rest` `[j, 3]`."""
    rest = rest.astype(np.float64)
    offsets = rest - np.where(parents[:, None] >= 0, rest[parents], 0.0)
    return SkeletonTrack(names, parents, offsets, rotations, root.astype(np.float64), np.nan)


def _sequence(path: Path) -> tuple[SkeletonTrack, float]:
    with open_sequence(path) as clip:
        motion, body = clip.motion, clip.scene.body
    return _track(body.joint_names, body.parents, body.joints, motion.rotations, motion.root), motion.fps


def read_smpl_motion(path: Path, content: Any = None) -> tuple[SmplMotion, float]:
    """Return the motion of an `.npz` file or a pickle, and the size of a garment in it whose unit is unsaid.

    `content` is that of the pickle, where it was loaded already. Raises as `read_motion`.
    """
    return _smpl_archive(path) if path.suffix.lower() == ".npz" else (_smpl_pickle(path, content), 0.0)


def _smpl_archive(path: Path) -> tuple[SmplMotion, float]:
    """Return the motion of an `.npz` file, and the size of the garment in it, if it has one."""
    if is_amass(path):
        return read_amass(path), 0.0
    if is_virtual_bones(path):
        clip = read_virtual_bones(path)
        first = clip.vertices[0][np.isfinite(clip.vertices[0]).all(axis=1)]
        return clip.motion, float(np.ptp(first, axis=0).max()) if len(first) else 0.0
    raise ValueError(
        f"{path} is no motion: it holds {', '.join(npz_names(path))[:200] or 'nothing'}; AMASS has poses and "
        "trans, VirtualBones pose, trans and sim_res."
    )


def _smpl_pickle(path: Path, content: Any = None) -> SmplMotion:
    content = load_pickle(path) if content is None else content
    if is_aist(content):
        return read_aist(path, content)
    if is_vto(content):
        return read_vto(path, content).motion
    raise ValueError(f"{path} is no motion: AIST++ has smpl_poses, a vto-dataset clip poses or pose.")


def smpl_track(
    motion: SmplMotion,
    body: RiggedBody,
    *,
    unit: float,
    origin: np.ndarray | None = None,
) -> SkeletonTrack:
    """Return a motion of the SMPL family on its own skeleton, in its file's world, metres.

    On a body of the family the skeleton is that of the body, the root as its shape places it; on another it
    is the family's mean. The root joint stands at its place in the rest pose, in the model's own frame, plus
    the translation.
    """
    names, parents = motion.joint_names, standard_parents(motion.poses.shape[1])
    t, j = motion.poses.shape[:2]
    rotations = Rotation.from_rotvec(motion.poses.reshape(-1, 3)).as_matrix().reshape(t, j, 3, 3)
    for k in range(1, j):
        rotations[:, k] = rotations[:, parents[k]] @ rotations[:, k]
    rest = standard_joints(j)
    own = {name: k for k, name in enumerate(body.joint_names)}
    if set(names[:22]) <= set(own):
        shift = np.zeros(3) if origin is None else origin
        rest = np.array([body.joints[own[n]] - shift if n in own else rest[k] for k, n in enumerate(names)])
    track = _track(names, parents, rest, rotations, rest[0] + unit * motion.translation)
    return track._replace(rest_is_another_world=True)
