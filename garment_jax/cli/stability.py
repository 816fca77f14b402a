"""`garment-jax stability`: stiff and extreme cases on a garment and a model."""

import argparse
from functools import partial
from pathlib import Path

from garment_jax.cli.choices import GARMENTS
from garment_jax.cli.next_step import say_next
from garment_jax.cli.parser import add_command

EXAMPLES = """  garment-jax stability models/skirt --clips data/mine/test --out runs/stability
  garment-jax stability --garment dress --only skinning"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "stability",
        does="check stiff and extreme cases on a garment and a model",
        examples=EXAMPLES,
    )
    parser.add_argument(
        "run_dir",
        nargs="?",
        type=Path,
        metavar="RUN",
        help="run or model, or a shipped one's name, for its rollouts",
    )
    parser.add_argument("--garment", choices=GARMENTS, help="an embedded garment (default skirt)")
    parser.add_argument(
        "--clips",
        nargs="+",
        type=Path,
        default=[],
        help="sequence files or folders of them",
    )
    parser.add_argument("--full", action="store_true", help="the long cases too (20 minutes and more)")
    parser.add_argument("--only", nargs="+", default=[], metavar="GROUP", help="some groups of cases")
    parser.add_argument("--out", type=Path, help="folder for stability.json and plots")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run it."""
    from garment_jax.model.shipped import find_model

    run = None if options.run_dir is None else find_model(options.run_dir)
    from garment_jax.stability.report import passed, stability  # seconds of imports

    cases = stability(
        run,
        garment=options.garment,
        clips=options.clips,
        full=options.full,
        only=options.only,
        out=options.out,
        show=partial(print, flush=True),
    )
    if not options.full:
        run_dir = [] if options.run_dir is None else [options.run_dir]
        garment = [] if options.garment is None else ["--garment", options.garment]
        clips = ["--clips", *options.clips] if options.clips else []
        say_next(
            "stability", *run_dir, *garment, *clips, "--full", why="the long cases too, 20 minutes and more"
        )
    return 0 if passed(cases) else 1
