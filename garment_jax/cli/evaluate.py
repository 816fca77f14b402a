"""`garment-jax evaluate`: measure predictions against the truth."""

import argparse
import json
from pathlib import Path

from garment_jax.cli.pairs import pair_files


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = commands.add_parser("evaluate", help="measure predictions against the truth")
    parser.add_argument("pred", type=Path, help="predicted sequence file, or a folder of them")
    parser.add_argument("truth", type=Path, help="simulated sequence file, or a folder with the same names")
    parser.add_argument("--every", type=int, default=1, help="slow metrics on every N-th frame (default 1)")
    parser.add_argument("--json", action="store_true", help="machine-readable, with the values per frame")
    parser.add_argument("--out", type=Path, help="also save the JSON there")
    parser.add_argument(
        "--whole-body", action="store_true", help="show the penetration of the arms and the head, too"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.evaluation.command import evaluate_files
    from garment_jax.evaluation.table import format_table

    pairs = pair_files(options.pred, options.truth)
    figures = [evaluate_files(pred, truth, every=options.every) for pred, truth in pairs]
    text = json.dumps(figures if options.pred.is_dir() else figures[0])
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(text + "\n")
    print(text if options.json else format_table(figures, whole_body=options.whole_body))
