"""Skin weights by heat: every bone warms the skin that is nearest to it, and the heat spreads along the skin.

Baran and Popović, "Automatic rigging and animation of 3D characters" (2007), without their visibility
test: bones of the other side are ruled out by x instead. Heat travels over the surface only, so the
inside of one thigh takes nothing from the other.
"""

import numpy as np
from scipy.sparse import csc_matrix, diags
from scipy.sparse.linalg import splu

from garment_jax.procedural.skeleton import JOINT_NAMES, bones

SMALLEST = 0.03  # weights below this are dropped, so that a vertex follows few joints
# Metres of flesh around a joint's bones, 4 cm where not named: nearest is what lies least under the skin, or
# the arms would own the sides of the chest.
FLESH = {
    "Hips": 0.08,
    "LowerBack": 0.09,
    "Spine": 0.09,
    "Spine1": 0.09,
    "LeftUpLeg": 0.08,
    "RightUpLeg": 0.08,
}
ARM_FROM = 0.3  # of the upper arm's bone; before it there is shoulder
ACROSS = 0.03  # metres past the middle at which a side's joint holds nothing
WIDEST = 0.07  # metres: or the trunk's wide changes would carry the arms down to the waist


def bone_heat(vertices: np.ndarray, faces: np.ndarray, *, spread: float = 0.8) -> np.ndarray:
    """Return skin weights `[n, j]` of a closed mesh, rows sum to 1.

    Solves (H - spread² Δ) w = H p with p the nearest bone's indicator and H = 1 / distance²: a change
    of bones takes about `spread` times the limb's radius, or `WIDEST`. `vertices` `[n, 3]` in metres.
    """
    nearest, distance = _nearest_bone(vertices)
    stiffness, mass = _cotangents(vertices, faces)
    heat = mass / np.square(np.minimum(distance, WIDEST))
    target = np.zeros((len(vertices), len(JOINT_NAMES)))
    target[np.arange(len(vertices)), nearest] = 1.0
    weights = splu(csc_matrix(diags(heat) + spread**2 * stiffness)).solve(heat[:, None] * target)
    weights = weights * _own_side(vertices[:, 0])
    weights = np.where(weights < SMALLEST, 0.0, weights)
    return weights / weights.sum(axis=1, keepdims=True)


def _own_side(x: np.ndarray) -> np.ndarray:
    """Return a factor `[n, j]`: 1 on a joint's own side, falling to 0 at `ACROSS` beyond the middle."""
    sides = np.array([name.startswith("Left") * 1.0 - name.startswith("Right") for name in JOINT_NAMES])
    part = np.clip(x[:, None] * sides / ACROSS + 1.0, 0.0, 1.0)
    return part * part * (3.0 - 2.0 * part)


def _nearest_bone(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest bone's joint `[n]` and its distance in metres; the other side's do not count."""
    owners, starts, ends = bones()
    arm = np.isin(owners, [JOINT_NAMES.index(side + "Arm") for side in ("Left", "Right")])
    starts[arm] += ARM_FROM * (ends - starts)[arm]
    flesh = np.array([FLESH.get(JOINT_NAMES[j], 0.04) for j in owners])
    along = ends - starts
    t = ((vertices[:, None] - starts) * along).sum(-1) / (along * along).sum(-1)
    foot = starts + np.clip(t, 0.0, 1.0)[..., None] * along
    distance = np.linalg.norm(vertices[:, None] - foot, axis=-1)
    middle = starts[:, 0] + ends[:, 0]
    distance = np.where(vertices[:, :1] * middle < 0, np.inf, distance)
    best = (distance - flesh).argmin(axis=1)
    return owners[best], np.maximum(distance[np.arange(len(best)), best], 1e-3)


def _cotangents(vertices: np.ndarray, faces: np.ndarray) -> tuple[csc_matrix, np.ndarray]:
    """Return the positive semidefinite stiffness matrix (cotangents clamped at 0) and vertex areas."""
    n, rows, columns, values = len(vertices), [], [], []
    mass = np.zeros(n)
    for corner in range(3):
        o, a, b = (faces[:, (corner + k) % 3] for k in range(3))
        u, v = vertices[a] - vertices[o], vertices[b] - vertices[o]
        doubled = np.linalg.norm(np.cross(u, v), axis=1)
        weight = np.maximum((u * v).sum(1) / doubled, 0.0) / 2
        rows += [a, b, a, b]
        columns += [b, a, a, b]
        values += [-weight, -weight, weight, weight]
        np.add.at(mass, o, doubled / 6)
    stacked = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return csc_matrix(stacked, shape=(n, n)), mass
