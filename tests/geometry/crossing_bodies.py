"""A mannequin whose parts cross each other: pressed thighs, an arm in the hip, a knee in the belly."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.kinematics import pose_body
from garment_jax.geometry.winding_number import winding_number
from garment_jax.procedural.mannequin import make_mannequin
from garment_jax.structs import Motion, RiggedBody
from tests.reference.kept import kept

# joint: its turn against its parent, degrees about x (left), y (up) and z (front)
POSES = {
    "pressed thighs": {
        "LeftUpLeg": (-70, 0, -22),
        "RightUpLeg": (-70, 0, 22),
        "LeftLeg": (90, 0, 0),
        "RightLeg": (90, 0, 0),
    },
    "an arm in the hip": {"LeftArm": (0, 0, -55), "LeftForeArm": (0, 0, -25)},
    "a knee in the belly": {"LeftUpLeg": (-150, 0, -15), "LeftLeg": (140, 0, 0)},
}


@lru_cache
def crossing_body(pose: str, resolution: float = 0.03) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices `[c, 3]` float64 (metres, in float32's digits) and faces `[f, 3]` of that mannequin."""
    body = make_mannequin(resolution)
    return turned(body, POSES[pose]).astype(np.float32).astype(np.float64), np.asarray(body.faces)


@lru_cache
def numbered_points(pose: str) -> tuple[np.ndarray, np.ndarray]:
    """Return 34,000 points around the mannequin in that pose, in float32's digits, and their winding numbers.

    By the sum of all solid angles, which takes ten seconds.
    """
    vertices, faces = crossing_body(pose)
    points = points_around(vertices, faces, 34_000, seed=len(pose)).astype(np.float32).astype(np.float64)
    return points, kept(winding_number, points, vertices, faces)


def turned(body: RiggedBody, turns: Mapping[str, tuple[float, float, float]]) -> np.ndarray:
    """Return the posed vertices `[c, 3]` of any body with these joints."""
    world: list[np.ndarray] = []
    for name, parent in zip(body.joint_names, body.parents, strict=True):
        own = Rotation.from_euler("xyz", turns.get(name, (0, 0, 0)), degrees=True).as_matrix()
        world.append(own if parent < 0 else world[parent] @ own)
    motion = Motion(np.array(world, np.float32)[None], body.joints[:1].astype(np.float32), 30.0)
    return pose_body(body, motion, np.array([0]))[0].astype(np.float64)


def points_around(vertices: np.ndarray, faces: np.ndarray, many: int, seed: int) -> np.ndarray:
    """Return points `[many, 3]` float64: most near the surface, some anywhere around it, some along edges."""
    rng = np.random.default_rng(seed)
    on = rng.dirichlet(np.ones(3), many)[:, :, None] * vertices[faces[rng.integers(len(faces), size=many)]]
    spread = rng.choice([1e-3, 1e-2, 5e-2], size=(many, 1))
    points = on.sum(axis=1) + rng.normal(size=(many, 3)) * spread
    anywhere = rng.random(many) < 0.1
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return np.where(anywhere[:, None], rng.uniform(low, high, (many, 3)), points)


def rest_body(resolution: float = 0.03) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and faces of the mannequin as it stands."""
    body = make_mannequin(resolution)
    return np.asarray(body.vertices), np.asarray(body.faces)
