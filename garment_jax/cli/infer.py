"""The options that `infer.py` shares with `garment-jax animate`, and its work."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from garment_jax.api.opened import Wanted, check_wanted, infer_motion, open_model


def add_options(parser: argparse._ActionsContainer) -> None:
    """Add the options that `Wanted` holds."""
    parser.add_argument("--no-column-rnn", action="store_true", help="move by latents alone")
    parser.add_argument(
        "--no-swing", dest="no_column_rnn", action="store_true", help=argparse.SUPPRESS
    )  # its name before
    parser.add_argument("--no-detail", action="store_true", help="leave out the detail module")
    parser.add_argument("--no-lengths", action="store_true", help="leave edges as the networks have them")
    parser.add_argument("--no-collision", action="store_true", help="leave out the collision solver")
    parser.add_argument("--untangle", action="store_true", help="undo crossings of the garment with itself")
    parser.add_argument(
        "--preroll",
        type=int,
        default=0,
        metavar="N",
        help="frames from the canonical pose before the first (default 0)",
    )
    parser.add_argument(
        "--plan", action="store_true", help="print what runs, what it costs here and what is left out"
    )
    parser.add_argument(
        "--budget-ms", type=float, metavar="MS", help="take the most accurate measured variant that fits"
    )
    parser.add_argument(
        "--lod", type=float, metavar="MM", help="what a pixel covers: leave out detail too fine to see"
    )


def wanted(options: argparse.Namespace) -> Wanted:
    """Return what the options of `add_options` ask for; `ValueError` for a number that means nothing."""
    asked = Wanted(**{name: getattr(options, name) for name in Wanted._fields})
    check_wanted(asked)
    return asked


def infer(*, model: str, motion: str, out: str | None, force: bool = False, **options: Any) -> Iterator[str]:
    """Yield the lines to print; `options` are those of `Wanted`. Raises as `infer_motion`."""
    from garment_jax.io.overwrite_checks import check_animation_out
    from garment_jax.storage.overwriting import check_free

    if out is not None:
        check_animation_out(Path(out), Path(motion))  # before minutes of measuring
        check_free(Path(out), force)
    asked = Wanted(**options)
    opened = open_model(model, asked)
    yield from infer_motion(opened, motion, out, asked)
