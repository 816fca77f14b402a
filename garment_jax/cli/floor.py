"""`garment-jax floor`: how far two simulations of the same frames differ."""

import argparse
import json
from pathlib import Path


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = commands.add_parser("floor", help="how far two simulations of the same frames differ")
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
    parser.add_argument(
        "--json", action="store_true", help="a list with the values per frame, as `benchmark` reads it"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    import numpy as np

    from garment_jax.data.replaceable import RESTARTED, check_floor_out
    from garment_jax.data.sequence import open_sequence
    from garment_jax.data.sequence_writer import INT16_REACH, SequenceWriter
    from garment_jax.data.validation import check_input, check_simulated, measure_extent
    from garment_jax.simulation.clips import ENGINE
    from garment_jax.simulation.command import check_same_cloth, cloth_settings, read_pattern
    from garment_jax.simulation.floor import floor_of, summary

    if options.out is not None and len(options.clips) > 1:
        raise ValueError(f"--out {options.out} holds one clip, and {len(options.clips)} are given; name one.")
    if options.out is not None:
        if options.out.resolve() == options.clips[0].resolve():
            raise ValueError(f"--out {options.out} is the clip itself; write to another file.")
        check_floor_out(options.out)
    settings = cloth_settings(options.cloth)
    flat = None if options.pattern is None else read_pattern(options.pattern)
    found = []
    for path in options.clips:
        with open_sequence(path) as clip:
            check_simulated(clip)
            check_input(clip)
            measure_extent(clip)  # frames that are not finite
            check_same_cloth(clip, settings)
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
                encoding = "float32" if far else "int16"
                attributes = {
                    "kind": "simulated",
                    "name": clip.name,
                    "engine": ENGINE,
                    "settings": settings.describe(),
                    RESTARTED: options.start,
                }
                with SequenceWriter(
                    options.out, clip.scene, floor.motion, encoding=encoding, attributes=attributes
                ) as writer:
                    writer.append(floor.V)
        figures = summary(floor)
        found.append(figures | {"rmse_cm_per_frame": [round(float(e), 4) for e in floor.rmse_cm]})
        if not options.json:
            print("\n".join(f"{key:<20} {value}" for key, value in figures.items()))
    if options.json:
        print(json.dumps(found))
