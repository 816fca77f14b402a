"""`garment-jax save`: a run becomes a model to ship."""

import argparse
from pathlib import Path


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = commands.add_parser("save", help="save a run's newest parameters as a model to ship")
    parser.add_argument(
        "runs",
        type=Path,
        nargs="+",
        metavar="RUN",
        help="folder that train.py wrote; of several, and of a model that they began from, the mean is saved",
    )
    parser.add_argument("--out", required=True, type=Path, help="folder of the model, e.g. models/skirt")
    parser.add_argument("--bits", type=int, choices=(16, 32), default=16, help="of each parameter")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.model.folder import MEASURED
    from garment_jax.model.mean_model import mean_model
    from garment_jax.model.store import save_model
    from garment_jax.training.pipeline import trained_model

    measured = [name for name in MEASURED if (options.out / name).is_file()]
    model = mean_model([trained_model(run) for run in options.runs], list(map(str, options.runs)))
    folder = save_model(model, options.out, bits=options.bits)
    size = sum(path.stat().st_size for path in folder.iterdir()) / 1e6
    print(f"{folder}: {size:.1f} MB, {options.bits} bits")
    if measured:
        print(f"removed {' and '.join(measured)}, which belonged to the model replaced; measure again")
