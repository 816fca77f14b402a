"""`info`: the facts of a file and of a run's folder."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.io.info import describe, format_description
from tests.reference.scene import write_clip


def test_facts_of_a_sequence_file(tmp_path: Path):
    path = write_clip(
        tmp_path / "clip.h5", 12, attributes={"kind": "predicted", "source": "waltz.bvh", "range": [1, 2]}
    )
    facts = describe(path)
    assert facts["kind"] == "predicted"
    assert facts["source"] == "waltz.bvh"
    assert facts["range"] == [1, 2]
    assert (facts["frames"], facts["fps"], facts["duration_s"]) == (12, 30.0, 0.4)
    assert (facts["garment"]["vertices"], facts["garment"]["faces"], facts["garment"]["pins"]) == (
        128,
        224,
        16,
    )
    assert facts["body"]["joints"] == 22
    assert facts["length_unit"] == "m"
    low, high = facts["extent_m"]
    assert all(-2 < a < b < 2 for a, b in zip(low, high, strict=True))
    assert json.loads(json.dumps(facts)) == facts
    text = format_description(str(path), facts)
    assert "garment.vertices" in text
    assert "LeftUpLeg" in text


def test_attributes_of_any_kind_are_strict_json(tmp_path: Path):
    path = write_clip(tmp_path / "clip.h5", 2)
    with h5py.File(path, "r+") as file:
        file.attrs.update(nothing=h5py.Empty("f8"), half=float("nan"), two=1 + 2j, bytes=np.bytes_(b"\xff"))
        file.attrs.update(link=file["root"].ref, void=np.void(b"\0\1"), row=[1.0, float("inf")])
    facts = describe(path)
    assert json.loads(json.dumps(facts, allow_nan=False)) == facts
    assert (facts["half"], facts["row"]) == ("nan", [1.0, "inf"])


def test_facts_of_a_run(tmp_path: Path):
    (tmp_path / "config.toml").write_text("[uv]\nsize = 64\n")
    (tmp_path / "figures.json").write_text('{"rmse_cm": 3.5}')
    assert describe(tmp_path) == {"config": {"uv": {"size": 64}}, "figures": {"rmse_cm": 3.5}}
    assert "config.uv.size   64" in format_description("run", describe(tmp_path))


def test_folder_without_facts_and_broken_facts_are_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="neither a run nor a model"):
        describe(tmp_path)
    (tmp_path / "figures.json").write_text("{")
    with pytest.raises(ValueError, match=r"figures\.json cannot be read"):
        describe(tmp_path)
    (tmp_path / "figures.json").write_text("[" * 100_000)
    with pytest.raises(ValueError, match=r"figures\.json cannot be read"):
        describe(tmp_path)
