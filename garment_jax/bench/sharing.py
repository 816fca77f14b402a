"""What one run of ours may take over from another: prepared clips, latents, finished stages.

Files that never change are linked, not copied. A stage is taken over whole, with its lines of the log,
where everything that it depends on is the same (`identity.stage_name`).
"""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

from garment_jax.bench.files import read_json, write_json
from garment_jax.bench.identity import stage_name
from garment_jax.config import Config, content_hash, to_dict
from garment_jax.io.stored_arrays import digest_path
from garment_jax.storage.whole import link_or_copy, replaced, write_text
from garment_jax.training.checkpoint import FOLDER, seal
from garment_jax.training.log import FILE_NAME, read_log

NAMES = "stages.json"  # in a run's folder: stage -> name
STAGES = ("generative", "warm_up", "motion", "detail")
CODES = "true_latents.npz"


def share_prepared(run: Path, others: Path) -> None:
    """Link the prepared clips of the runs in `others` into `run`; their names say what they hold."""
    cache = run / "cache"
    cache.mkdir(parents=True, exist_ok=True)
    for source in sorted(others.glob("*/cache/*.npy")):
        digest = digest_path(source)
        for path in (source, digest) if digest.is_file() else ():
            _link(path, cache / path.name)


def share_stages(run: Path, others: Path, config: Config, data: str) -> list[str]:
    """Take finished stages over into `run`, in order, as far as there are any; return their names."""
    names = {stage: stage_name(stage, config, data) for stage in STAGES}
    run.mkdir(parents=True, exist_ok=True)
    write_json(run / NAMES, names)
    taken = []
    for stage in STAGES:
        steps = _steps(config, stage)
        if not steps or (run / FOLDER / stage).is_dir():
            continue
        for other in _runs_with(others, stage, names[stage]):
            if other != run and (other / FOLDER / stage / str(steps)).is_dir():
                _take(stage, steps, other, run, config)
                taken.append(stage)
                break
    return taken


def _steps(config: Config, stage: str) -> int:
    return config.motion.warm_up_steps if stage == "warm_up" else getattr(config, stage).steps


def _runs_with(others: Path, stage: str, name: str) -> Iterator[Path]:
    for path in sorted(others.glob(f"*/{NAMES}")):
        if read_json(path).get(stage) == name:
            yield path.parent


def _take(stage: str, steps: int, other: Path, run: Path, config: Config) -> None:
    """Link one finished stage; its description then names the new run's configuration."""
    target = run / FOLDER / stage / str(steps)
    with replaced(target) as (taken,):
        shutil.copytree(other / FOLDER / stage / str(steps), taken, copy_function=link_or_copy)
        described = read_json(taken / "metadata.json")
        described["metadata"] |= {"config": to_dict(config), "config_hash": content_hash(config)}
        write_json(taken / "metadata.json", described)  # replaces the link, the other run keeps its own
        seal(taken)
        if stage == "generative" and (other / "cache" / CODES).is_file():
            (run / "cache").mkdir(exist_ok=True)
            _link(other / "cache" / CODES, run / "cache" / CODES)
        # the log first: a stage that is there has its lines
        kept = [entry for entry in read_log(run) if entry["stage"] != stage]
        lines = [json.dumps(entry) + "\n" for entry in [*kept, *read_log(other, stage=stage)]]
        write_text(run / FILE_NAME, "".join(lines))


def _link(source: Path, target: Path) -> None:
    if not target.exists():
        link_or_copy(source, target)
