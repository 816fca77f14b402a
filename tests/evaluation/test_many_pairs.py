"""Pairs measured on a farm: the figures of each alone, under the names that were given."""

import os
from pathlib import Path

import pytest

from garment_jax.evaluation.command import evaluate_files
from garment_jax.evaluation.many_pairs import Pair, evaluate_many
from garment_jax.farm.local import LocalFarm
from tests.reference.scene import write_clip


@pytest.mark.parametrize("workers", [1, 2])
def test_figures_are_those_of_each_alone(
    tmp_path: Path, workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("truth", "pred"):
        os.mkdir(name)
    for k in range(2):
        write_clip(tmp_path / f"truth/{k}.h5", 4 + k)
        write_clip(tmp_path / f"pred/{k}.h5", 4 + k)
    (tmp_path / "pred/2.h5").write_text("no clip")
    pairs = [Pair(Path(f"pred/{k}.h5"), Path(f"truth/{k}.h5")) for k in range(3)]
    found = dict(evaluate_many(pairs, LocalFarm(workers), every=2))
    for k in range(2):
        assert found[k].value == evaluate_files(pairs[k].pred, pairs[k].truth, every=2)
    assert "2.h5" in found[2].error
