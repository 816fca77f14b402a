"""From files to files: clips are simulated, models trained on them, measured, written for other programs."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from garment_jax.api.arguments import (
    a_flag,
    a_function,
    a_number,
    a_path,
    a_path_or,
    a_text,
    an_integer,
    optional,
    some_names,
    some_paths,
    some_settings,
    takes,
)
from garment_jax.api.loaded import LoadedModel, load
from garment_jax.config import Config, apply_overrides, load_config

if TYPE_CHECKING:
    import numpy as np

    from garment_jax.simulation.clips import Job
    from garment_jax.structs import Scene

Paths = str | Path | Sequence[str | Path]


@takes(
    garment=a_path_or(LoadedModel),
    motions=optional(some_paths),
    out=a_path,
    body=optional(a_path),
    collider=optional(a_path),
    pins=a_path,
    test=some_names,
    cloth=some_settings,
    vertices=an_integer,
    frames=an_integer,
    workers=an_integer,
    device=a_text,
    say=a_function,
)
def simulate(
    garment: "LoadedModel | str | Path",
    motions: Paths | None,
    out: str | Path,
    *,
    body: str | Path | None = None,
    collider: str | Path | None = None,
    pins: str = "top",
    test: Sequence[str] = (),
    cloth: Mapping[str, Any] = {},
    vertices: int = 900,
    frames: int = 900,
    workers: int = 1,
    device: str = "cpu",
    say: Callable[[str], None] = lambda line: None,
) -> list[Path]:
    """Simulate clips to train on or to measure with, into `out/train` and `out/test`; return their files.

    `garment`: a model, whose garment and body it takes; or an OBJ file, with a rigged `body` (.npz, .glb,
    SMPL), perhaps a closed part of it that the cloth touches (`collider`) and `pins` (top, none,
    above:HEIGHT, group:NAME or .npz); or one of the package's own on its mannequin: skirt, circle_skirt,
    dress, cape, of about so many `vertices`. `motions`: files or folders of them; None is the model's sample,
    or for the package's own garments so many `frames` of the package's own motions. Names in `test` are for
    testing. `cloth`: settings such as `{"bend": 3e-4}`. `workers` processes, or `device="cuda"`. A clip that
    is there already is kept. `say` gets a line for every clip. Needs the extra `sim`. Raises `ValueError` or
    `OSError` in one sentence.

        clips = gj.simulate("skirt", None, "data/made", frames=900)
    """
    from garment_jax.simulation.clips import simulate_clips
    from garment_jax.simulation.command import cloth_settings

    words = [f"{key}={_word(value)}" for key, value in cloth.items()]
    settings = cloth_settings([*_usual(garment, body), *words])
    scene, flat = _dressed(garment, body, collider, pins, vertices)
    jobs = _jobs(garment, scene, _listed(motions), test, settings.fps, frames)
    outcomes = simulate_clips(
        scene, jobs, Path(out), settings, flat=flat, workers=workers, device=device, progress=say
    )
    faults = [f"{outcome.job} ({'; '.join(outcome.faults)})" for outcome in outcomes if outcome.path is None]
    if faults:
        raise ValueError(f"{out}: left out: {', '.join(faults)}.")
    return [outcome.path for outcome in outcomes if outcome.path is not None]


@takes(
    config=a_path_or(Config),
    data=optional(a_path),
    out=optional(a_path),
    stage=a_text,
    settings=some_settings,
)
def train(
    config: Config | str | Path,
    data: str | Path | None = None,
    out: str | Path | None = None,
    *,
    stage: str = "all",
    settings: Mapping[str, Any] = {},
) -> LoadedModel:
    """Train on the clips of the folder `data` in the run folder `out`, and return the model, ready for use.

    `config`: a TOML file such as configs/skirt.toml; `settings` are keys of it with their values, such as
    `{"motion.steps": 500}`. `data` and `out` default to the configuration's `data.dir` and to runs/NAME.
    `stage`: all, generative, motion, detail or column_rnn. Stopped at any point, the same call goes on. As
    `train.py`. Raises `ValueError` or `OSError` in one sentence.

        model = gj.train("configs/skirt.toml", "data/mine", "runs/mine")
    """
    from garment_jax.training.pipeline import train as train_stages

    read = config if isinstance(config, Config) else load_config(config)
    words = [word for key, value in settings.items() for word in ("--" + key, _word(value))]
    read = apply_overrides(read, words)
    if out is None:
        if isinstance(config, Config):
            raise ValueError("out is missing; name the folder of the run.")
        out = Path("runs") / Path(config).stem
    return load(train_stages(read, out, data_dir=data or read.data.dir, stage=stage))


@takes(predicted=a_path_or(LoadedModel), truth=a_path, every=an_integer, again=optional(a_path))
def evaluate(
    predicted: "LoadedModel | str | Path",
    truth: str | Path,
    *,
    every: int = 1,
    again: str | Path | None = None,
) -> dict[str, Any]:
    """Return the metrics of a predicted clip against the simulated one, both sequence files.

    A model in the place of a prediction is animated on the truth's motion first. Keys: `metrics` (one number
    each: `rmse_cm`, `hausdorff_cm`, ...), `per_frame`, `per_sampled_frame` (slow ones, on every `every`-th
    frame), `frames`, `fps`; units are in the names (docs/metrics.md). `again`: a second simulation of the
    truth's motion, which says until when the cloth is determined. Raises `ValueError` or `OSError` in one
    sentence.

        gj.evaluate(model, "jump.h5")["metrics"]["rmse_cm"]
    """
    import tempfile

    from garment_jax.api.animating import animate
    from garment_jax.evaluation.command import evaluate_files

    if not isinstance(predicted, LoadedModel):
        return evaluate_files(predicted, truth, every=every, again=again)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "predicted.h5"
        animate(predicted, truth, out=made)
        figures = evaluate_files(made, truth, every=every, again=again)
        return figures | {"prediction": predicted.name}


@takes(
    source=a_path_or(LoadedModel),
    out=a_path,
    format=optional(a_text),
    unit=a_text,
    up=a_text,
    fps=optional(a_number),
    start=an_integer,
    stop=optional(an_integer),
    frame_offset=an_integer,
    every=an_integer,
    body=a_flag,
    detail=a_flag,
    clip=optional(a_path),
    blender=optional(a_path),
    force=a_flag,
)
def export(source: "LoadedModel | str | Path", out: str | Path, **options: Any) -> list[Path]:
    """Write a sequence file for other programs, or a model as ONNX graphs; return the files.

    The ending of `out` says the format: .usdc .usd .usda .usdz .glb .pc2 .mdd .npz .abc, or .onnx for a
    model; with `format="obj"` it is a folder, one OBJ a frame. `options` of clips: `unit` (m, cm, mm), `up`
    (Y, Z), `fps`, `start`, `stop`, `body`, `every` (glb), `frame_offset`, `blender` (abc); of models:
    `detail`. Raises `ValueError` or `OSError` in one sentence.

        gj.export("walk.h5", "walk.usdc", unit="cm", up="Z")
        gj.export(model, "step.onnx")
    """
    if isinstance(source, LoadedModel):
        from garment_jax.exporters.onnx_step import export_step

        return [Path(file) for file in export_step(source.opened.path, out, **options)["files"]]
    from garment_jax.exporters.command import export_file

    return export_file(source, out, **options).files


def _word(value: Any) -> str:
    """Return a setting as it is written on a command line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return ",".join(map(str, value)) if isinstance(value, tuple | list) else str(value)


def _listed(motions: Paths | None) -> list[Path] | None:
    if motions is None:
        return None
    return [Path(motions)] if isinstance(motions, str | Path) else [Path(path) for path in motions]


def _usual(garment: "LoadedModel | str | Path", body: str | Path | None) -> list[str]:
    """Return the settings that one of the package's own garments is simulated with."""
    from garment_jax.simulation.command import EMBEDDED_CLOTH

    return EMBEDDED_CLOTH.get(str(garment), []) if _is_embedded(garment, body) else []


def _is_embedded(garment: "LoadedModel | str | Path", body: str | Path | None) -> bool:
    return not isinstance(garment, LoadedModel) and body is None and Path(garment).suffix == ""


def _dressed(
    garment: "LoadedModel | str | Path",
    body: str | Path | None,
    collider: str | Path | None,
    pins: str,
    vertices: int,
) -> "tuple[Scene, np.ndarray | None]":
    """Return the scene to simulate, and its garment's flat pattern where that is known."""
    from garment_jax.importers.own_files import Wardrobe
    from garment_jax.importers.sources import Options
    from garment_jax.procedural.made import check_count
    from garment_jax.procedural.scene import make_outfit
    from garment_jax.simulation.command import check_collider, check_rest_shape

    if isinstance(garment, LoadedModel):
        return garment.scene, None
    if _is_embedded(garment, body):
        check_count(vertices)
        return make_outfit(str(garment), vertices=vertices)
    if body is None:
        raise ValueError(f"{garment} needs a body; name a rigged one: body=...")
    solid = None if collider is None else Path(collider)
    options = Options(garment=Path(garment), body=Path(body), collider=solid, pins=pins)
    scene = Wardrobe(options).dressed().scene
    check_rest_shape(scene.garment, None, Path(garment))
    if scene.collider is not None and solid is not None:
        check_collider(scene.collider, solid)
    return scene, None


def _jobs(
    garment: "LoadedModel | str | Path",
    scene: "Scene",
    motions: list[Path] | None,
    test: Sequence[str],
    fps: float,
    frames: int,
) -> "list[Job]":
    """Return the clips to simulate: of files, of a model's sample, or of the package's own motions."""
    from garment_jax.simulation.clips import Job
    from garment_jax.simulation.command import embedded_jobs, motion_jobs

    if motions is not None:
        return motion_jobs(motions, scene.body, fps=fps, test=test, say=lambda line: None)
    if isinstance(garment, LoadedModel):
        return [Job(garment.name, "test" if garment.name in test else "train", garment.motion)]
    if Path(garment).suffix:
        raise ValueError(f"{garment} needs motions; name files or folders of them.")
    return embedded_jobs(scene.body, frames=frames, fps=fps, seed=0)
