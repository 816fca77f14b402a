"""Packing a synthetic clip for transport, as the shared clips are: the importer's inverse, naively."""

from pathlib import Path

import h5py
import numpy as np

from tests.reference.scene import make_motion, make_scene, make_vertices

SCALE = 5e-5


def write_packed(folder: Path, name: str = "train_waltz", frames: int = 9) -> Path:
    """Write `folder/skirt/<name>.h5`, its pins, and `folder/avatar/*.npz`; return the clip's path."""
    scene = make_scene()
    assert scene.collider is not None
    assert scene.pins is not None
    for part in ("skirt", "avatar"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    np.savez(folder / "avatar/avatar.npz", **scene.body._asdict())
    np.savez(folder / "avatar/collider.npz", **scene.collider._asdict())
    np.savez(folder / "skirt/pins.npz", pins=scene.pins.vertices, pin_weights=scene.pins.weights)
    path = folder / "skirt" / f"{name}.h5"
    motion = make_motion(scene, frames)
    steps = np.rint((make_vertices(scene, motion) - motion.root[:, None]) / SCALE).astype(np.int32)
    with h5py.File(path, "w") as file:
        file["vertices_delta"] = pack(steps)
        file["vertices_delta"].attrs["scale"] = SCALE
        file["rotations"], file["root"] = motion.rotations, motion.root
        for key, value in scene.garment._asdict().items():
            file[key] = value
        file["pins"] = scene.pins.vertices
        file["collider_body_vertices"] = scene.collider.body_vertices
        split = name.split("_")[0]
        file.attrs.update({"fps": 30.0, "length_unit": "m", "up_axis": "Y", "split": split, "source": "code"})
        file.attrs["body"] = "avatar/avatar.npz"
    return path


def pack(steps: np.ndarray) -> np.ndarray:
    """Return the differences over frames, then over vertices, of int32 `steps` `[t, n, 3]` as int16.

    They wrap where they exceed 16 bits: a sum in 32 bits would then be wrong, so that is refused here.
    """
    delta = np.diff(np.diff(steps, axis=0, prepend=0), axis=1, prepend=0)
    assert np.abs(delta).max() < 32_768
    return delta.astype(np.int16)
