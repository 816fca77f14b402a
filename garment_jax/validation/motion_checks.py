"""Checks on motion files of their own: BVH, and the arrays of AMASS, AIST++ and of simulations (npz, pkl)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.bvh import read_bvh
from garment_jax.body.joint_names import roles_of
from garment_jax.body.local_axes import NEEDED
from garment_jax.body.rates import RATE_KEYS, rate_of_frame_time
from garment_jax.body.retarget import settle_world
from garment_jax.body.skeleton_track import SkeletonTrack, world_positions
from garment_jax.body.up_axis import axis_name, leg_length
from garment_jax.importers.finding import Finding
from garment_jax.importers.jumps import PERSON
from garment_jax.validation.body_checks import likely_units
from garment_jax.validation.point_checks import check_points
from garment_jax.validation.track_checks import check_track

# Headers of motion files lie about the rate, so half the joints above this is worth a note.
HEADER_USUAL = (
    0.95  # metres per second, the joints' median; 12 dances of a data base reach 0.72 at true rates
)
PERSON_LEGS = 1.0  # a person's height over the length of both legs, about
_SIDES = "name left and right joints as the knees bend and the toes point"
_LIMB = 0.25  # metres: what a joint's own turn moves, where there is no skeleton
_POSES, _PLACES = ("poses", "pose", "smpl_poses"), ("trans", "translation", "smpl_trans")
_FRAMES = ("vertices", "sim_res")
READ = (*_POSES, *_PLACES, *RATE_KEYS, *_FRAMES, "faces", "smpl_scaling")  # arrays that are looked at


def check_bvh(path: Path, *, fps: float | None = None) -> list[Finding]:
    """Return the findings on a BVH file; `fps`: its true rate where the header lies. Raises as `read_bvh`."""
    clip = read_bvh(path)
    points = world_positions(clip)
    size = float(np.ptp(points[0], axis=0).max())
    if not size > 0:
        return [
            Finding("skeleton", "error", "all joints are in one place", remedy="export it with its bones")
        ]
    found = [Finding("frames", "note", note) for note in clip.notes]
    found += _skeleton(clip, points)
    rate = fps or rate_of_frame_time(clip.frame_time)
    return [*found, *check_track(points * (PERSON / size), rate, usual=HEADER_USUAL)]


def _skeleton(clip: SkeletonTrack, points: np.ndarray) -> list[Finding]:
    """Return what `import` would say of the skeleton, its rest pose, its sides and its up axis."""
    roles = roles_of(clip.joint_names, clip.parents)
    lacking = [role for role in NEEDED if role not in roles]
    if lacking:
        remedy = "import it with a table of joint names, --joints"
        return [Finding("joint names", "note", f"no joint is known as {', '.join(lacking)}", remedy=remedy)]
    size = PERSON_LEGS * leg_length(points, roles)
    units = " or ".join(likely_units(size)) or "an unknown unit"
    found = [
        Finding("skeleton unit", "ok", f"about {size:.4g} tall ({units}); the legs' lengths set the scale")
    ]
    try:
        standing, axis = settle_world(clip, points, roles)
    except ValueError as error:
        return [*found, Finding("left and right", "error", str(error).partition("; ")[0], remedy=_SIDES)]
    if standing is None:
        value = "the rest pose is none that stands; it is retargeted by the posed bones' directions"
        found.append(Finding("rest pose", "note", value))
    if axis.note:
        found.append(Finding("up axis", "note", axis.note))
    else:
        found.append(Finding("up axis", "ok", axis.axis))
    return found


def is_motion(arrays: Mapping[str, Any]) -> bool:
    """Return whether arrays by name are a motion or a simulation that is read."""
    return any(name in arrays for name in _POSES + _FRAMES)


def check_arrays(arrays: Mapping[str, Any], *, fps: float | None = None) -> list[Finding]:
    """Return the findings on poses `[t, 3 j]`, root positions `[t, 3]` and vertices `[t, n, 3]`, by name."""
    poses, places = _first(arrays, _POSES), _first(arrays, _PLACES)
    vertices, rate = _first(arrays, _FRAMES), _first(arrays, RATE_KEYS)
    found = [_frame_counts({"poses": poses, "root": places, "vertices": vertices})]
    if found[0].severity == "error":
        return found
    rate = fps or (float(np.asarray(rate).reshape(-1)[0]) if rate is not None else None)
    if poses is not None:
        found += _poses(np.asarray(poses, np.float64), places, arrays, rate)
    if vertices is not None:
        faces = arrays.get("faces")
        faces = None if faces is None else np.asarray(faces, np.int32)
        found += check_points(np.asarray(vertices), faces, rate, unit=None)
    return found


def _first(arrays: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    return next((arrays[name] for name in names if arrays.get(name) is not None), None)


def _frame_counts(parts: Mapping[str, Any]) -> Finding:
    counts = {name: len(values) for name, values in parts.items() if values is not None}
    if len(set(counts.values())) == 1:
        return Finding("frame count", "ok", f"{next(iter(counts.values()))}")
    listed = ", ".join(f"{name} {count}" for name, count in counts.items())
    return Finding(
        "frame count",
        "error",
        f"body and garment differ in frames: {listed}",
        remedy="export both over the same frames; check for one frame more or less, and the rate",
    )


def _poses(poses: np.ndarray, places: Any, arrays: Mapping[str, Any], fps: float | None) -> list[Finding]:
    t = len(poses)
    flat = poses.reshape(t, -1)
    if places is None and flat.shape[1] == 75:  # 72 and the translation
        flat, places = flat[:, :72], flat[:, 72:]
    if flat.shape[1] % 3:
        message = f"poses have {flat.shape[1]} values a frame"
        return [Finding("poses", "error", message, remedy="store 3 numbers a joint (axis times angle)")]
    root = np.zeros((t, 3)) if places is None else np.asarray(places, np.float64).reshape(t, -1)[:, :3]
    scale = arrays.get("smpl_scaling")
    root = root / float(np.asarray(scale).reshape(-1)[0]) if scale is not None else root
    finite = np.isfinite(flat).all(axis=1) & np.isfinite(root).all(axis=1)
    if not finite.all():
        frame = int(np.flatnonzero(~finite)[0])
        message = f"{int((~finite).sum())} frames hold values that are not finite"
        return [Finding("NaN", "error", message, f"frame {frame}", "cut that part out of the clip")]
    turns = Rotation.from_rotvec(flat.reshape(-1, 3)).as_matrix().reshape(t, -1, 3, 3)
    limbs = np.concatenate([turns[..., 0], turns[..., 1]], axis=1)  # two axes of each joint's frame
    found = check_track(_LIMB * limbs + root[:, None], fps)
    if fps is None:
        found.append(
            Finding("frame rate", "note", "the file names none", remedy="give --fps when it is imported")
        )
    return [*found, _stands(turns[:, 0])]


def _stands(root: np.ndarray) -> Finding:
    up = root[:, :, 1].mean(axis=0)
    axis = axis_name(up)
    if axis == "Y" or abs(up).max() < 0.7:
        return Finding("up axis", "ok", "Y")
    return Finding(
        "up axis",
        "note",
        f"the body stands along {axis}",
        remedy="fine for AMASS; name the up axis when importing",
    )
