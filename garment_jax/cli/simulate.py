"""`garment-jax simulate`: make clips to train on with a cloth engine."""

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from garment_jax.cli.choices import GARMENTS
from garment_jax.cli.farm_options import add_farm_options, farm_of, shard_of
from garment_jax.cli.motion_options import add_motion_options
from garment_jax.cli.next_step import say_next
from garment_jax.cli.own_scene import add_scene_options, check_files, own_motions, own_scene
from garment_jax.cli.parser import add_command

if TYPE_CHECKING:
    import numpy as np

    from garment_jax.farm.shard import Shard
    from garment_jax.farm.work import Farm
    from garment_jax.simulation.settings import ClothSettings
    from garment_jax.structs import Scene

EXAMPLES = {
    "files": "  garment-jax simulate files --body me.glb --garment skirt.obj --motion moves/ --out data/mine",
    "varied": "  garment-jax simulate varied data/mine --copies 2 --out data/more",
    "embedded": "  garment-jax simulate embedded skirt --workers 2",
}


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "simulate",
        does="make clips to train on with a cloth engine (extra sim)",
        examples="\n".join(EXAMPLES.values()),
    )
    ways = parser.add_subparsers(
        title="where garment, body and motions come from", metavar="WAY", required=True
    )
    _add_files(ways, _shared())
    _add_varied(ways, _shared())
    _add_embedded(ways, _shared(pattern=False))


def _shared(*, pattern: bool = True) -> argparse.ArgumentParser:
    """Return what all ways have; `pattern`: for a garment that does not bring its flat pattern along."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--out", type=Path, help="folder for OUT/train and OUT/test (default: data/GARMENT)")
    add_farm_options(parser)
    parser.add_argument(
        "--device", default="cpu", help="cpu (default), or cuda: many clips side by side on a GPU"
    )
    parser.add_argument("--at-once", type=int, help="clips side by side on a GPU (default 128)")
    parser.add_argument(
        "--cloth", nargs="*", default=[], metavar="KEY=VALUE", help="e.g. bend=3e-4 self_collision=on"
    )
    if pattern:
        parser.add_argument(
            "--pattern", type=Path, help="flat pattern in metres, .npz or .h5 (default: from UVs)"
        )
    return parser


def _add_embedded(ways, shared: argparse.ArgumentParser) -> None:
    parser = add_command(
        ways,
        "embedded",
        parents=[shared],
        does="a garment, the mannequin and motions that the package makes",
        examples=EXAMPLES["embedded"],
    )
    parser.add_argument("garment", choices=GARMENTS, metavar="GARMENT", help=f"one of {', '.join(GARMENTS)}")
    parser.add_argument("--vertices", type=int, default=900, help="of the garment, about (default 900)")
    parser.add_argument("--frames", type=int, default=900, help="of the motions, in all (default 900)")
    parser.add_argument("--seed", type=int, default=0, help="of the motions (default 0)")
    parser.set_defaults(run=run, simulate=embedded, pattern=None)


def _add_varied(ways, shared: argparse.ArgumentParser) -> None:
    parser = add_command(
        ways,
        "varied",
        parents=[shared],
        does="the cloth of clips in varied motions of theirs",
        examples=EXAMPLES["varied"],
    )
    parser.add_argument(
        "clips", nargs="+", type=Path, metavar="CLIP", help="training clip, or a folder of them"
    )
    parser.add_argument("--copies", type=int, default=1, help="varied motions of each clip (default 1)")
    parser.add_argument("--crosses", type=int, default=0, help="motions out of three clips' parts each")
    parser.add_argument(
        "--turn", type=float, default=60.0, help="a varied body turns besides, deg/s at most (default 60)"
    )
    parser.add_argument(
        "--spins",
        type=float,
        default=0.0,
        help="and spins, so often in ten seconds on average, or less (default 0)",
    )
    parser.add_argument(
        "--kicks",
        type=float,
        default=0.0,
        help="and raised legs, so often in ten seconds on average, or less (default 0)",
    )
    parser.add_argument("--longest", type=int, help="frames of a varied motion, cut out anywhere")
    parser.add_argument("--seed", type=int, default=0, help="of the varied motions (default 0)")
    parser.set_defaults(run=run, simulate=varied)


def _add_files(ways, shared: argparse.ArgumentParser) -> None:
    parser = add_command(
        ways,
        "files",
        parents=[shared],
        does="a garment, a body and motions of your own",
        examples=EXAMPLES["files"],
    )
    add_scene_options(parser, required=True)
    parser.add_argument(
        "--motion", required=True, nargs="+", type=Path, help="BVH, AMASS, AIST++, glTF, … or folders of them"
    )
    add_motion_options(parser.add_argument_group("the motions"))
    parser.add_argument("--test", nargs="*", default=[], metavar="NAME", help="motions to test on")
    parser.set_defaults(run=run, simulate=files)


def run(options: argparse.Namespace) -> None:
    """Simulate what the way says."""
    shard = shard_of(options)
    if options.device != "cpu" and options.farm is None:
        from garment_jax.simulation.engine import find_device  # warp

        find_device(options.device)
    with farm_of(options) as farm:
        options.simulate(options, farm, shard)


def embedded(options: argparse.Namespace, farm: "Farm", shard: "Shard | None") -> None:
    """Simulate the package's own garment."""
    from garment_jax.procedural.made import check_count
    from garment_jax.procedural.scene import make_outfit
    from garment_jax.simulation.command import EMBEDDED_CLOTH, check_frames, embedded_jobs

    check_frames(options.frames)
    check_count(options.vertices)
    settings = _settings(options, EMBEDDED_CLOTH.get(options.garment, []))
    scene, flat = make_outfit(options.garment, vertices=options.vertices)
    jobs = embedded_jobs(scene.body, frames=options.frames, fps=settings.fps, seed=options.seed)
    _simulate(options, farm, shard, scene, jobs, settings, flat, [])


def varied(options: argparse.Namespace, farm: "Farm", shard: "Shard | None") -> None:
    """Simulate varied motions of clips."""
    from garment_jax.simulation.command import check_rest_shape
    from garment_jax.simulation.varied import varied_jobs

    settings = _settings(options)
    flat = _pattern(options)
    scene, jobs = varied_jobs(
        options.clips,
        copies=options.copies,
        seed=options.seed,
        turn=options.turn,
        spins=options.spins,
        kicks=options.kicks,
        longest=options.longest,
        crosses=options.crosses,
        settings=settings,
    )
    check_rest_shape(scene.garment, flat, options.pattern or options.clips[0])
    _simulate(options, farm, shard, scene, jobs, settings, flat, [])


def files(options: argparse.Namespace, farm: "Farm", shard: "Shard | None") -> None:
    """Simulate a user's own garment."""
    from garment_jax.simulation.command import check_rest_shape

    settings = _settings(options)
    check_files(options)
    flat = _pattern(options)
    left_out: list[str] = []
    dressed = own_scene(options)
    scene = dressed.scene
    jobs = own_motions(options, dressed, fps=settings.fps, test=options.test, left_out=left_out)
    check_rest_shape(scene.garment, flat, options.pattern or options.garment)
    _simulate(options, farm, shard, scene, jobs, settings, flat, left_out)


def _settings(options: argparse.Namespace, usual: list[str] | None = None) -> "ClothSettings":
    """Return the cloth's settings, `usual` ones first, once all numbers are ones that can be used."""
    from garment_jax.simulation.command import check_numbers, cloth_settings

    if options.at_once is not None and options.device == "cpu":
        raise ValueError("--at-once is for simulate --device cuda; on a CPU give --workers.")
    check_numbers(vars(options))
    return cloth_settings([*(usual or []), *options.cloth])


def _pattern(options: argparse.Namespace) -> "np.ndarray | None":
    from garment_jax.simulation.command import read_pattern

    return None if options.pattern is None else read_pattern(options.pattern)


def _simulate(
    options: argparse.Namespace,
    farm: "Farm",
    shard: "Shard | None",
    scene: "Scene",
    jobs: list[Any],
    settings: "ClothSettings",
    flat: "np.ndarray | None",
    left_out: list[str],
) -> None:
    """Simulate the clips and say how many there are; `ValueError` names those that were left out."""
    from garment_jax.simulation.clips import AT_ONCE, simulate_clips

    out = options.out or Path("data") / Path(getattr(options, "garment", "varied")).stem
    print(f"{len(jobs)} clips -> {out}", flush=True)
    outcomes = simulate_clips(
        scene,
        jobs,
        out if options.farm is None else out.absolute(),  # its workers are in folders of their own
        settings,
        flat=flat,
        farm=farm,
        shard=shard,
        device=options.device,
        at_once=AT_ONCE if options.at_once is None else options.at_once,
        progress=partial(print, flush=True),
    )
    kept = [outcome for outcome in outcomes if outcome.path is not None]
    print(f"{out}: {len(kept)} of {len(outcomes) + len(left_out)} clips")
    left_out += [outcome.job for outcome in outcomes if outcome.path is None]
    if left_out:
        raise ValueError(f"left out: {', '.join(left_out)}; the reasons are above.")
    say_next("validate", out, why="strain, rates and jumps, before training on it")
