"""`garment-jax animate`: a model and a motion become an animation in the format that its name says."""

import argparse
import os
import sys
import time
import webbrowser
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from garment_jax.api.animated import is_begun, is_made, made_of
from garment_jax.api.outputs import ENDINGS, Output, plan_outputs
from garment_jax.api.written_as import NEXT, Shape, check_able
from garment_jax.cli.export import shown_size
from garment_jax.cli.farm_options import add_farm_options, farm_of, shard_of
from garment_jax.cli.infer import add_options, wanted
from garment_jax.cli.motion_options import add_motion_options
from garment_jax.cli.pairs import LeftOut
from garment_jax.cli.parser import add_command, add_force
from garment_jax.progress import duration

if TYPE_CHECKING:
    from garment_jax.api.many_motions import Asked
    from garment_jax.farm.work import Farm
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
        default=[],
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
    add_motion_options(parser.add_argument_group("the motions"), skip=None)
    add_options(parser.add_argument_group("the model"))
    group = parser.add_argument_group("what is written")
    group.add_argument("--no-body", action="store_true", help="the garment alone")
    group.add_argument("--out-unit", choices=("m", "cm", "mm"), help="of meshes (default m)")
    group.add_argument("--out-up", choices=("Y", "Z"), help="axis of meshes that points upwards (default Y)")
    group.add_argument("--height", type=int, default=480, help="pixels of a picture or film (default 480)")
    group.add_argument("--every", type=int, metavar="N", help="glb: every Nth frame becomes a morph target")
    group.add_argument("--start", type=int, metavar="N", help="first frame that is written (default 0)")
    group.add_argument("--stop", type=int, metavar="N", help="frame before which to stop (default: the end)")
    group.add_argument(
        "--frame-offset", type=int, metavar="N", help="number of the first frame (default 0; Blender's is 1)"
    )
    group.add_argument("--blender", help="abc: a blender executable, or a Python with bpy")
    add_farm_options(parser.add_argument_group("many motions"))
    parser.set_defaults(begins="", run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.api.many_motions import Asked
    from garment_jax.model.shipped import find_model

    shard, o, chosen = shard_of(options), options, wanted(options)
    folder = find_model(options.model)
    motions, name = list_files(o.motions), folder.resolve().name
    meshes = (o.out_unit, o.out_up, o.blender)
    shape = Shape(not o.no_body, *meshes, o.height, o.every, o.start, o.stop, o.frame_offset)
    asked = Asked(folder, shape, motion_options(o), chosen, o.force, o.plan and o.out is None)
    keys: dict[Output, str] = {}

    def going_on(output: Output) -> bool:
        """Whether an output may be there: made by this command, or left by it."""
        if len(motions) == 1 or asked.planning:
            return False
        keys[output] = made_of(folder, output, shape, asked.own, asked.wanted)
        return is_made(output, keys[output]) or is_begun(output, keys[output])

    force = o.force or asked.planning  # which writes nothing
    outputs = plan_outputs(motions, o.out, o.format, name=name, force=force, going_on=going_on)
    if shard is not None:
        outputs = shard.of(outputs)
        print(f"shard {shard}: {len(outputs)} motions", file=sys.stderr, flush=True)
        if not outputs:
            return
    check_able({output.format for output in outputs}, shape)
    missing = [x for x in outputs if o.force or x not in keys or not is_made(x, keys[x])]
    if len(missing) < len(outputs):
        print(f"{len(outputs) - len(missing)} of {len(outputs)} are there already", flush=True)
    for output in missing:
        what = "its sample motion" if output.motion is None else str(output.motion)
        print(f"{name} on {what}{'' if asked.planning else f' -> {output.path}'}", flush=True)
    if missing:
        with farm_of(options) as farm:
            _animate(asked, missing, keys, farm, options)


def list_files(paths: Sequence[Path]) -> list[Path | None]:
    """Return the motions named, and those in the folders named; `[None]`, the sample, for none.

    Raises `FileNotFoundError` for what is not there and for a folder without motions.
    """
    if not paths:
        return [None]
    from garment_jax.importers.kinds import list_clips

    return [*list_clips(paths, "motion")]


def _animate(
    asked: "Asked",
    outputs: Sequence[Output],
    keys: dict[Output, str],
    farm: "Farm",
    options: argparse.Namespace,
) -> None:
    from garment_jax.api.many_motions import animate_many

    left_out, began = LeftOut(len(outputs)), time.monotonic()
    page = options.out is None and not options.no_open and len(outputs) == 1 and outputs[0].format == "html"
    early = page and has_screen() and options.start is None  # a page of the first frames
    open_early: list[Path] = []
    running = animate_many(
        asked,
        outputs,
        farm,
        keys=keys,
        say=partial(print, flush=True),
        show_early=partial(_show_early, open_early) if early else None,
    )
    for done, (output, outcome) in enumerate(running, 1):
        if outcome.error:
            left_out.note(output.motion or asked.model, outcome.error)
            continue
        for line in outcome.value.said:
            print(line, flush=True)
        if outcome.value.files:
            _end(outcome.value.files, output, opening=page and not open_early)
        if len(outputs) > 1:
            left = duration((time.monotonic() - began) / done * (len(outputs) - done))
            print(f"{done}/{len(outputs)} motions, {left} left", flush=True)
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
    print(f"{', '.join(map(str, files))}: {shown_size(size)}; next: {NEXT[output.format]}", flush=True)
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
