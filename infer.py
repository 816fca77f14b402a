"""Animate a garment: `python infer.py RUN_OR_MODEL --motion CLIP.h5 --out pred.h5`."""

import argparse
import sys


def main() -> int:
    """Parse, animate, and print what it took; exit code 2 after a refusal."""
    parser = argparse.ArgumentParser(description="Animate a garment over a clip's motion.")
    parser.add_argument("model", help="a run of train.py, or a saved model such as models/skirt")
    parser.add_argument("--motion", required=True, help="sequence file with the body's motion")
    parser.add_argument("--out", help="sequence file to write")
    parser.add_argument("--no-column-rnn", action="store_true", help="move by codes alone, the paper's way")
    parser.add_argument(
        "--no-swing", dest="no_column_rnn", action="store_true", help=argparse.SUPPRESS
    )  # as it was
    parser.add_argument("--no-detail", action="store_true", help="leave out the detail module")
    parser.add_argument("--no-lengths", action="store_true", help="leave edges as the networks have them")
    parser.add_argument("--no-collision", action="store_true", help="leave out the collision solver")
    parser.add_argument(
        "--preroll", type=int, default=0, help="frames from the canonical pose before the first"
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
    options = parser.parse_args()
    if not options.out and not options.plan:
        parser.error("--out is missing: name the sequence file to write, or ask for the --plan alone")
    try:
        from garment_jax.cli.infer import infer

        for line in infer(**vars(options)):
            print(line, flush=True)
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted; nothing was written", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    from garment_jax.cli.exit import leave
    from garment_jax.cli.printable import show_safely

    show_safely()
    leave(main())
