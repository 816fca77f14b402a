"""Animate a garment: `python infer.py RUN_OR_MODEL --motion CLIP.h5 --out pred.h5`."""

from garment_jax.__main__ import begin


def main() -> int:
    """Parse, animate, and print what it took; exit code 2 after a refusal."""
    from garment_jax.cli import infer_command, script  # `begin` first: see there

    return script(infer_command)


if __name__ == "__main__":
    begin("infer_command")
