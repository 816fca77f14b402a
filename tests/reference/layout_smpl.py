"""AMASS and AIST++ files, written from a performance of SMPL's skeleton."""

import pickle
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tests.reference.layout_files import resampled
from tests.reference.person import Performance, about


def write_amass(path: Path, truth: Performance, fps: float = 120.0) -> Path:
    """Write an AMASS archive (SMPL-H, Z up) of a performance of SMPL's skeleton."""
    truth = resampled(truth, fps)
    poses, translation = _smpl_arrays(truth, 52)
    turn = about("x", 90.0)  # the file's world: Z up
    poses[:, 0] = Rotation.from_matrix(turn @ truth.rotations[:, 0]).as_rotvec()
    root = truth.person.rest[0]
    translation = (translation + root) @ turn.T - root
    arrays = {"gender": np.array("neutral"), "mocap_framerate": np.array(fps), "betas": np.zeros(16)}
    arrays |= {"dmpls": np.zeros((len(poses), 8))}
    np.savez(path, trans=translation, poses=poses.reshape(len(poses), -1), **arrays)
    return path


def write_aist(path: Path, truth: Performance, scaling: float = 93.7) -> Path:
    """Write an AIST++ pickle (SMPL, Y up, 60 frames a second, translations times the scaling)."""
    poses, translation = _smpl_arrays(resampled(truth, 60.0), 24)
    content = {
        "smpl_poses": poses.reshape(len(poses), -1).astype(np.float32),
        "smpl_scaling": np.array([scaling], np.float32),
        "smpl_trans": (translation * scaling).astype(np.float32),
        "smpl_loss": 0.5,
    }
    path.write_bytes(pickle.dumps(content, 2))
    return path


def _smpl_arrays(truth: Performance, joints: int) -> tuple[np.ndarray, np.ndarray]:
    poses = np.zeros((len(truth.positions), joints, 3))
    for j, parent in enumerate(truth.person.parents):
        above = np.swapaxes(truth.rotations[:, parent], -1, -2) if j else np.eye(3)
        poses[:, j] = Rotation.from_matrix(above @ truth.rotations[:, j]).as_rotvec()
    return poses, truth.positions[:, 0] - truth.person.rest[0]
