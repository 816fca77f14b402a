"""Train a garment animator: `python train.py CONFIG.toml [--data DIR] [--run-dir DIR] [--stage STAGE]`."""

import argparse
import sys

from garment_jax.config import apply_overrides, load_config


def main() -> int:
    """Parse, train, and say where the run is; exit code 2 after a refusal."""
    parser = argparse.ArgumentParser(
        description="Train a garment animator. Interrupted at any point, the same command goes on.",
        epilog="Any configuration key: --SECTION.KEY VALUE, for example --motion.steps 500.",
    )
    parser.add_argument("config", help="experiment, e.g. configs/skirt.toml")
    parser.add_argument("--data", help="folder of imported clips (default: data.dir of the configuration)")
    parser.add_argument("--run-dir", help="folder for checkpoints and logs (default: runs/NAME)")
    parser.add_argument("--stage", default="all", help="all, generative, motion, detail or column_rnn")
    parser.add_argument("--tensorboard", action="store_true", help="also log for TensorBoard (extra)")
    options, overrides = parser.parse_known_args()
    try:
        config = apply_overrides(load_config(options.config), overrides)
        from garment_jax.training.pipeline import train  # loads JAX: only once the input is sound

        name = options.config.rsplit("/", 1)[-1].removesuffix(".toml")
        folder = train(
            config,
            options.run_dir or f"runs/{name}",
            data_dir=options.data or config.data.dir,
            stage=options.stage,
            tensorboard=options.tensorboard,
        )
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:  # between the stages, which save before they end
        print("interrupted; the same command goes on", file=sys.stderr)
        return 130
    print(f"trained: {folder}")
    return 0


if __name__ == "__main__":
    from garment_jax.cli.exit import leave
    from garment_jax.cli.printable import show_safely

    show_safely()
    leave(main())
