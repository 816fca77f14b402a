"""A motion put on a rigged body, whatever skeleton it was made on: retargeting by bone directions.

A body's joint takes its source joint's world rotation from rest times two constants, R = W R_source C: W
turns the file's world to Y up, as the posed skeleton shows it (`up_axis`), and C takes the body's bone to the
source's (`local_axes`), so that the posed bone points where the source's points and twists as it twists.
Where both rest poses stand, C is 1 for torso, head, shoulders and feet (upright stays upright, a flat foot
flat), the shortest arc for limbs, and a hand has its forearm's.
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.joint_names import match_joints, missing_joints, plain_name, roles_of, table_to_fill
from garment_jax.body.kinematics import joint_positions
from garment_jax.body.local_axes import NEEDED as NEEDED_ROLES
from garment_jax.body.local_axes import alignments, shortest_turn, sides_agree, standing_axes, upright_axis
from garment_jax.body.rates import rate_of_frame_time
from garment_jax.body.resample import between, sample_times, slerp
from garment_jax.body.skeleton_track import SkeletonTrack, rest_positions, world_positions
from garment_jax.body.up_axis import TO_Y, UpAxis, axis_name, known_axis, leg_length, settle_up
from garment_jax.storage.missing import not_a_file
from garment_jax.structs import Motion, RiggedBody

_SAME_SIZE = 5e-3  # relative: legs this near are of one skeleton
# Parts of the height of the body's joints: a limb's bone is at least this long (forearm 0.15; a shoulder
# and a foot 0.09), and a joint lower than this is a foot's.
LIMB, FOOT = 0.12, 0.1


def read_joint_table(path: str | Path) -> dict[str, str]:
    """Read a TOML of lines `body joint = "file joint"`, such as `LeftLeg = "lShin"`.

    Raises `FileNotFoundError` without the file and `ValueError` for anything but such lines; `retarget`
    refuses the names that the body or the motion file does not have.
    """
    path = Path(path)
    if not path.is_file():
        raise not_a_file(path, 'give a TOML of lines like LeftLeg = "lShin"')
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not valid TOML: {error}; correct that line.") from error
    for name, source in table.items():
        if not isinstance(source, str):
            raise ValueError(f'{path}: {name} = {source!r} must be a joint\'s name, like LeftLeg = "lShin".')
    return table


class Alignment(NamedTuple):
    """How a file's joints are turned against the body's, and their world."""

    C: np.ndarray  # [j, 3, 3] body rotation = W R_source C
    W: np.ndarray  # [3, 3] from the file's world to Y up
    scale: float  # metres per file unit by the legs; NaN where the table holds none
    notes: tuple[str, ...]


def joint_table(
    track: SkeletonTrack, body: RiggedBody, joints: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Return body joint -> file joint: by names (`joint_names`), or the user's table `joints`.

    A table's joints may stand without the prefixes of body or file, and empty ones are left out. Joints
    without a source follow their parents. Raises `ValueError` for joints that there are not, and for those
    that a motion cannot do without, with a table to fill in.
    """
    if joints is not None:
        return {
            _called(name, body.joint_names): _called(source, track.joint_names)
            for name, source in joints.items()
            if source
        }
    table = match_joints(track.joint_names, track.parents, body.joint_names, body.parents)
    missing = missing_joints(table, body.joint_names, body.parents)
    if missing:
        lines = table_to_fill(table, body.joint_names, track.joint_names)
        raise ValueError(
            f"no source for {', '.join(missing)} among the file's joints; fill in this table (body joint = "
            f"file joint) and give it with --joints:\n{lines}"
        )
    return table


def _called(name: str, known: Sequence[str]) -> str:
    """Return the one of `known` that a name with or without prefix means; the name where none or several."""
    if name in known:
        return name
    plain = [other for other in known if plain_name(other).lower() == plain_name(name).lower()]
    return plain[0] if len(plain) == 1 else name


def retarget(
    track: SkeletonTrack,
    body: RiggedBody,
    *,
    joints: Mapping[str, str] | None = None,
    fps: float = 30.0,
    source_fps: float | None = None,
    skip: int = 0,
    scale: float | None = None,
    metres: float | None = None,
    floor: bool = True,
    centre: bool = True,
    up: str | None = None,
    usual_up: str = "Y",
    rest_frame: int | None = None,
    say: Callable[[str], None] | None = None,
) -> Motion:
    """Return `track` as a motion of `body` at `fps`: rotations float32, root float64 in metres, Y up.

    `joints`: body joint -> file joint (default: by names); joints without a source follow their parents.
    `source_fps`: the track's true rate, where its header lies. `skip`: frames of the file to drop at its
    beginning. `scale`: metres per file unit (default: the ratio of the legs' lengths, or `metres` where that
    is nearly that ratio, for the skeletons are one, or no legs are known). The root begins
    at x = z = 0; without `centre` it is where the file has it, times `scale`. `floor` lifts the whole motion
    by one constant: in the median frame the lowest joint is as high as in the canonical pose. Without it
    the root's height is scale x the file's. `up` is the file's up axis ("Y", "Z") where the user says it,
    `usual_up` the format's (`up_axis.settle_up`). `rest_frame`: the file's frame that is its rest pose, a
    T- or A-pose. `say` takes what was decided, a phrase each. Raises `ValueError` for names that do not
    exist, left and right exchanged, an up axis that the motion does not have, and options out of range.
    """
    table = joint_table(track, body, joints)
    sources = _source_indices(table, track, body)
    if rest_frame is not None:
        track = _from_frame(track, rest_frame, sources, body)
    found = align(track, body, sources, up=up, usual_up=usual_up)
    if scale is None:
        scale = found.scale
        if metres is not None and not abs(scale / metres - 1) > _SAME_SIZE:  # NaN, too
            scale = metres
        elif metres is not None and say is not None:
            say(f"scaled by {scale / metres:.3g}, the ratio of the legs' lengths")
    if np.isnan(found.scale) and np.isnan(scale):
        raise ValueError(
            "the joint table holds no leg to compare lengths; give --motion-unit cm, or the legs' joints."
        )
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"scale = {scale} must be positive; 0.01 for a file in cm.")
    for note in found.notes:
        (say or (lambda _: None))(note)
    rate = source_rate(track) if source_fps is None else source_fps
    first, part = sample_times(len(track.root), fps, rate, skip)
    rotations = _target_rotations(track, sources, found, body, first, part)
    root = _root_path(track, body, sources, scale, found, rotations, first, part)
    if centre:
        root[:, [0, 2]] -= root[0, [0, 2]]
    if floor:
        lowest = joint_positions(rotations, root, body)[..., 1].min(axis=1)
        root[:, 1] += body.joints[:, 1].min() - np.median(lowest)
    return Motion(rotations.astype(np.float32), root, float(fps))


def _root_path(
    track: SkeletonTrack,
    body: RiggedBody,
    sources: np.ndarray,
    scale: float,
    found: Alignment,
    rotations: np.ndarray,
    first: np.ndarray,
    part: np.ndarray,
) -> np.ndarray:
    """Return joint 0's path `[t, 3]`, metres: where the hips are as far along as the file's, times `scale`.

    Of a body whose hips hang below its root, the root goes where its hips then are where they should be.
    """
    hips = _body_roles(track, body, sources).get("Hips", 0)
    hips = hips if sources[hips] >= 0 else 0
    path = world_positions(track)[:, sources[hips]] if sources[hips] else track.root.astype(np.float64)
    root = scale * between(path, first, part) @ found.W.T
    if hips:
        root -= joint_positions(rotations, np.zeros_like(root), body)[:, hips]
    return root


def align(
    track: SkeletonTrack,
    body: RiggedBody,
    sources: np.ndarray,
    *,
    up: str | None = None,
    usual_up: str = "Y",
) -> Alignment:
    """Return how a track's joints are turned against the body's, whose `sources` `[j]` they are."""
    up = None if up is None else known_axis(up)
    roles = _body_roles(track, body, sources)
    at = {role: int(sources[j]) for role, j in roles.items() if sources[j] >= 0}
    if not set(NEEDED_ROLES) <= set(at):
        return _by_shape(track, body, sources, up or usual_up)
    positions = world_positions(track)
    rest = rest_positions(track)
    standing, axis = settle_world(track, positions, at, up=up, usual_up=usual_up)
    C = alignments(track.rotations, positions, rest, sources, body, roles)
    legs = leg_length(body.joints[None].astype(np.float64), roles)
    scale = legs / leg_length(positions, at)
    notes = [axis.note] if axis.note else []
    still = [name for name, source in zip(body.joint_names, sources, strict=True) if source < 0]
    if still:
        shown = ", ".join(still[:6]) + (", …" if len(still) > 6 else "")
        notes.append(f"{len(still)} joints have no source and follow their parents: {shown}")
    if standing is None:
        notes.append("its rest pose is none that stands: retargeted by the posed bones' directions")
    else:
        apart = max(np.degrees(Rotation.from_matrix(standing.T @ C).magnitude()))
        if apart > 1.0:
            notes.append(
                f"its rest pose is {apart:.0f} degrees from the body's: retargeted by bone directions"
            )
    return Alignment(C, TO_Y[axis.axis], scale, tuple(notes))


def settle_world(
    track: SkeletonTrack,
    positions: np.ndarray,
    at: Mapping[str, int],
    *,
    up: str | None = None,
    usual_up: str = "Y",
) -> tuple[np.ndarray | None, UpAxis]:
    """Return how the rest pose stands (`standing_axes`) and which axis is up: what import asks of a track.

    `positions` `[t, j, 3]` are the track's; `at`: role -> its joint. Raises `ValueError` for left and right
    exchanged, and as `settle_up`.
    """
    standing = standing_axes(rest_positions(track), at)
    rest_up = None if standing is None or track.rest_is_another_world else axis_name(standing[:, 1])
    axis = settle_up(positions, at, usual=usual_up, said=up, rest_up=rest_up)
    if not sides_agree(positions, at):
        raise ValueError(
            "left and right are exchanged, knees and toes point backwards; check that the joint table does "
            "not mix left and right."
        )
    return standing, axis


def _body_roles(track: SkeletonTrack, body: RiggedBody, sources: np.ndarray) -> dict[str, int]:
    """Return what the body's joints are by their names, else by those of their sources."""
    roles = roles_of(body.joint_names, body.parents)
    there = {k: role for role, k in roles_of(track.joint_names, track.parents).items()}
    known = set(roles.values())
    return {there[int(s)]: j for j, s in enumerate(sources) if int(s) in there and j not in known} | roles


def _from_frame(track: SkeletonTrack, frame: int, sources: np.ndarray, body: RiggedBody) -> SkeletonTrack:
    """Return the same motion with its pose in `frame`, turned to face +Z with Y up, as the rest pose."""
    if not 0 <= frame < len(track.root):
        raise ValueError(
            f"--rest-frame {frame} is none of {len(track.root)} frames; take 0 to {len(track.root) - 1}."
        )
    positions = world_positions(
        track._replace(
            root=track.root[frame : frame + 1],
            rotations=track.rotations[frame : frame + 1],
            moved={j: offset[frame : frame + 1] for j, offset in track.moved.items()},
        )
    )
    roles = _body_roles(track, body, sources)
    at = {role: int(sources[j]) for role, j in roles.items() if sources[j] >= 0}
    if not set(NEEDED_ROLES) <= set(at):
        raise ValueError(
            f"--rest-frame {frame} needs hips, neck, arms and legs; name their joints with --joints."
        )
    left = positions[0, at["LeftUpLeg"]] - positions[0, at["RightUpLeg"]]
    up = TO_Y[upright_axis(positions, at)[0]][1]
    x = left - (left @ up) * up
    x /= np.linalg.norm(x)
    Q = np.stack([x, up, np.cross(x, up)], axis=1)  # from the new rest pose's axes to that frame's world
    R = track.rotations[frame].astype(np.float64)
    offsets = track.offsets.copy()
    for j in range(1, len(offsets)):
        offsets[j] = (positions[0, j] - positions[0, track.parents[j]]) @ Q
    turned = np.swapaxes(R, -1, -2) @ Q
    new = track._replace(
        rotations=track.rotations.astype(np.float64) @ turned,
        offsets=offsets,
        moved={j: offset @ turned[track.parents[j]] for j, offset in track.moved.items()},
    )
    if standing_axes(rest_positions(new), at) is None:
        raise ValueError(
            f"--rest-frame {frame}: the body does not stand in a T- or A-pose there; name another frame."
        )
    return new


def _by_shape(track: SkeletonTrack, body: RiggedBody, sources: np.ndarray, up: str) -> Alignment:
    """Return the alignment of a table that lacks limbs: by the rest poses, both upright and facing +Z."""
    rest = rest_positions(track)
    _check_orientation(sources, rest, body)
    bones = _limb_bones(sources, rest, body)
    scale = _leg_ratio(bones, sources, rest, body)
    return Alignment(_alignments(bones, sources, rest, body), TO_Y[up], scale, ())


def _source_indices(table: dict[str, str], track: SkeletonTrack, body: RiggedBody) -> np.ndarray:
    """Return each body joint's source `[j]`, -1 where it follows its parent."""
    unknown = [name for name in table if name not in body.joint_names]
    if unknown:
        raise ValueError(f"the body has no joint {unknown[0]!r}; it has {', '.join(body.joint_names)}.")
    unknown = [name for name in table.values() if name not in track.joint_names]
    if unknown:
        raise ValueError(f"the file has no joint {unknown[0]!r}; it has {', '.join(track.joint_names)}.")
    hips = body.joint_names[roles_of(body.joint_names, body.parents).get("Hips", 0)]
    if body.joint_names[0] not in table and hips not in table:
        raise ValueError(f"the joint table lacks the body's root {body.joint_names[0]!r}; add its source.")
    return np.array([track.joint_names.index(table[n]) if n in table else -1 for n in body.joint_names])


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
    return float(here / there) if legs else float("nan")


def _alignments(bones: dict[int, int], sources: np.ndarray, rest: np.ndarray, body: RiggedBody) -> np.ndarray:
    """Return C of every joint `[j, 3, 3]` (module docstring)."""
    x, foot = body.joints.astype(np.float64), _is_foot(body)
    C = np.tile(np.eye(3), (len(x), 1, 1))
    for j in range(1, len(x)):
        if j in bones:
            end = bones[j]
            C[j] = shortest_turn(x[end] - x[j], rest[sources[end]] - rest[sources[j]])
        elif not foot[j]:
            C[j] = C[body.parents[j]]
    return C


def source_rate(track: SkeletonTrack) -> float:
    """Return the frame rate that a clip's header means, frames a second."""
    return rate_of_frame_time(track.frame_time)


def _target_rotations(
    track: SkeletonTrack,
    sources: np.ndarray,
    found: Alignment,
    body: RiggedBody,
    first: np.ndarray,
    part: np.ndarray,
) -> np.ndarray:
    rotations = np.zeros((len(first), len(sources), 3, 3))
    for j, source in enumerate(sources):
        if source < 0:  # a root without a source, above the hips, stays as it is
            rotations[:, j] = rotations[:, body.parents[j]] if j else np.eye(3)
            continue
        R = slerp(track.rotations[:, source].astype(np.float64), first, part)
        rotations[:, j] = found.W @ R @ found.C[j]
    return rotations
