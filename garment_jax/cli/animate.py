"""`garment-jax animate`: a model and a motion become an animation in the format that its name says."""

import argparse
import os
import sys
import webbrowser
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from garment_jax.api.opened import open_model
from garment_jax.api.outputs import ENDINGS, Output, plan_outputs
from garment_jax.api.written_as import NEXT, Shape, check_able
from garment_jax.cli.infer import add_options, wanted
from garment_jax.cli.motion_options import add_motion_options
from garment_jax.cli.pairs import LeftOut
from garment_jax.cli.parser import add_command, add_force

if TYPE_CHECKING:
    from garment_jax.importers.sources import Options

EXAMPLES = """  garment-jax animate skirt                            its sample motion, as a page
  garment-jax animate skirt walk.bvh --out walk.glb    for Blender; also .usdc .abc .pc2 .mdd .mp4 ...
  garment-jax animate skirt moves/ --out made/ --format usd"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "animate",
        does="animate a model's garment on motions: a page, a film, or a file for other programs",
        description="Motions (BVH, glTF, AMASS, AIST++, sequence files) are put on the model's body, at its "
        "frame rate, and the garment follows.",
        examples=EXAMPLES,
    )
    parser.add_argument("model", help="a shipped model's name (see garment-jax models), a model or a run")
    parser.add_argument(
        "motions",
        nargs="*",
        type=Path,
        metavar="MOTION",
        help="files or folders (default: the model's sample)",
    )
    parser.add_argument(
        "--out", help="file, its ending says the format, or folder (default: MOTION's name + .html, here)"
    )
    parser.add_argument("--format", choices=tuple(ENDINGS), help="where --out is a folder (default html)")
    add_force(parser)
    parser.add_argument("--no-open", action="store_true", help="do not open the page in a browser")
    add_motion_options(parser.add_argument_group("the motions"))
    add_options(parser.add_argument_group("the model"))
    group = parser.add_argument_group("what is written")
    group.add_argument("--no-body", action="store_true", help="the garment alone")
    group.add_argument("--out-unit", choices=("m", "cm", "mm"), help="of meshes (default m)")
    group.add_argument("--out-up", choices=("Y", "Z"), help="axis of meshes that points upwards (default Y)")
    group.add_argument("--height", type=int, default=480, help="pixels of a picture or film (default 480)")
    group.add_argument("--every", type=int, metavar="N", help="glb: every Nth frame becomes a morph target")
    group.add_argument("--blender", help="abc: a blender executable, or a Python with bpy")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.model.shipped import find_model

    folder = find_model(options.model)
    motions = list_files(options.motions)
    name = folder.resolve().name
    o = options
    shape = Shape(not o.no_body, o.out_unit, o.out_up, o.blender, o.height, o.every)
    outputs = plan_outputs(motions, options.out, options.format, name=name, force=options.force)
    planning = options.plan and options.out is None  # as infer.py: then nothing is written
    check_able({output.format for output in outputs}, shape)
    for output in outputs:
        what = "its sample motion" if output.motion is None else str(output.motion)
        print(f"{name} on {what}{'' if planning else f' -> {output.path}'}", flush=True)
    _animate(folder, outputs, shape, options, planning)


def list_files(paths: Sequence[Path]) -> list[Path | None]:
    """Return the motions named, and those in the folders named; `[None]`, the sample, for none.

    Raises `FileNotFoundError` for what is not there and for a folder without motions.
    """
    if not paths:
        return [None]
    from garment_jax.importers.kinds import list_clips

    return [*list_clips(paths, "motion")]


def _animate(
    folder: Path, outputs: Sequence[Output], shape: Shape, options: argparse.Namespace, planning: bool
) -> None:
    from garment_jax.api.animating import write_animation
    from garment_jax.model.scene_file import read_sample

    asked, own = wanted(options), motion_options(options)
    opened = open_model(str(folder), asked)
    sample = read_sample(folder)
    left_out = LeftOut(len(outputs))
    for output in outputs:
        page = options.out is None and not options.no_open and output.format == "html"
        open_early: list[Path] = []
        with left_out.reading(output.motion or folder):
            files = write_animation(
                opened,
                sample,
                output,
                shape,
                own,
                asked,
                force=options.force,
                planning=planning,
                say=partial(print, flush=True),
                show_early=partial(_show_early, open_early) if page and has_screen() else None,
            )
            if files:
                _end(files, output, opening=page and not open_early)
    left_out.check()


def _show_early(shown: list[Path], page: Path) -> bool:
    """Open a page of the first frames, which becomes the finished one; note it in `shown`."""
    if not open_page(page):
        return False
    print("opened in the browser: first frames; contact handling is being compiled, this once", flush=True)
    shown.append(page)
    return True


def _end(files: Sequence[Path], output: Output, *, opening: bool) -> None:
    """Say what was written and what to do with it; open a page."""
    size = sum(p.stat().st_size for file in files for p in ([file] if file.is_file() else file.rglob("*")))
    print(f"{', '.join(map(str, files))}: {size / 1e6:.1f} MB; next: {NEXT[output.format]}", flush=True)
    if opening and open_page(files[0]):
        print("opened in the browser (--no-open leaves that out)", flush=True)


def motion_options(options: argparse.Namespace) -> "Options":
    """Return what the user says of the motions' files."""
    from garment_jax.importers.sources import Options

    def of_motion(value: str | None) -> dict[str, str]:
        return {} if value is None else {"motion": value}

    return Options(
        joints=options.joints,
        source_fps=options.source_fps,
        skip=options.skip,
        rest_frame=options.rest_frame,
        floor=not options.keep_height,
        unit=of_motion(options.motion_unit),
        up=of_motion(options.motion_up),
        animation=options.animation,
        mesh=of_motion(options.motion_mesh),
        skeleton=of_motion(options.motion_skeleton),
    )


def has_screen() -> bool:
    """Return whether there is one that a browser could be on."""
    shown = any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
    return sys.platform in ("win32", "darwin") or shown


def open_page(page: Path) -> bool:
    """Open a page in the user's browser, where there is a screen; return whether it did."""
    return has_screen() and webbrowser.open(page.resolve().as_uri())
