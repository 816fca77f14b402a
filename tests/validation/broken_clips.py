"""A good clip, and copies of it that are broken in one way each."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.io.sequence_writer import SequenceWriter
from garment_jax.structs import Motion, Scene
from tests.reference.scene import make_scene

FRAMES = 90
_TURNING = {"Hips": (1, 0.4), "LeftUpLeg": (0, 0.25), "RightUpLeg": (0, -0.25), "Spine": (2, 0.15)}


def calm_scene() -> Scene:
    """The reference scene, its pins carried by the hips alone."""
    scene = make_scene()
    assert scene.pins is not None
    weights = np.zeros_like(scene.pins.weights)
    weights[:, 0] = 1.0
    return scene._replace(pins=scene.pins._replace(weights=weights))


def calm_motion(frames: int = FRAMES, *, phase: float = 0.0, fps: float = 30.0) -> Motion:
    """A slow dance on the spot, without a frame like another."""
    body = make_scene().body
    time = np.arange(frames) / fps + phase
    local = np.tile(np.eye(3), (frames, len(body.joints), 1, 1))
    for k, (name, (axis, size)) in enumerate(_TURNING.items()):
        turn = np.zeros((frames, 3))
        turn[:, axis] = size * np.sin(2.0 * time * (1 + 0.13 * k) + k)
        local[:, body.joint_names.index(name)] = Rotation.from_rotvec(turn).as_matrix()
    rotations = local.copy()
    for j in range(1, len(body.joints)):
        rotations[:, j] = rotations[:, body.parents[j]] @ local[:, j]
    travel = np.stack([0.3 * np.sin(1.7 * time), 0.02 * np.sin(5 * time), 0.3 * np.cos(1.3 * time)], axis=1)
    return Motion(rotations.astype(np.float32), body.joints[0] + travel, fps)


def calm_vertices(scene: Scene, motion: Motion) -> np.ndarray:
    """The template carried by the hips, with small waves towards the hem, `[t, n, 3]`."""
    T = scene.garment.template.astype(np.float64)
    time, angle = np.arange(len(motion.root)) / motion.fps, np.arctan2(T[:, 0], T[:, 2])
    depth = (T[:, 1].max() - T[:, 1]) / np.ptp(T[:, 1])
    wave = 0.01 * depth * np.sin(3 * angle + 4 * time[:, None])
    outward = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=1)
    local = T + wave[..., None] * outward - scene.body.joints[0]
    R = motion.rotations[:, 0].astype(np.float64)
    return (local @ np.swapaxes(R, 1, 2) + motion.root[:, None]).astype(np.float32)


def good_clip(path: Path, *, frames: int = FRAMES, phase: float = 0.0, encoding: str = "float32") -> Path:
    """Write a clip without a fault."""
    scene, motion = calm_scene(), calm_motion(frames, phase=phase)
    with SequenceWriter(path, scene, motion, encoding=encoding) as writer:
        writer.append(calm_vertices(scene, motion))
    return path


def broken(path: Path, change: Callable[[h5py.File], object], **options) -> Path:
    """Write a good clip and change the file."""
    good_clip(path, **options)
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def put(file: h5py.File, name: str, values: np.ndarray) -> None:
    """Replace a dataset, its attributes kept."""
    attributes = dict(file[name].attrs)
    del file[name]
    file.create_dataset(name, data=values)
    file[name].attrs.update(attributes)


def scaled(*names: str, factor: float) -> Callable[[h5py.File], None]:
    """Return the change that multiplies datasets."""

    def change(file: h5py.File) -> None:
        for name in names:
            put(file, name, (file[name][()] * factor).astype(file[name].dtype))

    return change


LENGTHS = ("template", "vertices", "root", "body/vertices", "body/joints")
# to a world with Z up: a point (x, y, z) is (x, -z, y) there
TO_Z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def turned(*, canonical: bool, world: bool, back: bool = False) -> Callable[[h5py.File], None]:
    """Return the change to Z up of the canonical things, of the world, or of both; `back`: to -Z up."""
    C, W = ((TO_Z.T if back else TO_Z) if on else np.eye(3) for on in (canonical, world))

    def change(file: h5py.File) -> None:
        for name in ("template", "body/vertices", "body/joints"):
            put(file, name, (file[name][()] @ C.T).astype(np.float32))
        put(file, "vertices", (file["vertices"][()] @ W.T).astype(np.float32))
        put(file, "root", file["root"][()] @ W.T)
        put(file, "rotations", (W @ file["rotations"][()] @ C.T).astype(np.float32))

    return change


def edit(name: str, change: Callable[[np.ndarray], object]) -> Callable[[h5py.File], None]:
    """Return the change of one dataset in place, or by what `change` returns."""

    def apply(file: h5py.File) -> None:
        values = file[name][()]
        result = change(values)
        put(file, name, values if result is None else np.asarray(result))

    return apply


def set_attribute(name: str, value) -> Callable[[h5py.File], None]:
    """Return the change of an attribute, None to remove it."""

    def apply(file: h5py.File) -> None:
        if value is None:
            del file.attrs[name]
        else:
            file.attrs[name] = value

    return apply


def rest_pose_first(file: h5py.File) -> None:
    """Put four frames of the rest pose, far away, before the motion (as motion capture files do)."""
    scene = make_scene()
    R, root, V = (file[name][()] for name in ("rotations", "root", "vertices"))
    R[:4] = np.eye(3)
    root[:4] = scene.body.joints[0] + [2.0, 0.0, 0.0]
    V[:4] = scene.garment.template + np.float32([2.0, 0.0, 0.0])
    for name, values in (("rotations", R), ("root", root), ("vertices", V)):
        put(file, name, values)


def frozen_end(file: h5py.File) -> None:
    """Repeat a frame for the last 30."""
    for name in ("rotations", "root", "vertices"):
        values = file[name][()]
        values[-30:] = values[-31]
        put(file, name, values)


def held(file: h5py.File) -> None:
    """Hold every pose for four frames: a capture of 30 frames a second said to be of 120."""
    for name in ("rotations", "root", "vertices"):
        values = file[name][()]
        put(file, name, values[np.arange(len(values)) // 4 * 4])


def other_motion(file: h5py.File) -> None:
    """Put the cloth of another clip on this motion."""
    put(file, "vertices", calm_vertices(calm_scene(), calm_motion(phase=40.0)))
