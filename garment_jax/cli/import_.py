"""`garment-jax import`: packed clips become sequence files."""

import argparse
from functools import partial
from pathlib import Path


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = commands.add_parser("import", help="turn packed clips into sequence files")
    parser.add_argument("paths", nargs="+", type=Path, help="packed clips (.h5) or folders of them")
    parser.add_argument("--out", required=True, type=Path, help="folder for OUT/<split>/<name>.h5")
    parser.add_argument("--body", type=Path, help="rigged body (.npz); default: what the clips name")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.data.importer import import_clips

    show = partial(print, flush=True)
    clips = import_clips(options.paths, options.out, body=options.body, progress=show)
    new = sum(not clip.skipped for clip in clips)
    frames = sum(clip.frames for clip in clips)
    print(f"{options.out}: {len(clips)} clips, {frames} frames, {new} of them imported now")
