"""USD read: stages written by Pixar's library by hand: fans, transforms, rates, primvars; broken stages."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from garment_jax.io.formats.any_mesh_cache import read_cache

pxr = pytest.importorskip("pxr", reason="needs the extra usd")
from pxr import Gf, Sdf, Usd, UsdGeom, Vt  # noqa: E402

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0]], np.float32)


def make_stage(path: Path, *, times: tuple[float, ...] = (1, 2, 3), **names: str) -> Any:
    """A quad and a triangle below a transform; the points move up by one unit a time code."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.Xform.Define(stage, "/World")
    mesh = UsdGeom.Mesh.Define(stage, f"/World/{names.get('name', 'Skirt')}")
    mesh.CreateFaceVertexCountsAttr([4, 3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 1, 4, 2])
    points = mesh.CreatePointsAttr()
    for t in times:
        points.Set(Vt.Vec3fArray.FromNumpy(SQUARE + np.float32([0, t, 0])), t)
    return stage, mesh


def test_polygons_times_and_units(tmp_path: Path):
    stage, _ = make_stage(tmp_path / "a.usda")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.SetTimeCodesPerSecond(25)
    stage.Save()
    cache = read_cache(tmp_path / "a.usda")
    assert cache.faces is not None
    assert cache.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2]]
    assert (cache.fps, cache.unit, cache.up, cache.uv) == (25, 0.01, "Z", None)
    np.testing.assert_array_equal(
        cache.vertices[:], SQUARE + np.float32([[[0, 1, 0]], [[0, 2, 0]], [[0, 3, 0]]])
    )


def test_what_a_stage_does_not_say_is_none(tmp_path: Path):
    make_stage(tmp_path / "a.usdc", times=(5,))[0].Save()
    cache = read_cache(tmp_path / "a.usdc")
    assert (cache.vertices.shape, cache.fps, cache.unit, cache.up) == ((1, 5, 3), None, None, None)


def test_transforms_above_the_mesh_are_applied_at_their_time(tmp_path: Path):
    stage, _ = make_stage(tmp_path / "a.usda", times=())
    points = UsdGeom.Mesh.Get(stage, "/World/Skirt").GetPointsAttr()
    points.Set(Vt.Vec3fArray.FromNumpy(SQUARE))
    move = UsdGeom.Xform.Get(stage, "/World").AddTranslateOp()
    UsdGeom.Xform.Get(stage, "/World").AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    for t in (0, 2, 4):
        move.Set(Gf.Vec3d(t, 0, 0), t)
    stage.Save()
    cache = read_cache(tmp_path / "a.usda")
    assert cache.fps is None  # the library would answer 24 time codes a second
    assert cache.frames_a_sample == 2
    np.testing.assert_array_equal(cache.vertices[2], 2 * SQUARE + np.float32([4, 0, 0]))


def test_left_handed_meshes_are_turned_and_gaps_filled(tmp_path: Path):
    stage, mesh = make_stage(tmp_path / "a.usda", times=(0, 1, 3))
    mesh.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    stage.Save()
    cache = read_cache(tmp_path / "a.usda")
    assert cache.faces is not None
    assert cache.faces.tolist() == [[2, 1, 0], [3, 2, 0], [2, 4, 1]]
    np.testing.assert_array_equal(cache.vertices[:][:, 0, 1], [0, 1, 2, 3])


@pytest.mark.parametrize("indexed", [True, False])
@pytest.mark.parametrize("kind", ["faceVarying", "vertex"])
@pytest.mark.parametrize("name", ["st", "UVMap"])
def test_texture_coordinates(tmp_path: Path, indexed: bool, kind: str, name: str):
    stage, mesh = make_stage(tmp_path / "a.usda")
    size = 7 if kind == "faceVarying" else 5
    values = np.random.default_rng(0).random((size, 2)).astype(np.float32)
    order = np.random.default_rng(1).permutation(size)
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(name, Sdf.ValueTypeNames.TexCoord2fArray, kind)
    primvar.Set(Vt.Vec2fArray.FromNumpy(values))
    if indexed:
        primvar.SetIndices(Vt.IntArray.FromNumpy(order.astype(np.int32)))
    stage.Save()
    cache = read_cache(tmp_path / "a.usda")
    of_corner = values[order] if indexed else values
    corners = (
        [[0, 1, 2], [0, 2, 3], [4, 5, 6]] if kind == "faceVarying" else [[0, 1, 2], [0, 2, 3], [1, 4, 2]]
    )
    assert cache.uv is not None
    np.testing.assert_array_equal(cache.uv[cache.faces_uv], of_corner[np.array(corners)])


def test_one_of_several_meshes_is_named(tmp_path: Path):
    stage, _ = make_stage(tmp_path / "a.usda")
    UsdGeom.Mesh.Define(stage, "/World/Body").CreatePointsAttr([(0, 0, 0)])
    stage.Save()
    from garment_jax.io.formats.usd import read_usd

    with pytest.raises(ValueError, match=r"choose one with --mesh NAME: /World/Skirt, /World/Body"):
        read_usd(tmp_path / "a.usda")
    assert read_usd(tmp_path / "a.usda", mesh="Skirt").vertices.shape == (3, 5, 3)
    assert read_usd(tmp_path / "a.usda", mesh="/World/Body").vertices.shape == (1, 1, 3)


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz", ".usd"])
def test_files_that_are_no_stage(tmp_path: Path, suffix: str, capfd):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"PXR-USDC" + bytes(40) + b"PK\3\4" if suffix != ".usda" else b"#usda 1.0\ndef Mesh {")
    with pytest.raises(OSError, match="is damaged or no USD file"):
        read_cache(path)


def test_a_truncated_binary_stage(tmp_path: Path):
    make_stage(tmp_path / "a.usdc")[0].Save()
    whole = (tmp_path / "a.usdc").read_bytes()
    (tmp_path / "b.usdc").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(OSError, match=r"b\.usdc is damaged or no USD file"):
        read_cache(tmp_path / "b.usdc")


def _no_points(mesh: Any) -> None:
    mesh.GetPrim().RemoveProperty("points")


def _other_triangles(mesh: Any) -> None:
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3, 1, 4, 2], 1)
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3, 1, 4, 3], 2)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda m: m.GetPointsAttr().Set([(0, 0, 0)] * 5, 1.37), "unevenly spaced"),
        (lambda m: m.GetPointsAttr().Set([(0, 0, 0)] * 5, 1e12), "unevenly spaced"),
        (lambda m: m.GetPointsAttr().Set([(0, 0, 0)] * 4, 2), "time code 2 has 4 points, the first 5"),
        (lambda m: m.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3, 1, 4, 9]), "not among its 5"),
        (lambda m: m.GetFaceVertexCountsAttr().Set([4, 2_000_000_000]), "announce 2000000004 corners"),
        (lambda m: m.GetFaceVertexCountsAttr().Set([9, -2]), "announce 7 corners"),
        (_other_triangles, "the triangles change over time"),
        (_no_points, "has no points"),
    ],
)
def test_broken_meshes_are_refused(tmp_path: Path, change: Any, sentence: str):
    stage, mesh = make_stage(tmp_path / "a.usda")
    change(mesh)
    stage.Save()
    with pytest.raises(ValueError, match=sentence):
        read_cache(tmp_path / "a.usda").vertices[:]


def test_without_the_library_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    import sys

    make_stage(tmp_path / "a.usda")[0].Save()
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(ValueError, match=r"pip install 'garment-jax\[usd\]'"):
        read_cache(tmp_path / "a.usda")
