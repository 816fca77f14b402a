"""`garment-jax validate`: what is wrong with clips, garments, bodies and motions, and what helps."""

import argparse
import json
from pathlib import Path

from garment_jax.cli.next_step import say_next
from garment_jax.cli.parser import add_command

EXAMPLES = """  garment-jax validate data/mine
  garment-jax validate me.glb skirt.obj moves/ --all
  garment-jax validate body.npz --fix --out fixed"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "validate",
        does="say what is wrong with clips, garments, bodies, motions",
        examples=EXAMPLES,
    )
    parser.add_argument(
        "paths", nargs="+", type=Path, help="files of any kind that is read, or folders of them"
    )
    parser.add_argument("--json", action="store_true", help="machine-readable, one object per file")
    parser.add_argument("--all", action="store_true", help="also list the checks that found nothing")
    parser.add_argument("--garment", type=Path, help="template (.obj) that mesh sequences must fit")
    parser.add_argument("--fps", type=float, help="true frame rate, where a file has none or lies")
    for what, named in (("mesh", "mesh"), ("skeleton", "root joint or skin"), ("animation", "animation")):
        parser.add_argument(f"--{what}", metavar="NAME", help=f"{named} to take of files that hold several")
    parser.add_argument(
        "--fix", action="store_true", help="write repaired copies of what can be repaired safely"
    )
    parser.add_argument("--out", type=Path, help="folder of the repaired copies")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run it; 1 if any file has an error, or could not be repaired."""
    from garment_jax.model.shipped import check_clips

    _check(options)
    check_clips(*options.paths)
    from garment_jax.validation.fixes import check_out, fix_file  # seconds of imports
    from garment_jax.validation.report import format_report, format_totals, to_json
    from garment_jax.validation.validate import Options, list_files, validate_files

    files = list_files(options.paths)
    if options.fix:
        check_out(files, options.out)
    reports = []
    chosen = Options(options.fps, options.garment, options.mesh, options.skeleton, options.animation)
    for report in validate_files(files, chosen):
        reports.append(report)
        if not options.json:
            print(format_report(report, everything=options.all), flush=True)
    fixed = []
    if options.fix:
        for path in files:
            fixed.append(fix_file(path, files, options.out, fps=options.fps))
            if not options.json:
                print(fixed[-1].sentence(), flush=True)
    if options.json:
        print(json.dumps(to_json(reports, fixed), indent=2))
    else:
        print(format_totals(reports))
    errors = any(finding.severity == "error" for report in reports for finding in report.findings)
    if options.fix and not options.json:
        say_next("validate", options.out, why="the repaired copies")
    elif not errors and not options.json and (options.paths[0] / "train").is_dir():
        say_next("train", "demo", "--data", options.paths[0], why="small networks, minutes")
    return int(errors or any(one.refused for one in fixed))


def _check(options: argparse.Namespace) -> None:
    if options.fix != (options.out is not None):
        raise ValueError("--fix and --out FOLDER belong together; the files themselves are never changed.")
    if options.fps is not None and not 0 < options.fps < 10_000:
        raise ValueError(f"--fps {options.fps:g} is no frame rate; give frames a second, such as 30.")
