"""`garment-jax evaluate`: measure predictions against the truth."""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from garment_jax.cli.farm_options import add_farm_options, farm_of, shard_of
from garment_jax.cli.next_step import say_next
from garment_jax.cli.pairs import LeftOut, pair_files
from garment_jax.cli.parser import add_command, add_force

EXAMPLES = """  garment-jax evaluate pred.h5 truth.h5
  garment-jax evaluate pred/ data/test --every 10 --out figures.json
  garment-jax evaluate pred/ data/test --again data/again --curves curves.png"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "evaluate",
        does="measure predictions against the truth",
        examples=EXAMPLES,
    )
    parser.add_argument("pred", type=Path, help="predicted sequence file, or a folder of them")
    parser.add_argument("truth", type=Path, help="simulated sequence file, or a folder with the same names")
    parser.add_argument(
        "--again",
        type=Path,
        metavar="FILE",
        help="a second simulation of the truth's motion, or a folder of them: error while the two are alike, "
        "and afterwards as a multiple of their distance (garment-jax floor makes one)",
    )
    parser.add_argument("--every", type=int, default=1, help="slow metrics on every N-th frame (default 1)")
    parser.add_argument("--json", action="store_true", help="machine-readable, with the values per frame")
    parser.add_argument("--out", type=Path, help="also save the JSON there")
    parser.add_argument(
        "--curves", type=Path, metavar="PNG", help="also draw the error over time, with --again beside it"
    )
    add_force(parser)
    parser.add_argument(
        "--whole-body", action="store_true", help="show the penetration of the arms and the head, too"
    )
    add_farm_options(parser.add_argument_group("many clips"))
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.model.shipped import check_clips

    check_clips(options.pred, options.truth)
    from garment_jax.evaluation.many_pairs import Pair, evaluate_many  # seconds of imports
    from garment_jax.evaluation.table import format_table
    from garment_jax.storage.whole import written_whole

    pairs = pair_files(options.pred, options.truth)
    seconds = {} if options.again is None else dict(pair_files(options.pred, options.again))
    read = [*seconds.values(), *(path for pair in pairs for path in pair)]
    if options.out is not None:
        check_out(options.out, ".json", read, options.force)
    if options.curves is not None:
        check_out(options.curves, ".png", read, options.force, option="--curves")
    shard = shard_of(options)
    pairs = pairs if shard is None else shard.of(pairs)
    asked = [Pair(pred, truth, seconds.get(pred)) for pred, truth in pairs]
    if shard is not None:
        print(f"shard {shard}: {len(asked)} clips", file=sys.stderr, flush=True)
        if not asked:
            return
    left_out, found = LeftOut(len(pairs)), {}
    with farm_of(options) as farm:
        for i, outcome in evaluate_many(asked, farm, every=options.every):
            if outcome.error:
                left_out.note(asked[i].pred, outcome.error)
                continue
            found[i] = outcome.value
            if not farm.here(len(asked)):
                print(f"{asked[i].pred.stem}: {len(found)}/{len(asked)} clips", file=sys.stderr, flush=True)
    figures = [found[i] for i in sorted(found)]
    if not figures:
        left_out.check()
    text = json.dumps(figures if options.pred.is_dir() else figures[0])
    if options.out is not None:  # first: who reads what is printed may leave early
        with written_whole(options.out) as (temporary,):
            temporary.write_text(text + "\n", encoding="utf-8")
    if options.curves is not None:
        from garment_jax.evaluation.error_curve import save_curves  # matplotlib: where something is drawn

        save_curves(options.curves, figures)
    print(text if options.json else format_table(figures, whole_body=options.whole_body), flush=True)
    left_out.check()
    if not options.json:
        say_next("render", options.pred, options.truth, why="pictures of where the error is")


def check_out(out: Path, suffix: str, read: Sequence[Path], force: bool, *, option: str = "--out") -> None:
    """Check where something is to be written, before anything is measured.

    Raises `ValueError` for a folder, a file among those that are `read`, a name that does not end in `suffix`
    or is too long, and one that is there, without `force`.
    """
    from garment_jax.io.overwrite_checks import check_name
    from garment_jax.storage.overwriting import check_free

    if os.path.isdir(out):
        raise ValueError(f"{option} {out} is a folder; name a file.")
    if out.resolve() in {path.resolve() for path in read}:
        raise ValueError(f"{option} {out} is what is read; write to another file.")
    check_name(out)
    if out.suffix != suffix:
        raise ValueError(f"{option} {out} does not end in {suffix}; name such a file: {out.name}{suffix}.")
    check_free(out, force)
