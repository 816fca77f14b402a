"""Names by content: what makes another run, and what does not."""

from dataclasses import replace
from pathlib import Path

import pytest

from garment_jax.bench.identity import clips_hash, learnt, run_name, stage_name
from garment_jax.bench.settings import merged
from garment_jax.config import Config

CONFIG = Config()


def changed(**sections: dict) -> Config:
    return merged(CONFIG, sections, source="test")


@pytest.mark.parametrize(
    ("sections", "same"),
    [
        ({"motion": {"gru": 32}}, False),
        ({"training": {"seed": 1}}, False),
        ({"data": {"validation": ["salsa"]}}, False),
        ({"data": {"dir": "elsewhere"}}, True),
        ({"collision": {"iterations": 3}}, True),
        ({"rollout": {"chunk": 8}}, True),
        ({"training": {"checkpoint_seconds": 1.0}}, True),
        ({"baselines": {"pan_steps": 3}}, True),
        ({"column_rnn": {"hidden": 2}}, True),  # a stage of no steps
        ({"column_rnn": {"steps": 2000}}, False),
    ],
)
def test_a_run_of_ours_is_named_by_what_it_learns(sections: dict, same: bool) -> None:
    assert (run_name("ours", changed(**sections), "d") == run_name("ours", CONFIG, "d")) is same


def test_simulated_clips_make_every_stage_another() -> None:
    more = changed(simulation={"clips": 60})
    for stage in ("generative", "warm_up", "motion", "detail"):
        assert stage_name(stage, more, "d") != stage_name(stage, CONFIG, "d")
    assert learnt(more, "ours")["simulation"]["kept"]
    assert run_name("pan_2022", more, "d") != run_name("pan_2022", CONFIG, "d")


def test_column_rnns_are_another_run_each() -> None:
    names = {
        run_name("ours", changed(column_rnn={"steps": steps, "hidden": hidden}), "d")
        for steps in (2000, 9000)
        for hidden in (2, 3)
    }
    assert len(names) == 4


def test_a_baseline_is_named_by_its_own_section_and_not_by_ours() -> None:
    name = run_name("pan_2022", CONFIG, "d")
    assert run_name("pan_2022", changed(baselines={"pan_steps": 3}), "d") != name
    assert run_name("pan_2022", changed(generative={"latent_dim": 32}), "d") == name
    assert run_name("santesteban_2019", CONFIG, "d").split("-")[1] != name.split("-")[1]


def test_the_single_decoder_is_named_by_the_networks_that_it_is_made_of() -> None:
    name = run_name("vertex_decoder", CONFIG, "d")
    for section in ({"latent_dim": 32}, {"channels": (8, 16)}, {"lambda_kl": 0.5}, {"batch": 3}):
        assert run_name("vertex_decoder", changed(generative=section), "d") != name, section
    # its own section has these
    assert run_name("vertex_decoder", changed(generative={"steps": 3, "skin_reach": 0.2}), "d") == name


def test_other_data_is_another_run() -> None:
    assert run_name("ours", CONFIG, "d") != run_name("ours", CONFIG, "e")


def test_a_stage_is_shared_where_all_before_it_is_the_same() -> None:
    without = changed(motion={"previous_state": False})
    plain = changed(detail={"lambda_adversarial": 0.0})
    rolled = replace(without, detail=replace(CONFIG.detail, source="rollout"))
    rolled_too = replace(CONFIG, detail=rolled.detail)
    for stage, other, same in (
        ("generative", without, True),
        ("warm_up", without, False),
        ("motion", without, False),
        ("detail", without, True),  # it learns from reconstructions
        ("motion", plain, True),
        ("detail", plain, False),
        ("generative", changed(generative={"lambda_kl": 0.0}), False),
    ):
        assert (stage_name(stage, other, "d") == stage_name(stage, CONFIG, "d")) is same, stage
    assert stage_name("detail", rolled, "d") != stage_name("detail", rolled_too, "d")


def test_learnt_holds_what_is_not_a_default_and_no_path_and_no_watching() -> None:
    assert learnt(CONFIG, "ours") == {}
    assert learnt(CONFIG, "pan_2022") == {}
    config = changed(
        data={"dir": "elsewhere", "mirror": False},
        training={"log_every": 3, "seed": 2},
        baselines={"bones": 5},
    )
    common = {"data": {"mirror": False}, "training": {"seed": 2}}
    assert learnt(config, "ours") == common
    assert learnt(config, "pan_2022") == common | {"baselines": {"bones": 5}}


def test_clips_are_named_by_name_and_bytes(tmp_path: Path) -> None:
    a, b = tmp_path / "a.h5", tmp_path / "b.h5"
    a.write_bytes(b"one")
    b.write_bytes(b"two")
    first = clips_hash([a, b])
    assert clips_hash([b, a]) == first
    assert clips_hash([a]) != first
    b.write_bytes(b"twp")
    assert clips_hash([a, b]) != first
