"""A tiny model as three graphs: run in onnxruntime beside JAX, what they say of themselves, refusals."""

import json
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

onnx = pytest.importorskip("onnx", reason="needs the extra onnx")
pytest.importorskip("onnxruntime", reason="needs the extra onnx")

from garment_jax.body.root_frame import from_root  # noqa: E402
from garment_jax.cli import main  # noqa: E402
from garment_jax.exporters import onnx_check, onnx_step  # noqa: E402
from garment_jax.exporters.onnx_check import open_graph  # noqa: E402
from garment_jax.exporters.onnx_step import export_step  # noqa: E402
from garment_jax.model.compose import init_state  # noqa: E402
from garment_jax.model.scan import make_rollout  # noqa: E402
from garment_jax.model.shipped import shipped_model  # noqa: E402
from garment_jax.model.store import Model, model_input, save_model, skinned_template  # noqa: E402
from garment_jax.postprocess.pins import attach, pin_extension  # noqa: E402
from garment_jax.structs import Motion  # noqa: E402
from tests.animation.tiny_model import (  # noqa: E402
    CONFIG,
    JOINTS,
    SCENE,
    alone,
    canonical_model,
    first_state,
    inputs_of,
    seeds,
    template,
    tiny_model,
)
from tests.reference.scene import make_motion, make_scene, write_clip  # noqa: E402
from tests.reference.tiny_column_rnn import column_rnn_model  # noqa: E402


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A saved model, a clip of its garment, and its graphs."""
    folder = tmp_path_factory.mktemp("onnx")
    save_model(tiny_model(), folder / "tiny", bits=32)
    write_clip(folder / "clip.h5", frames=20)
    facts = export_step(folder / "tiny", folder / "tiny.onnx", clip=folder / "clip.h5")
    (folder / "facts.json").write_text(json.dumps(facts))
    return folder


def test_20_frames_from_a_skeleton_alone_are_the_rollout(folder: Path):
    motion = make_motion(SCENE, 20)
    inputs = inputs_of(motion)
    expected = make_rollout(template(), CONFIG)(tiny_model().params, alone(first_state(inputs)), inputs.x)[1]
    start, frame, step = (
        open_graph((folder / f"tiny{kind}.onnx").read_bytes()) for kind in (".start", ".frame", "")
    )
    R, root = motion.rotations.astype(np.float32), motion.root.astype(np.float32)
    h, V_prev = start.run(["h", "V_prev"], {"rotations": R[0]})
    for t in range(20):
        if t == 0:
            x, before = inputs.frame(0), V_prev
            M, turn, shift = x[:3]
        else:
            skeletons = {"rotations": R[t], "root": root[t]}
            skeletons |= {"rotations_prev": R[t - 1], "root_prev": root[t - 1]}
            M, turn, shift, to_world = frame.run(["M", "turn", "shift", "to_world"], skeletons)
        state = {"h": h, "V_prev": V_prev, "M": M, "turn": turn, "shift": shift}
        V, h, V_prev = step.run(["V", "h_next", "V_prev_next"], state)
        np.testing.assert_allclose(V, expected[t], atol=1e-4)
    assert np.abs(V - before).max() > 0.01
    world = from_root(V[None].astype(np.float64), inputs.root[19:], inputs.yaw[19:])[0]
    np.testing.assert_allclose(V @ to_world + root[19], world, atol=1e-5)


def test_a_model_in_canonical_pose_takes_joints_in_place_of_turn_and_shift(folder: Path):
    model, motion = canonical_model(), make_motion(SCENE, 20, legs=1.9)
    save_model(model, folder / "canonical", bits=32)
    out = folder / "canonical.onnx"
    facts = export_step(folder / "canonical", out, clip=folder / "clip.h5")  # runs 20 frames beside JAX
    assert 0 < facts["step_departure"] < 1e-4
    assert facts["start_departure"] == 0
    start, frame, step = (
        open_graph(out.with_suffix(f"{kind}.onnx").read_bytes()) for kind in (".start", ".frame", "")
    )
    assert [i.name for i in step.get_inputs()] == ["h", "V_prev", "M", "R", "t"]
    R, root = motion.rotations.astype(np.float32), motion.root.astype(np.float32)
    h, V_prev = start.run(["h", "V_prev"], {"rotations": R[0]})
    skeletons = {"rotations": R[0], "root": root[0], "rotations_prev": R[0], "root_prev": root[0]}
    made = dict(zip(("M", "R", "t"), frame.run(["M", "R", "t"], skeletons), strict=True))
    still = Motion(motion.rotations[[0, 0]], motion.root[[0, 0]], motion.fps)
    inputs, tables = inputs_of(still), template(model)
    state = init_state(model.params, jnp.asarray(V_prev), template=tables, config=model.config)
    x = jax.tree.map(lambda leaf: leaf[1:], inputs.x)
    expected = make_rollout(tables, model.config)(model.params, state, x)[1]
    V = step.run(["V"], {"h": h, "V_prev": V_prev, **made})[0]
    np.testing.assert_allclose(V, expected[0], atol=1e-4)


@pytest.mark.parametrize("base", [tiny_model(), canonical_model()], ids=["root frame", "canonical pose"])
def test_a_column_rnn_is_a_graph_of_its_own_from_the_skeleton_alone(folder: Path, base: Model):
    model, motion = column_rnn_model(base), make_motion(SCENE, 20)
    names = ("M", "turn", "shift") if template(base).W is None else ("M", "R", "t")
    save_model(model, folder / "columns", bits=32)
    facts = export_step(folder / "columns", folder / "columns.onnx", clip=folder / "clip.h5", force=True)
    assert facts["column_rnn_departure"] < 1e-4
    assert str(folder / "columns.column_rnn.onnx") in facts["files"]
    assert not (folder / "tiny.column_rnn.onnx").exists()
    tables = template(model)
    inputs = model_input(model, SCENE, tables, seeds(), motion)
    start = skinned_template(model, tables, seeds(), inputs)
    state = init_state(model.params, start, template=tables, config=model.config)
    expected = make_rollout(tables, model.config)(model.params, state, inputs.x)[1]
    begin, frame, step, column_rnn = (
        open_graph((folder / f"columns{kind}.onnx").read_bytes())
        for kind in (".start", ".frame", "", ".column_rnn")
    )
    R, root = motion.rotations.astype(np.float32), motion.root.astype(np.float32)
    h, V_prev, carried = begin.run(["h", "V_prev", "column_rnn"], {"rotations": R[0]})
    for t in range(20):
        last = max(t - 1, 0)
        skeleton = {"rotations": R[t], "root": root[t], "rotations_prev": R[last], "root_prev": root[last]}
        # the package gives the first frame the velocities of the second
        seen = frame.run(list(names), skeleton) if t else [getattr(inputs.frame(0), name) for name in names]
        given = {"h": h, "V_prev": V_prev, **dict(zip(names, seen, strict=True))}
        V, h, V_prev = step.run(["V", "h_next", "V_prev_next"], given)
        V, carried = column_rnn.run(
            ["V_corrected", "column_rnn_next"], {"V": V, "column_rnn": carried, **skeleton}
        )
        np.testing.assert_allclose(V, expected[t], atol=1e-4)


def test_what_another_model_left_is_not_taken_for_this_ones(folder: Path):
    clip, out = folder / "clip.h5", folder / "left.onnx"
    save_model(column_rnn_model(), folder / "before", bits=32)
    export_step(folder / "before", out, clip=clip, check=False)
    assert (folder / "left.column_rnn.onnx").exists()
    export_step(folder / "tiny", out, clip=clip, check=False, force=True)
    assert not (folder / "left.column_rnn.onnx").exists()
    assert (folder / "left.attach.onnx").exists()


def test_graphs_of_others_are_neither_replaced_nor_removed(folder: Path):
    for name in ("own.onnx", "own.column_rnn.onnx"):
        (folder / name).write_bytes(b"somebody's graph")
        with pytest.raises(ValueError, match=rf"{name} is there already; --force replaces it, or name"):
            export_step(folder / "tiny", folder / "own.onnx", clip=folder / "clip.h5", check=False)
        assert (folder / name).read_bytes() == b"somebody's graph"
        (folder / name).unlink()
    assert not list(folder.glob("own*"))


def test_the_attached_garment_is_the_animations(folder: Path):
    assert SCENE.pins is not None
    pins, T = SCENE.pins.vertices, template().T
    moved = T[pins] + np.float32(0.03)
    graph = open_graph((folder / "tiny.attach.onnx").read_bytes())
    V = graph.run(["V_attached"], {"V": T, "pins": moved})[0]
    extension = pin_extension(SCENE.garment, pins)
    expected = attach(jnp.asarray(T), jnp.asarray(moved), pins=pins, extension=extension)
    np.testing.assert_allclose(V, expected, atol=1e-6)
    np.testing.assert_allclose(V[pins], moved, atol=1e-6)


def test_the_graphs_are_standard_and_say_what_they_are(folder: Path):
    for kind in ("", ".start", ".frame", ".attach"):
        model = onnx.load(folder / f"tiny{kind}.onnx")
        onnx.checker.check_model(model, full_check=True)
        assert {node.domain for node in model.graph.node} == {""}
        assert [(o.domain, o.version) for o in model.opset_import] == [("", 17)]
        assert not model.functions
        said = {p.key: p.value for p in model.metadata_props}
        assert (said["garment"], said["fps"], said["schema"]) == ("tiny", "30", "garment_jax-step-1")
        assert json.loads(said["joint_names"]) == list(SCENE.body.joint_names)
        assert json.loads(said["motion_joints"]) == list(JOINTS)
        assert len(json.loads(said["features"])) == 10 + 12 * len(JOINTS)
        assert json.loads(said["pins"]) == list(range(16))
        assert "metres" in said["units"]
    assert list(folder.glob(".*tmp*")) == []


def test_the_facts_hold_sizes_and_departures(folder: Path):
    facts = json.loads((folder / "facts.json").read_text())
    assert (facts["opset"], facts["detail"]) == (17, True)
    for name, numbers in facts["files"].items():
        assert numbers["megabytes"] == pytest.approx(Path(name).stat().st_size / 1e6, abs=1e-3)
    assert 0 < facts["step_departure"] < 1e-4


def test_without_detail_the_garment_is_the_state(folder: Path):
    said: list[str] = []
    facts = export_step(
        folder / "tiny",
        folder / "plain.onnx",
        clip=folder / "clip.h5",
        detail=False,
        check=False,
        say=said.append,
    )
    assert said == [f"building {len(facts['files'])} graphs"]
    assert not facts["detail"]
    assert "step_departure" not in facts
    graph = open_graph((folder / "plain.onnx").read_bytes())
    given = {i.name: np.full(i.shape, 0.1, np.float32) for i in graph.get_inputs()}
    V, _, V_prev = graph.run(["V", "h_next", "V_prev_next"], given)
    np.testing.assert_array_equal(V, V_prev)


def test_a_garment_without_pins_has_no_pins_to_give(folder: Path):
    clip = write_clip(folder / "free.h5", frames=2, scene=SCENE._replace(pins=None))
    export_step(folder / "tiny", folder / "free.onnx", clip=clip, check=False)
    assert not (folder / "free.attach.onnx").exists()
    frame = onnx.load(folder / "free.frame.onnx")
    assert [x.name for x in frame.graph.output] == ["M", "turn", "shift", "to_world"]
    assert json.loads({p.key: p.value for p in frame.metadata_props}["pins"]) == []


def test_a_graph_that_departs_is_refused_and_nothing_is_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(onnx_check, "TOLERANCE", 1e-12)
    with pytest.raises(ValueError, match=r"graph departs from JAX by .* nothing was written"):
        export_step(folder / "tiny", folder / "bad.onnx", clip=folder / "clip.h5")
    assert list(folder.glob("bad*")) == []


def test_what_does_not_fit_is_refused_in_a_sentence(folder: Path):
    model, clip = folder / "tiny", folder / "clip.h5"
    with pytest.raises(ValueError, match=r"tiny.txt does not end in .onnx"):
        export_step(model, folder / "tiny.txt", clip=clip)
    with pytest.raises(ValueError, match="has no sample; name any sequence file of its garment with --clip"):
        export_step(model, folder / "a.onnx")
    with pytest.raises(ValueError, match="opset=9 is not supported"):
        export_step(model, folder / "a.onnx", clip=clip, opset=9)
    with pytest.raises(FileNotFoundError, match=r"holds no config.toml"):
        export_step(folder / "nowhere", folder / "a.onnx", clip=clip)
    with pytest.raises(FileNotFoundError, match=r"no.h5"):
        export_step(model, folder / "a.onnx", clip=folder / "no.h5")
    other = write_clip(folder / "other.h5", frames=2, scene=make_scene(rings=6))
    with pytest.raises(ValueError, match="96 vertices and the model was trained on 128"):
        export_step(model, folder / "a.onnx", clip=other)
    assert list(folder.glob("a*.onnx")) == []


def test_a_model_by_its_name_is_exported_with_its_own_sample(folder: Path, monkeypatch, capsys):
    asked = []
    files = {"files": {"a.onnx": {"megabytes": 15.476, "nodes": 441}}, "opset": 17, "step_departure": 2.4e-7}
    files |= {"start_departure": 0.0, "frame_departure": 3.1e-6}
    monkeypatch.chdir(folder)
    monkeypatch.setattr(onnx_step, "export_step", lambda *a, **k: asked.append((a, k)) or dict(files))
    assert main(["export", "cape", "--format", "onnx", "--out", "a.onnx"]) == 0
    (source, out), options = asked[0]
    assert (source, out, options["clip"]) == (shipped_model("cape"), Path("a.onnx"), None)
    assert capsys.readouterr().out.splitlines() == [
        "a.onnx: 15.5 MB, 441 nodes",
        "opset: 17",
        "checked beside JAX: largest departure 0.00024 mm, of a frame's inputs 3.1e-06",
    ]
    options["say"]("building")
    assert capsys.readouterr().err == "building\n"


def test_a_missing_package_names_the_extra(folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(ValueError, match=r"onnxruntime; pip install 'garment-jax\[onnx\]'"):
        export_step(folder / "tiny", folder / "a.onnx", clip=folder / "clip.h5")
