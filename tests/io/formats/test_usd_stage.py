"""USD from strangers: other people's files, crashes, instances, inactive and blocked prims."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from garment_jax.io.formats import usd
from garment_jax.io.formats.any_mesh_cache import files_named_in, read_cache
from tests.io.formats.test_usd import SQUARE, make_stage

pxr = pytest.importorskip("pxr", reason="needs the extra usd")
from pxr import Sdf, Usd, UsdGeom, Vt  # noqa: E402


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    """A stage in another folder, which the tested one names."""
    (tmp_path / "theirs").mkdir()
    (tmp_path / "ours").mkdir()
    stage, _ = make_stage(tmp_path / "theirs" / "secret.usda")
    stage.SetDefaultPrim(stage.GetPrimAtPath("/World"))
    stage.Save()
    return tmp_path / "theirs" / "secret.usda"


def _written(folder: Path, header: str, prim: str = "") -> Path:
    (folder / "a.usda").write_text(f'#usda 1.0\n({header})\ndef Xform "A" ({prim}) {{ }}\n', encoding="utf-8")
    return folder / "a.usda"


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize("kind", ["sublayer", "reference", "payload", "variant", "clips", "template", "link"])
def test_files_outside_the_folder_are_refused(tmp_path: Path, secret: Path, kind: str, absolute: bool):
    name = str(secret) if absolute else "../theirs/secret.usda"
    if kind == "link":
        name = "./linked.usda"
        (tmp_path / "ours" / "linked.usda").symlink_to(secret)
    clips = {
        "clips": f"asset[] assetPaths = [@{name}@]",
        "template": f'string templateAssetPath = "{name}.#.usd"',
    }
    prims = {
        "reference": f"references = @{name}@",
        "link": f"references = @{name}@",
        "payload": f"payload = @{name}@",
        "variant": 'prepend variantSets = "v"',
    }
    prim = prims.get(kind, "")
    if kind in clips:
        prim = f"clips = {{ dictionary default = {{ {clips[kind]} }} }}"
    path = _written(tmp_path / "ours", f"subLayers = [@{name}@]" if kind == "sublayer" else "", prim)
    if kind == "variant":
        inner = f'variantSet "v" = {{\n"one" (\nreferences = @{name}@\n) {{\n}}\n}}'
        path.write_text(f'#usda 1.0\ndef Xform "A" (\n{prim}\n) {{\n{inner}\n}}\n', encoding="utf-8")
    with pytest.raises(ValueError, match=r"a\.usda names '?\S+'?, outside its own folder, which is not read"):
        read_cache(path)
    with pytest.raises(ValueError, match="outside its own folder"):
        files_named_in(path)


def test_instances_of_a_file_in_the_folder_are_read(tmp_path: Path):
    stage, _ = make_stage(tmp_path / "asset.usda")
    stage.SetDefaultPrim(stage.GetPrimAtPath("/World"))
    stage.Save()
    path = _written(tmp_path, "", "instanceable = true\nprepend references = @./asset.usda@")
    np.testing.assert_array_equal(read_cache(path).vertices[0], SQUARE + np.float32([0, 1, 0]))
    assert files_named_in(path) == (tmp_path / "asset.usda",)


def test_inactive_meshes_are_left_out(tmp_path: Path):
    stage, mesh = make_stage(tmp_path / "a.usda")
    UsdGeom.Mesh.Define(stage, "/World/Old").GetPrim().SetActive(False)
    stage.Save()
    assert read_cache(tmp_path / "a.usda").vertices.shape == (3, 5, 3)
    mesh.GetPrim().SetActive(False)
    stage.Save()
    with pytest.raises(ValueError, match=r"a\.usda holds no mesh that is active; activate /World/Skirt"):
        read_cache(tmp_path / "a.usda")


def test_a_blocked_sample_is_named(tmp_path: Path):
    stage, mesh = make_stage(tmp_path / "a.usda")
    mesh.GetPointsAttr().Set(Sdf.ValueBlock(), 2)
    stage.Save()
    with pytest.raises(ValueError, match=r"a\.usda /World/Skirt: its points are blocked at time code 2; exp"):
        read_cache(tmp_path / "a.usda")


def test_the_shared_cases(shared_data: Path):
    cases = shared_data.parent / "cases"
    blocked, instance = cases / "usd_blocked_sample" / "clip.usdc", cases / "usd_instanceable" / "clip.usda"
    if not blocked.is_file():
        pytest.skip("needs the shared cases")
    with pytest.raises(ValueError, match=r"clip\.usdc /\S+: its points are blocked at time code 20;"):
        read_cache(blocked)
    cache = read_cache(instance)
    stage = Usd.Stage.Open(str(cases / "usd_instanceable" / "asset.usdc"))
    prim = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    points = UsdGeom.Mesh(prim).GetPointsAttr()
    times = points.GetTimeSamples()
    assert cache.vertices.shape[0] == len(times) == 41
    np.testing.assert_array_equal(cache.vertices[40], np.array(points.Get(times[40])))


def test_a_crash_of_the_library_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    make_stage(tmp_path / "a.usda")[0].Save()
    monkeypatch.setattr(usd, "_RUN", f"import os; os.kill(os.getpid(), {int(signal.SIGSEGV)})")
    with pytest.raises(OSError, match=rf"a\.usda is damaged or no USD file \(its reader ended with -{11}\)"):
        read_cache(tmp_path / "a.usda")
    monkeypatch.setattr(usd, "_RUN", "import time; time.sleep(60)")
    monkeypatch.setattr(usd, "_SECONDS", 0.2)
    with pytest.raises(OSError, match=r"its reader took more than 0\.2 s"):
        read_cache(tmp_path / "a.usda")


def test_frames_that_the_file_does_not_hold_are_refused(tmp_path: Path):
    stage, mesh = make_stage(tmp_path / "a.usdc", times=())
    same = Vt.Vec3fArray.FromNumpy(np.zeros((60_000, 3), np.float32))
    for t in range(200):
        mesh.GetPointsAttr().Set(same, t)
    stage.Save()
    with pytest.raises(ValueError, match=r"200 frames of 60000 points would fill 137\.3 MB from a file of"):
        read_cache(tmp_path / "a.usdc")


def test_nothing_is_left_in_the_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    make_stage(tmp_path / "a.usda")[0].Save()
    cache = read_cache(tmp_path / "a.usda")
    assert os.listdir(tmp_path / "temporary") == []
    assert cache.vertices[2].shape == (5, 3)
