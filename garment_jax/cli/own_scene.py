"""The user's own garment, body and motions, as `simulate files` and `learn` read them."""

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from garment_jax.storage.missing import not_a_file

if TYPE_CHECKING:
    from garment_jax.importers.bodies import LoadedBody
    from garment_jax.importers.sources import Options
    from garment_jax.simulation.clips import Job
    from garment_jax.structs import Scene


class Dressed(NamedTuple):
    """A scene from files, and what its motions have to know of them."""

    scene: "Scene"
    figure: "LoadedBody"
    said: "Options"  # units and axes


def add_scene_options(parser: argparse._ActionsContainer, *, required: bool) -> None:
    """Add the options to a parser or to a group of one."""
    parser.add_argument(
        "--garment", required=required, type=Path, help="template on the canonical body, an OBJ with UVs"
    )
    parser.add_argument(
        "--garment-unit", help="of the garment's file: m, cm, mm, in or metres per unit (default m)"
    )
    parser.add_argument("--garment-up", choices=("Y", "Z"), help="up axis of the garment's file (default Y)")
    parser.add_argument(
        "--unwrap", action="store_true", default=None, help="make the garment's UVs anew (extra unwrap)"
    )
    parser.add_argument(
        "--fit-uv", action="store_true", default=None, help="scale UVs in metres or on tiles into 0 … 1"
    )
    parser.add_argument(
        "--drop-duplicates", action="store_true", default=None, help="leave out faces that occur twice"
    )
    parser.add_argument(
        "--body", required=required, type=Path, help="rigged body: .npz, SMPL .npz or .pkl, .glb, .gltf, .fbx"
    )
    parser.add_argument("--betas", nargs="+", type=float, help="shape of a SMPL body")
    parser.add_argument("--body-unit", help="of the body's file: m, cm, mm, in or metres per unit")
    parser.add_argument("--body-up", choices=("Y", "Z"), help="up axis of the body's file")
    parser.add_argument("--body-mesh", metavar="NAME", help="the mesh, of a glTF that holds several bodies")
    parser.add_argument("--body-skeleton", metavar="NAME", help="the root joint, or skin, of such a body")
    parser.add_argument("--collider", type=Path, help="closed part that the cloth touches, .npz")
    parser.add_argument(
        "--pins", default="top", help="top, none, above:HEIGHT, group:NAME or .npz (default top)"
    )


def check_files(options: argparse.Namespace) -> None:
    """Raise `FileNotFoundError` for a file that is named and not there, before any is read."""
    for name in ("garment", "body", "collider", "pattern", "joints"):
        path = getattr(options, name)
        if path is not None and not path.is_file():
            raise not_a_file(path, f"name a file with --{name}")
    for path in options.motion:
        if not path.exists():
            raise not_a_file(path, "name files or folders of motions with --motion")


def own_scene(options: argparse.Namespace) -> Dressed:
    """Return the scene that the options describe, checked; says what was decided for the user."""
    import numpy as np

    from garment_jax.importers.bodies import place_template, read_any_body
    from garment_jax.importers.garment_mesh import load_garment
    from garment_jax.importers.own_files import check_on_body, is_same, of_one_file
    from garment_jax.importers.sources import Options
    from garment_jax.importers.units import to_metres_y_up
    from garment_jax.io.scene_files import load_scene
    from garment_jax.simulation.command import check_collider

    cloth, notes = load_garment(
        options.garment,
        unwrap=bool(options.unwrap),
        fit_uv=bool(options.fit_uv),
        drop_duplicates=bool(options.drop_duplicates),
    )
    for note in notes:
        if note.severity != "ok":
            print(f"{note.severity}: {note.sentence(str(options.garment))}", flush=True)
    given = to_metres_y_up(cloth.template, options.garment_unit or 1.0, options.garment_up or "Y")
    betas = None if options.betas is None else np.array(options.betas)
    said = Options(
        unit={part: unit for part in ("body", "motion") if (unit := getattr(options, f"{part}_unit"))},
        up={part: up for part in ("body", "motion") if (up := getattr(options, f"{part}_up"))},
    )
    if any(is_same(options.body, path) for path in options.motion):
        said = of_one_file(said, ("body", "motion"), options.body)
    figure = read_any_body(
        options.body,
        betas=betas,
        unit=said.unit.get("body"),
        up=said.up.get("body"),
        mesh=options.body_mesh,
        skeleton=options.body_skeleton,
        part="body",
    )
    cloth = cloth._replace(template=place_template(given, figure))
    for note in figure.notes:
        print(f"{options.body}: {note}", flush=True)
    scene = load_scene(
        options.garment,
        options.body,
        collider=options.collider,
        pins=options.pins,
        cloth=cloth,
        rigged=figure.body,
    )
    remedy = "in metres and with Y up, or say what it has: --garment-unit cm, --garment-up Z"
    check_on_body(scene.garment.template, scene.body, options.garment, remedy=remedy)
    if scene.collider is not None:
        check_collider(scene.collider, options.collider)
    return Dressed(scene, figure, said)


def own_motions(
    options: argparse.Namespace,
    dressed: Dressed,
    *,
    fps: float,
    test: Sequence[str],
    left_out: list[str],
) -> "list[Job]":
    """Return a clip for each of the user's motions; the names of those without use come into `left_out`.

    Raises `ValueError` where none is of use.
    """
    from garment_jax.body.retarget import read_joint_table
    from garment_jax.simulation.command import motion_jobs

    said = dressed.said
    jobs = motion_jobs(
        options.motion,
        dressed.scene.body,
        fps=fps,
        test=test,
        joints=None if options.joints is None else read_joint_table(options.joints),
        source_fps=options.source_fps,
        skip=options.skip,
        rest_frame=options.rest_frame,
        floor=not options.keep_height,
        unit=options.motion_unit,
        up=options.motion_up,
        rest_up=said.up.get("body"),
        body_file=options.body,
        body_unit=said.unit.get("body"),
        origin=dressed.figure.origin,
        animation=options.animation,
        mesh=options.motion_mesh,
        skeleton=options.motion_skeleton,
        say=partial(print, flush=True),
        left_out=left_out,
    )
    if not jobs:
        raise ValueError(f"left out: {', '.join(left_out)}; the reasons are above.")
    return jobs
