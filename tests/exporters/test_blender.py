"""Blender opens what is exported and reports the vertices back: within 0.01 mm (needs a Blender)."""

import json
from pathlib import Path

import numpy as np
import pytest

from garment_jax.body.kinematics import pose_body
from garment_jax.exporters.command import export_file
from garment_jax.io.formats.any_mesh_cache import read_cache
from garment_jax.io.formats.blender import find_blender, run_blender
from garment_jax.io.sequence import open_sequence
from tests.reference.scene import write_clip

SCRIPT = Path(__file__).with_name("open_in_blender.py")
FIRST, FRAMES = 5, [0, 3, 7]
EXPORTS = {
    "usd": {"up": "Y", "unit": "m"},
    "usd_cm_z": {"up": "Z", "unit": "cm"},  # Blender turns and scales it as the stage says
    "abc": {},
    "pc2": {},
    "mdd": {},
    "obj": {},
}


@pytest.fixture(scope="module")
def blender() -> Path:
    try:
        return find_blender()
    except FileNotFoundError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clip(tmp_path_factory.mktemp("blender") / "clip.h5", 8)


@pytest.fixture(scope="module")
def exported(clip: Path, blender: Path) -> Path:
    for name, options in EXPORTS.items():
        kind = name.split("_")[0]
        if kind == "usd":
            pytest.importorskip("pxr", reason="needs the extra usd")
        out = clip.parent / ("obj" if kind == "obj" else f"{name}.{kind}")
        export_file(clip, out, format=kind, frame_offset=FIRST, blender=blender, **options)
    return clip.parent


def listed(folder: Path) -> list[dict]:
    files = []
    for name in EXPORTS:
        kind = name.split("_")[0]
        for mesh in ("Garment", "Body"):
            body = mesh == "Body"
            path = {
                "obj": folder / "obj" / ("body/body" if body else "garment"),
                "pc2": folder / f"pc2{'_body' * body}.pc2",
                "mdd": folder / f"mdd{'_body' * body}.mdd",
            }.get(kind, folder / f"{name}.{kind}")
            files.append({"name": f"{name} {mesh}", "kind": kind, "path": str(path), "mesh": mesh})
    return files


@pytest.mark.slow
def test_every_format_opens_with_the_vertices_where_they_were(exported: Path, clip: Path, blender: Path):
    job = {"files": listed(exported), "frames": FRAMES, "first": FIRST, "fps": 30}
    job["out"] = str(exported / "found.npz")
    (exported / "job.json").write_text(json.dumps(job))
    run_blender(SCRIPT, [str(exported / "job.json")], blender=blender)
    with open_sequence(clip) as sequence:
        truth = {
            "Garment": sequence.read(0, 8)[FRAMES],
            "Body": pose_body(sequence.scene.body, sequence.motion, np.array(FRAMES)),
        }
    with np.load(exported / "found.npz") as found:
        assert len(found.files) == 2 * len(EXPORTS)
        for name in found.files:
            x, y, z = np.moveaxis(truth[name.split(" ")[1]].astype(np.float64), -1, 0)
            difference = np.abs(found[name] - np.stack([x, -z, y], axis=-1)).max()
            print(f"{name}: {1e3 * difference:.6f} mm")
            assert difference < 1e-5, name


@pytest.mark.slow
def test_alembic_comes_back_as_it_went(exported: Path, clip: Path, blender: Path):
    cache = read_cache(exported / "abc.abc", blender=str(blender))
    with open_sequence(clip) as sequence:
        garment = sequence.scene.garment
        np.testing.assert_array_equal(cache.vertices[:], sequence.read(0, 8))
    np.testing.assert_array_equal(cache.faces, garment.faces)
    assert cache.uv is not None
    np.testing.assert_array_equal(cache.uv[cache.faces_uv], garment.uv[garment.faces_uv])
    assert (cache.fps, cache.unit, cache.up) == (30.0, None, None)
    body = read_cache(exported / "abc.abc", mesh="Body", blender=str(blender))
    np.testing.assert_array_equal(body.faces, sequence.scene.body.faces)
