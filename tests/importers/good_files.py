"""A folder with a small case in every format, sound: what the tests of broken files spoil."""

import pickle
import struct
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tests.importers.glb_files import write_glb
from tests.importers.vto_files import CHEST, smpl_pose, write_vto
from tests.reference.files import write_body, write_bvh, write_obj
from tests.reference.scene import make_motion, make_scene, make_vertices

FRAMES = 6
SCENE = make_scene()
MOTION = make_motion(SCENE, FRAMES)
V = make_vertices(SCENE, MOTION)


def write_all(folder: Path) -> Path:
    """Write the case: SMPL body, vto clip, rigged bodies, garment, motions, mesh caches."""
    write_vto(folder, {"walk": FRAMES}, SCENE)
    write_body(folder / "me.npz", SCENE.body)
    write_glb(folder / "me.glb", SCENE.body, MOTION)
    write_obj(folder / "skirt.obj", SCENE.garment)
    write_bvh(folder / "walk.bvh", SCENE.body, MOTION)
    write_amass(folder / "amass.npz")
    (folder / "aist.pkl").write_bytes(pickle.dumps(aist_clip()))
    write_virtual_bones(folder / "dress02")
    write_pc2(folder / "walk.pc2", V)
    write_mdd(folder / "walk.mdd", V)
    write_frames(folder / "walk", V)
    (folder / "walk.ply").mkdir()
    for t, frame in enumerate(V):
        (folder / f"walk.ply/{t}.ply").write_bytes(ply(frame, SCENE.garment.faces))
    return folder


def write_amass(path: Path) -> None:
    """Write the motion as AMASS has it: Z up, 156 values a pose."""
    pose, translation = smpl_pose(SCENE, MOTION)
    upright = Rotation.from_euler("x", 90, degrees=True)
    root = SCENE.body.joints[0] - CHEST  # SMPL turns about the pelvis, then shifts
    poses = np.zeros((FRAMES, 156))
    poses[:, :66] = pose[:, :66]
    poses[:, :3] = (upright * Rotation.from_rotvec(pose[:, :3])).as_rotvec()
    shift = upright.apply(translation + root) - root
    arrays = {"poses": poses, "trans": shift, "betas": np.zeros(16), "dmpls": np.zeros((FRAMES, 8))}
    np.savez(path, gender="female", mocap_framerate=30.0, **arrays)


def aist_clip() -> dict:
    """Return the motion as AIST++ has it: its translation times a scale."""
    pose, translation = smpl_pose(SCENE, MOTION)
    return {"smpl_poses": pose, "smpl_trans": translation * 90, "smpl_scaling": np.array([90.0])}


def write_virtual_bones(folder: Path) -> None:
    """Write a clip as VirtualBones has it: rotation vectors of SMPL-H's joints, a template beside it."""
    pose, translation = smpl_pose(SCENE, MOTION)
    poses = np.zeros((FRAMES, 52, 3), np.float32)
    poses[:, :22] = pose.reshape(-1, 24, 3)[:, :22]
    folder.mkdir()
    np.savez(folder / "1.npz", pose=poses, trans=translation.astype(np.float32), sim_res=V)
    write_obj(folder / "template.obj", SCENE.garment)


def write_pc2(path: Path, frames: np.ndarray) -> None:
    """Write a PC2 file, byte by byte as its specification says."""
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, frames.shape[1], 0.0, 1.0, len(frames))
    path.write_bytes(head + frames.astype("<f4").tobytes())


def write_mdd(path: Path, frames: np.ndarray) -> None:
    """Write an MDD file: big-endian; frames, points, times, positions."""
    head = struct.pack(">ii", len(frames), frames.shape[1])
    times = (np.arange(len(frames)) / 30).astype(">f4")
    path.write_bytes(head + times.tobytes() + frames.astype(">f4").tobytes())


def write_frames(folder: Path, frames: np.ndarray) -> None:
    """Write an OBJ file for each frame."""
    folder.mkdir()
    for t, frame in enumerate(frames):
        write_obj(folder / f"walk_{t + 1}.obj", SCENE.garment._replace(template=frame))


def ply(points: np.ndarray, faces: np.ndarray) -> bytes:
    """Return a binary PLY file."""
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    rows = np.zeros(len(faces), [("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, faces
    return head.encode() + points.astype("<f4").tobytes() + rows.tobytes()


def write_usd(path: Path, frames: np.ndarray, *, unit: float = 1.0, up: str = "Y", fps: float = 30.0) -> Path:
    """Write an ASCII stage with an animated mesh."""

    def listed(points: np.ndarray) -> str:
        return "[" + ", ".join(f"({x}, {y}, {z})" for x, y, z in points.tolist()) + "]"

    faces = SCENE.garment.faces
    samples = ",\n".join(f"{t}: {listed(frame)}" for t, frame in enumerate(frames))
    path.write_text(
        f'#usda 1.0\n(\nmetersPerUnit = {unit}\nupAxis = "{up}"\ntimeCodesPerSecond = {fps}\n'
        f'endTimeCode = {len(frames) - 1}\nstartTimeCode = 0\n)\ndef Mesh "Garment"\n{{\n'
        f"int[] faceVertexCounts = {[3] * len(faces)}\nint[] faceVertexIndices = {faces.ravel().tolist()}\n"
        f"point3f[] points.timeSamples = {{\n{samples}\n}}\n}}\n"
    )
    return path
