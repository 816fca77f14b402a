"""A run directory belongs to one configuration, garment and data set."""

import json
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from garment_jax.config import Config, differences, load_config, to_dict, to_toml
from garment_jax.storage.lock import locked
from garment_jax.storage.whole import write_text

STAGES = ("generative", "motion", "detail", "column_rnn")
CHECKPOINTS, CACHE = "checkpoints", "cache"  # folders inside a run
CONFIG_NAME = "config.toml"
FACTS_NAME = "facts.json"
_SHOWN = 3


def prepare_run(run_dir: str | Path, config: Config, *, facts: Mapping[str, Any] | None = None) -> Path:
    """Create the directory, or check that it was made with this configuration; return its path.

    `facts` are JSON values that must agree as well, such as the template's and the data's hash.
    Keys that do not change what is learnt may differ (see `config.differences`); the newer
    ones are then stored. ValueError says which key differs, both values and the remedy.
    """
    path = check_run(run_dir, config, facts=facts)
    write_text(path / FACTS_NAME, json.dumps(run_facts(path) | _plain(facts), indent=1) + "\n")
    write_text(path / CONFIG_NAME, to_toml(config))  # last: its presence says that the facts are there
    return path


def check_run(run_dir: str | Path, config: Config, *, facts: Mapping[str, Any] | None = None) -> Path:
    """Create the directory, or refuse it as `prepare_run` does with what it holds unchanged; return its path.

    ValueError for a path where no folder can be, too.
    """
    path, new = _new(Path(run_dir)), _plain(facts)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f"--run-dir {path} cannot be made ({error.strerror}); name another folder."
        ) from error
    if (path / CONFIG_NAME).exists():
        changed = differences(to_dict(run_config(path)), to_dict(config))
        changed += [(k, v, new[k]) for k, v in run_facts(path).items() if k in new and new[k] != v]
        _refuse(path, changed)
    return path


def run_lock(run_dir: str | Path) -> AbstractContextManager[None]:
    """Hold a run directory while it is trained in; `OSError` names the process that does so already."""
    return locked(_new(Path(run_dir)), "training", remedy="use another --run-dir")


def _new(path: Path) -> Path:
    if path.exists() and not path.is_dir():
        raise ValueError(f"--run-dir {path} is a file; name a folder.")
    return path


def _plain(facts: Mapping[str, Any] | None) -> dict[str, Any]:
    return json.loads(json.dumps(dict(facts or {})))


def run_config(run_dir: str | Path) -> Config:
    """The configuration that a run directory was made with; FileNotFoundError if it holds none."""
    path = Path(run_dir) / CONFIG_NAME
    if not path.is_file():
        raise FileNotFoundError(f"{run_dir} holds no {CONFIG_NAME}; name a folder that train.py wrote.")
    return load_config(path)


def run_facts(path: Path) -> dict[str, Any]:
    """Return what a run belongs to beside its configuration; empty where there is no run, as `check_run`."""
    file = path / FACTS_NAME
    if not file.exists():
        return {}
    try:
        facts = json.loads(file.read_text(encoding="utf-8"))
    except ValueError:
        facts = None
    if not isinstance(facts, dict):
        raise ValueError(f"{file} is damaged; put it back, or train into another folder.")
    return facts


def _refuse(path: Path, changed: list[tuple[str, Any, Any]]) -> None:
    if changed:
        shown = "; ".join(f"{name} = {old!r}, not {new!r}" for name, old, new in changed[:_SHOWN])
        more = f"; and {len(changed) - _SHOWN} more" if len(changed) > _SHOWN else ""
        raise ValueError(
            f"{path} belongs to another run ({shown}{more}); use another --run-dir or the old values."
        )
