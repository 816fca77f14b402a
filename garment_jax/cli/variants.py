"""`garment-jax variants`: measure what `infer.py --budget-ms` and `--lod` choose from."""

import argparse
from functools import partial
from pathlib import Path

from garment_jax.cli.next_step import say_next
from garment_jax.cli.parser import add_command

EXAMPLES = """  garment-jax variants models/mine --validation data/mine/train/walk.h5 --errors
  garment-jax variants models/mine --validation data/mine/train/walk.h5 --times"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "variants",
        does="measure a saved model's cheaper variants, for infer.py --budget-ms",
        examples=EXAMPLES,
    )
    parser.add_argument(
        "model",
        type=Path,
        metavar="MODEL",
        help="saved model, or a shipped one by name; its variants.json is written",
    )
    parser.add_argument("--validation", nargs="+", type=Path, required=True, help="clips that choose")
    parser.add_argument("--test", nargs="*", type=Path, default=[], help="clips that are only reported")
    parser.add_argument("--errors", action="store_true", help="errors of whole rollouts, at any time")
    parser.add_argument("--times", action="store_true", help="milliseconds a frame, on an idle machine")
    parser.add_argument("--frames", type=int, default=0, help="of each clip (default all)")
    parser.add_argument("--every", type=int, default=10, help="depths on every N-th frame (default 10)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.model.shipped import find_model

    folder = find_model(options.model)
    if options.every < 1 or options.frames < 0:
        raise ValueError(
            f"--every {options.every} and --frames {options.frames}: give 1 or more, and 0 (all) or more."
        )
    from garment_jax.bench.variants import measure_variants  # seconds of imports

    path = measure_variants(
        folder,
        options.validation,
        options.test,
        errors=options.errors,
        times=options.times,
        frames=options.frames,
        every=options.every,
        show=partial(print, flush=True),
    )
    print(f"measured: {path}")
    say_next("infer", options.model, options.validation[0], "--plan", why="what a frame costs here")
