"""Hashes stay when keys are added; what a resumed run may change; what shapes a network."""

import json
from pathlib import Path

import pytest

from garment_jax.config import (
    Config,
    apply_overrides,
    content_hash,
    differences,
    from_dict,
    network_keys,
    to_dict,
)

MODEL = Path(__file__).parents[2] / "models" / "skirt" / "model.json"
# of configurations as they were before their later keys existed: saved runs and caches are known by them
HASHES = {
    "": "2a684f941a28cdd6",
    "--baselines.lanes=33": "cb6a001567127e33",
    "--collision.eps=0.252": "1481867ef15c7d09",
    "--generative.skin_reach=0.25": "b819aa257a3f49f5",
    "--column_rnn.layers=1": "14c8309826c044fb",
    "--column_rnn.steps=1": "cd1d50e514f55b9b",
    "--rollout.column_rnn=0.75": "89f892a33ad68278",
    "--training.begin_from=x": "4e3000b3c5779a4d",
}


@pytest.mark.parametrize("override", HASHES)
def test_hashes_stay_when_keys_are_added(override: str) -> None:
    config = apply_overrides(Config(), [override] if override else [])
    assert content_hash(config) == HASHES[override], "a new key needs later=True"


def test_the_keys_that_shape_a_network_are_those_that_saved_models_name() -> None:
    facts = json.loads(MODEL.read_text(encoding="utf-8"))
    shaping = facts["shaping"]
    assert {name: tuple(keys) for name, keys in shaping.items()} == network_keys()


def test_the_hash_is_of_the_content() -> None:
    assert content_hash(Config()) == content_hash(from_dict({}))
    assert content_hash(Config()) != content_hash(apply_overrides(Config(), ["--uv.size", "32"]))


def test_differences_leave_out_what_does_not_change_the_result() -> None:
    other = apply_overrides(Config(), ["--training.log_every", "7", "--rollout.chunk=9", "--uv.size=32"])
    assert differences(to_dict(Config()), to_dict(other)) == [("uv.size", 64, 32)]
    # A run of an older version, without a key that exists now, is another run as well.
    older = to_dict(Config())
    del older["uv"]["size"]
    assert differences(older, to_dict(Config())) == [("uv.size", None, 64)]
