"""FBX is read as the glTF that Blender makes of it, under its own name."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from garment_jax.body.kinematics import pose_body
from garment_jax.importers.bodies import read_any_body
from garment_jax.importers.motions import read_motion
from garment_jax.io.formats import fbx
from garment_jax.io.formats.blender import VARIABLE, find_blender, run_blender
from tests.importers.glb_files import write_glb
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene()
BODY, MOTION = SCENE.body, make_motion(SCENE, 12)


@pytest.fixture
def walk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An FBX for which a stand-in of Blender makes `walk.made.glb`."""
    glb = write_glb(tmp_path / "walk.made.glb", BODY, MOTION)
    monkeypatch.setattr(fbx, "run_blender", lambda _, paths, **options: shutil.copy(glb, paths[1]))
    path = tmp_path / "walk.FBX"
    path.write_bytes(b"Kaydara FBX Binary  \x00")
    return path


def test_body_and_motion_are_those_of_the_gltf(walk: Path) -> None:
    glb = walk.with_name("walk.made.glb")
    np.testing.assert_array_equal(read_any_body(walk).body.vertices, read_any_body(glb).body.vertices)
    one, other = read_motion(walk, BODY, fps=30.0), read_motion(glb, BODY, fps=30.0)
    np.testing.assert_array_equal(one.rotations, other.rotations)
    np.testing.assert_array_equal(one.root, other.root)


def test_what_is_said_of_it_has_its_name(walk: Path) -> None:
    walk.with_name("walk.made.glb").write_bytes(b"glTF")
    with pytest.raises((ValueError, OSError), match=r"walk\.FBX") as refused:
        read_motion(walk, BODY, fps=30.0)
    assert ".glb" not in str(refused.value)


def test_without_blender_a_sentence_says_how(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "nowhere"))
    (tmp_path / "me.fbx").write_bytes(b"x")
    with pytest.raises(FileNotFoundError, match=r"me\.fbx is FBX: .*Blender.* or give it as glTF"):
        read_any_body(tmp_path / "me.fbx")


def test_a_file_that_is_not_there_asks_for_no_blender(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"me\.fbx"):
        read_any_body(tmp_path / "me.fbx")


def test_blenders_own_fbx_moves_as_the_gltf_it_is_made_of(tmp_path: Path) -> None:
    try:
        find_blender()
    except FileNotFoundError as error:
        pytest.skip(str(error))
    glb = write_glb(tmp_path / "walk.glb", BODY, MOTION)
    run_blender(Path(__file__).with_name("fbx_from_glb.py"), [str(glb), str(tmp_path / "walk.fbx")])
    body = read_any_body(tmp_path / "walk.fbx").body
    moved = read_motion(tmp_path / "walk.fbx", body, fps=30.0)
    ours = pose_body(body, moved, slice(None))
    true = pose_body(BODY, read_motion(glb, BODY, fps=30.0), slice(None))
    _, match = KDTree(true[5]).query(ours[5])
    worst = np.abs(ours - true[: len(ours), match]).max()
    print(f"largest difference from the glTF: {worst * 1e3:.4f} mm")
    assert worst < 3e-3  # FBX has times and angles of its own
