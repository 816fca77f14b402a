"""A rig that Blender exports: our reading of body and animation poses it as Blender does."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from garment_jax.body.kinematics import pose_body
from garment_jax.io.formats.blender import find_blender, run_blender
from garment_jax.io.formats.gltf import read_animation, read_body
from garment_jax.structs import Motion


def test_blenders_rig_moves_as_in_blender(tmp_path: Path):
    try:
        find_blender()
    except FileNotFoundError as error:
        pytest.skip(str(error))
    glb, out = tmp_path / "rig.glb", tmp_path / "rig.npz"
    run_blender(Path(__file__).with_name("glb_from_blender.py"), [str(glb), str(out)])
    with np.load(out) as seen:
        posed = seen["posed"]
    body, moved = read_body(glb).body, read_animation(glb, fps=30.0)
    assert body.joint_names == ("hips", "spine", "arm", "head")
    assert len(body.vertices) == posed.shape[1]  # split at UV seams by the exporter, welded by us
    assert len(moved.root) == len(posed)
    ours = pose_body(body, Motion(*moved[:3]), slice(None))
    _, match = KDTree(posed[3]).query(ours[3])
    assert len(set(match.tolist())) == len(match)
    worst = np.abs(ours - posed[:, match]).max()
    print(f"largest difference from Blender: {worst * 1e3:.6f} mm")
    assert worst < 1e-5
