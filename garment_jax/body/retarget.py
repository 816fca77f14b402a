"""Motion capture put on a rigged body: retargeting by bone directions.

Both skeletons stand upright in their rest poses, Y up and facing +Z; they differ in proportions and in how
far arms and legs are spread (a T-pose there, an A-pose here). So a joint takes its source joint's world
rotation from rest, R = R_source C, where C turns the body's limb bone along the shortest arc to the
source's, both at rest: the posed bone then points where the source's points and twists as it twists.
Torso, head, shoulders and feet have C = 1 (upright stays upright, a flat foot flat), a hand has its
forearm's.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.bvh import BvhClip
from garment_jax.body.kinematics import joint_positions
from garment_jax.body.resample import between, sample_times, slerp
from garment_jax.structs import Motion, RiggedBody

# Parts of the height of the body's joints: a limb's bone is at least this long (forearm 0.15; a shoulder
# and a foot 0.09), and a joint lower than this is a foot's.
LIMB, FOOT = 0.12, 0.1
_TORSO = {"Hips": "hip", "Spine": "abdomen", "Spine1": "chest", "Neck": "neck", "Head": "head"}
_SIDE = {
    "Shoulder": "Collar",
    "Arm": "Shldr",
    "ForeArm": "ForeArm",
    "Hand": "Hand",
    "UpLeg": "Thigh",
    "Leg": "Shin",
    "Foot": "Foot",
}
# The CMU data base goes round with two sets of names: those of the body itself and these.
CMU_JOINTS = _TORSO | {f"{s}{a}": f"{s[0].lower()}{b}" for s in ("Left", "Right") for a, b in _SIDE.items()}
NEEDED = ("Hips", *(f"{s}{n}" for s in ("Left", "Right") for n in ("Arm", "ForeArm", "UpLeg", "Leg", "Foot")))


def read_joint_table(path: str | Path) -> dict[str, str]:
    """Read a TOML of lines `body joint = "file joint"`, such as `LeftLeg = "lShin"`.

    Raises `FileNotFoundError` without the file and `ValueError` for anything but such lines; `retarget`
    refuses the names that the body or the motion file does not have.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f'{path}: no such file; give a TOML of lines like LeftLeg = "lShin".')
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not valid TOML: {error}; correct that line.") from error
    for name, source in table.items():
        if not isinstance(source, str):
            raise ValueError(f'{path}: {name} = {source!r} must be a joint\'s name, like LeftLeg = "lShin".')
    return table


def cmu_joint_table(clip: BvhClip, body: RiggedBody) -> dict[str, str]:
    """Return body joint -> file joint by the names of the CMU data base, either set of them.

    Capitals do not count, nor a prefix before a colon. Joints without a source are left out (they follow
    their parents); `ValueError` names those that a motion cannot do without.
    """
    found = {name.rpartition(":")[2].lower(): name for name in reversed(clip.joint_names)}
    table = {}
    for name in body.joint_names:
        source = found.get(name.lower()) or found.get(CMU_JOINTS.get(name, name).lower())
        if source is not None:
            table[name] = source
    missing = [name for name in NEEDED if name not in table]
    if missing:
        raise ValueError(
            f"no source for {', '.join(missing)} among the file's joints {', '.join(clip.joint_names)}; "
            "give a joint table (body joint -> file joint)."
        )
    return table


def retarget(
    clip: BvhClip,
    body: RiggedBody,
    *,
    joints: Mapping[str, str] | None = None,
    fps: float = 30.0,
    source_fps: float | None = None,
    skip: int = 0,
    scale: float | None = None,
    floor: bool = True,
    centre: bool = True,
) -> Motion:
    """Return `clip` as a motion of `body` at `fps`: rotations float32, root float64 in metres, Y up.

    `joints`: body joint -> file joint (default: `cmu_joint_table`); joints without a source follow their
    parents. `source_fps`: the clip's true rate, where its header lies. `skip`: frames of the file to drop at
    its beginning. `scale`: metres per file unit (default: the ratio of the legs' lengths). The root begins
    at x = z = 0; without `centre` it is where the file has it, times `scale`. `floor` lifts the whole motion
    by one constant: in the median frame the lowest joint is as high as in the canonical pose. Without it
    the root's height is scale x the file's.
    Raises `ValueError` for names that do not exist, a skeleton that is not Y up facing +Z, and options out
    of range.
    """
    table = dict(cmu_joint_table(clip, body) if joints is None else joints)
    sources = _source_indices(table, clip, body)
    rest = _rest_positions(clip)
    _check_orientation(sources, rest, body)
    bones = _limb_bones(sources, rest, body)
    if scale is None:
        scale = _leg_ratio(bones, sources, rest, body)
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"scale = {scale} must be positive; 0.01 for a file in cm.")
    rate = source_rate(clip) if source_fps is None else source_fps
    first, part = sample_times(len(clip.root), fps, rate, skip)
    turns = _alignments(bones, sources, rest, body)
    rotations = _target_rotations(clip, sources, turns, body, first, part)
    root = scale * between(clip.root, first, part)
    if centre:
        root[:, [0, 2]] -= root[0, [0, 2]]
    if floor:
        lowest = joint_positions(rotations, root, body)[..., 1].min(axis=1)
        root[:, 1] += body.joints[:, 1].min() - np.median(lowest)
    return Motion(rotations.astype(np.float32), root, float(fps))


def _source_indices(table: dict[str, str], clip: BvhClip, body: RiggedBody) -> np.ndarray:
    """Return each body joint's source `[j]`, -1 where it follows its parent."""
    unknown = [name for name in table if name not in body.joint_names]
    if unknown:
        raise ValueError(f"the body has no joint {unknown[0]!r}; it has {', '.join(body.joint_names)}.")
    unknown = [name for name in table.values() if name not in clip.joint_names]
    if unknown:
        raise ValueError(f"the file has no joint {unknown[0]!r}; it has {', '.join(clip.joint_names)}.")
    if body.joint_names[0] not in table:
        raise ValueError(f"the joint table lacks the body's root {body.joint_names[0]!r}; add its source.")
    return np.array([clip.joint_names.index(table[n]) if n in table else -1 for n in body.joint_names])


def _rest_positions(clip: BvhClip) -> np.ndarray:
    rest = np.zeros_like(clip.offsets)
    for j, parent in enumerate(clip.parents):
        rest[j] = clip.offsets[j] + rest[parent] if parent >= 0 else 0.0
    return rest


def _check_orientation(sources: np.ndarray, rest: np.ndarray, body: RiggedBody) -> None:
    mapped = np.flatnonzero(sources >= 0)
    here = body.joints[mapped].astype(np.float64) - body.joints[0]
    there = rest[sources[mapped]] - rest[sources[0]]
    for axis, size in ((1, np.linalg.norm(there)), (0, np.linalg.norm(there[:, 0]))):
        if here[:, axis] @ there[:, axis] < 0.5 * np.linalg.norm(here[:, axis]) * size:
            raise ValueError(
                "the file's rest pose does not stand Y up and face +Z with its left at +X; export it so, or "
                "check that the joint table does not mix left and right."
            )


def _limb_bones(sources: np.ndarray, rest: np.ndarray, body: RiggedBody) -> dict[int, int]:
    """Return joint -> the joint at its bone's other end, for arms and legs.

    A limb's bone lies beside the middle, is long, and has one end: torso bones fail the first, shoulders,
    feet and fingers the second.
    """
    x, height = body.joints.astype(np.float64), float(np.ptp(body.joints[:, 1]))
    ends: dict[int, list[int]] = {}
    for j in range(1, len(sources)):
        if sources[j] >= 0:
            ends.setdefault(_mapped_parent(j, sources, body), []).append(j)
    return {
        j: end[0]
        for j, end in ends.items()
        if len(end) == 1
        and abs(x[j, 0] - x[0, 0]) > 0.01 * height
        and np.linalg.norm(x[end[0]] - x[j]) > LIMB * height
        and np.linalg.norm(rest[sources[end[0]]] - rest[sources[j]]) > 0
    }


def _mapped_parent(j: int, sources: np.ndarray, body: RiggedBody) -> int:
    j = int(body.parents[j])
    while sources[j] < 0:
        j = int(body.parents[j])
    return j


def _is_foot(body: RiggedBody) -> np.ndarray:
    height = body.joints[:, 1]
    return height < height.min() + FOOT * np.ptp(height)


def _leg_ratio(bones: dict[int, int], sources: np.ndarray, rest: np.ndarray, body: RiggedBody) -> float:
    """Return the legs' length here over that in the file; a leg is a limb that ends at a foot."""
    x, foot = body.joints.astype(np.float64), _is_foot(body)
    legs = {j: end for j, end in bones.items() if foot[end] or (end in bones and foot[bones[end]])}
    here = sum(np.linalg.norm(x[end] - x[j]) for j, end in legs.items())
    there = sum(np.linalg.norm(rest[sources[end]] - rest[sources[j]]) for j, end in legs.items())
    if not legs:
        raise ValueError("the joint table holds no leg to compare lengths; give scale (0.01 for cm).")
    return float(here / there)


def _alignments(bones: dict[int, int], sources: np.ndarray, rest: np.ndarray, body: RiggedBody) -> np.ndarray:
    """Return C of every joint `[j, 3, 3]` (module docstring)."""
    x, foot = body.joints.astype(np.float64), _is_foot(body)
    C = np.tile(np.eye(3), (len(x), 1, 1))
    for j in range(1, len(x)):
        if j in bones:
            end = bones[j]
            C[j] = _shortest_turn(x[end] - x[j], rest[sources[end]] - rest[sources[j]])
        elif not foot[j]:
            C[j] = C[body.parents[j]]
    return C


def _shortest_turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the rotation by the smallest angle that takes direction `a` to `b`.

    Opposite directions have no shortest arc; they turn about the axis farthest from them.
    """
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis = np.cross(a, b)
    if np.linalg.norm(axis) < 1e-9:
        axis = np.cross(a, np.eye(3)[np.abs(a).argmin()])
    angle = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    return Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()


def source_rate(clip: BvhClip) -> float:
    """Return the frame rate that a clip's header claims, frames a second."""
    # headers round: 0.00833333 s is 120 frames a second, and a long clip must not drift
    rate = 1.0 / clip.frame_time
    return float(round(rate)) if abs(rate - round(rate)) < 1e-3 else rate


def _target_rotations(
    clip: BvhClip, sources: np.ndarray, C: np.ndarray, body: RiggedBody, first: np.ndarray, part: np.ndarray
) -> np.ndarray:
    rotations = np.zeros((len(first), len(sources), 3, 3))
    for j, source in enumerate(sources):
        if source < 0:
            rotations[:, j] = rotations[:, body.parents[j]]
            continue
        rotations[:, j] = slerp(clip.rotations[:, source], first, part) @ C[j]
    return rotations
