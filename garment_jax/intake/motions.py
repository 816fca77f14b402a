"""Any motion on a body as the package has it: world rotations from the canonical pose, metres, Y up.

BVH files are retargeted by bone directions. All others bring the rotations of joints from the same rest pose
that the body has, or one like it: they go by the joints' names, and only onto bodies that have them.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.bvh import BvhClip, read_bvh
from garment_jax.body.kinematics import joint_positions
from garment_jax.body.resample import between, sample_times, slerp
from garment_jax.body.retarget import cmu_joint_table, retarget, source_rate
from garment_jax.formats.damage import reads_foreign
from garment_jax.formats.rotation_vectors import SmplMotion
from garment_jax.formats.smpl import standard_parents
from garment_jax.intake.units import metres_per_unit, settle_unit, turn_to_y_up
from garment_jax.structs import Motion, RiggedBody

SUFFIXES = (".bvh", ".npz", ".pkl", ".glb", ".gltf", ".h5")
_LEAST = 0.5  # part of the joints, of the smaller skeleton, that must be found in the other
_SIDE = {
    **{"collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand"},
    **{"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase"},
}
_MIDDLE = {
    **{"pelvis": "Hips", "spine1": "LowerBack", "spine2": "Spine", "spine3": "Spine1"},
    **{"neck": "Neck", "head": "Head"},
}
# SMPL's names of joints -> those of motion capture files
CAPTURE_NAMES = _MIDDLE | {f"{s.lower()}_{a}": f"{s}{b}" for s in ("Left", "Right") for a, b in _SIDE.items()}
Say = Callable[[str], None]


class _Track(NamedTuple):
    """A motion on the skeleton of its file; metres, Y up."""

    rotations: np.ndarray  # [t, j, 3, 3] world rotation of each joint from its rest pose
    root: np.ndarray  # [t, 3] world position of joint 0
    joint_names: tuple[str, ...]
    fps: float | None


@reads_foreign
def read_motion(
    path: str | Path,
    body: RiggedBody,
    *,
    fps: float | None = None,
    source_fps: float | None = None,
    joints: Mapping[str, str] | None = None,
    skip: int = 0,
    floor: bool = False,
    centre: bool = True,
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

    BVH, AMASS and VirtualBones `.npz`, AIST++ and vto-dataset `.pkl`, glTF, or a sequence file. `source_fps`:
    the file's true rate, where it does not say or lies. `joints`: body joint -> file joint (by names without
    it). `skip`: frames to drop at the beginning. `floor` lifts the whole motion by one constant: in the
    median frame the lowest joint is as high as in the canonical pose. `centre` begins a BVH at x = z = 0, the
    others stay where they are. `unit` and `up` replace what the format says; `rest_up` is the axis that was
    up in the body's file: a glTF motion turns its joints from that rest pose, and has that axis without `up`.
    `origin` `[3]`: the body file's own origin (`LoadedBody.origin`), from which SMPL's translations count.
    `animation`, `mesh` and `skeleton` choose of a glTF that holds several (`formats.gltf.read_animation`).
    `say` takes what was decided for the user. Raises `FileNotFoundError`, `OSError` or `ValueError`, by file.
    """
    path, say = Path(path), say or (lambda _: None)
    if not path.is_file():
        raise FileNotFoundError(f"{path} is not there; name a motion ({', '.join(SUFFIXES)}).")
    chosen = {"animation": animation, "motion-mesh": mesh, "motion-skeleton": skeleton}
    if path.suffix.lower() not in (".glb", ".gltf") and any(chosen.values()):
        option = next(name for name, value in chosen.items() if value)
        raise ValueError(f"{path} holds one motion; leave out --{option}.")
    if path.suffix.lower() == ".bvh":
        return _captured(path, body, joints, fps, source_fps, skip, floor, centre, unit, up)
    if path.suffix.lower() in (".glb", ".gltf"):
        if source_fps is not None:
            raise ValueError(f"{path}: a glTF's keys have times in seconds; leave --source-fps out.")
        up = up or rest_up
    choice = (animation, mesh, skeleton)
    track = _read_track(path, body, fps, unit, up, rest_up, origin, choice, say)
    try:
        return _on_body(track, body, joints, fps, source_fps, skip, floor, say)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _captured(
    path: Path,
    body: RiggedBody,
    joints: Mapping[str, str] | None,
    fps: float | None,
    source_fps: float | None,
    skip: int,
    floor: bool,
    centre: bool,
    unit: float | str | None,
    up: str | None,
) -> Motion:
    if up is not None and turn_to_y_up(up)[1, 1] != 1:
        raise ValueError(f"{path}: BVH files must stand Y up in their rest pose; export it so.")
    clip = read_bvh(path)
    rate = source_rate(clip) if source_fps is None else source_fps
    try:
        return retarget(
            clip,
            body,
            joints=joints or _capture_table(clip, body),
            fps=rate if fps is None else fps,
            source_fps=rate,
            skip=skip,
            scale=None if unit is None else metres_per_unit(unit),
            floor=floor,
            centre=centre,
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _capture_table(clip: BvhClip, body: RiggedBody) -> dict[str, str]:
    """Return body joint -> file joint by names, those of SMPL as well."""
    renamed = tuple(CAPTURE_NAMES.get(name, name) for name in body.joint_names)
    table = cmu_joint_table(clip, body._replace(joint_names=renamed))
    own = dict(zip(renamed, body.joint_names, strict=True))
    return {own[name]: source for name, source in table.items()}


def _read_track(
    path: Path,
    body: RiggedBody,
    fps: float | None,
    unit: float | str | None,
    up: str | None,
    rest_up: str | None,
    origin: np.ndarray | None,
    choice: tuple[str | None, str | None, str | None],
    say: Say,
) -> _Track:
    suffix = path.suffix.lower()
    if suffix in (".npz", ".pkl"):
        motion, size = read_smpl_motion(path)
        for note in motion.notes:
            say(f"{path}: {note}")
        settled = settle_unit(motion.unit, unit, size, f"{path}: the garment", "--motion-unit")
        if settled.note:
            say(settled.note)
        return smpl_track(motion, body, unit=settled.metres, up=up or motion.up, origin=origin)
    rest = np.eye(3)  # from the rest pose of the motion's file to the body's
    if suffix == ".h5":
        track = _sequence(path)
    elif suffix in (".glb", ".gltf"):
        from garment_jax.formats.gltf import read_animation

        name, mesh, skeleton = choice
        moved = read_animation(
            path,
            name=name,
            fps=fps or 30.0,
            mesh=mesh,
            skeleton=skeleton,
            like=body.joint_names,
            part="motion",
        )
        for note in moved.notes:
            say(f"{path}: {note}")
        track = _Track(moved.rotations, moved.root, moved.joint_names, moved.fps)
        rest = turn_to_y_up(rest_up or "Y")
    else:
        raise ValueError(f"{path} is no motion that is known; give one of {', '.join(SUFFIXES)}.")
    turn, metres = turn_to_y_up(up or "Y"), metres_per_unit(unit or 1.0)
    if unit is None and up is None:
        return track
    return track._replace(rotations=turn @ track.rotations @ rest.T, root=metres * track.root @ turn.T)


def _sequence(path: Path) -> _Track:
    from garment_jax.data.sequence import open_sequence

    with open_sequence(path) as clip:
        motion, names = clip.motion, clip.scene.body.joint_names
    return _Track(motion.rotations, motion.root, names, motion.fps)


def read_smpl_motion(path: Path, content: Any = None) -> tuple[SmplMotion, float]:
    """Return the motion of an `.npz` file or a pickle, and the size of a garment in it whose unit is unsaid.

    `content` is that of the pickle, where it was loaded already. Raises as `read_motion`.
    """
    return _smpl_archive(path) if path.suffix.lower() == ".npz" else (_smpl_pickle(path, content), 0.0)


def _smpl_archive(path: Path) -> tuple[SmplMotion, float]:
    """Return the motion of an `.npz` file, and the size of the garment in it, if it has one."""
    from garment_jax.formats.amass import is_amass, read_amass
    from garment_jax.formats.npz import npz_names
    from garment_jax.formats.virtual_bones import is_virtual_bones, read_virtual_bones

    if is_amass(path):
        return read_amass(path), 0.0
    if is_virtual_bones(path):
        clip = read_virtual_bones(path)
        return clip.motion, float(np.ptp(clip.vertices[0], axis=0).max())
    raise ValueError(
        f"{path} is no motion: it holds {', '.join(npz_names(path))[:200] or 'nothing'}; AMASS has poses and "
        "trans, VirtualBones pose, trans and sim_res."
    )


def _smpl_pickle(path: Path, content: Any = None) -> SmplMotion:
    from garment_jax.formats.aist import is_aist, read_aist
    from garment_jax.formats.pickles import load_pickle
    from garment_jax.formats.vto import is_vto, read_vto

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
    up: str,
    origin: np.ndarray | None = None,
) -> _Track:
    """Return a motion of the SMPL family on its own skeleton, the root as the body's shape places it.

    The root joint stands at its place in the rest pose, in the model's own frame, plus the translation, and
    only then is the world turned.
    """
    parents = standard_parents(motion.poses.shape[1])
    t, j = motion.poses.shape[:2]
    rotations = Rotation.from_rotvec(motion.poses.reshape(-1, 3)).as_matrix().reshape(t, j, 3, 3)
    for k in range(1, j):
        rotations[:, k] = rotations[:, parents[k]] @ rotations[:, k]
    turn = turn_to_y_up(up)
    rest = body.joints[0].astype(np.float64) - (np.zeros(3) if origin is None else origin)
    root = rest + unit * motion.translation
    return _Track(turn @ rotations, root @ turn.T, motion.joint_names, motion.fps)


def _on_body(
    track: _Track,
    body: RiggedBody,
    joints: Mapping[str, str] | None,
    fps: float | None,
    source_fps: float | None,
    skip: int,
    floor: bool,
    say: Say,
) -> Motion:
    rate = track.fps if source_fps is None else source_fps
    if rate is None:
        raise ValueError("the file does not say its frame rate; give --source-fps, for example 30.")
    sources = _sources(track.joint_names, body, joints, say)
    first, part = sample_times(len(track.root), rate if fps is None else fps, rate, skip)
    rotations = np.empty((len(first), len(sources), 3, 3), np.float32)
    for j, source in enumerate(sources):
        follows = rotations[:, body.parents[j]] if source < 0 else None
        rotations[:, j] = slerp(track.rotations[:, source], first, part) if follows is None else follows
    root = between(track.root.astype(np.float64), first, part)
    if floor:
        lowest = joint_positions(rotations, root, body)[..., 1].min(axis=1)
        root[:, 1] += body.joints[:, 1].min() - np.median(lowest)
    return Motion(rotations, root, float(rate if fps is None else fps))


def _sources(
    names: tuple[str, ...], body: RiggedBody, joints: Mapping[str, str] | None, say: Say
) -> list[int]:
    """Return the file's joint for each of the body's `[j]`, -1 where it follows its parent."""
    number = {name.lower(): k for k, name in enumerate(names)}
    table = {name: name for name in body.joint_names} if joints is None else joints
    wrong = [name for name in table if name not in body.joint_names]
    if wrong:
        raise ValueError(f"the body has no joint {wrong[0]!r}; it has {', '.join(body.joint_names)}.")
    wrong = [] if joints is None else [name for name in table.values() if name.lower() not in number]
    if wrong:
        raise ValueError(f"the file has no joint {wrong[0]!r}; it has {', '.join(names)}.")
    found = [number.get(table[name].lower(), -1) if name in table else -1 for name in body.joint_names]
    known = sum(source >= 0 for source in found)
    if found[0] != 0 or known < _LEAST * min(len(found), len(names)):
        raise ValueError(
            f"its joints {_few(names)} are not the body's {_few(body.joint_names)}; name the body that it "
            "was made for, or give a table with --joints (body joint -> file joint)."
        )
    if known < len(found):
        still = [name for name, source in zip(body.joint_names, found, strict=True) if source < 0]
        say(f"{len(still)} joints have no source and follow their parents: {_few(tuple(still))}")
    return found


def _few(names: tuple[str, ...]) -> str:
    return ", ".join(names[:6]) + (", …" if len(names) > 6 else "")
