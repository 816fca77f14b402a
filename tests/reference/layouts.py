"""The skeletons of motion libraries and capture programs: names, hierarchy, channels and local axes.

Each layout was read off a published file of its kind; the proportions here are those of the person. A joint's
line is "name < parent: segment, axes". The axes say where the joint's own axes point in the person's T-pose:
"X+ Y=forward" is X along the bone to the next joint (exactly) and Y forward (as nearly as that allows),
"X-" against the bone; none: the world's axes.
"""

from typing import NamedTuple

import numpy as np

from tests.reference.layout_tables import (
    BANDAI,
    CMU,
    CMU_DAZ,
    FINGERS,
    LAFAN,
    MIXAMO,
    ROKOKO,
    ROKOKO_OWN,
    STYLE,
    UNREAL,
)
from tests.reference.person import SIDES, Person, about

WORLD = {"left": (1, 0, 0), "right": (-1, 0, 0), "up": (0, 1, 0), "down": (0, -1, 0)}
WORLD |= {"forward": (0, 0, 1), "back": (0, 0, -1)}


class Joint(NamedTuple):
    """One joint of a file."""

    name: str
    parent: str  # "" for the file's root
    segment: str  # of the person; "" does not move
    place: np.ndarray  # [3] in the person's rest pose, metres
    axes: np.ndarray  # [3, 3] columns: its own axes in the person's rest pose


class Layout(NamedTuple):
    """How a library writes a skeleton."""

    joints: tuple[Joint, ...]  # parents before children
    order: str  # of the rotation channels, as written
    positions: str = "root"  # joints with position channels: root, hips (and what is above), all
    metres: float = 0.01  # per unit of the file
    fps: float = 30.0
    precision: int = 6  # decimals
    zero_offsets: bool = False
    extra_rows: int = 0  # more than announced
    frame_time: str = ""  # as the library writes it


_NEXT = {"Hips": "Spine", "Spine": "Spine1", "Spine1": "Spine2", "Spine2": "Neck", "Neck": "Head"}
_NEXT |= {"Shoulder": "Arm", "Arm": "ForeArm", "ForeArm": "Hand", "Hand": "HandMiddle1"}
_NEXT |= {"UpLeg": "Leg", "Leg": "Foot", "Foot": "Toe"}
_NEXT |= {f"Hand{f}{k}": f"Hand{f}{k + 1}" for f in FINGERS for k in (1, 2)}


def _bone(person: Person, segment: str) -> np.ndarray:
    """The direction from a segment's joint to the next one in the person's rest pose."""
    side = next((s for s in SIDES if segment.startswith(s)), "")
    after = _NEXT.get(segment.removeprefix(side), "")
    places = dict(zip(person.names, person.rest, strict=True))
    if not after:  # an end: as the bone before it
        above = person.names[person.parents[person.names.index(segment)]]
        return places[segment] - places[above] if segment != "Head" else np.array([0.0, 1.0, 0.0])
    if segment in ("Hips", "Spine", "Spine1", "Spine2", "Neck"):
        return np.array(WORLD["up"], float)
    return places[side + after] - places[segment]


def axes_of(person: Person, segment: str, text: str) -> np.ndarray:
    """Return the columns `[3, 3]` that the module's docstring describes."""
    if not text:
        return np.eye(3)
    first, second = text.split()
    bone = _bone(person, segment) if segment else np.array([0.0, 1.0, 0.0])
    main = bone if first[1] == "+" else -bone if first[1] == "-" else np.array(WORLD[first[2:]], float)
    main = main / np.linalg.norm(main)
    near = np.array(WORLD[second[2:]], float)
    near = near - (near @ main) * main
    columns = {first[0]: main, second[0]: near / np.linalg.norm(near)}
    third = next(k for k in "XYZ" if k not in columns)
    i = "XYZ".index(third)
    columns[third] = np.cross(columns["XYZ"[(i + 1) % 3]], columns["XYZ"[(i + 2) % 3]])
    return np.stack([columns[k] for k in "XYZ"], axis=1)


def joints_of(person: Person, lines: str) -> tuple[Joint, ...]:
    """Return the joints of a table; "L" lines stand for both sides (`{S}` Left, `{s}` l, `{U}` L)."""
    found: list[Joint] = []
    for line in lines.strip().splitlines():
        for side in SIDES if "{" in line else ("",):
            written = line.format(S=side, s=side[:1].lower(), U=side[:1])
            name, _, rest = written.partition(" <")
            parent, _, rest = rest.strip().partition(": ")
            options = [part.strip() for part in rest.split(",")]
            segment, axes = options[0], options[1] if len(options) > 1 else ""
            if "|" in axes:  # the left side's and the right's
                axes = axes.split("|")[SIDES.index(side)].strip()
            place = person.rest[person.names.index(segment)] if segment else np.zeros(3)
            if len(options) > 2:  # a joint that sits elsewhere on its segment, metres from its joint
                shift = np.array([float(x) for x in options[2].split()])
                place = place + shift * (1 if side != "Right" else np.array([-1.0, 1.0, 1.0]))
            found.append(Joint(name, parent, segment, place, axes_of(person, segment, axes)))
    return tuple(found)


def layout(name: str, person: Person) -> Layout:
    """Return the layout of a library, named as below."""
    match name:
        case "lafan1":
            return Layout(joints_of(person, LAFAN), "ZYX", frame_time="0.033333")
        case "bandai":
            joints = joints_of(person, BANDAI)
            return Layout(joints, "ZXY", "all", frame_time="0.0333333")
        case "rokoko" | "rokoko_own":
            table = ROKOKO if name == "rokoko" else ROKOKO_OWN
            joints = joints_of(person, table)
            return Layout(joints, "YXZ", precision=4, fps=100.0, extra_rows=1, frame_time="0.010000")
        case "mixamo":  # as BVH the joints' axes are the world's; "@" are those in FBX and glTF
            return Layout(joints_of(person, _without_axes(MIXAMO)), "ZXY", frame_time="0.033333")
        case "cmu_daz":
            return Layout(joints_of(person, CMU_DAZ), "ZXY", fps=120.0, frame_time="0.0083333")
        case "cmu":
            joints = _spread(person, CMU)
            return Layout(joints, "ZYX", metres=0.0254 / 0.45, fps=120.0, precision=5, frame_time=".0083333")
        case "100style":
            return Layout(joints_of(person, STYLE), "YXZ", fps=60.0, frame_time="0.016667")
        case "unreal":
            return Layout(joints_of(person, UNREAL), "ZYX", "hips", frame_time="0.033333")
    raise KeyError(name)


def mixamo_nodes(person: Person) -> tuple[Joint, ...]:
    """Return Mixamo's joints with the axes that they have in FBX and glTF: Y along the bones."""
    return joints_of(person, MIXAMO.replace("@", ""))


def _without_axes(lines: str) -> str:
    def plain(line: str) -> str:
        head, mark, axes = line.partition("@")
        return head + (",".join(["", *axes.split(",")[1:]]) if mark else "")

    return "\n".join(map(plain, lines.splitlines()))


def _spread(person: Person, lines: str) -> tuple[Joint, ...]:
    found = []
    for line in lines.strip().splitlines():
        text, _, angle = line.partition("spread")
        for joint in joints_of(person, text.rstrip(" ,") + "," if angle else line):
            axes = about("z", float(angle)) if angle else joint.axes
            found.append(joint._replace(axes=axes))
    return tuple(found)
