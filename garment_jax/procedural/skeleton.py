"""The mannequin's joints: the shared avatar's names and hierarchy (metres, Y up, facing +Z, A-pose)."""

import numpy as np

# name, parent, canonical position; left is +X, the right side is its mirror image
_LEFT = (
    ("Shoulder", "Spine1", (0.024, 1.318, -0.005)),
    ("Arm", "Shoulder", (0.158, 1.304, -0.008)),
    ("ForeArm", "Arm", (0.322, 1.128, -0.002)),
    ("Hand", "ForeArm", (0.446, 0.972, 0.088)),
    ("UpLeg", "Hips", (0.096, 0.842, -0.004)),
    ("Leg", "UpLeg", (0.134, 0.462, 0.020)),
    ("Foot", "Leg", (0.168, 0.072, 0.000)),
    ("ToeBase", "Foot", (0.178, 0.026, 0.126)),
)
_MIDDLE = (
    ("Hips", "", (0.0, 0.855, 0.0)),
    ("LowerBack", "Hips", (0.0, 0.930, -0.024)),
    ("Spine", "LowerBack", (0.0, 1.086, -0.014)),
    ("Spine1", "Spine", (0.0, 1.244, -0.018)),
    ("Neck", "Spine1", (0.0, 1.392, -0.024)),
    ("Head", "Neck", (0.0, 1.500, 0.008)),
)
_SIDED = {name for name, _, _ in _LEFT}
_ENDS = {"Head": (0.0, 1.64, 0.02), "Hand": (0.512, 0.868, 0.150), "ToeBase": (0.184, 0.022, 0.190)}


def _rows() -> list[tuple[str, str, tuple[float, float, float]]]:
    """Return name, parent's name and position of all 22 joints in the avatar's order."""

    def sided(side: str, part: slice) -> list[tuple[str, str, tuple[float, float, float]]]:
        sign = 1.0 if side == "Left" else -1.0
        return [
            (side + name, side + parent if parent in _SIDED else parent, (sign * x, y, z))
            for name, parent, (x, y, z) in _LEFT[part]
        ]

    arm, leg = slice(0, 4), slice(4, 8)
    sides = sided("Left", arm) + sided("Left", leg) + sided("Right", arm) + sided("Right", leg)
    return list(_MIDDLE) + sides


JOINT_NAMES = tuple(name for name, _, _ in _rows())
PARENTS = np.array([JOINT_NAMES.index(parent) if parent else -1 for _, parent, _ in _rows()], np.int32)
JOINTS = np.array([position for _, _, position in _rows()], np.float32)
# the joint of the other side, for mirrored weights
PARTNERS = np.array(
    [
        JOINT_NAMES.index(name.replace("Left", "\0").replace("Right", "Left").replace("\0", "Right"))
        for name in JOINT_NAMES
    ]
)


def bones() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return every bone's joint `[k]` and its two ends `[k, 3]`, metres: joint to child, or to its tip."""
    rows = [(int(PARENTS[j]), JOINTS[PARENTS[j]], JOINTS[j]) for j in range(1, len(JOINTS))]
    for name, end in _ENDS.items():
        for side, sign in (("", 1.0),) if name == "Head" else (("Left", 1.0), ("Right", -1.0)):
            joint = JOINT_NAMES.index(side + name)
            rows.append((joint, JOINTS[joint], np.array(end, np.float32) * [sign, 1.0, 1.0]))
    owners, starts, ends = zip(*rows, strict=True)
    return np.array(owners), np.array(starts, np.float64), np.array(ends, np.float64)
