"""`garment-jax collide`: push a finished sequence's garment out of the body."""

import argparse
from pathlib import Path

from garment_jax.cli.next_step import say_next
from garment_jax.cli.parser import add_command, add_force

EXAMPLES = """  garment-jax collide mine.h5 --out better.h5
  garment-jax collide mine.h5 --eps 2 --whole-body"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "collide",
        does="push a finished sequence's garment out of the body",
        examples=EXAMPLES,
    )
    parser.add_argument("sequence", type=Path, help="sequence file, predicted or any other")
    parser.add_argument(
        "--out", type=Path, help="sequence file to write (default: SEQUENCE's name + _collided.h5, here)"
    )
    add_force(parser)
    parser.add_argument(
        "--body", type=Path, help="take the body of another sequence file, or a rigged body (.npz)"
    )
    parser.add_argument("--whole-body", action="store_true", help="all of the body, not its collider")
    parser.add_argument(
        "--eps",
        type=float,
        metavar="MM",
        help="distance to keep, millimetres, such as 4; default: as when animating",
    )
    parser.add_argument("--iterations", type=int, help="gradient steps a frame at most (default 20)")
    parser.add_argument("--no-limbs", action="store_true", help="leave cloth that a limb has passed through")
    parser.add_argument("--untangle", action="store_true", help="undo crossings of the garment with itself")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.io.overwrite_checks import check_sequence_name
    from garment_jax.model.shipped import check_clips

    out = options.out or Path(f"{options.sequence.stem}_collided.h5")
    check_clips(options.sequence)
    check_sequence_name(out)  # before seconds of imports
    from garment_jax.animation.collide import collide_file, summary
    from garment_jax.aot_cache import warm_start

    settings = {} if options.eps is None else {"eps": options.eps / 1000.0}
    settings |= {} if options.iterations is None else {"iterations": options.iterations}
    settings |= {"limbs": False} if options.no_limbs else {}
    report = collide_file(
        options.sequence,
        out,
        body=options.body,
        whole_body=options.whole_body,
        untangle=options.untangle,
        force=options.force,
        store=warm_start().store,
        **settings,
    )
    first, *further = summary(report)
    print("\n".join([f"{out}: {first}", *further]))
    say_next("view", options.sequence, out, why="before and after, side by side")
