"""Limits that all readers share."""

from pathlib import Path

import pytest

from garment_jax.formats.limits import check_growth, check_numbers


def test_what_is_multiplied_out_of_few_numbers_is_bounded_by_the_file() -> None:
    check_growth(60 * 2**20, 100, "some numbers", Path("a.bvh"))  # harmless, however small the file
    check_growth(2**30, 2**24, "some numbers", Path("a.bvh"))
    with pytest.raises(
        ValueError, match=r"a\.bvh: 20000 joints would fill 3433 MB from a file of 600000 bytes"
    ):
        check_growth(3_600_000_000, 600_000, "20000 joints", Path("a.bvh"))
    with pytest.raises(ValueError, match="cut it into clips"):
        check_growth(3 * 2**30, 2**30, "frames", Path("a.bvh"))


def test_a_word_of_a_thousand_digits_is_no_number() -> None:
    check_numbers(["1.25", "-3e-5"], "a.obj")
    check_numbers([], "a.obj")
    with pytest.raises(ValueError, match=r"a\.obj: a number has 1000 characters"):
        check_numbers(["1", "1" * 1000], "a.obj")
