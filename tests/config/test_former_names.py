"""Files, commands and hashes from before keys had their names."""

import pytest

from garment_jax.config import Config, apply_overrides, current, former, from_dict, to_dict
from garment_jax.config.former_names import current_names, former_names

OLD = {"swing": {"hidden": 5}, "rollout": {"swing": 0.25, "gain": 1.5, "reach": 2.0}}
NEW = {
    "column_rnn": {"hidden": 5},
    "rollout": {"column_rnn": 0.25, "amplitude": 1.5, "max_correction": 2.0},
}


def test_former_names_are_read_as_the_present_ones() -> None:
    assert current_names(OLD) == NEW
    assert from_dict(OLD) == from_dict(NEW) != Config()
    given = ["--swing.hidden=5", "--rollout.swing", "0.25", "--rollout.gain=1.5", "--rollout.reach", "2"]
    assert apply_overrides(Config(), given) == from_dict(NEW)


def test_hashes_are_made_of_the_former_names() -> None:
    assert former_names(NEW) == OLD
    assert current_names(former_names(to_dict(Config()))) == to_dict(Config())


def test_both_names_at_once_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"x\.toml: swing is the former name of column_rnn, and both are given"
    ):
        from_dict(OLD | NEW, source="x.toml")
    with pytest.raises(ValueError, match=r"\[rollout\]: gain is the former name of amplitude"):
        from_dict({"rollout": {"gain": 1.0, "amplitude": 1.0}})


def test_a_stage_is_known_by_both_names() -> None:
    assert (former("column_rnn"), current("swing")) == ("swing", "column_rnn")
    assert (former("motion"), current("motion"), current("unknown")) == ("", "motion", "unknown")
