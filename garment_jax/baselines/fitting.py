"""A baseline's run: its folder, its data and the model that it ends with."""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
import numpy as np

from garment_jax.config import Config, GenerativeConfig, to_dict
from garment_jax.io.content_hash import garment_hash
from garment_jax.model.store import Model, load_model, save_model
from garment_jax.training.run import Run, open_run

MODEL = "model"  # folder inside a run's; appears when the fit has ended


def own_config(config: Config) -> Config:
    """Return `config` with the sections of our own stages at their defaults, but for what lanes are.

    A baseline's folder must not be refused because a width of ours has changed.
    """
    lanes = ("from_first", "grace", "lane_windows", "window")
    motion = dataclasses.replace(Config().motion, **{key: getattr(config.motion, key) for key in lanes})
    return dataclasses.replace(
        Config(),
        data=config.data,
        body=config.body,
        uv=config.uv,
        motion=motion,
        baselines=config.baselines,
        simulation=config.simulation,
        training=dataclasses.replace(config.training, begin_from=""),  # which is a model of ours
        rollout=config.rollout,
    )


@contextmanager
def open_baseline(
    name: str,
    keys: tuple[str, ...],
    config: Config,
    run_dir: str | Path,
    data_dir: str | Path,
    *,
    generative: GenerativeConfig | None = None,
) -> Iterator[Run]:
    """Prepare the data (cached in the run's folder) and open or create the run of the baseline `name`.

    `keys` are beginnings of the keys of `[baselines]` that it reads: those must stay. `generative` is for a
    method that trains our first stage.
    Raises `ValueError` for a folder that belongs to another method, configuration, garment or data set.
    """
    folder, config = Path(run_dir), own_config(config)
    if generative is not None:
        config = dataclasses.replace(config, generative=generative)
    own = {k: v for k, v in to_dict(config)["baselines"].items() if k.startswith(keys)}

    run = open_run(
        config,
        folder,
        data_dir=data_dir,
        more_facts={"method": name, "baselines": own},
        unposed=generative is not None,
    )
    with run.log:
        yield run


def finish_model(run: Run, params: dict[str, Any]) -> None:
    """Write the fitted model into the run's folder; its presence says that the fit has ended."""
    params = jax.tree.map(lambda x: np.asarray(x, np.float32), params)
    garment = run.data.scene.garment
    model = Model(
        run.config, params, run.template.statistics, garment_hash(garment), len(run.template.T), run.data.fps
    )
    save_model(model, run.folder / MODEL, bits=32)


def fitted_model(run_dir: str | Path) -> Model:
    """Return the model of a folder whose fit has ended; `FileNotFoundError` for another."""
    if not (Path(run_dir) / MODEL / "model.json").is_file():
        raise FileNotFoundError(
            f"{run_dir} holds no fitted baseline yet; fit it first, the same call goes on."
        )
    return load_model(Path(run_dir) / MODEL)
