"""Deep penetration: pushed in, swallowed, a body that crosses itself, jumps or is noisy."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.kinematics import joint_positions
from garment_jax.evaluation.penetration import neighbour_faces
from garment_jax.postprocess.collision import initial_state
from garment_jax.stability.case import Case, Findings, at_most, info, left_out
from garment_jax.stability.contact import Contact, Solve, contact_cases, make_contact, pushed, solve
from garment_jax.stability.subject import Subject, canonical_pose, root_frame_collider
from garment_jax.structs import Collider, Motion, Scene

GROUP = "deep"
DEPTHS = (0.01, 0.05, 0.10)  # metres
JUMP = 0.5  # metres in one frame
NOISE = 0.02  # metres, of each vertex of the body
SWALLOWED = 0.03  # metres: radius of the garment inside the body
CAUGHT = 12  # vertices
DENT, PULLED = 0.01, 0.15  # metres: how deep garments are pulled into a crossing body, and from how far


def deep_cases(subject: Subject) -> Findings:
    """Return the cases of garments inside a body."""
    scene = subject.scene
    try:
        contact = make_contact(scene)
    except ValueError as error:
        return Findings([left_out(GROUP, "all", str(error))])
    cases = list(_pushed_in(contact, scene))
    cases += _swallowed(contact, scene)
    cases += _crossing(contact, scene)
    cases += _jumps(contact, scene)
    cases += _noisy(contact)
    return Findings(cases)


def _pushed_in(contact: Contact, scene: Scene) -> Iterator[Case]:
    """Yield the cases of a dent that goes 1, 5 and 10 cm into hip and thigh."""
    for place, height in _heights(scene).items():
        for depth in DEPTHS:
            V = dented(contact, height, depth)
            yield from contact_cases(GROUP, f"{100 * depth:g} cm into the {place}", solve(contact, V))


def _heights(scene: Scene) -> dict[str, float]:
    """Return the heights of hip and thigh: by the joints' names, else by the garment."""
    names, y = scene.body.joint_names, scene.body.joints[:, 1]
    if {"LeftUpLeg", "LeftLeg"} <= set(names):
        hip, knee = (float(y[names.index(name)]) for name in ("LeftUpLeg", "LeftLeg"))
        return {"hip": hip, "thigh": (hip + knee) / 2}
    low, high = np.quantile(scene.garment.template[:, 1], [0.4, 0.7])
    return {"hip": float(high), "thigh": float(low)}


def dented(contact: Contact, height: float, depth: float, *, width: float = 0.1) -> np.ndarray:
    """Return the garment with a dent `depth` inside the body's left side at `height`, metres.

    The vertex that is nearest to the place goes there, its surroundings less and less (a bell of
    `width`).
    """
    level = contact.C[np.abs(contact.C[:, 1] - height) < 0.03]
    spot = level[level[:, 0].argmax()]
    nearest = contact.T[np.linalg.norm(contact.T - spot, axis=1).argmin()]
    shift = spot - np.array([depth, 0.0, 0.0], np.float32) - nearest
    bell = np.exp(-(np.linalg.norm(contact.T - nearest, axis=1) ** 2) / width**2)
    return (contact.T + bell[:, None] * shift).astype(np.float32)


def _swallowed(contact: Contact, scene: Scene) -> list[Case]:
    """Return the cases of a whole garment around the root joint, inside the trunk."""
    centre = scene.body.joints[0]
    away = contact.T - centre
    V = centre + SWALLOWED / np.linalg.norm(away, axis=1).max() * away
    return contact_cases(GROUP, "fully inside the trunk", solve(contact, V))


def _crossing(contact: Contact, scene: Scene) -> Iterator[Case]:
    """Yield the cases of legs that cross and of an arm in the hip."""
    legs = {"LeftUpLeg": (0.0, 0.0, -20.0), "RightUpLeg": (0.0, 0.0, 20.0)}
    if not {*legs, "LeftLeg", "RightLeg"} <= set(scene.body.joint_names):
        yield left_out(GROUP, "legs crossing each other", "the body does not name both UpLegs and Legs")
    else:
        yield from contact_cases(GROUP, "legs crossing each other", _posed(contact, scene, legs))
        caught = "cloth between crossing legs"
        yield from contact_cases(GROUP, caught, _posed(contact, scene, legs, caught=CAUGHT))
    case, body = "arm in the hip", scene.body
    if "LeftArm" not in body.joint_names:
        yield left_out(GROUP, case, "the body names no LeftArm")
        return
    every = np.arange(len(body.vertices), dtype=np.int32)
    whole = scene._replace(collider=Collider(every, np.zeros(0, np.int32), body.faces))
    try:
        neighbour_faces(body.faces)
    except ValueError:
        yield left_out(GROUP, case, "the whole body is not closed, and the collider has no arms")
        return
    yield from contact_cases(GROUP, case, _posed(make_contact(whole), whole, {"LeftArm": (0.0, 0.0, -60.0)}))


def _posed(
    contact: Contact, scene: Scene, degrees: dict[str, tuple[float, float, float]], *, caught: int = 0
) -> Solve:
    """Return the solve of a garment pulled into a body with some joints turned.

    The `caught` vertices nearest to the middle of the thighs are drawn right between them.
    """
    motion = bent(scene, degrees)
    C = root_frame_collider(scene, motion)[0] + scene.body.joints[0]
    V = pushed(contact, DENT, C, near=PULLED)
    if caught:
        where = joint_positions(motion.rotations, motion.root, scene.body)[0]
        ends = [where[scene.body.joint_names.index(name)] for name in ("LeftLeg", "RightLeg")]
        middle = 0.7 * np.mean(ends, axis=0) + 0.3 * where[0]
        away = V - middle
        near = np.argsort(np.linalg.norm(away, axis=1))[:caught]
        V = V.copy()
        V[near] = middle + 0.05 * away[near]
    return solve(contact, V, C, crossing=True)


def bent(scene: Scene, degrees: dict[str, tuple[float, float, float]]) -> Motion:
    """Return the canonical pose with joints turned against their parents, rotation vectors in degrees."""
    motion, body = canonical_pose(scene), scene.body
    R = motion.rotations.astype(np.float64)
    for j, name in enumerate(body.joint_names):  # parents come before their children
        above = np.eye(3) if j == 0 else R[0, body.parents[j]]
        R[0, j] = above @ Rotation.from_rotvec(degrees.get(name, (0.0, 0.0, 0.0)), degrees=True).as_matrix()
    return motion._replace(rotations=R.astype(np.float32))


def _jumps(contact: Contact, scene: Scene) -> Iterator[Case]:
    """Yield the cases of bodies that move far in one frame, the garment and the last frame's answer left."""
    state = initial_state(contact.T, contact.C, contact.tables.surface)
    moved = {
        f"body {JUMP:g} m aside in a frame": contact.C + np.array([JUMP, 0.0, 0.0], np.float32),
        f"body {JUMP:g} m down in a frame": contact.C - np.array([0.0, JUMP, 0.0], np.float32),
    }
    if "LeftUpLeg" in scene.body.joint_names:
        kick = bent(scene, {"LeftUpLeg": (-90.0, 0.0, 0.0)})
        moved["leg 90° up in a frame"] = root_frame_collider(scene, kick)[0] + scene.body.joints[0]
    for case, C in moved.items():
        found, fresh = solve(contact, contact.T, C, state=state), solve(contact, contact.T, C)
        yield from contact_cases(GROUP, case, found)
        apart = 1e3 * np.linalg.norm(found.V - fresh.V, axis=1).max()
        yield at_most(GROUP, case, "stale correspondences change the solution by", apart, 0.1, "mm")


def _noisy(contact: Contact) -> list[Case]:
    """Return the cases of a body whose every vertex lies up to 2 cm off."""
    rng = np.random.default_rng(0)
    way = rng.normal(size=contact.C.shape)
    way *= rng.uniform(0.0, NOISE, (len(way), 1)) / np.linalg.norm(way, axis=1, keepdims=True)
    found = solve(contact, contact.T, contact.C + way, crossing=True)
    case = f"{100 * NOISE:g} cm of noise on the body"
    moved = 1e3 * np.linalg.norm(found.V - contact.T, axis=1).max()
    return [*contact_cases(GROUP, case, found), info(GROUP, case, "farthest vertex moved", moved, "mm")]
