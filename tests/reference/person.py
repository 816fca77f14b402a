"""One person's motion, the ground truth that other programs' files are written from.

The person begins near a T-pose, walks 2 m along +Z, turns by 90 degrees, squats and lifts the arms. The rest
pose is a T-pose (metres, Y up, facing +Z, left at +X) in which every segment's axes are the world's. Legs
follow from hips and feet (two bones in a plane, the knee before it); all else is forward kinematics. Nothing
here comes from the package.
"""

from typing import NamedTuple

import numpy as np

FPS = 30.0
_MIDDLE = {
    "Hips": ("", (0.0, 0.93, 0.0)),
    "Spine": ("Hips", (0.0, 1.03, -0.01)),
    "Spine1": ("Spine", (0.0, 1.15, -0.012)),
    "Spine2": ("Spine1", (0.0, 1.28, -0.01)),
    "Neck": ("Spine2", (0.0, 1.48, -0.015)),
    "Head": ("Neck", (0.0, 1.57, 0.005)),
}
_LEFT = {
    "Shoulder": ("Spine2", (0.03, 1.42, 0.0)),
    "Arm": ("Shoulder", (0.17, 1.42, -0.01)),
    "ForeArm": ("Arm", (0.45, 1.42, -0.01)),
    "Hand": ("ForeArm", (0.71, 1.42, -0.01)),
    "UpLeg": ("Hips", (0.09, 0.90, 0.0)),
    "Leg": ("UpLeg", (0.09, 0.485, 0.0)),
    "Foot": ("Leg", (0.09, 0.085, 0.0)),
    "Toe": ("Foot", (0.09, 0.025, 0.13)),
}
_FINGERS = {"Thumb": (0.02, -0.01, 0.035), "Index": (0.09, 0.0, 0.03), "Middle": (0.095, 0.0, 0.01)}
_FINGERS |= {"Ring": (0.09, 0.0, -0.01), "Pinky": (0.08, 0.0, -0.03)}
_PHALANX = 0.03
SIDES = ("Left", "Right")


class Person(NamedTuple):
    """A skeleton in its rest pose."""

    names: tuple[str, ...]  # parents before children
    parents: tuple[int, ...]
    rest: np.ndarray  # [j, 3] metres


class Performance(NamedTuple):
    """A person in motion: world frame, metres, Y up."""

    person: Person
    rotations: np.ndarray  # [t, j, 3, 3] from the rest pose
    positions: np.ndarray  # [t, j, 3]
    fps: float

    def at(self, name: str) -> np.ndarray:
        """A joint's positions `[t, 3]`."""
        return self.positions[:, self.person.names.index(name)]

    def turn(self, name: str) -> np.ndarray:
        """A segment's rotations `[t, 3, 3]`."""
        return self.rotations[:, self.person.names.index(name)]


def make_person() -> Person:
    """Return the person of this module: 1.75 m, legs of 0.815 m from hip to ankle, five fingers a hand."""
    rows = dict(_MIDDLE)
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        for name, (parent, (x, y, z)) in _LEFT.items():
            above = parent if parent in _MIDDLE else side + parent
            rows[side + name] = (above, (sign * x, y, z))
        hand = np.array(rows[f"{side}Hand"][1])
        for finger, (x, y, z) in _FINGERS.items():
            for k in range(3):
                above = f"{side}Hand" if k == 0 else f"{side}Hand{finger}{k}"
                place = hand + (sign * (x + k * _PHALANX), y, z)
                rows[f"{side}Hand{finger}{k + 1}"] = (above, tuple(place.tolist()))
    names = tuple(rows)
    parents = tuple(names.index(parent) if parent else -1 for parent, _ in rows.values())
    return Person(names, parents, np.array([place for _, place in rows.values()]))


# SMPL's neutral skeleton, from the joint above: published with many programs that read AMASS.
_SMPL = {
    "Hips": ("", (-0.0022, -0.2408, 0.0286)),
    "LeftUpLeg": ("Hips", (0.05858135, -0.08228004, -0.01766408)),
    "RightUpLeg": ("Hips", (-0.06030973, -0.09051332, -0.01354254)),
    "Spine": ("Hips", (0.00443945, 0.12440352, -0.03838522)),
    "LeftLeg": ("LeftUpLeg", (0.04345142, -0.38646945, 0.008037)),
    "RightLeg": ("RightUpLeg", (-0.04325663, -0.38368791, -0.00484304)),
    "Spine1": ("Spine", (0.00448844, 0.1379564, 0.02682033)),
    "LeftFoot": ("LeftLeg", (-0.01479032, -0.42687458, -0.037428)),
    "RightFoot": ("RightLeg", (0.01905555, -0.4200455, -0.03456167)),
    "Spine2": ("Spine1", (-0.00226458, 0.05603239, 0.00285505)),
    "LeftToe": ("LeftFoot", (0.04105436, -0.06028581, 0.12204243)),
    "RightToe": ("RightFoot", (-0.03483987, -0.06210566, 0.13032329)),
    "Neck": ("Spine2", (-0.0133902, 0.21163553, -0.03346758)),
    "LeftShoulder": ("Spine2", (0.07170245, 0.11399969, -0.01889817)),
    "RightShoulder": ("Spine2", (-0.08295366, 0.11247234, -0.02370739)),
    "Head": ("Neck", (0.01011321, 0.08893734, 0.05040987)),
    "LeftArm": ("LeftShoulder", (0.12292141, 0.04520509, -0.019046)),
    "RightArm": ("RightShoulder", (-0.11322832, 0.04685326, -0.00847207)),
    "LeftForeArm": ("LeftArm", (0.2553319, -0.01564902, -0.02294649)),
    "RightForeArm": ("RightArm", (-0.26012748, -0.01436928, -0.03126873)),
    "LeftHand": ("LeftForeArm", (0.26570925, 0.01269811, -0.00737473)),
    "RightHand": ("RightForeArm", (-0.26910836, 0.00679372, -0.00602676)),
}


def smpl_person() -> Person:
    """Return SMPL's neutral skeleton in its own frame, 22 joints in SMPL's order, by this module's names."""
    names = tuple(_SMPL)
    parents = tuple(names.index(parent) if parent else -1 for parent, _ in _SMPL.values())
    rest = np.array([offset for _, offset in _SMPL.values()])
    for j, parent in enumerate(parents):
        if j:
            rest[j] += rest[parent]
    return Person(names, parents, rest)


def as_person(truth: Performance, person: Person) -> Performance:
    """Return another person's turning its segments as `truth` does, its hips on the same path."""
    G = np.stack([truth.turn(name) for name in person.names], axis=1)
    return Performance(person, G, forward(person, G, truth.positions[:, 0]), truth.fps)


def forward(person: Person, rotations: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return the joints' positions `[t, j, 3]` of world rotations `[t, j, 3, 3]` and the root's path."""
    places = np.zeros(rotations.shape[:2] + (3,))
    places[:, 0] = root
    for j, parent in enumerate(person.parents):
        if j:
            bone = person.rest[j] - person.rest[parent]
            places[:, j] = places[:, parent] + rotations[:, parent] @ bone
    return places


def about(axis: str, degrees: np.ndarray | float) -> np.ndarray:
    """Return the rotations `[..., 3, 3]` about a world axis."""
    a = np.radians(np.asarray(degrees, np.float64))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    R = np.zeros((*a.shape, 3, 3)) + np.eye(3)
    R[..., i, i] = R[..., j, j] = np.cos(a)
    R[..., j, i], R[..., i, j] = np.sin(a), -np.sin(a)
    return R


# The steps: side, where the foot goes (x, z and heading), in how many frames.
_START, _STANDING = 10, 0.88  # frames of lowering the arms; height of the hips, metres
_WALK = [("Left", 0.2), ("Right", 0.6), ("Left", 1.0), ("Right", 1.4), ("Left", 1.8), ("Right", 2.0)]
_WALK += [("Left", 2.0)]
_STEPS = [(side, (0.09 if side == "Left" else -0.09), z, 0.0, 8) for side, z in _WALK]
for _heading in (45.0, 90.0):
    for _side, _sign in (("Left", 1.0), ("Right", -1.0)):
        _x, _z = 0.09 * _sign * np.cos(np.radians(_heading)), 0.09 * _sign * np.sin(np.radians(_heading))
        _STEPS.append((_side, _x, 2.0 - _z, _heading, 7))
_SQUAT, _LIFT = 24, 14


def _feet() -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return each foot's track `[t, 4]` (x, lift, z, heading in degrees) and how fast the steps go `[t]`."""
    now = {"Left": np.array([0.09, 0, 0, 0.0]), "Right": np.array([-0.09, 0, 0, 0.0])}
    tracks: dict[str, list[np.ndarray]] = {side: [now[side]] * _START for side in SIDES}
    phase = [0.0] * _START
    for side, x, z, heading, count in _STEPS:
        goal = np.array([x, 0.0, z, heading])
        for k in range(1, count + 1):
            s = k / count
            part = s * s * (3 - 2 * s)
            for other in SIDES:
                moved = now[other]
                if other == side:
                    moved = moved + part * (goal - moved) + [0, 0.1 * np.sin(np.pi * s), 0, 0]
                tracks[other].append(moved)
            phase.append((1.0 if side == "Left" else -1.0) * np.sin(np.pi * s))
        now[side] = goal
    for side in SIDES:
        tracks[side] += [now[side]] * (_SQUAT + _LIFT)
    return {side: np.array(track) for side, track in tracks.items()}, np.array(
        phase + [0.0] * (_SQUAT + _LIFT)
    )


def perform(person: Person, *, first: int = 0) -> Performance:
    """Return the motion of this module's docstring; `first`: frames to leave out at the beginning."""
    feet, column_rnn = _feet()
    t = len(column_rnn)
    squat, lift, lowered = np.zeros(t), np.zeros(t), np.minimum(np.arange(t) / _START, 1.0)
    squat[-_SQUAT - _LIFT : -_LIFT] = np.sin(np.pi * np.arange(_SQUAT) / _SQUAT) ** 2
    lift[-_LIFT:] = np.linspace(0, 1, _LIFT)
    heading = (feet["Left"][:, 3] + feet["Right"][:, 3]) / 2
    middle = (feet["Left"] + feet["Right"]) / 2
    root = np.stack([middle[:, 0], _STANDING - 0.32 * squat, middle[:, 2]], axis=1)
    facing = about("y", heading)
    root = root - 0.12 * squat[:, None] * facing[:, :, 2]
    G = np.zeros((t, len(person.names), 3, 3))

    def put(name: str, rotation: np.ndarray) -> None:
        G[:, person.names.index(name)] = rotation

    hips = facing @ about("y", 6 * column_rnn) @ about("z", 3 * column_rnn) @ about("x", 3 + 14 * squat)
    lower = hips @ about("x", 4 + 10 * squat)
    chest = facing @ about("y", -7 * column_rnn) @ about("x", 6 + 30 * squat) @ about("z", 2 * column_rnn)
    neck = facing @ about("x", 5 + 12 * squat)
    for name, rotation in (("Hips", hips), ("Spine", lower), ("Spine1", lower), ("Spine2", chest)):
        put(name, rotation)
    put("Neck", neck)
    put("Head", facing @ about("y", 15 * column_rnn) @ about("x", 8.0))
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        shoulder = chest @ about("z", sign * (3 + 12 * lift))
        down = -70 * lowered + 130 * lift
        raised = 55 * squat * lowered - sign * 25 * column_rnn
        arm = chest @ about("x", -raised) @ about("z", sign * down) @ about("x", 12 * sign * column_rnn)
        bend = 6 + (18 + 12 * sign * column_rnn + 40 * squat) * lowered
        fore = arm @ about("y", -sign * bend) @ about("x", 20 * lowered)
        hand = fore @ about("z", sign * -8 * lowered)
        for name, rotation in (("Shoulder", shoulder), ("Arm", arm), ("ForeArm", fore), ("Hand", hand)):
            put(side + name, rotation)
        for finger in _FINGERS:
            for k in (1, 2, 3):
                put(f"{side}Hand{finger}{k}", hand @ about("z", -sign * 12 * k * lowered))
    _legs(person, G, root, feet, squat)
    whole = Performance(person, G, forward(person, G, root), FPS)
    return whole._replace(rotations=whole.rotations[first:], positions=whole.positions[first:])


def _legs(person: Person, G: np.ndarray, root: np.ndarray, feet: dict, squat: np.ndarray) -> None:
    """Set the legs' rotations so that the feet stand on their tracks, the knees before the legs' planes."""
    number, x = person.names.index, person.rest
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        hip, knee, ankle = (number(side + name) for name in ("UpLeg", "Leg", "Foot"))
        track = feet[side]
        flat = about("y", track[:, 3] + sign * 8)
        foot = flat @ about("x", 120 * track[:, 1])
        goal = np.stack([track[:, 0], x[ankle, 1] + track[:, 1], track[:, 2]], axis=1)
        start = root + G[:, 0] @ (x[hip] - x[0])
        a, b = x[hip, 1] - x[knee, 1], x[knee, 1] - x[ankle, 1]
        line = goal - start
        d = np.linalg.norm(line, axis=1)
        assert (d < a + b - 1e-4).all(), f"the {side} leg is too short by {(d - a - b).max():.3f} m"
        line /= d[:, None]
        forward_ = flat @ about("y", sign * 10 * squat)
        hinge = np.cross(forward_[:, :, 2], line)
        hinge *= np.sign((hinge * G[:, 0, :, 0]).sum(axis=1))[:, None]
        hinge /= np.linalg.norm(hinge, axis=1)[:, None]
        before = np.cross(line, hinge)  # the knee is on this side of the line
        cosine = (a * a + d * d - b * b) / (2 * a * d)
        bent = start + a * (cosine[:, None] * line + np.sqrt(1 - cosine**2)[:, None] * before)
        for joint, bone in ((hip, bent - start), (knee, goal - bent)):
            up = -bone / np.linalg.norm(bone, axis=1)[:, None]
            G[:, joint] = np.stack([hinge, up, np.cross(hinge, up)], axis=2)
        G[:, ankle] = foot
        G[:, number(side + "Toe")] = foot @ about("x", -60 * track[:, 1])
