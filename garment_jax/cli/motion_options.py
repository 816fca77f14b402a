"""How motions of other programs are read: the options that `animate` and `simulate files` share."""

import argparse
from pathlib import Path


def add_motion_options(group: argparse._ActionsContainer, *, skip: int | None = 0) -> None:
    """Add the options to a parser or to a group of one; `skip` is the default, None: a rest pose."""
    group.add_argument("--joints", type=Path, help="table of joint names, .toml")
    group.add_argument("--source-fps", type=float, help="true rate, where a file lies or does not say")
    rest = "a rest pose and the jump out of it" if skip is None else str(skip)
    group.add_argument(
        "--skip", type=int, default=skip, metavar="N", help=f"first frames to drop (default: {rest})"
    )
    group.add_argument("--rest-frame", type=int, help="frame that is a T- or A-pose: the rest pose")
    group.add_argument("--motion-unit", help="m, cm, mm, in or metres per unit")
    group.add_argument("--motion-up", choices=("Y", "Z"), help="up axis")
    group.add_argument("--animation", metavar="NAME", help="the one to take of a glTF that holds several")
    group.add_argument("--motion-mesh", metavar="NAME", help="whose motion, in a glTF that holds several")
    group.add_argument("--motion-skeleton", metavar="NAME", help="root joint, or skin, of such a motion")
    group.add_argument("--keep-height", action="store_true", help="do not lift the feet to the floor")
