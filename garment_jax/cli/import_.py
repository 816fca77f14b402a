"""`garment-jax import`: clips and motions of foreign formats become sequence files."""

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from garment_jax.cli.next_step import say_next
from garment_jax.cli.parser import add_command

PARTS = ("garment", "body", "motion", "clip")  # each has a unit and an up axis
MOVED = ("body", "motion")  # what may hold several skeletons

# options that packed clips have no use for
FOREIGN = (
    *(
        "garment",
        "motion",
        "collider",
        "pins",
        "unit",
        "up",
        "fps",
        "source_fps",
        "joints",
        "skip",
        "rest_frame",
        "floor",
        "keep_height",
    ),
    *("unwrap", "fit_uv", "drop_duplicates", "test", "animation", "mesh", "skeleton"),
    *(f"{part}_{what}" for part in PARTS for what in ("unit", "up")),
    *(f"{part}_{what}" for part in MOVED for what in ("mesh", "skeleton")),
)

EXAMPLES = """  garment-jax import cloth/*.abc --garment skirt.obj --body me.glb --motion moves --clip-unit cm
  garment-jax import walk.bvh --garment skirt.obj --body me.glb --fps 30 --out moves"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "import",
        examples=EXAMPLES,
        does="turn clips and motions of other programs into sequence files",
        description="Packed clips, vto-dataset and VirtualBones simulations, animated meshes (PC2, MDD, USD, "
        "Alembic, folders of OBJ or PLY) and motions (BVH, AMASS, AIST++, glTF) become OUT/train/NAME.h5.",
    )
    parser.add_argument("paths", nargs="+", type=Path, help="clips, or folders of them")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("data/imported"),
        help="folder for OUT/<train|test>/<name>.h5 (default data/imported)",
    )
    parser.add_argument(
        "--format",
        default="auto",
        choices=("auto", "packed", "vto", "virtualbones", "meshes", "motion"),
        help="what the paths are (default auto: by suffix and content)",
    )
    parser.add_argument("--garment", type=Path, help="template on the canonical body, OBJ")
    parser.add_argument(
        "--body", type=Path, help="rigged body (.npz, .glb, SMPL .pkl or .npz), or a mesh that --motion moves"
    )
    parser.add_argument("--motion", nargs="+", type=Path, default=[], help="motions, by the clips' names")
    parser.add_argument("--collider", type=Path, help="closed part of the body that the cloth touches, .npz")
    parser.add_argument("--pins", help="top, none, above:HEIGHT, group:NAME or .npz (default by the garment)")
    parser.add_argument(
        "--unit",
        help="m, cm, mm, in or metres per unit, of all files; --clip-unit, --garment-unit, --body-unit, "
        "--motion-unit of one",
    )
    parser.add_argument(
        "--up", choices=("Y", "Z"), help="up axis of all files; --clip-up and so on speak of one"
    )
    for part in PARTS:
        parser.add_argument(f"--{part}-unit", metavar="UNIT", help=argparse.SUPPRESS)
        parser.add_argument(f"--{part}-up", choices=("Y", "Z"), help=argparse.SUPPRESS)
    parser.add_argument(
        "--mesh",
        metavar="NAME",
        help="the mesh to take of clips that hold several, or else of body and motion",
    )
    parser.add_argument(
        "--skeleton", metavar="NAME", help="root joint or skin, of a body and motion that hold several"
    )
    parser.add_argument("--animation", metavar="NAME", help="the one to take of motions that hold several")
    for part in MOVED:
        parser.add_argument(f"--{part}-mesh", metavar="NAME", help=argparse.SUPPRESS)
        parser.add_argument(f"--{part}-skeleton", metavar="NAME", help=argparse.SUPPRESS)
    parser.add_argument(
        "--fps", type=float, help="of clips that do not say it; for motions, the rate to bring them to"
    )
    parser.add_argument("--source-fps", type=float, help="true rate of motions that do not say it, or lie")
    parser.add_argument("--joints", type=Path, help="table of joint names, .toml")
    parser.add_argument("--skip", type=int, default=0, help="first frames of motions to drop (rest poses)")
    parser.add_argument(
        "--rest-frame", type=int, help="frame of motions that is a T- or A-pose: their rest pose"
    )
    parser.add_argument(
        "--keep-height", action="store_true", help="do not lift the feet of motions to the floor"
    )
    parser.add_argument("--floor", action="store_true", help=argparse.SUPPRESS)  # what is done anyway
    parser.add_argument("--unwrap", action="store_true", help="make UVs for a garment without (extra unwrap)")
    parser.add_argument("--fit-uv", action="store_true", help="scale UVs in metres or on tiles into 0 … 1")
    parser.add_argument("--drop-duplicates", action="store_true", help="leave out faces that occur twice")
    parser.add_argument("--test", nargs="*", default=[], metavar="NAME", help="clips to test on")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.importers.kinds import find_kind

    kind = find_kind(options.paths) if options.format == "auto" else options.format
    (_import_packed if kind == "packed" else partial(_import_foreign, kind=kind))(options)


def _import_packed(options: argparse.Namespace) -> None:
    from garment_jax.io.importer import import_clips
    from garment_jax.validation.written_clip import refuse_errors

    ignored = [name for name in FOREIGN if getattr(options, name) not in (None, [], 0, False)]
    if ignored:
        raise ValueError(f"--{ignored[0].replace('_', '-')}: packed clips say that themselves; leave it out.")
    show = partial(print, flush=True)
    check = partial(refuse_errors, packed=True)
    clips = import_clips(options.paths, options.out, body=options.body, progress=show, check=check)
    kept = [clip for clip in clips if not clip.refused]
    new = sum(not clip.skipped for clip in kept)
    frames = sum(clip.frames for clip in kept)
    print(f"{options.out}: {len(kept)} clips, {frames} frames, {new} of them imported now")
    if len(kept) < len(clips):
        lost = ", ".join(clip.source.name for clip in clips if clip.refused)
        raise ValueError(f"left out: {lost}; the reasons are above.")
    say_next("validate", options.out, why="rates, jumps and strain, before training on it")


def _import_foreign(options: argparse.Namespace, *, kind: str) -> None:
    from garment_jax.importers.clips import import_sources
    from garment_jax.importers.formats import list_sources
    from garment_jax.importers.sources import Options
    from garment_jax.validation.written_clip import refuse_errors

    own = Options(
        garment=options.garment,
        body=options.body,
        motions=tuple(options.motion),
        collider=options.collider,
        pins=options.pins,
        unit=by_part(options, "unit"),
        up=by_part(options, "up"),
        fps=options.fps,
        source_fps=options.source_fps,
        joints=options.joints,
        skip=options.skip,
        rest_frame=options.rest_frame,
        floor=options.floor or (kind == "motion" and not options.keep_height),
        unwrap=options.unwrap,
        fit_uv=options.fit_uv,
        drop_duplicates=options.drop_duplicates,
        mesh=_chosen(options, "mesh", kind),
        skeleton=_chosen(options, "skeleton", kind),
        animation=options.animation,
    )
    sources = list_sources(options.paths, kind, own)
    show = partial(print, flush=True)
    outcomes = import_sources(
        sources,
        options.out,
        test=options.test,
        settings=settings_text(own),
        progress=show,
        check=refuse_errors,
    )
    _summarise(options.out, outcomes)


def by_part(options: argparse.Namespace, what: str) -> dict[str, str]:
    """Return the unit or the up axis of each part that the user says: its own, else that of all."""
    if what == "unit" and options.unit is not None:
        from garment_jax.importers.units import metres_per_unit

        metres_per_unit(options.unit)  # named as it was typed; a part's reader names the part's option
    said = {part: getattr(options, f"{part}_{what}") or getattr(options, what) for part in PARTS}
    return {part: value for part, value in said.items() if value is not None}


def _chosen(options: argparse.Namespace, what: str, kind: str) -> dict[str, str]:
    """Return the mesh or the skeleton to take, by parts: a part's own option, else that of all.

    The mesh of all is the clips', where these are meshes; a skeleton is asked for only in glTF files.
    """
    said = {part: getattr(options, f"{part}_{what}") for part in MOVED}
    everywhere = getattr(options, what)
    if what == "mesh" and kind == "meshes":
        return {k: v for k, v in (said | {"clip": everywhere}).items() if v is not None}
    files = {
        "body": [options.body],
        "motion": [*options.motion, *(options.paths if kind == "motion" else [])],
    }
    for part in MOVED:
        named = [path for path in files[part] if path is not None]
        able = any(path.is_dir() or path.suffix.lower() in (".glb", ".gltf", ".fbx") for path in named)
        if said[part] is None and able:
            said[part] = everywhere
    if everywhere is not None and everywhere not in said.values():
        raise ValueError(f"--{what} {everywhere}: no file that is named holds several; leave it out.")
    return {part: value for part, value in said.items() if value is not None}


def settings_text(own: Any) -> str:
    """Return the options that shape a clip besides the files, as a text to hash."""
    files = ("garment", "body", "motions", "collider", "joints")
    return repr([(k, v) for k, v in sorted(own._asdict().items()) if k not in files])


def _summarise(out: Path, outcomes: Sequence) -> None:
    kept = [outcome for outcome in outcomes if not outcome.refused]
    new = sum(not outcome.skipped for outcome in kept)
    print(f"{out}: {len(kept)} clips, {sum(o.frames for o in kept)} frames, {new} of them imported now")
    bodies = {outcome.body for outcome in kept if outcome.body}
    if len(bodies) > 1:
        print(f"they show {len(bodies)} different bodies; train.py takes the clips of one: import them apart")
    if len(kept) < len(outcomes):
        lost = ", ".join(outcome.source.name for outcome in outcomes if outcome.refused)
        raise ValueError(f"left out: {lost}; the reasons are above.")
    say_next("validate", out, why="units, rates, jumps and strain")
