"""Animate a garment: `python infer.py RUN_OR_MODEL --motion CLIP.h5 --out pred.h5`."""

import argparse
import sys

from garment_jax.cli.infer import add_options, infer


def main() -> int:
    """Parse, animate, and print what it took; exit code 2 after a refusal."""
    parser = argparse.ArgumentParser(description="Animate a garment over a clip's motion.")
    parser.add_argument("model", help="a run of train.py, a saved model, or a shipped one by name: skirt")
    parser.add_argument("--motion", required=True, help="sequence file with the body's motion")
    parser.add_argument("--out", help="sequence file to write")
    add_options(parser)
    options = parser.parse_args()
    if not options.out and not options.plan:
        parser.error("--out is missing: name the sequence file to write, or ask for the --plan alone")
    try:
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
