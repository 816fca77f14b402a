"""`garment-jax benchmark`: error against run time of every method, in one report."""

import argparse
from functools import partial
from pathlib import Path

from garment_jax.cli.farm_options import add_farm_options, farm_of
from garment_jax.cli.next_step import say_next
from garment_jax.cli.parser import add_command

EXAMPLES = """  garment-jax benchmark benchmark --data data/mine --quick"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "benchmark",
        does="train, roll out and measure every method; one report",
        examples=EXAMPLES,
    )
    parser.add_argument("config", help="a TOML file, or a name of the package, such as benchmark")
    parser.add_argument("--data", type=Path, help="folder with train/ and test/ (default: the file's)")
    parser.add_argument("--out", type=Path, help="folder for runs, results and report (default: the file's)")
    parser.add_argument(
        "--again",
        type=Path,
        metavar="DIR",
        help="second simulations of the test clips, by name: errors on determined frames as well",
    )
    parser.add_argument("--quick", action="store_true", help="ten minutes, to see that everything works")
    parser.add_argument("--only", nargs="+", default=[], metavar="ROW", help="some rows")
    parser.add_argument("--report-only", action="store_true", help="from what is measured, nothing else")
    parser.add_argument(
        "--keep",
        type=Path,
        metavar="DIR",
        help="take over records of finished jobs from DIR, add new ones",
    )
    parser.add_argument(
        "--timed-by",
        default="",
        metavar="COMMAND",
        help='runs the measurements of run time, e.g. "taskset -c 0,1"',
    )
    add_farm_options(parser.add_argument_group("jobs at once, but for run time"), shards=False)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run it; exit code 1 where a job failed."""
    from garment_jax.config.reading import find_config

    find_config(options.config)
    from garment_jax.bench.runner import benchmark  # seconds of imports

    with farm_of(options) as farm:
        failed = benchmark(
            options.config,
            data=options.data,
            out=options.out,
            again=options.again,
            quick=options.quick,
            only=options.only,
            report_only=options.report_only,
            timed_by=options.timed_by,
            kept=options.keep,
            farm=farm,
            show=partial(print, flush=True),
        )
    if options.quick and not failed:
        data = [] if options.data is None else ["--data", options.data]
        say_next("benchmark", options.config, *data, why="all of it, at full length")
    return 1 if failed else 0
