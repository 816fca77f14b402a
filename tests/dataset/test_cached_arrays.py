"""Arrays of a run's cache: made once, made anew where the file is damaged or holds something else."""

import errno
from pathlib import Path

import numpy as np
import pytest

from garment_jax.dataset import cached_arrays as module
from garment_jax.dataset.cached_arrays import cached_arrays, cached_list

MADE = [np.arange(6.0).reshape(3, 2), np.arange(4.0).reshape(2, 2)]


def counted(calls: list[int]):
    def make() -> list[np.ndarray]:
        calls.append(1)
        return MADE

    return make


def test_arrays_are_made_once(tmp_path: Path):
    calls: list[int] = []
    for _ in range(2):
        for found, made in zip(
            cached_list(tmp_path / "cache/x.npz", counted(calls), [3, 2]), MADE, strict=True
        ):
            np.testing.assert_array_equal(found, made)
    assert len(calls) == 1
    assert [path.name for path in (tmp_path / "cache").iterdir()] == ["x.npz"]


@pytest.mark.parametrize("damage", [b"", b"PK", None], ids=["empty", "begun", "cut"])
def test_damaged_files_are_made_anew(tmp_path: Path, damage: bytes | None):
    calls: list[int] = []
    path = tmp_path / "x.npz"
    cached_list(path, counted(calls), [3, 2])
    path.write_bytes(path.read_bytes()[:-30] if damage is None else damage)
    np.testing.assert_array_equal(cached_list(path, counted(calls), [3, 2])[0], MADE[0])
    cached_list(path, counted(calls), [3, 2])
    assert len(calls) == 2


def test_arrays_of_other_lengths_are_made_anew(tmp_path: Path):
    path, calls = tmp_path / "x.npz", []
    np.savez(path, **{"0": np.zeros((9, 2)), "1": np.zeros((2, 2))})
    np.testing.assert_array_equal(cached_list(path, counted(calls), [3, 2])[0], MADE[0])
    np.savez(path, **{"0": np.zeros((3, 2))})
    assert len(cached_list(path, counted(calls), [3, 2])) == 2
    assert len(calls) == 2


def test_a_full_disk_leaves_a_sentence_and_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(path: Path, **_) -> None:
        path.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "x.npz"
    path.write_bytes(b"damaged")
    monkeypatch.setattr(module.np, "savez", full)
    with pytest.raises(OSError, match=r"x\.npz could not be written \(No space left on device\); free"):
        cached_arrays(path, lambda: {"x": np.zeros(3)})
    assert [(file.name, file.read_bytes()) for file in tmp_path.iterdir()] == [("x.npz", b"damaged")]
