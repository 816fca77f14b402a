"""Several meshes, skeletons or animations in a file: each sentence's option chooses what it lists."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from garment_jax.cli import main as garment_jax
from garment_jax.io.sequence import open_sequence
from tests.importers.glb_files import glb_parts, pack_glb
from tests.importers.good_files import FRAMES, MOTION, SCENE, V, write_all, write_usd
from tests.reference.scene import make_motion

OTHER = make_motion(SCENE, FRAMES, seed=5)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_all(tmp_path_factory.mktemp("good"))


@pytest.fixture
def case(good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(good, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write_two(path: Path, names: tuple[str | None, str | None], *, alone: bool = False) -> None:
    """The body with two motions of it; `alone`: the motions without the body."""
    document, data = glb_parts(SCENE.body, MOTION)
    more, other = glb_parts(SCENE.body, OTHER)
    start, views = len(data), len(document["bufferViews"])
    for view in more["bufferViews"]:
        document["bufferViews"].append(view | {"byteOffset": view.get("byteOffset", 0) + start})
    shift = len(document["accessors"])
    for accessor in more["accessors"]:
        document["accessors"].append(accessor | {"bufferView": accessor["bufferView"] + views})
    for sampler in more["animations"][0]["samplers"]:
        document["animations"] += []
        sampler["input"], sampler["output"] = sampler["input"] + shift, sampler["output"] + shift
    document["animations"] += more["animations"]
    document["buffers"][0]["byteLength"] = len(data) + len(other)
    for animation, name in zip(document["animations"], names, strict=True):
        animation.pop("name", None)
        if name is not None:
            animation["name"] = name
    if alone:
        for key in ("meshes", "skins"):
            del document[key]
        document["nodes"].pop()
        document["scenes"][0]["nodes"] = [0]
    path.write_bytes(pack_glb(document, data + other))


@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize("names", [("walk", "run"), (None, None)])
def test_an_animation_is_chosen(case: Path, capsys, names, alone: bool):
    write_two(case / "two.glb", names, alone=alone)
    words = ["import", "two.glb", "--garment", "skirt.obj", "--body", "me.glb", "--keep-height", "--out"]
    assert garment_jax([*words, "c"]) == 2
    listed = re.search(r"choose one with (--animation) NAME: (.+)\.\n", capsys.readouterr().err)
    assert listed is not None
    option, called = listed[1], listed[2].split(", ")
    for name, motion in zip(called, (MOTION, OTHER), strict=True):
        assert garment_jax([*words, name, option, name]) == 0
        with open_sequence(f"{name}/train/two.h5") as clip:
            np.testing.assert_allclose(clip.motion.rotations, motion.rotations, atol=1e-3)
            np.testing.assert_allclose(clip.motion.root, motion.root, atol=1e-5)
        assert garment_jax(["validate", "two.glb", option, name, "--all"]) in (0, 1)
        assert "readable" not in capsys.readouterr().out


def test_a_motion_alone_is_validated_as_a_motion(case: Path, capsys):
    write_two(case / "two.glb", ("walk", "run"), alone=True)
    assert garment_jax(["validate", "two.glb"]) == 1
    assert "choose one with --animation NAME: walk, run" in capsys.readouterr().out.replace("\n", " ")
    garment_jax(["validate", "two.glb", "--animation", "run", "--all"])
    shown = capsys.readouterr().out
    assert "two.glb (motion)" in shown
    assert "readable" not in shown


def write_twins(path: Path) -> None:
    """Two bodies in one file, the second a metre beside the first and called You."""
    document, data = glb_parts(SCENE.body, MOTION)
    count = len(document["nodes"])
    for node in document["nodes"][: count - 1]:
        copied = dict(node) | (
            {"children": [c + count for c in node["children"]]} if "children" in node else {}
        )
        document["nodes"].append(
            copied | {"name": node["name"] if node is not document["nodes"][0] else "Top"}
        )
    document["nodes"].append({"name": "You", "mesh": 1, "skin": 1})
    document["meshes"][0]["name"] = "Me"
    document["meshes"].append(document["meshes"][0] | {"name": "You"})
    document["skins"].append(
        document["skins"][0] | {"joints": [j + count for j in document["skins"][0]["joints"]]}
    )
    path.write_bytes(pack_glb(document, data))


@pytest.mark.parametrize("way", [["--body-mesh", "Me"], ["--mesh", "Me"], ["--skeleton", "root"]])
def test_a_body_of_two_is_chosen(case: Path, capsys, way: list[str]):
    write_twins(case / "two.glb")
    words = ["import", "walk.bvh", "--garment", "skirt.obj", "--body", "two.glb", "--out", "c"]
    assert garment_jax(words) == 2
    said = capsys.readouterr().err
    top = SCENE.body.joint_names[0]
    assert f"several skeletons ({top} with Me; Top with You)" in said
    assert "--body-skeleton, or its mesh with --body-mesh" in said
    chosen = [top if word == "root" else word for word in way]
    assert garment_jax([*words, *chosen]) == 0
    with open_sequence("c/train/walk.h5") as clip:
        assert clip.scene.body.joint_names == SCENE.body.joint_names
    assert garment_jax(["validate", "two.glb"]) == 1
    assert "name the body's with --skeleton" in capsys.readouterr().out.replace("\n", " ")
    assert garment_jax(["validate", "two.glb", "--mesh", "Me"]) == 0


def test_a_mesh_of_a_usd_stage_is_chosen(case: Path, capsys):
    Usd = pytest.importorskip("pxr.Usd")
    from pxr import UsdGeom

    write_usd(case / "walk.usda", V)
    text = (case / "walk.usda").read_text()
    (case / "walk.usda").write_text(text.replace("Garment", "Skirt"))
    stage = Usd.Stage.Open("walk.usda")
    UsdGeom.Mesh.Define(stage, "/Chair").CreatePointsAttr([(0, 0, 0)])
    stage.Save()
    words = [
        "import",
        "walk.usda",
        "--garment",
        "skirt.obj",
        "--body",
        "me.npz",
        "--motion",
        "walk.bvh",
        "--out",
        "c",
    ]
    assert garment_jax(words) == 2
    listed = re.search(r"choose one with (--mesh) NAME: (\S+),", capsys.readouterr().err)
    assert listed is not None
    assert garment_jax(["validate", "walk.usda"]) == 1
    for name in (listed[2], "Skirt"):
        assert garment_jax([*words, listed[1], name]) == 0
        assert garment_jax(["validate", "walk.usda", listed[1], name]) == 0


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["walk.bvh", "--animation", "run"], "walk.bvh holds one motion; leave out --animation."),
        (["walk.bvh", "--motion-skeleton", "x"], "walk.bvh holds one motion; leave out --motion-skeleton."),
        (["walk.bvh", "--body-mesh", "x"], "me.npz holds one body; leave out --body-mesh."),
        (["walk.bvh", "--mesh", "x"], "--mesh x: no file that is named holds several; leave it out."),
    ],
)
def test_options_that_nothing_needs_are_refused(case: Path, capsys, words: list[str], sentence: str):
    assert garment_jax(["import", *words, "--garment", "skirt.obj", "--body", "me.npz", "--out", "c"]) == 2
    assert sentence in capsys.readouterr().err
