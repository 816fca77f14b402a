"""Motion files in the layouts of `layouts.py`, written from one person's motion; and a BVH reader of its own.

A joint that sits on a segment has the world matrix (G B, P + G (place - rest)): G and P the segment's, B the
joint's axes in the rest pose. What a file holds are these matrices in their parents' frames.
"""

import re
import warnings
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from tests.reference.layouts import Joint, Layout
from tests.reference.person import Performance, forward


def resampled(truth: Performance, fps: float) -> Performance:
    """Return the motion at another rate: smooth between its frames, equal at them."""
    if fps == truth.fps:
        return truth
    t = np.arange(len(truth.positions)) / truth.fps
    times = np.arange(int(t[-1] * fps + 1e-6) + 1) / fps
    tracks = [RotationSpline(t, Rotation.from_matrix(R)) for R in truth.rotations.swapaxes(0, 1)]
    G = np.stack([track(times).as_matrix() for track in tracks], axis=1)
    root = CubicSpline(t, truth.positions[:, 0])(times)
    return Performance(truth.person, G, forward(truth.person, G, root), fps)


def joint_worlds(joints: tuple[Joint, ...], truth: Performance) -> tuple[np.ndarray, np.ndarray]:
    """Return the joints' world axes `[t, k, 3, 3]` and places `[t, k, 3]`, metres."""
    person, t = truth.person, len(truth.positions)
    R = np.zeros((t, len(joints), 3, 3))
    p = np.zeros((t, len(joints), 3))
    for k, joint in enumerate(joints):
        if not joint.segment:
            R[:, k], p[:, k] = joint.axes, joint.place
            continue
        j = person.names.index(joint.segment)
        R[:, k] = truth.rotations[:, j] @ joint.axes
        p[:, k] = truth.positions[:, j] + truth.rotations[:, j] @ (joint.place - person.rest[j])
    return R, p


def local_frames(joints: tuple[Joint, ...], R: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return world axes and places in the parents' frames."""
    names = [joint.name for joint in joints]
    turns, places = R.copy(), p.copy()
    for k, joint in enumerate(joints):
        if joint.parent:
            above = names.index(joint.parent)
            inverse = np.swapaxes(R[:, above], -1, -2)
            turns[:, k] = inverse @ R[:, k]
            places[:, k] = (inverse @ (p[:, k] - p[:, above])[..., None])[..., 0]
    return turns, places


def write_layout(path: Path, layout: Layout, truth: Performance, world: np.ndarray | None = None) -> Path:
    """Write a BVH file; `world` `[3, 3]` turns the whole motion (not the rest pose)."""
    truth = resampled(truth, layout.fps)
    joints = layout.joints
    R, p = joint_worlds(joints, truth)
    if world is not None:
        moving = [k for k, joint in enumerate(joints) if joint.segment]
        R[:, moving], p[:, moving] = world @ R[:, moving], p[:, moving] @ world.T
    turns, places = local_frames(joints, R, p)
    places /= layout.metres
    offsets = np.zeros_like(places[0]) if layout.zero_offsets else places[0].copy()
    order = _depth_first(joints)
    lines = ["HIERARCHY"]
    values: list[np.ndarray] = []
    for k in order:
        if _has_positions(layout, joints[k]):
            values.append(places[:, k])
        with warnings.catch_warnings():  # of gimbal lock: any of the angles that give the rotation will do
            warnings.simplefilter("ignore", UserWarning)
            values.append(Rotation.from_matrix(turns[:, k]).as_euler(layout.order, degrees=True))
    _write_joint(lines, layout, offsets, order[0], 0)
    rows = np.concatenate(values, axis=1)
    head = ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {layout.frame_time or f'{1 / layout.fps:.6f}'}"]
    text = [" ".join(f"{x:.{layout.precision}f}" for x in row) for row in rows]
    text += [text[-1]] * layout.extra_rows
    path.write_text("\n".join([*lines, *head, *text]) + "\n")
    return path


def _has_positions(layout: Layout, joint: Joint) -> bool:
    if layout.positions == "all" or not joint.parent:
        return True
    return layout.positions == "hips" and joint.segment == "Hips"


def _depth_first(joints: tuple[Joint, ...]) -> list[int]:
    def below(name: str) -> list[int]:
        found = []
        for k, joint in enumerate(joints):
            if joint.parent == name:
                found += [k, *below(joint.name)]
        return found

    return below("")


def _write_joint(lines: list[str], layout: Layout, offsets: np.ndarray, k: int, depth: int) -> None:
    joints, tab = layout.joints, "\t" * depth
    numbers = " ".join(f"{x:.{layout.precision}f}" for x in offsets[k])
    lines += [f"{tab}{'JOINT' if depth else 'ROOT'} {joints[k].name}", tab + "{", f"{tab}\tOFFSET {numbers}"]
    channels = [f"{axis}rotation" for axis in layout.order]
    if _has_positions(layout, joints[k]):
        channels = ["Xposition", "Yposition", "Zposition", *channels]
    lines.append(f"{tab}\tCHANNELS {len(channels)} {' '.join(channels)}")
    children = [c for c, joint in enumerate(joints) if joint.parent == joints[k].name]
    for child in children:
        _write_joint(lines, layout, offsets, child, depth + 1)
    if not children:
        lines += [
            f"{tab}\tEnd Site",
            f"{tab}\t{{",
            f"{tab}\t\tOFFSET 0.000000 0.000000 0.000000",
            f"{tab}\t}}",
        ]
    lines.append(tab + "}")


def read_layout(path: Path) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return a BVH file's world rotations `[t, 3, 3]` and places `[t, 3]` by joint, its units and axes."""
    head, _, motion = path.read_text().partition("MOTION\n")
    announced, _, body = motion.partition("\n")
    rows = np.array([row.split() for row in body.splitlines()[1:] if row], float)
    rows = rows[: int(announced.split()[1])]
    R: dict[str, np.ndarray] = {"": np.tile(np.eye(3), (len(rows), 1, 1))}
    p: dict[str, np.ndarray] = {"": np.zeros((len(rows), 3))}
    open_joints, column = [""], 0
    pattern = r"(?:ROOT|JOINT) (\S+)\s*{\s*OFFSET (.*)\s*CHANNELS \d+ (.*)|(End Site)\s*{[^}]*}|(})"
    for name, offset, channels, _, closing in re.findall(pattern, head):
        if closing:
            open_joints.pop()
        elif name:
            above = open_joints[-1]
            place = np.tile(np.array(offset.split(), float), (len(rows), 1))
            turn = np.tile(np.eye(3), (len(rows), 1, 1))
            for channel in channels.split():
                if channel.endswith("position"):
                    place[:, "XYZ".index(channel[0])] = rows[:, column]
                else:
                    axis = channel[0].lower()
                    turn = turn @ Rotation.from_euler(axis, rows[:, column, None], degrees=True).as_matrix()
                column += 1
            R[name] = R[above] @ turn
            p[name] = p[above] + (R[above] @ place[..., None])[..., 0]
            open_joints.append(name)
    assert column == rows.shape[1]
    return R, p
