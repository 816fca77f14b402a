"""Animate a garment: `python infer.py RUN_OR_MODEL --motion CLIP.h5 --out pred.h5`."""

import argparse
import sys


def main() -> int:
    """Parse, animate, and print what it took; exit code 2 after a refusal."""
    parser = argparse.ArgumentParser(description="Animate a garment over a clip's motion.")
    parser.add_argument("model", help="a run of train.py, or a saved model such as models/skirt")
    parser.add_argument("--motion", required=True, help="sequence file with the body's motion")
    parser.add_argument("--out", required=True, help="sequence file to write")
    parser.add_argument("--no-detail", action="store_true", help="leave out the detail module")
    parser.add_argument("--no-collision", action="store_true", help="leave out the collision solver")
    parser.add_argument(
        "--preroll", type=int, default=0, help="frames from the canonical pose before the first"
    )
    options = parser.parse_args()
    try:
        from garment_jax.rollout.animate import animate_file
        from garment_jax.training.pipeline import trained_model

        figures = animate_file(
            trained_model(options.model),
            options.motion,
            options.out,
            detail=not options.no_detail,
            collision=not options.no_collision,
            preroll=options.preroll,
        )
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted; nothing was written", file=sys.stderr)
        return 130
    rate = figures["frames"] / figures["seconds"]
    took = f"{figures['frames']} frames in {figures['seconds']:.1f} s ({rate:.0f} frames/s, start included)"
    print(f"{options.out}: {took}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
