"""Files, commands and hashes from before keys had their names."""

import pytest

from garment_jax.config import Config, apply_overrides, current, former, from_dict, to_dict
from garment_jax.config.former_names import current_names, former_names

OLD = {"swing": {"hidden": 5}, "rollout": {"swing": 0.25}}
NEW = {"column_rnn": {"hidden": 5}, "rollout": {"column_rnn": 0.25}}


def test_former_names_are_read_as_the_present_ones() -> None:
    assert current_names(OLD) == NEW
    assert from_dict(OLD) == from_dict(NEW) != Config()
    given = ["--swing.hidden=5", "--rollout.swing", "0.25"]
    assert apply_overrides(Config(), given) == from_dict(NEW)


def test_hashes_are_made_of_the_former_names() -> None:
    assert former_names(NEW) == OLD
    assert current_names(former_names(to_dict(Config()))) == to_dict(Config())


def test_both_names_at_once_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"x\.toml: swing is the former name of column_rnn, and both are given"
    ):
        from_dict(OLD | NEW, source="x.toml")
    with pytest.raises(ValueError, match=r"\[rollout\]: swing is the former name of column_rnn"):
        from_dict({"rollout": {"swing": 1.0, "column_rnn": 1.0}})


def test_a_stage_is_known_by_both_names() -> None:
    assert (former("column_rnn"), current("swing")) == ("swing", "column_rnn")
    assert (former("motion"), current("motion"), current("unknown")) == ("", "motion", "unknown")


def test_keys_that_no_rollout_reads_any_more_are_passed_over_in_files_and_unknown_elsewhere() -> None:
    former_keys = {"amplitude": 1.03, "gain": 1.0, "max_correction": 8.0, "reach": 1.5}
    assert from_dict({"rollout": {"column_rnn": 0.25, **former_keys}}) == from_dict(NEW | {"column_rnn": {}})
    with pytest.raises(ValueError, match=r"unknown key in \[rollout\] 'amplitude'"):
        apply_overrides(Config(), ["--rollout.amplitude", "1.03"])
