"""`--workers`, `--farm` and `--shard`: where the jobs of a command run, and which of them."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from garment_jax.farm.shard import Shard
    from garment_jax.farm.work import Farm


def add_farm_options(parser: argparse._ActionsContainer, *, shards: bool = True) -> None:
    """Add the options that `farm_of` and `shard_of` read."""
    parser.add_argument("--workers", type=int, help="processes, each with a job (default 1)")
    parser.add_argument(
        "--farm",
        metavar="WHERE",
        help="a Dask scheduler instead: tcp://HOST:PORT or its scheduler.json (extra farm)",
    )
    if shards:
        parser.add_argument(
            "--shard", metavar="K/N", help="the K-th of N parts of the jobs, for a queue's job array"
        )


def farm_of(options: argparse.Namespace) -> "Farm":
    """Return where the jobs run; `ValueError` or `OSError` where that cannot be."""
    from garment_jax.farm.local import LocalFarm

    if options.workers is not None and options.workers < 1:
        raise ValueError(f"--workers {options.workers} is too small; give 1 or more.")
    if options.farm is None:
        return LocalFarm(1 if options.workers is None else options.workers)
    if options.workers is not None:
        raise ValueError("--workers are this machine's; leave it out with --farm, which has its own.")
    from garment_jax.farm.dask_farm import DaskFarm  # JAX and distributed: only where used

    return DaskFarm(options.farm)


def shard_of(options: argparse.Namespace) -> "Shard | None":
    """Return which part is asked for, None for all; `ValueError` for what is no part."""
    from garment_jax.farm.shard import parse_shard

    return None if options.shard is None else parse_shard(options.shard)
