"""`garment-jax floor`: how far two simulations of the same frames differ."""

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from garment_jax.cli.next_step import say_next
from garment_jax.cli.parser import add_command, add_force

if TYPE_CHECKING:
    import numpy as np

    from garment_jax.simulation.settings import ClothSettings

PER_FRAME = "rmse_cm_per_frame"

EXAMPLES = """  garment-jax floor data/mine/test/jump.h5 --start 100 --frames 60
  garment-jax floor data/mine/test/jump.h5 --start 0 --cloth settle=60 --out again.h5  # evaluate --again"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "floor",
        does="how far two simulations of the same frames differ",
        examples=EXAMPLES,
    )
    parser.add_argument("clips", type=Path, nargs="+", metavar="clip", help="simulated sequence file")
    parser.add_argument("--start", type=int, default=100, help="frame of the restart (default 100)")
    parser.add_argument("--frames", type=int, help="how many to simulate (default: to the end)")
    parser.add_argument(
        "--own-start",
        action="store_true",
        help="begin with the clip's own cloth and its speed: are the settings the clip's?",
    )
    parser.add_argument("--cloth", nargs="*", default=[], metavar="KEY=VALUE", help="as the clip's own")
    parser.add_argument("--pattern", type=Path, help="flat pattern in metres, as the clip's own")
    parser.add_argument("--out", type=Path, help="also write one clip's second simulation, a sequence file")
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="a list with the values per frame")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.io.overwrite_checks import check_sequence_name
    from garment_jax.simulation.command import cloth_settings, read_pattern
    from garment_jax.storage.overwriting import check_free

    if options.out is not None and len(options.clips) > 1:
        raise ValueError(f"--out {options.out} holds one clip, and {len(options.clips)} are given; name one.")
    if options.out is not None:
        if options.out.resolve() == options.clips[0].resolve():
            raise ValueError(f"--out {options.out} is the clip itself; write to another file.")
        check_sequence_name(options.out)
        check_free(options.out, options.force)
    settings = cloth_settings(options.cloth)
    flat = None if options.pattern is None else read_pattern(options.pattern)
    found, left_out = [], []
    for path in options.clips:
        try:
            figures = _restarted(path, options, settings, flat)
        except (ValueError, OSError) as error:
            if len(options.clips) == 1:
                raise
            left_out.append(str(path))
            print(f"left out: {error}", file=sys.stderr, flush=True)  # stdout is the list of --json
            continue
        found.append(figures)
        if not options.json:
            print("\n".join(f"{k:<20} {v}" for k, v in figures.items() if k != PER_FRAME))
    if options.json:
        print(json.dumps(found))
    if left_out:
        raise ValueError(f"left out: {', '.join(left_out)}; the reasons are above.")
    if options.out is not None and not options.json:
        say_next("view", options.out, options.clips[0], why="both simulations, and how far they differ")


def _restarted(
    path: Path, options: argparse.Namespace, settings: "ClothSettings", flat: "np.ndarray | None"
) -> dict[str, Any]:
    """Return the figures of one clip, those per frame under `PER_FRAME`; write its restart where asked."""
    import numpy as np

    from garment_jax.io.overwrite_checks import RESTARTED
    from garment_jax.io.sequence import open_sequence
    from garment_jax.io.sequence_writer import INT16_REACH, SequenceWriter
    from garment_jax.io.validation import check_input, check_simulated, measure_extent
    from garment_jax.simulation.clips import ENGINE
    from garment_jax.simulation.command import check_same_cloth
    from garment_jax.simulation.floor import floor_of, summary
    from garment_jax.simulation.settings import BEFORE

    with open_sequence(path) as clip:
        check_simulated(clip)
        check_input(clip)
        measure_extent(clip)  # frames that are not finite
        asked = {pair.partition("=")[0] for pair in options.cloth}
        check_same_cloth(clip, settings, free=asked & set(BEFORE))  # another start that is asked for
        floor = floor_of(
            clip,
            settings,
            start=options.start,
            frames=options.frames,
            flat=flat,
            own_start=options.own_start,
        )
        if options.out is not None:
            far = np.abs(floor.V - floor.motion.root[:, None]).max() > INT16_REACH
            attributes = {
                "kind": "simulated",
                "name": clip.name,
                "engine": ENGINE,
                "settings": settings.describe(),
                RESTARTED: options.start,
            }
            with SequenceWriter(
                options.out,
                clip.scene,
                floor.motion,
                encoding="float32" if far else "int16",
                attributes=attributes,
            ) as writer:
                writer.append(floor.V)
    return summary(floor) | {PER_FRAME: [round(float(e), 4) for e in floor.rmse_cm]}
