"""`garment-jax view`: a page that plays sequence files in a browser."""

import argparse
from collections.abc import Callable
from pathlib import Path

from garment_jax.cli.next_step import say_step
from garment_jax.cli.parser import add_command, add_force
from garment_jax.progress import FrameProgress

EXAMPLES = """  garment-jax view pred.h5 truth.h5 --out page.html    both, and the error in colours
  garment-jax view walk.h5                              walk.html"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "view",
        does="make a web page that plays sequence files",
        examples=EXAMPLES,
    )
    parser.add_argument("paths", nargs="+", type=Path, help="sequence files of one garment on one motion")
    parser.add_argument("--out", type=Path, help="the page, one HTML file (default: the first file's name)")
    add_force(parser)
    parser.add_argument(
        "--truth", type=Path, help="which file errors are measured against (default: the last simulated one)"
    )
    parser.add_argument(
        "--penetration",
        action="store_true",
        help="mark vertices inside the body and where cloth crosses itself (slow)",
    )
    parser.add_argument("--no-body", action="store_true", help="leave the body out")
    parser.add_argument("--start", type=int, default=0, help="first frame (default 0)")
    parser.add_argument("--stop", type=int, help="end before this frame (default: the end)")
    parser.add_argument("--every", type=int, default=1, help="every N-th frame only (default 1)")
    parser.add_argument("--scale-cm", type=float, help="error at the end of the colours (default: fits)")
    parser.add_argument("--title", help="the page's title (default: the clip's name)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.model.shipped import check_clips
    from garment_jax.viewer.command import view_files

    check_clips(*options.paths)

    out = options.out or Path(f"{options.paths[0].stem}.html")
    names = ("truth", "title", "penetration", "start", "stop", "every", "scale_cm", "force")
    settings = {name: getattr(options, name) for name in names}
    written = view_files(options.paths, out, body=not options.no_body, report=_report(), **settings)
    for note in written.notes:
        print(note)
    print(f"{written.path}  {written.bytes / 1e6:.1f} MB")
    say_step(f"open {written.path} in a browser")


def _report() -> Callable[[str, int, int], None]:
    """Return what shows the frames of each part of the work."""
    parts: dict[str, FrameProgress] = {}

    def line(what: str, done: int, of: int) -> None:
        if what in parts:
            parts[what](done, of)
        else:
            parts[what] = FrameProgress(what)
            parts[what].begin(done)
        if done == of:
            parts[what].clear()

    return line
