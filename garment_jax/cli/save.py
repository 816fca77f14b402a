"""`garment-jax save`: a run becomes a model to ship."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from garment_jax.cli.next_step import say_next
from garment_jax.cli.parser import add_command, add_force

if TYPE_CHECKING:
    from garment_jax.model.scene_file import Sample
    from garment_jax.model.store import Model

EXAMPLES = """  garment-jax save runs/mine --out models/mine
  garment-jax save runs/mine runs/other --out models/mean    the mean of their parameters"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "save",
        does="save a run's newest parameters as a model to ship",
        examples=EXAMPLES,
    )
    parser.add_argument(
        "runs",
        type=Path,
        nargs="+",
        metavar="RUN",
        help="folder that train.py wrote, or a model; of several the mean is saved",
    )
    parser.add_argument("--out", type=Path, help="folder of the model (default: models/ and the run's name)")
    add_force(parser)
    parser.add_argument("--bits", type=int, choices=(16, 32), default=16, help="of each parameter")
    parser.add_argument(
        "--scene",
        type=Path,
        metavar="CLIP",
        help="sequence file whose garment, body, pins, collider and first ten seconds of motion come along "
        "(default: the run's own)",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.evaluation.portrait import template_portrait
    from garment_jax.model.folder import MEASURED, check_no_model
    from garment_jax.model.mean_model import mean_model
    from garment_jax.model.shipped import find_model
    from garment_jax.model.store import save_model
    from garment_jax.training.pipeline import trained_model

    names = list(map(str, options.runs))
    options.runs = [find_model(run) for run in options.runs]
    if options.out is None:
        options.out = Path("models") / options.runs[0].resolve().name
    check_no_model(options.out, options.force)
    measured = [name for name in MEASURED if (options.out / name).is_file()]
    model = mean_model([trained_model(run) for run in options.runs], names)
    sample = _sample(options.scene, options.runs, model)
    picture = None if sample is None else template_portrait(sample.scene)
    folder = save_model(
        model, options.out, bits=options.bits, sample=sample, picture=picture, source=" and ".join(names)
    )
    size = sum(path.stat().st_size for path in folder.iterdir() if path.is_file()) / 1e6
    print(f"{folder}: {size:.1f} MB, {options.bits} bits")
    if measured:
        print(f"removed {' and '.join(measured)}, which belonged to the model replaced; measure again")
    if sample is None:
        print(
            "its garment and body did not come along, for the run keeps none and its clips are not there; "
            "save it with --scene CLIP.h5 to animate it alone"
        )
    else:
        say_next("animate", folder, why="see it move")


def _sample(scene: Path | None, runs: Sequence[Path], model: "Model") -> "Sample | None":
    """Return what the model animates: of the clip that is named, of the runs, or of a run's first clip.

    The last is for runs of train.py that are older than `scene.h5`.
    """
    from garment_jax.dataset.prepared import training_clips
    from garment_jax.io.sequence import open_sequence
    from garment_jax.model.scene_file import read_sample, sample_of
    from garment_jax.model.store import garment_misfit

    if scene is not None:
        with open_sequence(scene) as clip:
            return sample_of(clip)
    for run in runs:
        if (kept := read_sample(run)) is not None:
            return kept
    data = model.config.data
    if not Path(data.dir).is_dir():
        return None
    try:
        with open_sequence(training_clips(data.dir, data.validation)[0]) as clip:
            found = sample_of(clip)
    except (ValueError, OSError):  # that folder has other clips today
        return None
    return None if garment_misfit(model, found.scene.garment) else found
