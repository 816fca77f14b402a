"""Numbers in whatever type, order or container: one array of ours, or a sentence."""

from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest

from garment_jax.io.formats.number_arrays import is_index, number_array

TABLE = np.arange(6).reshape(2, 3) - 1
FILE = Path("a.pkl")


def read_only(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array


SPELLINGS = {
    "float64": TABLE.astype(np.float64),
    "float32": TABLE.astype(np.float32),
    "float16": TABLE.astype(np.float16),
    "long double": TABLE.astype(np.longdouble),
    "big-endian": TABLE.astype(">f8"),
    "big-endian float32": TABLE.astype(">f4"),
    "big-endian int16": TABLE.astype(">i2"),
    "int8": TABLE.astype(np.int8),
    "Fortran's order": np.asfortranarray(TABLE.astype(np.float64)),
    "read-only": read_only(TABLE.astype(np.float64)),
    "a window": TABLE.astype(np.float64)[:, ::-1][:, ::-1],
    "lists": TABLE.tolist(),
    "tuples of lists": tuple(TABLE.tolist()),
    "a list of arrays": list(TABLE.astype(np.float32)),
    "an array of objects": TABLE.astype(object),
    "NumPy's numbers in lists": [list(row) for row in TABLE],
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_every_spelling_is_the_same_numbers(spelling: str):
    found = number_array(SPELLINGS[spelling], "poses", FILE)
    np.testing.assert_array_equal(found, TABLE)
    assert found.dtype in (np.float32, np.float64, np.int64)
    assert found.dtype.isnative
    assert found.flags.c_contiguous
    assert found.flags.writeable


@pytest.mark.parametrize(
    "number", [93.0, 93, np.float32(93), np.uint8(93), np.array(93.0), np.array([93]), [93]]
)
def test_a_single_number_is_an_array_too(number: object):
    found = number_array(number, "scaling", FILE)
    assert found.size == 1
    assert found.item() == 93


def circle() -> list:
    ring: list = []
    ring += [ring, ring]
    return ring


def doubled() -> list:
    rows: list = [0.0] * 2**13
    return [[[rows] * 2**13] * 2**13]


NOTHING = {
    "text": ("93", "str"),
    "an array of text": (np.array(["a"]), "<U1"),
    "truth": (True, "bool"),
    "an array of truth": (np.ones(3, bool), "bool"),
    "complex": (np.ones(3, complex), "complex128"),
    "dates": (np.array(["2020-01-01"], "M8[D]"), r"datetime64\[D\]"),
    "structures": (np.zeros(3, [("x", "f4")]), r"\[\('x', '<f4'\)\]"),
    "objects": (np.array([{}, {}]), "object"),
    "none": (None, "NoneType"),
    "a dictionary": (OrderedDict(), "OrderedDict"),
    "unequal lists": ([[1, 2], [3]], "list"),
    "deep lists": ([[[[[1.0]]]]], "list"),
    "a list in itself": (circle(), "list"),
    "a list many times": (doubled(), "list"),
    "whole numbers beyond 64 bits": ([10**400, 1.5], "list"),
    "a whole number beyond 64 bits": (10**400, "int"),
    "unsigned beyond": (np.array([2**63 + 1], np.uint64), "uint64"),
}


@pytest.mark.parametrize("case", NOTHING)
def test_what_is_no_number_is_refused_by_name(case: str):
    value, kind = NOTHING[case]
    with pytest.raises(
        ValueError, match=rf"^a\.pkl: 'poses' is of type {kind}, not an array of numbers; save"
    ):
        number_array(value, "poses", FILE)


def test_what_float64_cannot_hold_is_infinite_without_a_warning():
    assert np.isinf(number_array(np.array([np.longdouble("1e4000")]), "poses", FILE)).all()


def test_indices_are_whole_and_in_range():
    assert is_index(np.array([0.0, 4.0]), 5)
    assert is_index(np.zeros(0), 0)
    assert not is_index(np.array([0, 5]), 5)
    assert not is_index(np.array([-1, 2]), 5)
    assert not is_index(np.array([0.5]), 5)
    assert not is_index(np.array([np.nan]), 5)
