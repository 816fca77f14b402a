"""`garment-jax export`: sequence files for other programs, models as ONNX."""

import argparse
import sys
from functools import partial
from pathlib import Path

from garment_jax.api.written_as import NEXT
from garment_jax.cli.next_step import say_step
from garment_jax.cli.parser import add_command, add_force
from garment_jax.progress import FrameProgress

EXAMPLES = """  garment-jax export pred.h5 --out pred.usdc
  garment-jax export pred.h5 --format pc2
  garment-jax export skirt --format onnx --out step.onnx"""


ENDINGS = {"usd": ".usdc", "obj": "_obj"}  # of a name that is made here; of others the format's own
FORMATS = ("usd", "glb", "pc2", "mdd", "obj", "npz", "abc", "onnx")  # as exporters.command


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "export",
        does="write a sequence for other programs, or a model as ONNX",
        examples=EXAMPLES,
    )
    parser.add_argument("source", type=Path, help="sequence file (for onnx: a model, its name, or a run)")
    parser.add_argument(
        "--out",
        type=Path,
        help="file, of obj a folder (default: SOURCE's name with the format's ending)",
    )
    add_force(parser)
    parser.add_argument("--format", choices=FORMATS, help="default: by the ending of --out; glb without it")
    parser.add_argument(
        "--out-unit", "--unit", dest="unit", choices=("m", "cm", "mm"), help="unit of length (default m)"
    )
    parser.add_argument(
        "--out-up", "--up", dest="up", choices=("Y", "Z"), help="axis that points upwards (default Y)"
    )
    parser.add_argument("--fps", type=float, help="rate to write instead of the clip's; nothing is resampled")
    parser.add_argument("--frame-offset", type=int, metavar="N", help="number of the first frame (default 0)")
    parser.add_argument("--start", type=int, help="first frame of the clip to export (default 0)")
    parser.add_argument("--stop", type=int, help="frame before which to stop (default: the clip's end)")
    parser.add_argument("--every", type=int, help="glb: every so many frames becomes a morph target")
    parser.add_argument("--no-body", action="store_true", help="the garment alone")
    parser.add_argument(
        "--blender", help="abc: a blender executable, or a Python with bpy (or GARMENT_JAX_BLENDER)"
    )
    parser.add_argument(
        "--clip", type=Path, help="onnx: a sequence file of its garment (default: its sample)"
    )
    parser.add_argument("--no-detail", action="store_true", help="onnx: without the detail network")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.exporters.command import choose_format, export_file
    from garment_jax.model.shipped import check_clips

    given = _given(options)
    if options.out is None:
        options.format = options.format or "glb"
        options.out = Path(
            f"{options.source.resolve().stem}{ENDINGS.get(options.format, f'.{options.format}')}"
        )
    if choose_format(options.out, options.format) == "onnx":
        return _run_onnx(options, given)
    check_clips(options.source)
    if options.source.is_dir():
        raise ValueError(f"{options.source} is a folder; name a sequence file, or --format onnx for a model.")
    if options.clip or options.no_detail:
        raise ValueError("--clip and --no-detail are for --format onnx; leave them out.")
    with FrameProgress(options.source.stem) as progress:
        report = export_file(
            options.source,
            options.out,
            format=options.format,
            force=options.force,
            progress=progress,
            **given,
        )
    print(
        f"{', '.join(map(str, report.files))}: {report.frames} frames, {shown_size(report.bytes)}, "
        f"{report.frames / report.seconds:.3g} frames/s{report.note and '; '}{report.note}"
    )
    say_step(NEXT[choose_format(options.out, options.format)])


def _given(options: argparse.Namespace) -> dict:
    """Return the options of clips that were given, by `export_file`'s names."""
    names = ("unit", "up", "fps", "frame_offset", "start", "stop", "every", "blender")
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    return given | ({"body": False} if options.no_body else {})


def shown_size(size: int) -> str:
    """Return so many bytes in MB, below one in kB."""
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.1f} kB"


def _run_onnx(options: argparse.Namespace, given: dict) -> None:
    """Export a run's or a model's step function; options of clips have no meaning there."""
    if given:
        said = ["no-body" if name == "body" else name.replace("_", "-") for name in given]
        names = ", ".join(f"--{name}" for name in said)
        raise ValueError(f"{names}: for sequences, not for --format onnx; leave out.")
    from garment_jax.exporters.onnx_step import export_step
    from garment_jax.model.shipped import find_model

    facts = export_step(
        find_model(options.source),
        options.out,
        clip=options.clip,
        detail=not options.no_detail,
        force=options.force,
        say=partial(print, file=sys.stderr, flush=True),
    )
    for name, file in facts.pop("files").items():
        print(f"{name}: {file['megabytes']:.3g} MB, {file['nodes']} nodes")
    inputs = facts.pop("frame_departure", 0.0)  # of the motion features, in units of their own
    garment = [facts.pop(name) for name in list(facts) if name.endswith("_departure")]
    for name, value in facts.items():
        print(f"{name}: {value}")
    if garment:
        print(
            f"checked beside JAX: largest departure {1e3 * max(garment):.2g} mm, "
            f"of a frame's inputs {inputs:.2g}"
        )
