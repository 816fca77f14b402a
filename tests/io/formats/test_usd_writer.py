"""USD written: read back by us and by Pixar's library, every ending; its validators find nothing wrong."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.io.formats.usd_writer import UsdMesh, write_usd
from tests.reference.scene import make_motion, make_scene, make_vertices

pxr = pytest.importorskip("pxr", reason="needs the extra usd")
from pxr import Usd, UsdGeom, UsdValidation  # noqa: E402

from garment_jax.io.formats.usd import read_usd  # noqa: E402

SCENE = make_scene(3, 8)
V = make_vertices(SCENE, make_motion(SCENE, 70))
BODY = np.tile(SCENE.body.vertices, (70, 1, 1))
UP = np.tile(np.float32([0, 0, 1]), (1000, 1))


def write(path: Path, *, up: str = "Y") -> Path:
    garment, body = SCENE.garment, SCENE.body
    meshes = [
        UsdMesh("Garment", garment.faces, garment.uv, garment.faces_uv, np.array([[0.5, 0.25, 0.125]])),
        UsdMesh("Body", body.faces, None, None, body.vertices % 1),
    ]
    frames = ([(V[k], UP[: V.shape[1]]), (BODY[k], UP[: BODY.shape[1]])] for k in range(70))
    write_usd(path, meshes, frames, fps=24, first_frame=10, count=70, unit=0.01, up=up)
    return path


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usd", ".usdz"])
def test_round_trip(tmp_path: Path, suffix: str):
    cache = read_usd(write(tmp_path / f"a{suffix}", up="Z"))
    np.testing.assert_array_equal(cache.vertices[:], V)
    np.testing.assert_array_equal(cache.faces, SCENE.garment.faces)
    np.testing.assert_array_equal(cache.uv, SCENE.garment.uv)
    np.testing.assert_array_equal(cache.faces_uv, SCENE.garment.faces_uv)
    assert (cache.fps, cache.unit, cache.up) == (24, 0.01, "Z")
    np.testing.assert_array_equal(read_usd(tmp_path / f"a{suffix}", mesh="Body").vertices[60], BODY[60])
    assert [file.name for file in tmp_path.iterdir()] == [f"a{suffix}"]


def test_the_stage_says_what_programs_need(tmp_path: Path):
    stage = Usd.Stage.Open(str(write(tmp_path / "a.usdc")))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (10, 79, 24)
    root = stage.GetDefaultPrim()
    assert (root.GetPath(), Usd.ModelAPI(root).GetKind()) == ("/Clip", "component")
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Clip/Garment"))
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    assert list(mesh.GetPointsAttr().GetTimeSamples()) == list(range(10, 80))
    np.testing.assert_array_equal(mesh.GetExtentAttr().Get(33), [V[23].min(axis=0), V[23].max(axis=0)])
    assert len(mesh.GetNormalsAttr().Get(33)) == V.shape[1]
    assert mesh.GetDisplayColorPrimvar().ComputeFlattened() == [(0.5, 0.25, 0.125)]
    body = UsdGeom.Mesh(stage.GetPrimAtPath("/Clip/Body")).GetDisplayColorPrimvar()
    assert body.GetInterpolation() == "vertex"
    np.testing.assert_array_equal(body.Get(), SCENE.body.vertices % 1)


@pytest.mark.parametrize("suffix", [".usdc", ".usdz"])
def test_validators_find_nothing(tmp_path: Path, suffix: str):
    registry = UsdValidation.ValidationRegistry()
    validators = registry.GetOrLoadAllValidators()
    assert len(validators) > 10
    stage = Usd.Stage.Open(str(write(tmp_path / f"a{suffix}")))
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetMessage() for error in found] == []


def test_the_validators_do_look(tmp_path: Path):
    stage = Usd.Stage.Open(str(write(tmp_path / "a.usdc")))
    stage.ClearDefaultPrim()
    stage.ClearMetadata("upAxis")
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    assert {error.GetName() for error in found} >= {"MissingDefaultPrim", "MissingUpAxisMetadata"}


def test_a_folder_that_is_not_there_is_one_sentence():
    with pytest.raises(OSError, match="could not be written"):
        write(Path("/proc/none/a.usdc"))
