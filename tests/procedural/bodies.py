"""The bodies that the embedded garments and motions are tested on, each made once."""

import functools
from pathlib import Path

import numpy as np
import trimesh

from garment_jax.procedural.mannequin import make_mannequin
from garment_jax.structs import Collider, RiggedBody


@functools.cache
def mannequin() -> RiggedBody:
    return make_mannequin()


@functools.cache
def avatar(shared_data: Path) -> tuple[RiggedBody, Collider]:
    """The shared avatar and the collider that its clips were simulated with."""
    arrays = dict(np.load(shared_data / "avatar" / "avatar.npz"))
    arrays["joint_names"] = tuple(arrays["joint_names"].tolist())
    collider = Collider(**np.load(shared_data / "avatar" / "collider.npz"))
    return RiggedBody(**{name: arrays[name] for name in RiggedBody._fields}), collider


def pillar(radii: dict[float, float] | None = None) -> tuple[RiggedBody, Collider]:
    """A round body of 2 m, 12 cm in radius unless `radii` by height say otherwise, with two joints."""
    profile = sorted((radii or {0.0: 0.12, 2.0: 0.12}).items())
    line = np.array([[0, 0], *[[r, y] for y, r in profile], [0, profile[-1][0]]])
    mesh = trimesh.creation.revolve(line, sections=128)
    vertices = np.asarray(mesh.vertices)[:, [1, 2, 0]].astype(np.float32)
    faces = np.asarray(mesh.faces, np.int32)
    joints = np.array([[0, 0.8, 0], [0, 1.3, 0]], np.float32)
    weights = np.tile(np.float32([1, 0]), (len(vertices), 1))
    body = RiggedBody(vertices, faces, joints, np.array([-1, 0], np.int32), ("Hips", "Spine1"), weights)
    return body, Collider(np.arange(len(vertices), dtype=np.int32), np.zeros(0, np.int32), faces)
