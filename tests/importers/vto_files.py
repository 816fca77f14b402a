"""The small dressed body of `tests.reference.scene` as files that SMPL's users have: body, garment, clips."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.structs import Garment, Motion, Scene
from tests.reference.files import write_obj
from tests.reference.scene import make_motion, make_scene, make_vertices

# SMPL's joints in its own order, by the names that the small body has
ORDER = (
    *(
        "Hips",
        "LeftUpLeg",
        "RightUpLeg",
        "LowerBack",
        "LeftLeg",
        "RightLeg",
        "Spine",
        "LeftFoot",
        "RightFoot",
    ),
    *("Spine1", "LeftToeBase", "RightToeBase", "Neck", "LeftShoulder", "RightShoulder", "Head", "LeftArm"),
    *("RightArm", "LeftForeArm", "RightForeArm", "LeftHand", "RightHand"),
)
PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
CHEST = np.array([0.0, 1.1, 0.0])  # SMPL's origin is in the chest, its floor far below zero


def smpl_arrays(scene: Scene) -> dict[str, Any]:
    """Return the arrays of an SMPL file whose body at beta = 0 is the scene's, moved to SMPL's origin."""
    body = scene.body
    index = [body.joint_names.index(name) for name in ORDER]
    vertices = body.vertices.astype(np.float64) - CHEST
    joints = np.concatenate([body.joints[index], body.joints[index[-2:]] + [[0.0, -0.05, 0.0]]]) - CHEST
    homogeneous = np.concatenate([vertices, np.ones((len(vertices), 1))], axis=1)
    targets = np.concatenate([joints, np.ones((24, 1))], axis=1)
    weights = np.zeros((len(vertices), 24))
    weights[:, :22] = body.skin_weights[:, index]
    taller = np.zeros((len(vertices), 3, 10))
    taller[:, :, 0] = 0.02 * vertices
    return {
        "v_template": vertices,
        "shapedirs": taller,
        "posedirs": np.zeros((len(vertices), 3, 207)),
        "J_regressor": targets @ np.linalg.pinv(homogeneous),
        "weights": weights,
        "kintree_table": np.array([[2**32 - 1, *PARENTS[1:]], range(24)], np.int64),
        "f": body.faces.astype(np.uint32),
    }


def smpl_pose(scene: Scene, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return SMPL's `pose` `[t, 72]` (rotation vectors) and `translation` `[t, 3]` of a motion."""
    R = motion.rotations.astype(np.float64)
    index = [scene.body.joint_names.index(name) for name in ORDER]
    pose = np.zeros((len(R), 24, 3))
    for k, j in enumerate(index):
        above = R[:, index[PARENTS[k]]] if k else np.eye(3)[None]
        pose[:, k] = Rotation.from_matrix(np.swapaxes(above, -1, -2) @ R[:, j]).as_rotvec()
    return pose.reshape(-1, 72), motion.root - (scene.body.joints[0] - CHEST)


def vto_clip(scene: Scene, motion: Motion, seed: int = 0, *, joined: bool = False) -> dict[str, Any]:
    """Return the dict of a simulation in either spelling of the data set (`joined`: 75 values a pose)."""
    pose, translation = smpl_pose(scene, motion)
    shape = np.zeros((len(pose), 10))
    clip = {"vertices": make_vertices(scene, motion, seed), "faces": scene.garment.faces, "sequence": "01_01"}
    if joined:
        return clip | {"shapes": shape, "poses": np.concatenate([pose, translation], axis=1)}
    return clip | {"shape": shape, "pose": pose, "translation": translation}


def write_vto(folder: Path, frames: dict[str, int], scene: Scene | None = None) -> Path:
    """Write `folder/smpl.pkl` and `folder/skirt/` as the data set has it; a clip for each of `frames`."""
    scene = scene or make_scene()
    (folder / "skirt/simulations").mkdir(parents=True)
    (folder / "smpl.pkl").write_bytes(pickle.dumps(smpl_arrays(scene)))
    write_metres_obj(folder / "skirt/skirt.obj", scene.garment)
    for seed, (name, count) in enumerate(frames.items()):
        clip = vto_clip(scene, make_motion(scene, count, seed), seed, joined=bool(seed % 2))
        (folder / f"skirt/simulations/{name}.pkl").write_bytes(pickle.dumps(clip))
    return folder / "skirt"


def write_metres_obj(path: Path, garment: Garment) -> Path:
    """Write a template at SMPL's origin, its UVs in metres and with the lines that readers must skip."""
    moved = garment._replace(
        template=(garment.template - CHEST).astype(np.float32), uv=garment.uv * 1.7 - 0.4
    )
    write_obj(path, moved)
    path.write_text(path.read_text() + "\nny 0.1\nnv 0 0 1\n")
    return path
