"""Cheaper variants: lower rank against a dense SVD, 16-bit layers, and the choice within a budget."""

import json
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import pytest

from garment_jax.animation import calibration
from garment_jax.animation.calibration import _path, frame_times
from garment_jax.animation.variants import (
    FILE,
    Measured,
    Variant,
    apply_variant,
    choose,
    stored_variants,
    variants_of,
    with_rank,
)
from garment_jax.model.generative.network import decode
from garment_jax.structs import Motion
from tests.animation.tiny_model import CONFIG, SCENE, template, tiny_model
from tests.reference.scene import make_motion


def linear_map(params: dict) -> tuple[np.ndarray, np.ndarray]:
    """Return D_rec's last two layers as one: the matrix `[h + z, 3 n]` and the constant."""
    D = {
        k: {a: np.asarray(b, np.float64) for a, b in v.items()}
        for k, v in params["generative"]["D_rec"].items()
    }
    A = np.concatenate([D["Dense_1"]["kernel"], D["skip"]["kernel"]])
    return A @ D["basis"]["kernel"], D["Dense_1"]["bias"] @ D["basis"]["kernel"] + D["basis"]["bias"]


def test_a_variant_without_lengths_changes_that_alone():
    model = tiny_model()
    changed = apply_variant(model, Variant(lengths=False))
    assert model.config.rollout.lengths
    assert changed.config == replace(CONFIG, rollout=replace(CONFIG.rollout, lengths=False))
    assert changed.params is model.params


@pytest.mark.parametrize("rank", [1, 3, 5])
def test_a_lower_rank_is_the_truncated_svd_of_the_stored_factors(rank: int):
    model = tiny_model()
    narrow = with_rank(model, rank)
    (M, m), (N, c) = linear_map(model.params), linear_map(narrow.params)
    U, S, Vt = np.linalg.svd(M, full_matrices=False)
    np.testing.assert_allclose(N, U[:, :rank] * S[:rank] @ Vt[:rank], atol=1e-5 * S[0])
    np.testing.assert_allclose(c, m, atol=1e-5)
    assert narrow.config.generative.rec_rank == rank
    assert narrow.params["generative"]["D_rec"]["basis"]["kernel"].shape[0] == rank
    # and the network reads the new factors as this oracle does
    Z = jax.random.normal(jax.random.key(1), (CONFIG.generative.latent_dim,))
    V, W = (
        decode(m.params["generative"], Z, template=template(), config=m.config.generative).V
        for m in (model, narrow)
    )
    assert 1e-6 < np.abs(np.asarray(V - W)).max() < 1.0


@pytest.mark.parametrize("rank", [0, 6, 7])
def test_a_rank_that_is_none_is_refused(rank: int):
    with pytest.raises(ValueError, match=f"rank {rank} is not below 6, the rank of the model's last layer"):
        with_rank(tiny_model(), rank)


def test_sixteen_bits_touch_the_widest_layers_only():
    model = tiny_model()
    half = apply_variant(model, Variant(last_layers="bfloat16"))
    changed = {
        jax.tree_util.keystr(path)
        for path, leaf in jax.tree_util.tree_leaves_with_path(half.params)
        if leaf.dtype != np.float32
    }
    assert changed == {
        "['generative']['D_rec']['basis']['kernel']",
        "['generative']['D_dyn']['skip']['kernel']",
    }
    assert apply_variant(model, Variant()) is model
    assert apply_variant(model, Variant(iterations=3)).config.collision.iterations == 3


ROWS = [
    Measured("whole", Variant(), 4.661, 9.0),
    Measured("no detail", Variant(detail=False), 4.664, 8.0),
    Measured("bare", Variant(False, False), 4.75, 2.0),
]


@pytest.mark.parametrize(("budget", "name"), [(9.0, "whole"), (8.9, "no detail"), (3.0, "bare")])
def test_the_most_accurate_that_fits_is_chosen_by_times_measured_here(budget: float, name: str):
    assert choose(ROWS, {"whole": 9.0, "no detail": 8.5, "bare": 3.0}, budget).name == name


def test_of_equal_errors_the_more_complete_is_chosen():
    assert choose(ROWS, dict.fromkeys(("whole", "no detail", "bare"), 1.0), 4.0).name == "whole"


def test_budgets_that_nothing_fits_are_refused():
    times = {"whole": 9.0, "no detail": 8.5, "bare": 3.04}
    with pytest.raises(
        ValueError, match=r"--budget-ms 1 is less than any .* the fastest, 'bare', takes 3.0 ms"
    ):
        choose(ROWS, times, 1.0)


def test_stored_variants_are_read_or_refused(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"variants.json is missing.*run garment-jax variants"):
        stored_variants(tmp_path)
    row = {"name": "whole", "settings": Variant()._asdict(), "error_cm": 1.0, "ms": 2.0}
    (tmp_path / FILE).write_text(json.dumps({"variants": [row], "detail_mm": 0.3}))
    assert stored_variants(tmp_path) == ([Measured("whole", Variant(), 1.0, 2.0)], 0.3)
    begun = {"name": "no detail", "settings": Variant(detail=False)._asdict(), "error_cm": 1.0}
    (tmp_path / FILE).write_text(json.dumps({"variants": [row, begun], "detail_mm": 0.3}))
    assert [found.name for found in stored_variants(tmp_path)[0]] == ["whole"]
    (tmp_path / FILE).write_text(json.dumps({"variants": [begun], "detail_mm": 0.3}))
    with pytest.raises(
        ValueError, match="has no error and time of the whole model yet; run garment-jax variants"
    ):
        stored_variants(tmp_path)
    old = {**row, "settings": {"detail": True, "dynamics": True}}
    (tmp_path / FILE).write_text(json.dumps({"variants": [old], "detail_mm": 0.3}))
    with pytest.raises(
        ValueError, match=r"before models had a column RNN \('whole'\); run garment-jax variants"
    ):
        stored_variants(tmp_path)
    (tmp_path / FILE).write_text('{"variants": [{}]}')
    with pytest.raises(ValueError, match=r"variants.json is damaged .*run garment-jax variants"):
        stored_variants(tmp_path)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"error_cm": "3"}, "error_cm = '3'"),
        ({"ms": float("nan")}, "ms = nan"),
        ({"ms": 10**400}, "ms = 1"),
        ({"name": ["whole"]}, r"name = \['whole'\]"),
        ({"settings": Variant()._asdict() | {"column_rnn": 1}}, "column_rnn = 1"),
        ({"settings": Variant()._asdict() | {"rank": 2.5}}, r"rank = 2\.5"),
        ({"settings": Variant()._asdict() | {"last_layers": "int8"}}, "last_layers = 'int8'"),
    ],
)
def test_variants_of_other_values_are_damage(tmp_path: Path, changed: dict, said: str):
    row = {"name": "whole", "settings": Variant()._asdict(), "error_cm": 1.0, "ms": 2.0} | changed
    (tmp_path / FILE).write_text(json.dumps({"variants": [row], "detail_mm": 0.3}))
    with pytest.raises(ValueError, match=rf"variants\.json is damaged \({said}"):
        stored_variants(tmp_path)


def test_times_are_measured_once_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    measured = []

    def measure(model, scene, motion, variant, *, store=None) -> float:
        measured.append(variant)
        return 1.5

    monkeypatch.setattr("garment_jax.animation.calibration.measured_ms", measure)
    motion = make_motion(SCENE, 4)
    for names in (["whole"], ["whole", "no detail"]):
        times = frame_times(tiny_model(), SCENE, motion, names, folder=tmp_path)
        assert {times[name] for name in names} == {1.5}
    variants = variants_of(tiny_model().params)
    assert measured == [variants["whole"], variants["no detail"]]
    assert frame_times(tiny_model(), SCENE, motion, ["whole"])["whole"] == 1.5  # without a folder too
    assert len(measured) == 3


def test_times_of_one_garment_are_not_anothers(tmp_path: Path):
    model = tiny_model()
    others = (model._replace(vertices=3000), model._replace(garment_hash="another"))
    assert len({_path(tmp_path, m, SCENE) for m in (model, *others)}) == 3


def test_time_is_measured_in_the_middle_of_a_rollout(monkeypatch: pytest.MonkeyPatch):
    """Chunks that were made ahead while the first one compiled, and the last ones, take no part."""
    seconds = [50.0, 0.1, 0.1, 0.1, *[3.2] * 6, 0.1, 0.1]
    clock, asked = [0.0], []

    def animator(model, scene, *, detail, collision, store):
        def run(motion: Motion):
            asked.append(motion)
            for k, took in enumerate(seconds):
                clock[0] += took
                yield FakePiece(motion.root[32 * k : 32 * (k + 1)])

        return run

    monkeypatch.setattr(calibration, "make_animator", animator)
    monkeypatch.setattr(calibration.time, "perf_counter", lambda: clock[0])
    short = make_motion(SCENE, 5)
    assert calibration.measured_ms(tiny_model(), SCENE, short, Variant()) == pytest.approx(100.0)
    assert len(asked[0].root) == 32 * len(seconds)
    there = [0, 1, 2, 3, 4, 3, 2, 1, 0, 1]  # a short motion goes to and fro, it does not stand still
    np.testing.assert_array_equal(asked[0].root[:10], short.root[there])
    single = short._replace(root=short.root[:1], rotations=short.rotations[:1])
    calibration.measured_ms(tiny_model(), SCENE, single, Variant())
    np.testing.assert_array_equal(asked[1].root, np.repeat(single.root, len(asked[1].root), axis=0))


class FakePiece(NamedTuple):
    V: np.ndarray
