"""Animate a garment: `python infer.py RUN_OR_MODEL --motion CLIP.h5 --out pred.h5`."""

from garment_jax.cli import infer_command, program, script


def main() -> int:
    """Parse, animate, and print what it took; exit code 2 after a refusal."""
    return script(infer_command)


if __name__ == "__main__":
    program(infer_command)
