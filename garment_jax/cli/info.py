"""`garment-jax info`: what is in a sequence file, a run or a model."""

import argparse
import json
from pathlib import Path


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = commands.add_parser("info", help="say what is in a sequence file, a run or a model")
    parser.add_argument("paths", nargs="+", type=Path, help="sequence files, run or model folders")
    parser.add_argument("--json", action="store_true", help="machine-readable, one object per path")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.data.info import describe, format_description

    facts = {str(path): describe(path) for path in options.paths}
    if options.json:
        print(json.dumps(facts, indent=2))
    else:
        print("\n\n".join(format_description(path, fact) for path, fact in facts.items()))
