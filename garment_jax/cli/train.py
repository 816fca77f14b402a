"""`garment-jax train`, and the work of `train.py`: a configuration and clips become a run."""

import argparse
import sys
from contextlib import nullcontext
from pathlib import Path

from garment_jax.cli.next_step import say_next
from garment_jax.cli.parser import Parser, add_command

GOES_ON = "interrupted; the same command goes on"  # the stages save before they end
DESCRIPTION = (
    "Trains every stage of a configuration. Interrupted at any point, the same command "
    "goes on. Any key of the configuration: --SECTION.KEY VALUE (docs/configuration.md)."
)
EXAMPLES = """  garment-jax train configs/skirt.toml --data data/mine --run-dir runs/mine
  garment-jax train configs/skirt.toml --data data/mine --motion.steps 500    any key of the configuration"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    add_arguments(
        add_command(
            commands,
            "train",
            does="train a model on simulated clips",
            examples=EXAMPLES,
            description=DESCRIPTION,
        )
    )


def add_arguments(parser: Parser) -> None:
    """Add what the command and `train.py` take."""
    parser.add_argument(
        "config",
        metavar="CONFIG",
        help="a TOML file, or a name of the package: demo, skirt, skirt_small, skirt_large, paper",
    )
    parser.add_argument("--data", help="folder of imported clips (default: data.dir of the configuration)")
    parser.add_argument("--run-dir", "--out", help="folder for checkpoints and logs (default: runs/NAME)")
    parser.add_argument("--stage", default="all", help="all, generative, motion, detail or column_rnn")
    parser.add_argument(
        "--devices",
        choices=("one", "all"),
        default="one",
        help="all: this machine's, and of all processes that SLURM, Open MPI or a Kubernetes Job starts",
    )
    parser.add_argument(
        "--coordinator", metavar="HOST:PORT", default="", help="by hand: address of process 0"
    )
    parser.add_argument("--processes", metavar="N", type=int, help="by hand: how many there are")
    parser.add_argument("--process", metavar="I", type=int, help="by hand: which this is, 0 to N - 1")
    parser.add_argument("--tensorboard", action="store_true", help="also log for TensorBoard (extra)")
    parser.set_defaults(begins="", run=run, overrides=[], stopped=GOES_ON)


def run(options: argparse.Namespace) -> None:
    """Train, and say where the run is."""
    from garment_jax.config import apply_overrides, load_config

    name = options.config.rsplit("/", 1)[-1].removesuffix(".toml")
    config = apply_overrides(load_config(options.config), options.overrides)
    data, run_dir = options.data or config.data.dir, options.run_dir or f"runs/{name}"
    by_hand = options.coordinator, options.processes, options.process
    shared = options.devices == "all" or by_hand != ("", None, None)
    line = f"train: {name} on {data} -> {run_dir}"
    if not shared:
        print(line, file=sys.stderr, flush=True)
    from garment_jax.aot_cache import warm_start  # loads JAX: only once the input is sound
    from garment_jax.training.devices import ONE
    from garment_jax.training.launch import all_devices
    from garment_jax.training.pipeline import train

    with all_devices(*by_hand) if shared else nullcontext(ONE) as devices:
        if shared:  # now that it is known who is silent
            print(line, file=sys.stderr, flush=True)
        warm_start()
        folder = train(
            config,
            run_dir,
            data_dir=data,
            stage=options.stage,
            tensorboard=options.tensorboard,
            devices=devices,
        )
    if not devices.first:
        return
    print(f"trained: {folder}")
    if options.stage != "all":
        say_next(
            "train", options.config, "--data", Path(data), "--run-dir", Path(run_dir), why="the other stages"
        )
        return
    say_next("animate", folder, why="see it move")
    say_next("save", folder, why="a model's folder to keep")
