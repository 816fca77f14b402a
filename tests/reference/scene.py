"""A small dressed body made in code: what every test runs on, without assets.

The body is one watertight surface, a closed union of tubes: the torso is a tube whose lower end is split
into two legs. It has the avatar's 22 joints. The skirt is a cone grid with one UV seam at its back. All
is deterministic; lengths in metres, Y up, facing +Z.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np

from garment_jax.io.sequence import SequenceWriter
from garment_jax.structs import Collider, Garment, Motion, Pins, RiggedBody, Scene

JOINTS: tuple[tuple[str, int, tuple[float, float, float]], ...] = (
    ("Hips", -1, (0.0, 0.83, 0.0)),
    ("LowerBack", 0, (0.0, 0.91, -0.02)),
    ("Spine", 1, (0.0, 1.06, -0.01)),
    ("Spine1", 2, (0.0, 1.21, -0.01)),
    ("Neck", 3, (0.0, 1.36, -0.01)),
    ("Head", 4, (0.0, 1.47, 0.0)),
    ("LeftShoulder", 3, (0.02, 1.29, 0.0)),
    ("LeftArm", 6, (0.16, 1.27, 0.0)),
    ("LeftForeArm", 7, (0.31, 1.10, 0.0)),
    ("LeftHand", 8, (0.42, 0.98, 0.1)),
    ("LeftUpLeg", 0, (0.095, 0.82, 0.0)),
    ("LeftLeg", 10, (0.13, 0.45, 0.02)),
    ("LeftFoot", 11, (0.16, 0.07, 0.0)),
    ("LeftToeBase", 12, (0.17, 0.02, 0.12)),
    ("RightShoulder", 3, (-0.02, 1.29, 0.0)),
    ("RightArm", 14, (-0.16, 1.27, 0.0)),
    ("RightForeArm", 15, (-0.31, 1.10, 0.0)),
    ("RightHand", 16, (-0.42, 0.98, 0.1)),
    ("RightUpLeg", 0, (-0.095, 0.82, 0.0)),
    ("RightLeg", 18, (-0.13, 0.45, 0.02)),
    ("RightFoot", 19, (-0.16, 0.07, 0.0)),
    ("RightToeBase", 20, (-0.17, 0.02, 0.12)),
)
SIDES = 16  # vertices around the torso; a leg's ring shares half of the crotch ring


def make_body() -> RiggedBody:
    """Return a watertight, outward body of a few hundred vertices with smooth skin weights."""
    joints = np.array([position for _, _, position in JOINTS], np.float32)
    parents = np.array([parent for _, parent, _ in JOINTS], np.int32)
    vertices, faces = _body_surface()
    weights = _skin_weights(vertices, joints, parents)
    names = tuple(name for name, _, _ in JOINTS)
    return RiggedBody(vertices, faces, joints, parents, names, weights)


def make_scene(rings: int = 8, columns: int = 16) -> Scene:
    """Return the dressed body: a cone skirt of `rings x columns` vertices, pinned at its top ring."""
    body = make_body()
    garment = _make_skirt(rings, columns)
    top = np.arange(columns, dtype=np.int32)
    weights = _skin_weights(garment.template[top], body.joints, body.parents)
    return Scene(garment, body, _make_collider(body), Pins(top, weights))


def make_motion(
    scene: Scene, frames: int = 40, seed: int = 0, *, fps: float = 30.0, legs: float = 0.6
) -> Motion:
    """Return a smooth dance: the body turns and travels, sways its hips and swings its legs (`legs` rad)."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames) / fps
    names = scene.body.joint_names
    local = np.tile(np.eye(3), (frames, len(names), 1, 1))

    def wave(size: float) -> np.ndarray:
        rate, phase = rng.uniform(0.4, 1.0), rng.uniform(0, 2 * np.pi)
        return size * np.sin(2 * np.pi * rate * time + phase)

    turn = rng.uniform(0.5, 1.5) * time + wave(0.4)
    local[:, 0] = _about("y", turn) @ _about("x", wave(0.1)) @ _about("z", wave(0.1))
    for name, size in (("LeftUpLeg", legs), ("RightUpLeg", legs), ("Spine", 0.2)):
        local[:, names.index(name)] = _about("x", wave(size)) @ _about("z", wave(size / 3))
    for name in ("LeftLeg", "RightLeg"):
        local[:, names.index(name)] = _about("x", np.abs(wave(0.8)))
    rotations = local.copy()
    for j in range(1, len(names)):
        rotations[:, j] = rotations[:, scene.body.parents[j]] @ local[:, j]
    travel = np.stack([wave(0.5), 0.03 * np.sin(6 * time), wave(0.5)], axis=1)
    root = scene.body.joints[0].astype(np.float64) + travel
    return Motion(rotations.astype(np.float32), root, fps)


def make_vertices(scene: Scene, motion: Motion, seed: int = 0) -> np.ndarray:
    """Return a plausible garment, `[t, n, 3]` float32 world metres.

    The template skinned to the body, plus a wave that travels round the hem, swells with the root's
    speed and vanishes at the pins.
    """
    rng = np.random.default_rng(seed)
    T, body = scene.garment.template.astype(np.float64), scene.body
    weights = _skin_weights(scene.garment.template, body.joints, body.parents)
    if scene.pins is not None:
        weights[scene.pins.vertices] = scene.pins.weights
    posed = skin(T, weights, motion, body)
    time = np.arange(len(motion.root)) / motion.fps
    speed = np.linalg.norm(np.gradient(motion.root, axis=0), axis=1) * motion.fps if len(time) > 1 else [0.0]
    angle = np.arctan2(T[:, 0], T[:, 2])
    depth = (T[:, 1].max() - T[:, 1]) / np.ptp(T[:, 1])
    folds = 0.02 * np.sin(3 * angle + 5 * time[:, None] + rng.uniform(0, 2 * np.pi))
    lift = depth * (folds * (1 + np.asarray(speed)[:, None]))
    outward = np.stack([np.sin(angle), np.full_like(angle, 0.3), np.cos(angle)], axis=1)
    offset = (
        lift[:, :, None] * (motion.rotations[:, :1].astype(np.float64) @ outward[None, :, :, None])[..., 0]
    )
    return (posed + offset).astype(np.float32)


def write_clip(path: str | Path, frames: int = 40, seed: int = 0, **options) -> Path:
    """Write a synthetic clip as a sequence file and return its path; `options` go to the writer.

    `scene=` and `motion=` replace the default ones.
    """
    scene = options.pop("scene", None) or make_scene()
    motion = options.pop("motion", None) or make_motion(scene, frames, seed)
    with SequenceWriter(path, scene, motion, **options) as writer:
        writer.append(make_vertices(scene, motion, seed))
    return Path(path)


def joint_positions(motion: Motion, body: RiggedBody) -> np.ndarray:
    """Return the joints' world positions, `[t, j, 3]` (a naive loop)."""
    rest = body.joints.astype(np.float64)
    positions = np.zeros((len(motion.root), len(rest), 3))
    for t in range(len(motion.root)):
        positions[t, 0] = motion.root[t]
        for j in range(1, len(rest)):
            parent = body.parents[j]
            positions[t, j] = positions[t, parent] + motion.rotations[t, parent] @ (rest[j] - rest[parent])
    return positions


def skin(points: np.ndarray, weights: np.ndarray, motion: Motion, body: RiggedBody) -> np.ndarray:
    """Return canonical `points` `[q, 3]` posed by linear blend skinning, `[t, q, 3]` world metres."""
    positions = joint_positions(motion, body)
    posed = np.zeros((len(motion.root), len(points), 3))
    for j in np.flatnonzero(weights.max(axis=0)):
        moved = (points - body.joints[j]) @ np.swapaxes(motion.rotations[:, j].astype(np.float64), 1, 2)
        posed += weights[:, j, None] * (moved + positions[:, None, j])
    return posed


def _about(axis: str, angle: np.ndarray) -> np.ndarray:
    """Rotations about a coordinate axis, `[t, 3, 3]`, right-handed, radians."""
    i, k = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    R = np.tile(np.eye(3), (len(angle), 1, 1))
    R[:, i, i] = R[:, k, k] = np.cos(angle)
    R[:, k, i], R[:, i, k] = np.sin(angle), -np.sin(angle)
    return R


def _ring(y: float, x: float, rx: float, rz: float, count: int = SIDES) -> np.ndarray:
    """A horizontal ellipse, counter-clockwise seen from above +Y looking down -Y … from +Z towards +X."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([x + rx * np.sin(angle), np.full(count, y), rz * np.cos(angle)], axis=1)


def _body_surface() -> tuple[np.ndarray, np.ndarray]:
    """One closed surface: torso rings down to the crotch ring, whose halves go on as the legs."""
    points: list[np.ndarray] = []
    faces: list[tuple[int, int, int]] = []

    def add(ring: np.ndarray) -> list[int]:
        first = sum(len(p) for p in points)
        points.append(ring)
        return list(range(first, first + len(ring)))

    def join(upper: list[int], lower: list[int]) -> None:
        for i in range(len(upper)):
            k = (i + 1) % len(upper)
            faces.extend([(upper[i], lower[i], upper[k]), (upper[k], lower[i], lower[k])])

    def close(ring: list[int], centre: np.ndarray, *, top: bool) -> None:
        (tip,) = add(centre[None])
        for i in range(len(ring)):
            k = (i + 1) % len(ring)
            faces.append((tip, ring[i], ring[k]) if top else (tip, ring[k], ring[i]))

    torso = [(1.34, 0.09, 0.07), (1.24, 0.13, 0.09), (1.12, 0.115, 0.085), (1.04, 0.11, 0.08)]
    torso += [(0.97, 0.125, 0.09), (0.90, 0.15, 0.10), (0.83, 0.165, 0.11), (0.77, 0.165, 0.11)]
    rings = [add(_ring(y, 0.0, rx, rz)) for y, rx, rz in torso]
    close(rings[0], np.array([0.0, 1.40, 0.0]), top=True)
    for upper, lower in pairwise(rings):
        join(upper, lower)
    half = SIDES // 2
    between = np.array([[0.0, 0.74, z] for z in (-0.045, 0.0, 0.045)])  # from back to front
    bridge = add(between)
    crotch = rings[-1]
    left = crotch[: half + 1] + bridge  # front, round the left side to the back, and home below
    right = [*crotch[half:], crotch[0], *bridge[::-1]]
    for sign, start in ((1, left), (-1, right)):
        last = start
        for y, x, r in ((0.66, 0.10, 0.085), (0.55, 0.115, 0.075), (0.45, 0.13, 0.06), (0.34, 0.137, 0.058)):
            last = _next_ring(add, join, last, sign * x, y, r, sign)
        for y, x, r in ((0.22, 0.147, 0.05), (0.10, 0.158, 0.04)):
            last = _next_ring(add, join, last, sign * x, y, r, sign)
        close(last, np.array([sign * 0.16, 0.04, 0.0]), top=False)
    return np.concatenate(points).astype(np.float32), np.array(faces, np.int32)


def _next_ring(add, join, last: list[int], x: float, y: float, r: float, sign: int) -> list[int]:
    """Add a leg's ring below `last`: it begins at the front of the left leg, at the back of the right."""
    ring = _ring(y, 0.0, r, r, len(last))
    ring[:, [0, 2]] *= sign
    ring[:, 0] += x
    lower = add(ring)
    join(last, lower)
    return lower


def _skin_weights(points: np.ndarray, joints: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Weights that fall off with the distance to each bone, `[q, j]` float32; rows sum to 1.

    The arms carry nothing: the body has none. A toe's or head's own bone ends at its joint.
    """
    names = [name for name, _, _ in JOINTS]
    distance = np.full((len(points), len(joints)), np.inf)
    for j in range(len(joints)):
        if any(part in names[j] for part in ("Arm", "Hand", "Shoulder")):
            continue
        children = [k for k in range(len(joints)) if parents[k] == j and np.isfinite(joints[k]).all()]
        ends = [joints[k] for k in children if "Shoulder" not in names[k]] or [joints[j]]
        distance[:, j] = np.min([_segment_distance(points, joints[j], end) for end in ends], axis=0)
    nearest = distance.min(axis=1, keepdims=True)
    weights = np.exp(-(distance - nearest) / 0.03)
    weights[weights < 1e-3] = 0
    return (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)


def _segment_distance(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    along = b - a
    u = np.clip((points - a) @ along / max(float(along @ along), 1e-12), 0, 1)
    return np.linalg.norm(points - (a + u[:, None] * along), axis=1)


def _make_skirt(rings: int, columns: int) -> Garment:
    """A cone from the waist (1.0 m high) to the hem; u runs round from the back seam, v down from 1."""
    angle = np.pi + 2 * np.pi * np.arange(columns) / columns
    down = np.linspace(0, 1, rings)
    radius = 0.13 + 0.27 * down
    x = np.sin(angle)[None] * radius[:, None]
    y = np.repeat(1.0 - 0.5 * down[:, None], columns, axis=1)
    z = np.cos(angle)[None] * radius[:, None]
    template = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    u, v = np.meshgrid(np.arange(columns + 1) / columns, 1 - down)
    uv = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32)
    faces, faces_uv = [], []
    for r in range(rings - 1):
        for c in range(columns):
            corners = [(r, c), (r + 1, c), (r, c + 1), (r + 1, c + 1)]
            a, b, d, e = (row * columns + column % columns for row, column in corners)
            faces += [(a, b, d), (d, b, e)]
            a, b, d, e = (row * (columns + 1) + column for row, column in corners)
            faces_uv += [(a, b, d), (d, b, e)]
    return Garment(template, np.array(faces, np.int32), uv, np.array(faces_uv, np.int32))


def _make_collider(body: RiggedBody) -> Collider:
    """The body below the chest, closed by a cap at the cut ring."""
    ring = np.arange(SIDES, 2 * SIDES, dtype=np.int32)  # the second torso ring
    kept = np.setdiff1d(np.arange(len(body.vertices)), np.append(np.arange(SIDES), _crown(body)))
    number = np.full(len(body.vertices), -1)
    number[kept] = np.arange(len(kept))
    faces = number[body.faces]
    faces = faces[(faces >= 0).all(axis=1)]
    inner = number[ring]
    cap = np.stack([np.full(SIDES, len(kept)), inner, np.roll(inner, -1)], axis=1)
    faces = np.concatenate([faces, cap]).astype(np.int32)
    return Collider(kept.astype(np.int32), ring, faces)


def _crown(body: RiggedBody) -> int:
    return int(body.vertices[:, 1].argmax())
