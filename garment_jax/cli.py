"""`garment-jax COMMAND`: simulate, floor, import, info, collide, evaluate, render, stability, save.

Commands import what they need when they run, so that `--help` is quick. What a user can do wrong ends
in one sentence and exit code 2.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from garment_jax import __version__

GARMENTS = ("skirt", "circle_skirt", "dress", "cape")  # as embedded.scene; not imported, to be quick


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return the exit code (0, 1 for a red stability report, 2 after a refusal)."""
    options = make_parser().parse_args(arguments)
    try:
        return options.run(options) or 0
    except BrokenPipeError:
        sys.stderr.close()  # the reader (head, less) has had enough; nothing is wrong
        return 0
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="garment-jax", description="Dynamic garments learnt from simulation."
    )
    parser.add_argument("--version", action="version", version=f"garment-jax {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_simulate(commands)
    _add_floor(commands)
    _add_import(commands)
    _add_info(commands)
    _add_collide(commands)
    _add_evaluate(commands)
    _add_render(commands)
    _add_stability(commands)
    _add_save(commands)
    return parser


def _add_simulate(commands) -> None:
    parser = commands.add_parser("simulate", help="make clips to train on with a cloth engine (extra sim)")
    parser.add_argument("--out", required=True, type=Path, help="folder for OUT/train and OUT/test")
    parser.add_argument(
        "--embedded", choices=GARMENTS, help="a garment on the mannequin and motions that the package makes"
    )
    parser.add_argument("--vary", nargs="+", type=Path, help="training clips to simulate varied motions of")
    parser.add_argument("--copies", type=int, default=1, help="varied motions of each clip (default 1)")
    parser.add_argument(
        "--turn", type=float, default=60.0, help="a varied body turns besides, deg/s at most (default 60)"
    )
    parser.add_argument("--longest", type=int, help="frames of a varied motion, cut out anywhere")
    parser.add_argument("--vertices", type=int, default=900, help="of the embedded garment, about")
    parser.add_argument("--frames", type=int, default=900, help="of the embedded motions, in all")
    parser.add_argument("--seed", type=int, default=0, help="of the embedded or varied motions")
    parser.add_argument("--garment", type=Path, help="template on the canonical body, OBJ with UVs, metres")
    parser.add_argument("--body", type=Path, help="rigged body, .npz")
    parser.add_argument("--collider", type=Path, help="closed part that the cloth touches, .npz")
    parser.add_argument(
        "--pins", default="top", help="top, none, above:HEIGHT, group:NAME or .npz (default top)"
    )
    parser.add_argument(
        "--pattern", type=Path, help="flat pattern in metres, .npz or .h5 (default: from UVs)"
    )
    parser.add_argument("--motion", nargs="+", type=Path, help="BVH files or folders of them")
    parser.add_argument("--joints", type=Path, help="table of joint names, .toml")
    parser.add_argument("--source-fps", type=float, help="true rate of the BVH files, where the header lies")
    parser.add_argument("--skip", type=int, default=0, help="first BVH frames to drop (rest poses)")
    parser.add_argument("--keep-height", action="store_true", help="do not lift the feet to the floor")
    parser.add_argument("--test", nargs="*", default=[], metavar="NAME", help="motions to test on")
    parser.add_argument("--workers", type=int, default=1, help="clips simulated at once (default 1)")
    parser.add_argument(
        "--cloth", nargs="*", default=[], metavar="KEY=VALUE", help="e.g. bend=3e-4 self_collision=on"
    )
    parser.set_defaults(run=_simulate)


def _simulate(options: argparse.Namespace) -> None:
    from garment_jax.embedded.made import check_count
    from garment_jax.simulation.clips import simulate_clips
    from garment_jax.simulation.command import (
        EMBEDDED_CLOTH,
        check_frames,
        check_numbers,
        check_rest_shape,
        cloth_settings,
        embedded_jobs,
        read_pattern,
        varied_jobs,
    )

    _check_way(options)
    if options.embedded:
        check_frames(options.frames)
        check_count(options.vertices)
    check_numbers(vars(options))
    settings = cloth_settings([*EMBEDDED_CLOTH.get(options.embedded, []), *options.cloth])
    flat = None if options.pattern is None else read_pattern(options.pattern)
    if options.embedded is not None:
        from garment_jax.embedded.scene import make_outfit

        scene, flat = make_outfit(options.embedded, vertices=options.vertices)
        jobs = embedded_jobs(scene.body, frames=options.frames, fps=settings.fps, seed=options.seed)
    elif options.vary is not None:
        scene, jobs = varied_jobs(
            options.vary, copies=options.copies, seed=options.seed, turn=options.turn, longest=options.longest
        )
        check_rest_shape(scene.garment, flat, options.pattern or options.vary[0])
    else:
        scene, jobs = _own_files(options, settings.fps)
        check_rest_shape(scene.garment, flat, options.pattern or options.garment)
    show = partial(print, flush=True)
    outcomes = simulate_clips(
        scene, jobs, options.out, settings, flat=flat, workers=options.workers, progress=show
    )
    kept = [outcome for outcome in outcomes if outcome.path is not None]
    print(f"{options.out}: {len(kept)} of {len(outcomes)} clips")
    if len(kept) < len(outcomes):
        lost = ", ".join(outcome.job for outcome in outcomes if outcome.path is None)
        raise ValueError(f"left out: {lost}; the reasons are above.")


def _check_way(options: argparse.Namespace) -> None:
    """Refuse files that would not be looked at."""
    own = ("garment", "body", "collider", "motion", "joints")
    for way, others in (("embedded", ("vary", "pattern", *own)), ("vary", own)):
        given = [name for name in others if getattr(options, name) is not None]
        if getattr(options, way) is not None and given:
            raise ValueError(f"--{way} brings its own scene and motions; leave out --{given[0]}.")


def _own_files(options: argparse.Namespace, fps: float) -> tuple:
    """Return the scene and the clips that a user's own files describe."""
    from garment_jax.body.retarget import read_joint_table
    from garment_jax.data.scene_files import load_scene
    from garment_jax.simulation.command import bvh_jobs, check_collider

    missing = [name for name in ("garment", "body", "motion") if getattr(options, name) is None]
    if missing:
        raise ValueError(f"--{missing[0]} is not given; name your files, or use --embedded skirt.")
    scene = load_scene(options.garment, options.body, collider=options.collider, pins=options.pins)
    if scene.collider is not None:
        check_collider(scene.collider, options.collider)
    jobs = bvh_jobs(
        options.motion,
        scene.body,
        fps=fps,
        test=options.test,
        joints=None if options.joints is None else read_joint_table(options.joints),
        source_fps=options.source_fps,
        skip=options.skip,
        floor=not options.keep_height,
    )
    return scene, jobs


def _add_floor(commands) -> None:
    parser = commands.add_parser("floor", help="how far two simulations of the same frames differ")
    parser.add_argument("clip", type=Path, help="simulated sequence file")
    parser.add_argument("--start", type=int, default=100, help="frame of the restart (default 100)")
    parser.add_argument("--frames", type=int, help="how many to simulate (default: to the end)")
    parser.add_argument("--cloth", nargs="*", default=[], metavar="KEY=VALUE", help="as the clip's own")
    parser.add_argument("--pattern", type=Path, help="flat pattern in metres, as the clip's own")
    parser.add_argument("--out", type=Path, help="also write the second simulation, a sequence file")
    parser.add_argument("--json", action="store_true", help="machine-readable, with the values per frame")
    parser.set_defaults(run=_floor)


def _floor(options: argparse.Namespace) -> None:
    from garment_jax.data.sequence import SequenceWriter, open_sequence
    from garment_jax.simulation.command import cloth_settings, read_pattern
    from garment_jax.simulation.floor import floor_of, summary

    settings = cloth_settings(options.cloth)
    flat = None if options.pattern is None else read_pattern(options.pattern)
    with open_sequence(options.clip) as clip:
        floor = floor_of(clip, settings, start=options.start, frames=options.frames, flat=flat)
        if options.out is not None:
            with SequenceWriter(options.out, clip.scene, floor.motion) as writer:
                writer.append(floor.V)
    figures = summary(floor)
    if options.json:
        print(json.dumps(figures | {"rmse_cm_per_frame": floor.rmse_cm.tolist()}))
    else:
        print("\n".join(f"{key:<20} {value}" for key, value in figures.items()))


def _add_save(commands) -> None:
    parser = commands.add_parser("save", help="save a run's newest parameters as a model to ship")
    parser.add_argument("run_dir", type=Path, metavar="RUN", help="folder that train.py wrote")
    parser.add_argument("--out", required=True, type=Path, help="folder of the model, e.g. models/skirt")
    parser.add_argument("--bits", type=int, choices=(16, 32), default=16, help="of each parameter")
    parser.set_defaults(run=_save)


def _save(options: argparse.Namespace) -> None:
    from garment_jax.rollout.model import save_model
    from garment_jax.training.pipeline import trained_model

    folder = save_model(trained_model(options.run_dir), options.out, bits=options.bits)
    size = sum(path.stat().st_size for path in folder.iterdir()) / 1e6
    print(f"{folder}: {size:.1f} MB, {options.bits} bits")


def _add_import(commands) -> None:
    parser = commands.add_parser("import", help="turn packed clips into sequence files")
    parser.add_argument("paths", nargs="+", type=Path, help="packed clips (.h5) or folders of them")
    parser.add_argument("--out", required=True, type=Path, help="folder for OUT/<split>/<name>.h5")
    parser.add_argument("--body", type=Path, help="rigged body (.npz); default: what the clips name")
    parser.set_defaults(run=_import)


def _import(options: argparse.Namespace) -> None:
    from garment_jax.data.importer import import_clips

    show = partial(print, flush=True)
    clips = import_clips(options.paths, options.out, body=options.body, progress=show)
    new = sum(not clip.skipped for clip in clips)
    frames = sum(clip.frames for clip in clips)
    print(f"{options.out}: {len(clips)} clips, {frames} frames, {new} of them imported now")


def _add_info(commands) -> None:
    parser = commands.add_parser("info", help="say what is in a sequence file, a run or a model")
    parser.add_argument("paths", nargs="+", type=Path, help="sequence files, run or model folders")
    parser.add_argument("--json", action="store_true", help="machine-readable, one object per path")
    parser.set_defaults(run=_info)


def _info(options: argparse.Namespace) -> None:
    from garment_jax.data.info import describe, format_description

    facts = {str(path): describe(path) for path in options.paths}
    if options.json:
        print(json.dumps(facts, indent=2))
    else:
        print("\n\n".join(format_description(path, fact) for path, fact in facts.items()))


def _add_collide(commands) -> None:
    parser = commands.add_parser("collide", help="push a finished sequence's garment out of the body")
    parser.add_argument("sequence", type=Path, help="sequence file, predicted or any other")
    parser.add_argument("--out", required=True, type=Path, help="sequence file to write")
    parser.add_argument(
        "--body", type=Path, help="take the body of another sequence file, or a rigged body (.npz)"
    )
    parser.add_argument("--whole-body", action="store_true", help="all of the body, not its collider")
    parser.add_argument(
        "--eps", type=float, metavar="MM", help="distance to keep (default: as when animating)"
    )
    parser.add_argument("--iterations", type=int, help="gradient steps a frame at most (default 20)")
    parser.set_defaults(run=_collide)


def _collide(options: argparse.Namespace) -> None:
    from garment_jax.collision.command import collide_file, summary

    settings = {} if options.eps is None else {"eps": options.eps / 1000.0}
    settings |= {} if options.iterations is None else {"iterations": options.iterations}
    report = collide_file(
        options.sequence, options.out, body=options.body, whole_body=options.whole_body, **settings
    )
    first, *further = summary(report)
    print("\n".join([f"{options.out}: {first}", *further]))


def _add_evaluate(commands) -> None:
    parser = commands.add_parser("evaluate", help="measure predictions against the truth")
    parser.add_argument("pred", type=Path, help="predicted sequence file, or a folder of them")
    parser.add_argument("truth", type=Path, help="simulated sequence file, or a folder with the same names")
    parser.add_argument("--every", type=int, default=1, help="slow metrics on every N-th frame (default 1)")
    parser.add_argument("--json", action="store_true", help="machine-readable, with the values per frame")
    parser.add_argument("--out", type=Path, help="also save the JSON there")
    parser.add_argument(
        "--whole-body", action="store_true", help="show the penetration of the arms and the head, too"
    )
    parser.set_defaults(run=_evaluate)


def _evaluate(options: argparse.Namespace) -> None:
    from garment_jax.evaluation.command import evaluate_files
    from garment_jax.evaluation.table import format_table

    pairs = _pair_files(options.pred, options.truth)
    figures = [evaluate_files(pred, truth, every=options.every) for pred, truth in pairs]
    text = json.dumps(figures if options.pred.is_dir() else figures[0])
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(text + "\n")
    print(text if options.json else format_table(figures, whole_body=options.whole_body))


def _pair_files(pred: Path, truth: Path) -> list[tuple[Path, Path]]:
    """Pair two files, or every prediction in a folder with the truth of the same name."""
    if pred.is_dir() != truth.is_dir():
        raise ValueError(f"{pred} and {truth} are a file and a folder; give two files or two folders.")
    if not pred.is_dir():
        return [(pred, truth)]
    pairs = [(path, truth / path.name) for path in sorted(pred.glob("*.h5"))]
    if not pairs:
        raise FileNotFoundError(f"{pred} holds no predictions (*.h5); run infer.py into it first.")
    return pairs


def _add_render(commands) -> None:
    parser = commands.add_parser("render", help="draw contact sheets, error maps and short films")
    parser.add_argument("paths", nargs="+", type=Path, help="a file; or PRED TRUTH, files or folders")
    parser.add_argument("--out", required=True, type=Path, help="folder for the pictures")
    parser.add_argument("--frames", type=int, default=6, help="columns of the contact sheet (default 6)")
    parser.add_argument("--animation", action="store_true", help="also a film, NAME.gif")
    parser.add_argument("--seconds", type=float, default=8.0, help="length of the film (default 8)")
    parser.add_argument("--side-view", action="store_true", help="also a sheet from the side")
    parser.add_argument("--whole-body", action="store_true", help="show head and feet too")
    parser.add_argument("--scale-cm", type=float, help="error at the end of the colours (default: fits)")
    parser.add_argument("--azimuth", type=float, default=35.0, help="degrees from the body's front")
    parser.add_argument("--height", type=int, default=360, help="pixels of one picture (default 360)")
    parser.set_defaults(run=_render)


def _render(options: argparse.Namespace) -> None:
    from garment_jax.evaluation.render import render_files

    if len(options.paths) > 2:
        raise ValueError(
            f"render takes a file, or PRED TRUTH, not {len(options.paths)} paths; run it once a pair."
        )
    pairs = [options.paths] if len(options.paths) == 1 else _pair_files(*options.paths)
    names = ("frames", "animation", "seconds", "side_view", "whole_body", "scale_cm", "azimuth", "height")
    settings = {name: getattr(options, name) for name in names}
    for pair in pairs:
        for path in render_files(list(pair), options.out, **settings):
            print(path, flush=True)


def _add_stability(commands) -> None:
    parser = commands.add_parser("stability", help="check stiff and extreme cases on a garment and a model")
    parser.add_argument("run_dir", nargs="?", type=Path, metavar="RUN", help="run or model, for its rollouts")
    parser.add_argument("--garment", choices=GARMENTS, help="an embedded garment (default skirt)")
    parser.add_argument(
        "--clips",
        nargs="+",
        type=Path,
        default=[],
        help="sequence files or folders of them",
    )
    parser.add_argument("--full", action="store_true", help="the long cases too (an hour)")
    parser.add_argument("--only", nargs="+", default=[], metavar="GROUP", help="some groups of cases")
    parser.add_argument("--out", type=Path, help="folder for stability.json and plots")
    parser.set_defaults(run=_stability)


def _stability(options: argparse.Namespace) -> int:
    from garment_jax.stability.report import passed, stability

    cases = stability(
        options.run_dir,
        garment=options.garment,
        clips=options.clips,
        full=options.full,
        only=options.only,
        out=options.out,
        show=partial(print, flush=True),
    )
    return 0 if passed(cases) else 1
