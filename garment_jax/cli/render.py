"""`garment-jax render`: contact sheets, error maps and short films."""

import argparse
from pathlib import Path

from garment_jax.cli.next_step import say_next
from garment_jax.cli.pairs import LeftOut, pair_files
from garment_jax.cli.parser import add_command, add_force
from garment_jax.progress import FrameProgress

EXAMPLES = """  garment-jax render pred.h5 truth.h5 --out pictures
  garment-jax render walk.h5 --animation --seconds 4"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "render",
        does="draw contact sheets, error maps and short films",
        examples=EXAMPLES,
    )
    parser.add_argument("paths", nargs="+", type=Path, help="a file; or PRED TRUTH, files or folders")
    parser.add_argument(
        "--out", default=Path("pictures"), type=Path, help="folder for the pictures (default pictures)"
    )
    add_force(parser)
    parser.add_argument("--frames", type=int, default=6, help="columns of the contact sheet (default 6)")
    parser.add_argument("--animation", action="store_true", help="also a film, NAME.gif")
    parser.add_argument("--seconds", type=float, default=8.0, help="length of the film (default 8)")
    parser.add_argument("--start", type=int, default=0, metavar="N", help="first frame (default 0)")
    parser.add_argument("--stop", type=int, metavar="N", help="frame before which to stop (default: the end)")
    parser.add_argument("--side-view", action="store_true", help="also a sheet from the side")
    parser.add_argument(
        "--whole-body",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="head and arms too (default), or end a hand above the garment",
    )
    parser.add_argument("--scale-cm", type=float, help="error at the end of the colours (default: fits)")
    parser.add_argument("--azimuth", type=float, default=35.0, help="degrees from the body's front")
    parser.add_argument("--height", type=int, help="pixels of one picture (default 360, and 240 in the film)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.model.shipped import check_clips

    check_clips(*options.paths)
    from garment_jax.evaluation.render import render_files  # seconds of imports

    if len(options.paths) > 2:
        raise ValueError(
            f"render takes a file, or PRED TRUTH, not {len(options.paths)} paths; run it once a pair."
        )
    pairs = [options.paths] if len(options.paths) == 1 else pair_files(*options.paths)
    names = ("frames", "animation", "seconds", "start", "stop", "side_view", "whole_body", "scale_cm")
    settings = {name: getattr(options, name) for name in (*names, "azimuth", "height", "force")}
    left_out = LeftOut(len(pairs))
    for pair in pairs:
        with left_out.reading(pair[0]):
            with FrameProgress(f"{Path(pair[-1]).stem}, pictures") as progress:
                written = render_files(list(pair), options.out, **settings, progress=progress)
            for path in written:
                print(path, flush=True)
    left_out.check()
    say_next("view", *pairs[0], why="turn it and play it in the browser")
