"""Limits that all readers share."""

from pathlib import Path

import pytest

from garment_jax.io.formats.limits import check_directory, check_growth


def test_what_is_multiplied_out_of_few_numbers_is_bounded_by_the_file() -> None:
    check_growth(60 * 2**20, 100, "some numbers", Path("a.bvh"))  # harmless, however small the file
    check_growth(2**30, 2**24, "some numbers", Path("a.bvh"))
    with pytest.raises(
        ValueError, match=r"a\.bvh: 20000 joints would fill 3433 MB from a file of 600000 bytes"
    ):
        check_growth(3_600_000_000, 600_000, "20000 joints", Path("a.bvh"))
    with pytest.raises(ValueError, match="cut it into clips"):
        check_growth(3 * 2**30, 2**30, "frames", Path("a.bvh"))


def test_a_directory_that_is_nowhere_is_read_over(tmp_path: Path) -> None:
    """A zip archive's locator may name any place; a seek beyond 63 bits would be the system's own error."""
    end = b"PK\x06\x07" + bytes(4) + b"\xff" * 8 + bytes(4) + b"PK\x05\x06" + bytes(18)
    path = tmp_path / "a.npz"
    path.write_bytes(bytes(80) + end)
    with path.open("rb") as file:
        check_directory(file, path)
