"""Models on disk: what is written comes back, what is damaged is refused."""

import json
import re
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from garment_jax.model import store as module
from garment_jax.model.column_rnn.tables import seen_body
from garment_jax.model.folder import arrays_hash
from garment_jax.model.store import (
    Model,
    load_model,
    model_facts,
    save_model,
    template_for,
    without_column_rnn,
)
from garment_jax.postprocess.collision.solid import everything
from garment_jax.structs import Scene
from tests.animation.tiny_model import CONFIG, SCENE, tiny_model
from tests.reference.scene import make_scene
from tests.reference.tiny_column_rnn import column_rnn_model


def test_32_bits_come_back_bit_for_bit(tmp_path: Path):
    folder = save_model(tiny_model(), tmp_path / "model", bits=32)
    assert sorted(path.name for path in folder.iterdir()) == ["config.toml", "model.json", "parameters.npz"]
    again = load_model(folder)
    assert again[0] == tiny_model().config
    assert again[3:] == tiny_model()[3:]
    assert jax.tree.structure(again.params) == jax.tree.structure(tiny_model().params)
    for a, b in zip(jax.tree.leaves(again.params), jax.tree.leaves(tiny_model().params), strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(again.statistics, tiny_model().statistics, strict=True):
        np.testing.assert_array_equal(a, b)


def test_16_bits_round_to_three_digits_and_come_back_as_float32(tmp_path: Path):
    again = load_model(save_model(tiny_model(), tmp_path))
    size = sum(leaf.size for leaf in jax.tree.leaves(again.params))
    assert (tmp_path / "parameters.npz").stat().st_size < 2.2 * size + 20_000
    for a, b in zip(jax.tree.leaves(again.params), jax.tree.leaves(tiny_model().params), strict=True):
        assert a.dtype == np.float32
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-6)
    np.testing.assert_array_equal(again.statistics.map_std, tiny_model().statistics.map_std)
    once = save_model(again, tmp_path / "again")
    for a, b in zip(jax.tree.leaves(load_model(once).params), jax.tree.leaves(again.params), strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_16_bits_cannot_hold_is_refused_before_anything_is_written(tmp_path: Path):
    wild = tiny_model()._replace(params={"generative": {"split_s": {"kernel": np.array([7e4])}}})
    with pytest.raises(ValueError, match=r"split_s/kernel of runs/a reaches 7e\+04, which 16 bits cannot"):
        save_model(wild, tmp_path / "model", source="runs/a")
    assert not (tmp_path / "model").exists()


def test_a_full_disk_leaves_no_part_of_a_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(path: Path, **arrays: np.ndarray) -> None:
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module.np, "savez_compressed", full)
    with pytest.raises(OSError, match=r"could not be written \(No space left on device\); free some space"):
        save_model(tiny_model(), tmp_path / "model")
    assert not (tmp_path / "model").exists()


def test_a_folder_without_a_model_is_refused(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"holds no config\.toml; name a run of train\.py or a model"):
        load_model(tmp_path)
    (tmp_path / "run" / "checkpoints").mkdir(parents=True)
    (tmp_path / "run" / "config.toml").touch()
    with pytest.raises(
        FileNotFoundError, match=r"run is a run of train\.py .*; run garment-jax save .* first"
    ):
        load_model(tmp_path / "run")
    model = save_model(tiny_model(), tmp_path / "model")
    (model / "parameters.npz").unlink()
    with pytest.raises(FileNotFoundError, match=r"holds no parameters\.npz"):
        load_model(model)


def shorten(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-400])


def blur(path: Path) -> None:
    """Overwrite the middle of the compressed parameters."""
    data = bytearray(path.read_bytes())
    half = len(data) // 2
    data[half : half + 64] = bytes(64)
    path.write_bytes(data)


def lose_statistics(path: Path) -> None:
    with np.load(path) as stored:
        kept = {name: stored[name] for name in stored.files if name != "statistics/map_std"}
    np.savez(path, **kept)


def claim_another_packing(path: Path) -> None:
    data = bytearray(path.read_bytes())
    for mark, offset in ((b"PK\x01\x02", 10), (b"PK\x03\x04", 8)):
        place = data.index(mark) + offset
        data[place : place + 2] = b"\x63\0"
    path.write_bytes(data)


@pytest.mark.parametrize(
    "damage", [shorten, blur, claim_another_packing, lose_statistics, lambda path: path.write_text("no zip")]
)
def test_damaged_parameters_are_refused(tmp_path: Path, damage):
    save_model(tiny_model(), tmp_path)
    damage(tmp_path / "parameters.npz")
    with pytest.raises(ValueError, match=r"holds a damaged model .*; copy or save it again"):
        load_model(tmp_path)


@pytest.mark.parametrize("text", ["{", json.dumps({"vertices": 3})])
def test_damaged_facts_are_refused(tmp_path: Path, text: str):
    save_model(tiny_model(), tmp_path)
    (tmp_path / "model.json").write_text(text)
    with pytest.raises(ValueError, match="holds a damaged model"):
        load_model(tmp_path)


def test_another_garment_is_refused_by_name():
    with pytest.raises(
        ValueError, match="polka has a garment of 112 vertices and the model was trained on 128"
    ):
        template_for(tiny_model(), make_scene(7, 16), "polka")
    shifted = SCENE.garment._replace(uv=np.roll(SCENE.garment.uv, 1, axis=0))
    with pytest.raises(
        ValueError, match=r"polka has another garment .* template, faces or UVs have the hash"
    ):
        template_for(tiny_model(), SCENE._replace(garment=shifted), "polka")


def test_a_column_rnn_needs_pins_and_codes_alone_do_not():
    model, free = column_rnn_model(), SCENE._replace(pins=None)
    assert template_for(model, SCENE, "polka")[0].ring is not None
    with pytest.raises(ValueError, match=r"polka has a garment whose pins do not lie around the body, "):
        template_for(model, free, "polka")
    assert template_for(without_column_rnn(model), free, "polka")[0].ring is None


def test_a_column_rnn_looks_where_it_has_learnt_to_whatever_collider_a_clip_has(tmp_path: Path):
    """The whole body has arms: beside a skirt they looked like a body of twice its size."""

    def looked_at(model: Model, scene: Scene) -> np.ndarray:
        return template_for(model, scene, "the clip")[0].ring.carried.weighted.toarray()

    older = column_rnn_model()
    model = load_model(save_model(older._replace(seen=seen_body(SCENE)), tmp_path / "model"))
    wanted = looked_at(older, SCENE)
    np.testing.assert_array_equal(looked_at(model, SCENE), wanted)
    for collider in (None, everything(SCENE.body)):
        scene = SCENE._replace(collider=collider)
        np.testing.assert_array_equal(looked_at(model, scene), wanted)
        assert looked_at(older, scene).shape != wanted.shape  # a model that does not know goes by the clip
    other = SCENE.body._replace(faces=SCENE.body.faces[::-1])  # numbers of vertices that mean nothing here
    scene = SCENE._replace(body=other, collider=everything(other))
    np.testing.assert_array_equal(looked_at(model, scene), looked_at(older, scene))


def test_files_of_two_models_are_damage(tmp_path: Path):
    folder = save_model(tiny_model(), tmp_path / "model")
    config = (folder / "config.toml").read_text()
    refused = pytest.raises(ValueError, match=r"damaged model \(config.toml has motion.gru = 7, ")
    (folder / "config.toml").write_text(re.sub(r"(?m)^gru = .*$", "gru = 7", config))
    for read in (load_model, module.model_facts):
        with refused:
            read(folder)
    (folder / "config.toml").write_text(re.sub(r"(?m)^eps = .*$", "eps = 0.006", config))
    assert load_model(folder).config.collision.eps == 0.006  # what shapes no network may be changed
    with np.load(folder / "parameters.npz") as stored:
        arrays = {name: stored[name] for name in stored.files}
    lost = next(name for name in arrays if name.startswith("motion/"))
    for others in ({lost: None}, {lost: np.zeros(3)}):
        kept = {k: v for k, v in (arrays | others).items() if v is not None}
        np.savez(folder / "parameters.npz", **kept)
        with pytest.raises(ValueError, match=r"\(parameters.npz has other arrays than it was saved with\)"):
            load_model(folder, leave_out=("detail",))


def test_a_model_from_before_the_column_rnn_had_its_name_loads(tmp_path: Path):
    model = column_rnn_model()
    folder = save_model(model, tmp_path / "model", bits=32)
    for name in ("config.toml", "model.json"):
        text = (folder / name).read_text()
        (folder / name).write_text(text.replace("[column_rnn]", "[swing]").replace('"column_rnn"', '"swing"'))
    with np.load(folder / "parameters.npz") as stored:
        arrays = {name.replace("column_rnn/", "swing/"): array for name, array in stored.items()}
    np.savez(folder / "parameters.npz", **arrays)  # type: ignore[arg-type]
    facts = json.loads((folder / "model.json").read_text())
    facts["arrays"] = arrays_hash({name: array.shape for name, array in arrays.items()})
    (folder / "model.json").write_text(json.dumps(facts))
    jax.tree.map(np.testing.assert_array_equal, load_model(folder).params, model.params)
    assert model_facts(folder).parts == set(model.params)
    assert "column_rnn" not in load_model(folder, leave_out=["column_rnn"]).params


def test_an_older_model_that_does_not_say_what_shapes_it_loads(tmp_path: Path):
    folder = save_model(tiny_model(), tmp_path / "model")
    facts = json.loads((folder / "model.json").read_text())
    (folder / "model.json").write_text(json.dumps({k: facts[k] for k in ("garment_hash", "vertices", "fps")}))
    assert load_model(folder).vertices == facts["vertices"]
    for name, value in (("fps", 0), ("fps", "30"), ("vertices", "32"), ("garment_hash", 3)):
        (folder / "model.json").write_text(json.dumps(facts | {name: value}))
        with pytest.raises(ValueError, match=rf"model holds a damaged model \(model.json has {name} = "):
            load_model(folder)


@pytest.mark.parametrize("text", ["[]", "null", "3", '{"seen": []}'])
def test_facts_that_are_no_facts_are_damage(tmp_path: Path, text: str):
    folder = save_model(tiny_model(), tmp_path / "model")
    (folder / "model.json").write_text(text)
    for read in (load_model, module.model_facts):
        with pytest.raises(ValueError, match=r"model holds a damaged model \(.*copy or save it again"):
            read(folder)


def _changed(folder: Path, name: str, array: np.ndarray) -> None:
    path = folder / "parameters.npz"
    arrays = dict(np.load(path)) | {name: array}
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("array", "sentence"),
    [
        (np.zeros(8, [("a", "f4"), ("b", "i8")]), "holds .*, no real numbers"),
        (np.zeros(8, complex), "holds complex128, no real numbers"),
        (np.array(["x"] * 8), "holds <U1, no real numbers"),
        (np.full(8, np.nan, np.float16), "holds NaN or infinite values"),
    ],
)
def test_parameters_that_are_no_numbers_are_refused_when_they_are_loaded(tmp_path: Path, array, sentence):
    save_model(tiny_model(), tmp_path)
    with np.load(tmp_path / "parameters.npz") as stored:
        name = next(name for name in stored if stored[name].shape == (8,))
    _changed(tmp_path, name, array)
    with pytest.raises(ValueError, match=rf"damaged model \(parameter {name} {sentence}\); copy"):
        load_model(tmp_path)


def test_statistics_of_another_shape_are_refused(tmp_path: Path):
    save_model(tiny_model(), tmp_path)
    facts = json.loads((tmp_path / "model.json").read_text())
    (tmp_path / "model.json").write_text(json.dumps({k: v for k, v in facts.items() if k != "arrays"}))
    _changed(tmp_path, "statistics/map_std", np.ones((2, 3), np.float32))
    with pytest.raises(ValueError, match=r"\(statistics/map_std has shape \(2, 3\), not \(3,\)\)"):
        load_model(tmp_path)


@pytest.mark.parametrize(
    ("file", "text", "sentence"),
    [
        ("model.json", "[" * 100_000, "holds a damaged model"),
        ("config.toml", "x = " + "[" * 100_000, "is not valid TOML"),
        ("config.toml", "[generative]\nlatent_dim = 1000000000000\n", "latent_dim = 1000000000000"),
    ],
)
def test_deep_nesting_and_absurd_sizes_are_one_sentence(tmp_path: Path, file: str, text: str, sentence: str):
    save_model(tiny_model(), tmp_path)
    (tmp_path / file).write_text(text)
    with pytest.raises(ValueError, match=sentence):
        load_model(tmp_path)


def test_sizes_are_bounded_where_facts_and_configuration_agree(tmp_path: Path):
    absurd = replace(CONFIG, uv=replace(CONFIG.uv, size=2**20))
    save_model(tiny_model()._replace(config=absurd), tmp_path)
    with pytest.raises(ValueError, match=r"config\.toml has uv\.size = 1048576, above 8192\); copy or save"):
        load_model(tmp_path)


def test_a_jax_told_to_compute_in_64_bits_is_refused(tmp_path: Path):
    save_model(tiny_model(), tmp_path / "tiny")
    with (
        jax.enable_x64(True),
        pytest.raises(ValueError, match=r"^jax_enable_x64 is on, .* switch it off \(unset JAX_ENABLE_X64"),
    ):
        load_model(tmp_path / "tiny")
