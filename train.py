"""Train a garment animator: `python train.py CONFIG.toml [--data DIR] [--run-dir DIR] [--stage STAGE]`."""

from garment_jax.__main__ import begin


def main() -> int:
    """Parse, train, and say where the run is; exit code 2 after a refusal."""
    from garment_jax.cli import script, train  # `begin` first: see there

    return script(train)


if __name__ == "__main__":
    begin("train")
