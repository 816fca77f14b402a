"""`garment-jax learn`: one command from a body and a garment to a model that animates it."""

import argparse
import os
import shlex
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from garment_jax.cli.choices import GARMENTS
from garment_jax.cli.motion_options import add_motion_options
from garment_jax.cli.next_step import say_next
from garment_jax.cli.own_scene import Dressed, add_scene_options, check_files, own_motions, own_scene
from garment_jax.cli.parser import add_command, add_force
from garment_jax.cli.train import GOES_ON

if TYPE_CHECKING:
    from garment_jax.learning.learn import Given

EXAMPLES = """\
  garment-jax learn --body me.glb --garment skirt.obj --motion moves/ --minutes 60 --out models/mine
  garment-jax learn dress --minutes 10 --out models/dress2    the package's own mannequin and motions"""
MOST_WORKERS = 8  # each holds half a gigabyte
_OWN = ("garment", "body", "collider", "betas", "body_unit", "body_up", "body_mesh", "body_skeleton")


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "learn",
        does="make a model of a garment on a body, within the minutes given (extra sim)",
        description="Simulates clips, keeps some back, trains every stage, measures on what was kept back, "
        "and saves a model's folder. Stopped at any point, the same command goes on.",
        examples=EXAMPLES,
    )
    parser.add_argument(
        "embedded",
        nargs="?",
        choices=GARMENTS,
        metavar="GARMENT",
        help=f"one of the package, on its mannequin: {', '.join(GARMENTS)}",
    )
    parser.add_argument("--out", type=Path, help="folder of the model (default: models/GARMENT)")
    parser.add_argument("--minutes", type=float, default=30.0, help="how long it may take (default 30)")
    parser.add_argument("--work", type=Path, help="folder of what is half done (default: OUT.work)")
    add_force(parser)
    parser.add_argument("--seed", type=int, default=0, help="of motions and training (default 0)")
    parser.add_argument("--workers", type=int, help="processes that simulate (default: one for each core)")
    parser.add_argument("--vertices", type=int, help="of the package's garment, about (default 900)")
    group = parser.add_argument_group("garment and body")
    add_scene_options(group, required=False)
    group.add_argument("--pattern", type=Path, help="flat pattern, .npz or .h5 (default: from UVs)")
    group.add_argument(
        "--cloth", nargs="*", default=[], metavar="KEY=VALUE", help="e.g. bend=3e-4 self_collision=on"
    )
    group = parser.add_argument_group("the motions")
    group.add_argument(
        "--motion", nargs="+", default=[], type=Path,
        help="BVH, AMASS, AIST++, glTF, … or folders of them (default: the package's own)",
    )  # fmt: skip
    group.add_argument(
        "--test", nargs="*", default=[], metavar="NAME",
        help="motions to keep back and measure on (default: a quarter; of fewer than four, their ends)",
    )  # fmt: skip
    add_motion_options(group)
    parser.set_defaults(begins="", run=run, stopped=GOES_ON)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    check_given(options)
    if options.out is None:
        options.out = Path("models") / (options.embedded or options.garment.stem)
    print(f"{options.out}: reading garment, body and motions", flush=True)
    from garment_jax.learning.budget import divide
    from garment_jax.learning.learn import Wanted, learn

    shares = divide(options.minutes)
    say = partial(print, flush=True)
    work = options.work or options.out.with_name(f"{options.out.name}.work")
    given = _given(options, work)
    parts = [
        f"{seconds / 60:.1f} to {part}"
        for part, seconds in zip(("simulate", "train", "measure"), shares, strict=True)
    ]
    say(f"{options.minutes:g} minutes: {', '.join(parts)}; all that is decided and half done is in {work}")
    workers = options.workers or min(_cores(), MOST_WORKERS)
    command = shlex.join(["garment-jax", *sys.argv[1:]])
    wanted = Wanted(options.minutes, options.seed, workers, options.force, command)
    learnt = learn(given, options.out, work, wanted, say=say)
    if learnt is None:
        return
    say(
        f"{learnt.folder}: RMSE {learnt.rmse_cm:.2f} cm on motions kept back ({learnt.skinned_cm:.2f} for "
        "the template carried by the skin); figures.json and picture.png are in it"
    )
    for page in learnt.pages:
        say(f"{page}: prediction beside simulation")
    say_next("animate", learnt.folder, why="see it move")


def check_given(options: argparse.Namespace) -> None:
    """Raise `ValueError` or `OSError` for what cannot be, or not together, before anything is read."""
    given = [name for name in _OWN if getattr(options, name) is not None]
    if options.embedded and given:
        raise ValueError(
            f"--{given[0].replace('_', '-')} is of garments of your own; leave it out, or {options.embedded}."
        )
    if not options.embedded:
        for name in ("garment", "body"):
            if getattr(options, name) is None:
                raise ValueError(
                    f"--{name} is not given; name garment and body, or one of {', '.join(GARMENTS)}."
                )
        if options.vertices is not None:
            raise ValueError("--vertices is of the package's garments; leave it out.")
    if options.test and not options.motion:
        raise ValueError(f"--test {options.test[0]} is of motions of your own; name them with --motion.")
    from garment_jax.learning.budget import divide
    from garment_jax.model.folder import check_no_file
    from garment_jax.procedural.made import check_count

    divide(options.minutes)
    if options.vertices is not None:
        check_count(options.vertices)
    if options.out is not None:
        check_no_file(options.out)
    check_files(options)


def _given(options: argparse.Namespace, work: Path) -> "Given":
    """Return what is to be learnt from; refuses what could not be simulated."""
    import numpy as np

    import garment_jax.simulation.engine  # noqa: F401  (raises where it is not installed)
    from garment_jax.importers.bodies import LoadedBody
    from garment_jax.importers.sources import Options
    from garment_jax.learning.collider import proposed_collider
    from garment_jax.learning.learn import Given
    from garment_jax.learning.motions import Own, Recorded
    from garment_jax.procedural.scene import make_outfit
    from garment_jax.simulation.command import (
        EMBEDDED_CLOTH,
        check_numbers,
        check_rest_shape,
        cloth_settings,
        read_pattern,
    )

    check_numbers(vars(options))
    settings = cloth_settings([*EMBEDDED_CLOTH.get(options.embedded, []), *options.cloth])
    flat = None if options.pattern is None else read_pattern(options.pattern)
    if options.embedded:
        vertices = 900 if options.vertices is None else options.vertices
        scene, own_flat = make_outfit(options.embedded, vertices=vertices)
        flat = own_flat if flat is None else flat
        dressed = Dressed(scene, LoadedBody(scene.body, np.zeros(3), ()), Options())
    else:
        dressed = own_scene(options)
        scene = dressed.scene
        if scene.collider is None and (collider := proposed_collider(scene)) is not None:
            scene = scene._replace(collider=collider)
            print("the cloth touches trunk, legs and upper arms (--collider FILE chooses)", flush=True)
        check_rest_shape(scene.garment, flat, options.pattern or options.garment)
    if not options.motion:
        return Given(scene, flat, settings, Own(scene.body, work, fps=settings.fps, seed=options.seed))
    left_out: list[str] = []
    jobs = own_motions(options, dressed, fps=settings.fps, test=(), left_out=left_out)
    return Given(scene, flat, settings, Recorded({job.name: job.motion for job in jobs}, options.test))


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
