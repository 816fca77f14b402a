"""A run directory refuses another configuration, garment or data set."""

from pathlib import Path

import pytest

from garment_jax.config import Config, apply_overrides
from garment_jax.training.run_directory import check_run, prepare_run, run_config


def test_the_configuration_is_stored_and_read_back(tmp_path: Path) -> None:
    config = apply_overrides(Config(), ["--uv.size", "32"])
    assert run_config(prepare_run(tmp_path / "run", config)) == config
    prepare_run(tmp_path / "run", config)


def test_another_configuration_is_refused_with_key_values_and_remedy(tmp_path: Path) -> None:
    prepare_run(tmp_path, Config())
    other = apply_overrides(Config(), ["--uv.size", "32"])
    with pytest.raises(ValueError, match=r"uv\.size = 64, not 32\); use another --run-dir or the old values"):
        prepare_run(tmp_path, other)
    assert run_config(tmp_path) == Config()


@pytest.mark.parametrize("text", ["[]", "null", "{", "3"])
def test_facts_that_are_none_are_refused(tmp_path: Path, text: str) -> None:
    prepare_run(tmp_path, Config(), facts={"garment": "a"})
    (tmp_path / "facts.json").write_text(text)
    with pytest.raises(
        ValueError, match=r"facts\.json is damaged; put it back, or train into another folder"
    ):
        check_run(tmp_path, Config(), facts={"garment": "a"})


def test_many_differences_are_counted(tmp_path: Path) -> None:
    prepare_run(tmp_path, Config())
    words = [
        "--uv.size",
        "32",
        "--body.seeds",
        "9",
        "--motion.gru",
        "4",
        "--motion.lanes",
        "1",
        "--detail.batch",
        "1",
    ]
    with pytest.raises(ValueError, match="and 2 more"):
        prepare_run(tmp_path, apply_overrides(Config(), words))


def test_how_a_run_is_watched_may_change(tmp_path: Path) -> None:
    prepare_run(tmp_path, Config())
    watched = apply_overrides(Config(), ["--training.log_every", "5", "--rollout.chunk", "10"])
    assert run_config(prepare_run(tmp_path, watched)) == watched


def test_other_facts_are_refused_and_new_ones_added(tmp_path: Path) -> None:
    prepare_run(tmp_path, Config(), facts={"template": "a1"})
    prepare_run(tmp_path, Config(), facts={"template": "a1", "data": "c3"})
    with pytest.raises(ValueError, match="data = 'c3', not 'd4'"):
        prepare_run(tmp_path, Config(), facts={"data": "d4"})


def test_a_file_or_an_empty_folder_is_no_run(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="is a file; name a folder"):
        prepare_run(tmp_path / "file", Config())
    with pytest.raises(FileNotFoundError, match=r"holds no config\.toml"):
        run_config(tmp_path)
    with pytest.raises(ValueError, match=r"--run-dir .*run cannot be made \(Not a directory\); name another"):
        prepare_run(tmp_path / "file" / "run", Config())


def test_a_run_that_is_only_checked_stays_as_it_is(tmp_path: Path) -> None:
    check_run(tmp_path, Config(), facts={"garment": "a1"})
    assert not list(tmp_path.iterdir())
    prepare_run(tmp_path, Config(), facts={"garment": "a1"})
    stored = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    check_run(
        tmp_path, apply_overrides(Config(), ["--rollout.chunk", "10"]), facts={"garment": "a1", "data": "c3"}
    )
    with pytest.raises(ValueError, match="garment = 'a1', not 'b2'"):
        check_run(tmp_path, Config(), facts={"garment": "b2"})
    assert stored == {file.name: file.read_bytes() for file in tmp_path.iterdir()}
