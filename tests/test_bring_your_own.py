"""A user's own files from beginning to end, each as the commands that the documentation gives.

Simulations of another data set become a trained model; a rigged GLB, a BVH and an OBJ are simulated, trained
on, animated and become USD.
"""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import infer
import train
from garment_jax.cli import main as garment_jax
from garment_jax.config import Config, DataConfig, to_toml
from garment_jax.io.formats.blender import VARIABLE, run_blender
from garment_jax.io.formats.usd_library import load_pxr
from garment_jax.io.sequence import open_sequence
from tests.animation.tiny_model import CONFIG, SCENE
from tests.importers.glb_files import write_glb
from tests.importers.vto_files import write_vto
from tests.reference.files import write_bvh, write_obj
from tests.reference.scene import make_motion, make_vertices

FRAMES = 18
CLOTH = ["settle=10", "blend=10", "hold=2"]
LEGS = ("spine1", "spine2", "left_hip", "left_knee", "right_hip", "right_knee")
SMALL = replace(CONFIG, data=DataConfig(mirror=False))
SMPL = replace(SMALL, body=replace(SMALL.body, motion_joints=LEGS))


def run(program, words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["program", *words])
    assert program.main() == 0


def train_and_animate(config: Config, clips: str, motion: str, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("mine.toml").write_text(to_toml(config))
    run(train, ["mine.toml", "--data", clips, "--run-dir", "run"], monkeypatch)
    run(infer, ["run", "--motion", motion, "--out", "pred.h5"], monkeypatch)


@pytest.mark.slow
def test_from_vto_pickles_to_a_trained_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    write_vto(
        tmp_path,
        {"skirt_shape00_01_01": FRAMES, "skirt_shape00_01_02": FRAMES, "skirt_shape00_09_01": FRAMES},
    )
    monkeypatch.chdir(tmp_path)
    words = ["skirt", "--body", "smpl.pkl", "--test", "skirt_shape00_09_01", "--out", "clips"]
    assert garment_jax(["import", *words]) == 0
    assert "clips: 3 clips, 54 frames, 3 of them imported now" in capsys.readouterr().out
    with open_sequence("clips/test/skirt_shape00_09_01.h5") as clip:
        truth = make_vertices(SCENE, make_motion(SCENE, FRAMES, 2), 2)
        assert np.abs(clip.read(0, FRAMES) - truth).max() < 1e-4
    train_and_animate(SMPL, "clips", "clips/test/skirt_shape00_09_01.h5", monkeypatch)
    assert garment_jax(["evaluate", "pred.h5", "clips/test/skirt_shape00_09_01.h5", "--every", "6"]) == 0
    table = [line.split()[1:4:2] for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert table[:2] == [["clip", "skirt_shape00_09_01"], ["frames", str(FRAMES)]]


def write_own_files(folder: Path) -> None:
    """Write `me.glb`, `skirt.obj`, `solid.npz` and `moves/*.bvh` of the small dressed body."""
    assert SCENE.collider is not None
    write_glb(folder / "me.glb", SCENE.body)
    write_obj(folder / "skirt.obj", SCENE.garment)
    np.savez(folder / "solid.npz", **SCENE.collider._asdict())
    (folder / "moves").mkdir()
    for k, name in enumerate(("walk", "run", "jump")):
        write_bvh(folder / "moves" / f"{name}.bvh", SCENE.body, make_motion(SCENE, FRAMES, seed=k))


@pytest.mark.slow
def test_from_bvh_glb_and_obj_to_usd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    pytest.importorskip("newton")
    pytest.importorskip("pxr")
    write_own_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    own = ["--garment", "skirt.obj", "--body", "me.glb", "--motion", "moves", "--test", "jump"]
    assert (
        garment_jax(
            ["simulate", "files", *own, "--collider", "solid.npz", "--out", "clips", "--cloth", *CLOTH]
        )
        == 0
    )
    assert "clips: 3 of 3 clips" in capsys.readouterr().out
    train_and_animate(SMALL, "clips", "clips/test/jump.h5", monkeypatch)
    assert garment_jax(["export", "pred.h5", "--format", "usd", "--out", "pred.usdc"]) == 0
    with open_sequence("pred.h5") as clip:
        V = clip.read(0, FRAMES)
    check_usd(Path("pred.usdc"), V)
    if VARIABLE in os.environ:
        check_in_blender(Path("pred.usdc"), V)


def check_usd(path: Path, V: np.ndarray) -> None:
    """Compare the stage's points with the clip's `[t, n, 3]` through Pixar's own library."""
    pxr = load_pxr()
    stage = pxr.Usd.Stage.Open(str(path))
    mesh = pxr.UsdGeom.Mesh(stage.GetPrimAtPath("/Clip/Garment"))
    for t in range(len(V)):
        points = np.array(mesh.GetPointsAttr().Get(stage.GetStartTimeCode() + t))
        assert np.abs(points - V[t]).max() < 1e-5
    assert pxr.UsdGeom.GetStageUpAxis(stage) == "Y"
    assert stage.GetFramesPerSecond() == 30


IN_BLENDER = """
import sys
import bpy
import numpy as np
path, out, last = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.usd_import(filepath=path)
frames = []
for frame in range(int(last)):
    bpy.context.scene.frame_set(frame)
    found = bpy.data.objects["Garment"].evaluated_get(bpy.context.evaluated_depsgraph_get())
    frames.append([tuple(found.matrix_world @ vertex.co) for vertex in found.data.vertices])
np.save(out, np.array(frames))
"""


def check_in_blender(path: Path, V: np.ndarray) -> None:
    """Compare what Blender shows, Z up, with the clip's `[t, n, 3]`: below 0.01 mm."""
    script, seen = path.with_name("look.py"), path.with_name("seen.npy")
    script.write_text(IN_BLENDER)
    run_blender(script, [str(path.resolve()), str(seen.resolve()), str(len(V))])
    shown = np.load(seen)
    assert np.abs(shown[..., [0, 2, 1]] * [1, 1, -1] - V).max() < 1e-5
