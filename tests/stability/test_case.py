import numpy as np
import pytest

from garment_jax.stability.case import (
    GREEN,
    RED,
    at_least,
    at_most,
    finite,
    holds,
    info,
    left_out,
    refused,
    spell,
)
from garment_jax.stability.table import format_cases, summary


@pytest.mark.parametrize(
    ("value", "verdict"), [(0.9, GREEN), (1.0, GREEN), (1.1, RED), (np.nan, RED), (np.inf, RED)]
)
def test_a_value_above_its_bound_and_one_that_is_no_number_are_red(value, verdict):
    assert at_most("g", "c", "q", value, 1.0, "mm").verdict == verdict


def test_a_value_below_its_least_and_one_that_is_no_number_are_red():
    verdicts = [at_least("g", "c", "q", value, 1.0, "").verdict for value in (1.0, 0.9, np.nan)]
    assert verdicts == [GREEN, RED, RED]


def test_one_number_that_is_not_finite_is_counted_and_red():
    assert finite("g", "c", "q", np.ones(3)).verdict == GREEN
    bad = finite("g", "c", "q", np.ones(3), np.array([1.0, np.nan, np.inf]))
    assert (bad.value, bad.verdict) == (2.0, RED)


def test_a_refusal_is_green_only_as_one_sentence_with_its_words():
    def refuse(text: str):
        raise ValueError(text)

    def verdict(text: str) -> str:
        return refused("g", "c", lambda: refuse(text), ["fps"]).verdict

    assert verdict("15 fps; resample.") == GREEN
    assert verdict("something else") == RED
    assert verdict("fps\nand more") == RED
    assert refused("g", "c", lambda: None, ["fps"]).value == "accepted in silence"
    shown = refused("g", "c", lambda: refuse("/clips/x/clip.h5 has 15 fps"), ["fps"], hide="/clips/x/")
    assert shown.value == "clip.h5 has 15 fps"


def test_the_table_is_aligned_and_the_summary_names_what_is_red():
    cases = [
        at_most("g", "first", "depth", 0.25, 1.0, "mm"),
        holds("g", "second", "says", "nothing", "a sentence", False),
        left_out("g", "third", "only with --full"),
        info("g", "fourth", "moved", 3.0, "mm"),
    ]
    lines = format_cases(cases).splitlines()
    assert len({len(line) for line in lines}) == 1
    assert "0.25 mm" in lines[2]
    assert "**red**" in lines[3]
    assert summary(cases) == "1 green, 1 red, 1 left out\nred: g: second, says"


def test_values_are_spelt_with_three_digits():
    assert [spell(x) for x in (3.0, 0.12345, 1e-9, 1.5e7, "yes")] == ["3", "0.123", "1e-09", "1.5e+07", "yes"]
