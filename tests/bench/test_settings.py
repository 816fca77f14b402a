"""The benchmark's file: what it means, and what is refused by name."""

from dataclasses import replace
from pathlib import Path

import pytest

from garment_jax.baselines import METHODS
from garment_jax.bench.quick import quick_version
from garment_jax.bench.settings import (
    SEARCH,
    SEEDS,
    check_methods,
    load_benchmark,
    merged,
    row_config,
    scaled,
)
from garment_jax.config import ColumnRnnConfig, Config
from tests.bench.made import TEXT, write_benchmark

ROOT = Path(__file__).parents[2]


def test_a_row_is_base_and_budget_and_its_own_values(tmp_path: Path) -> None:
    loaded = load_benchmark(write_benchmark(tmp_path))
    ours, other = (row_config(loaded, loaded.row(name), 7) for name in ("ours", "no_previous_state"))
    assert (ours.motion.steps, ours.motion.gru, ours.training.seed) == (6, 16, 7)
    assert (ours.motion.previous_state, other.motion.previous_state) == (True, False)


def test_length_and_rate_scale_steps_and_rates_and_nothing_else() -> None:
    config = scaled(Config(), length=0.5, rate=3.0)
    assert config.motion.steps == 2_500
    assert config.motion.warm_up_steps == 750
    assert config.baselines.pan_residual_steps == Config().baselines.pan_residual_steps // 2
    assert config.motion.warm_up_rate == pytest.approx(3e-3)
    assert config.detail.learning_rate == pytest.approx(6e-4)
    assert config.training == Config().training  # final_rate is a part, not a rate
    assert scaled(Config(), length=1e-9).detail.steps == 1
    column_rnn = scaled(
        replace(Config(), column_rnn=ColumnRnnConfig(steps=40)), length=0.5, rate=3.0
    ).column_rnn
    assert column_rnn == ColumnRnnConfig(steps=20)


def test_no_steps_stay_none() -> None:
    config = merged(Config(), {"motion": {"warm_up_steps": 0}}, source="x")
    assert scaled(config, length=2.0).motion.warm_up_steps == 0


def test_the_shipped_benchmarks_are_sound() -> None:
    for path in sorted((ROOT / "configs").glob("benchmark*.toml")):
        loaded = load_benchmark(path)
        check_methods(loaded.settings, METHODS, str(path))
        groups = [word for word in loaded.settings.order if word not in (SEARCH, SEEDS)]
        first = [row.name for row in loaded.settings.rows if row.group == groups[0]]
        assert first[0] == "ours"
        for row in loaded.settings.rows:
            row_config(loaded, row, 0, rate=0.3, length=0.5)


def test_quick_keeps_the_first_group_and_shortens_it(tmp_path: Path) -> None:
    loaded = load_benchmark(write_benchmark(tmp_path))
    quick = quick_version(loaded).settings
    assert [row.name for row in quick.rows] == [
        row.name for row in loaded.settings.rows if row.group == "main"
    ]
    assert all(len(row.seeds) == 1 and row.part < 1 and row.length < 1 for row in quick.rows)
    assert quick.search.methods == ()


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("every = 6", "evry = 6", "unknown key 'evry'; known are .* Did you mean 'every'"),
        ("every = 6", 'every = "6"', "every = '6' must be a whole number"),
        ("every = 6", "every = 0", "every and lengths count frames"),
        ("lengths = [5, 12]", "lengths = 5", r"must be a list; write \[5\]"),
        ('base = "tiny.toml"', "", "base is missing"),
        ('base = "tiny.toml"', 'base = "other.toml"', "No configuration file"),
        ("steps = 6", "stepz = 6", "unknown key in .motion. 'stepz'"),
        ("part = 0.5", "part = 1.5", "part = 1.5 must lie above 0 and be at most 1"),
        ("part = 0.5", "length = 0.0", "length = 0 must be above 0"),
        ("seeds = [0, 7]", "seeds = []", "seeds is empty"),
        ('group = "fractions"', 'group = "other"', "group 'other' is not in order"),
        ('name = "ours_half"', 'name = "ours"', "two rows are called 'ours'"),
        ('title = "skinned"', "", "title is missing"),
        (
            'task = "reconstruction"',
            'task = "guess"',
            "task = 'guess' is not one of 'rollout'",
        ),
        ("factors = [0.5, 1.0]", "factors = [0.0]", "length and factors must be above 0"),
        (
            "set.motion.previous_state = false",
            "set.motion.previous = 1",
            "unknown key in .motion. 'previous'",
        ),
        ("set.motion.previous_state = false", "set.motion = 1", "motion = 1 is a section"),
        ("[search]", "[serch]", "unknown key 'serch'"),
        ('order = ["main"', 'reference = "x"\norder = ["main"', "reference = 'x' is no row"),
        ("every = 6", "every =", "is not valid TOML"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    assert old in TEXT
    with pytest.raises((ValueError, FileNotFoundError), match=sentence):
        load_benchmark(write_benchmark(tmp_path, TEXT.replace(old, new)))


def test_unknown_methods_and_files_are_refused(tmp_path: Path) -> None:
    loaded = load_benchmark(write_benchmark(tmp_path))
    check_methods(loaded.settings, {"skinned_template": None}, "x")
    with pytest.raises(ValueError, match="unknown method 'skinned_template'; known are ours, x"):
        check_methods(loaded.settings, {"x": None}, "x")
    with pytest.raises(FileNotFoundError, match=r"No configuration file .*; did you mean .*tiny\.toml"):
        load_benchmark(tmp_path / "none.toml")
    with pytest.raises(ValueError, match="unknown row 'x'"):
        loaded.row("x")


def test_the_packages_benchmark_is_found_by_its_name():
    assert load_benchmark("benchmark").folder.name == "configs"
