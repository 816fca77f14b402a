"""The checks on clips at the border: what would train or animate nonsense is refused in one sentence.

What the layout of a file says (shapes, units by name, UVs) is checked when it is opened; here come the
values: lengths that look like another unit, frames that are not finite, clips in which nothing moves,
meshes and skeletons that differ from the model's.
"""

from collections.abc import Iterable
from collections.abc import Sequence as Many
from typing import Any, NamedTuple

import numpy as np

from garment_jax.body.frame_windows import FrameWindows, stretches
from garment_jax.body.motion_features import chosen_joints
from garment_jax.io.sequence import Sequence
from garment_jax.structs import Garment, Motion, RiggedBody, Scene

SMALLEST, LARGEST = 0.05, 5.0  # metres: extents of a garment or a body that wears it
STILL = 1e-4  # metres (and radians): movement below this is none
FARTHEST = 1e9  # of a coordinate in any unit: a number beyond is damage, and its square overflows
FARTHEST_ROOT = 2.0**14  # metres: beyond, float32 rounds the world's coordinates by more than 0.5 mm
FPS_TOLERANCE = 0.01  # relative; another frame rate means other velocities a frame
FASTEST = 30.0  # metres per second; the fastest sprinters reach 12


class ClipExtent(NamedTuple):
    """Where a clip's garment was and how much it moved; metres."""

    low: np.ndarray  # [3] world
    high: np.ndarray  # [3] world
    reach: float  # largest coordinate of a vertex relative to the root
    movement: float  # extent of the longest vertex path; in the world or relative to the root, the smaller


def check_clip(sequence: Sequence, *, joints: Iterable[str] = (), window: int = 64) -> ClipExtent:
    """Check a clip for training: units, joints, motion, and every vertex by windows.

    Raises ValueError naming the clip, and the frame where there is one.
    """
    check_simulated(sequence)
    check_input(sequence, joints=joints)
    check_moves(sequence.motion, str(sequence.path))
    extent = measure_extent(sequence, window=window)
    name = str(sequence.path)
    if not SMALLEST <= extent.reach <= LARGEST:
        raise ValueError(
            f"{name}: the garment reaches {extent.reach:.4g} m from the root, which looks like another unit; "
            "convert all lengths to metres."
        )
    if extent.movement < STILL:
        raise ValueError(
            f"{name} is static: no vertex moves more than {extent.movement * 1e3:.3f} mm; leave it out or "
            "export it again with its animation."
        )
    return extent


def check_simulated(sequence: Sequence) -> None:
    """Raise ValueError if the file says that its garment was predicted: that is nothing to learn from."""
    if sequence.attributes.get("kind") == "predicted":
        raise ValueError(
            f"{sequence.path} is predicted, not simulated; give the clip that it was predicted for, or leave "
            "it out."
        )


def check_input(sequence: Sequence, *, joints: Iterable[str] = ()) -> None:
    """Check what is needed to animate a garment: scene, joints and motion; no vertices are read."""
    name = str(sequence.path)
    check_scene(sequence.scene, name)
    check_joints(sequence.scene.body, joints, name)
    check_motion(sequence.long_motion, name, joints=sequence.scene.body.joint_names)


def check_scene(scene: Scene, name: str) -> None:
    """Raise ValueError if the garment's or the body's size is not that of things in metres."""
    check_size(scene.garment.template, f"{name}: the template")
    check_size(scene.body.vertices, f"{name}: the body")


def check_size(points: np.ndarray, name: str) -> None:
    """Raise ValueError if the extent of `points` `[q, 3]` is not that of a garment or a body in metres."""
    size = float(np.ptp(points, axis=0).max())
    if SMALLEST <= size <= LARGEST:
        return
    guess = "centimetres or millimetres" if size > LARGEST else "another unit"
    raise ValueError(
        f"{name} is {size:.4g} m large, which looks like {guess}; convert all lengths to metres."
    )


def check_joints(body: RiggedBody, joints: Iterable[str], name: str) -> None:
    """Raise ValueError if the body lacks one of `joints`, by name."""
    missing = [joint for joint in chosen_joints(body, tuple(joints)) if joint not in body.joint_names]
    if missing:
        raise ValueError(
            f"{name}: the body has no joint {', '.join(missing)}; it has {', '.join(body.joint_names)}: "
            "rename its joints or give --body.motion_joints all: every joint but the root."
        )


def to_motion(given: Many[Any], name: str, *, fps: float) -> Motion:
    """Return (rotations, root) at `fps`, or (rotations, root, fps), as a motion of arrays of real numbers.

    Raises `ValueError` for what holds none; `check_motion` looks at shapes and values.
    """
    long = isinstance(given[0], FrameWindows)
    rotations: Any = given[0] if long else real_numbers(given[0], f"{name}: rotations")
    rate = real_numbers(given[2] if len(given) == 3 else fps, f"{name}: fps", give="one, such as 30")
    if rate.ndim:
        raise ValueError(f"{name}: fps has the shape {list(rate.shape)}; give one number, such as 30.")
    return Motion(rotations, real_numbers(given[1], f"{name}: root"), float(rate))


def real_numbers(given: object, name: str, *, give: str = "an array of floats") -> np.ndarray:
    """Return numbers as an array of float32 or float64; `ValueError` for what is none, complex or ragged."""
    try:
        array = np.asarray(given)
    except (TypeError, ValueError, RuntimeError):  # ragged lists, another library's arrays
        array = np.asarray(None)
    if array.dtype.kind not in "fiu":
        said = f"of type {array.dtype.name}" if array.ndim else repr(given)[:40]
        raise ValueError(f"{name} is {said}, no real numbers; give {give}.")
    return array if array.dtype in (np.float32, np.float64) else array.astype(np.float64)


def check_motion(motion: Motion, name: str, *, joints: Many[str] = ()) -> None:
    """Raise ValueError if rotations are none, the root is nowhere or jumps; `joints` are their names."""
    check_poses(motion, name, joints=joints)
    speed = np.linalg.norm(np.diff(motion.root, axis=0), axis=1) * motion.fps
    if len(speed) and speed.max() > FASTEST:
        raise ValueError(
            f"{name}: the root moves at {speed.max():.4g} m/s in frame {int(speed.argmax()) + 1}; check for "
            "centimetres, a wrong fps or a jump, and convert or cut it."
        )


def check_poses(motion: Motion, name: str, *, joints: Many[str] = ()) -> None:
    """Raise ValueError if shapes or rate are wrong, rotations none, the root nowhere; any speed is taken."""
    check_shapes(motion.rotations.shape, motion.root.shape, name, joints=joints)
    if not 0 < motion.fps < np.inf:  # nor NaN
        raise ValueError(f"{name} has {motion.fps} fps; give frames a second, such as 30.")
    for _, frames in stretches(len(motion.root)):
        R = motion.rotations[frames].astype(np.float64)
        with np.errstate(invalid="ignore", over="ignore"):
            error = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(axis=(2, 3))
            wrong = ~((error <= 1e-2) & (np.linalg.det(R) >= 0))  # a mirrored one has no error; NaN is wrong
        if wrong.any():
            frame, joint = np.argwhere(wrong)[0]
            which = joints[joint] if joint < len(joints) else f"joint {joint}"
            raise ValueError(
                f"{name}: rotations of frame {frames.start + frame} are no rotation matrices ({which}); "
                "export them again."
            )
    nowhere = ~(np.abs(motion.root) <= FARTHEST_ROOT).all(axis=1)  # NaN, too
    if nowhere.any():
        frame = int(nowhere.argmax())
        place = np.asarray(motion.root[frame])
        remedy = "export the motion again"
        if np.isfinite(place).all():
            remedy = f"move it to within {FARTHEST_ROOT:.0f} m of the origin, or convert it to metres"
        raise ValueError(f"{name}: the root of frame {frame} is at {place.tolist()}; {remedy}.")


def check_shapes(
    rotations: Many[int], root: Many[int], name: str, *, joints: Many[str] = (), one_frame: bool = False
) -> None:
    """Raise ValueError unless shapes are `[t, j, 3, 3]` and `[t, 3]`, of one frame `[j, 3, 3]` and `[3]`.

    `joints` are the names of the body's, where they are known.
    """
    t = 0 if one_frame else 1
    if len(rotations) != t + 3 or tuple(rotations[t + 1 :]) != (3, 3) or tuple(root[t:]) != (3,):
        wanted = "[j, 3, 3] and [3] of one frame" if one_frame else "[t, j, 3, 3] and [t, 3]"
        raise ValueError(
            f"{name} has rotations {list(rotations)} and root {list(root)}; give rotation matrices and "
            f"positions, {wanted}."
        )
    if tuple(rotations[:t]) != tuple(root[:t]):
        raise ValueError(f"{name} has {rotations[0]} rotations and {root[0]} roots; give one each a frame.")
    if 0 in rotations[:t]:
        raise ValueError(f"{name} has no frames; give one or more.")
    if joints and rotations[t] != len(joints):
        raise ValueError(
            f"{name} has {rotations[t]} joints and the body {len(joints)}; give the rotations of "
            f"{', '.join(joints)}."
        )


def check_moves(motion: Motion, name: str) -> None:
    """Raise ValueError if a clip to train on holds one pose (a frozen pose may well be animated)."""
    R = motion.rotations.astype(np.float64)
    turned = float(np.abs(R - R[:1]).max())
    if max(turned, float(np.abs(motion.root - motion.root[:1]).max())) < STILL:
        raise ValueError(f"{name} is static: its {len(R)} frames hold one pose; leave it out.")


def check_same_attachment(a: Scene, b: Scene, *, names: tuple[str, str]) -> None:
    """Raise ValueError unless two clips have the same pins (weights to 1e-4) and the same collider."""
    for what, one, other in (("other pins", a.pins, b.pins), ("another collider", a.collider, b.collider)):
        pairs = list(zip(one or (), other or (), strict=False))
        same = all(x.shape == y.shape and np.allclose(x, y, rtol=0.0, atol=1e-4) for x, y in pairs)
        if not same or (one is None) != (other is None):
            raise ValueError(
                f"{names[1]} has {what} than {names[0]}; import the clips of one training the same way."
            )


def check_same_garment(a: Garment, b: Garment, *, names: tuple[str, str] = ("model", "clip")) -> None:
    """Raise ValueError unless two garments are one: vertices, faces, UVs and template (0.1 mm)."""
    one, other = names
    remedy = f"use the {other} of the garment that the {one} was made for, with its vertex order"
    if len(a.template) != len(b.template):
        raise ValueError(
            f"the {one} has {len(a.template)} garment vertices, the {other} {len(b.template)}; {remedy}."
        )
    for field in ("faces", "faces_uv", "uv"):
        first, second = getattr(a, field), getattr(b, field)
        if first.shape != second.shape:
            raise ValueError(
                f"`{field}` differs: the {one} has {len(first)} rows, the {other} {len(second)}; {remedy}."
            )
        differs = (np.abs(first - second) > 1e-5).any(axis=1)
        if differs.any():
            raise ValueError(
                f"`{field}` differs between {one} and {other} in {int(differs.sum())} rows, first in row "
                f"{int(differs.argmax())}; {remedy}."
            )
    far = float(np.abs(a.template - b.template).max())
    if far > STILL:
        raise ValueError(f"the templates of {one} and {other} differ by up to {far * 100:.4g} cm; {remedy}.")


def measure_extent(sequence: Sequence, *, window: int = 64) -> ClipExtent:
    """Return where the garment was, reading by windows; ValueError for a vertex that is not finite."""
    world, relative = _Box(), _Box()
    for start, V in sequence.windows(window):
        _check_finite(V, start, str(sequence.path))
        world.add(V)
        relative.add(V - sequence.motion.root[start : start + len(V), None])
    reach = max(float(np.abs(relative.low).max()), float(np.abs(relative.high).max()))
    movement = min(float(np.max(box.high - box.low)) for box in (world, relative))
    return ClipExtent(world.low.min(axis=0), world.high.max(axis=0), reach, movement)


class _Box:
    """The bounding box of every vertex's path, `low` and `high` `[n, 3]`."""

    def __init__(self) -> None:
        self.low, self.high = np.array(np.inf), np.array(-np.inf)

    def add(self, V: np.ndarray) -> None:
        self.low, self.high = np.minimum(self.low, V.min(axis=0)), np.maximum(self.high, V.max(axis=0))


def _check_finite(V: np.ndarray, start: int, name: str) -> None:
    bad = ~np.isfinite(V).all(axis=2)
    if bad.any():
        frame, vertex = np.argwhere(bad)[0]
        raise ValueError(
            f"{name}: vertex {vertex} of frame {start + frame} is {V[frame, vertex].tolist()}; cut the "
            "clip before that frame or simulate it again."
        )
