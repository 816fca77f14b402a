"""`garment-jax infer`, and the work of `infer.py`: a sequence file's motion becomes a predicted one."""

import argparse
import sys
from pathlib import Path

from garment_jax.cli.infer import add_options, infer, wanted
from garment_jax.cli.next_step import say_next
from garment_jax.cli.parser import Parser, add_command, add_force

DESCRIPTION = (
    "Takes a motion that is a sequence file of the model's garment already, and writes "
    "one; `animate` reads motions of other programs and writes files for them."
)
EXAMPLES = """  garment-jax infer runs/mine data/mine/test/jump.h5 --out pred/jump.h5
  garment-jax infer models/skirt walk.h5 --plan     what a frame costs here; nothing is written"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    add_arguments(
        add_command(
            commands,
            "infer",
            does="predict a sequence file's garment, as evaluate and render read it",
            examples=EXAMPLES,
            description=DESCRIPTION,
        )
    )


def add_arguments(parser: Parser) -> None:
    """Add what the command and `infer.py` take."""
    parser.add_argument("model", help="a run of train.py, a saved model, or a shipped one by name: skirt")
    parser.add_argument("clip", nargs="?", metavar="MOTION", help="sequence file with the body's motion")
    parser.add_argument("--motion", help="the same, as an option")
    parser.add_argument("--out", help="sequence file to write (default: MOTION's name + _pred.h5, here)")
    add_force(parser)
    add_options(parser)
    parser.set_defaults(begins="", run=run, stopped="interrupted; nothing was written")


def run(options: argparse.Namespace) -> None:
    """Predict, and print what it took."""
    motion = options.clip or options.motion
    if motion is None or (options.clip and options.motion):
        raise ValueError("infer takes one motion: name a sequence file, as in infer skirt walk.h5.")
    out = options.out or (None if options.plan else f"{Path(motion).stem}_pred.h5")
    asked = wanted(options)
    into = "" if out is None else f" -> {out}"
    print(f"infer: {options.model} on {motion}{into}", file=sys.stderr, flush=True)
    for line in infer(model=options.model, motion=motion, out=out, force=options.force, **asked._asdict()):
        print(line, flush=True)
    if out is not None:
        from garment_jax.io.content_hash import stored_attribute

        if stored_attribute(Path(motion), "kind") == "simulated":
            say_next("evaluate", Path(out), Path(motion), why="how far it is from the simulation")
        else:
            say_next("view", Path(out))
