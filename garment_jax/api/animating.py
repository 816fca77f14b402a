"""A model and a motion become vertices, or a file in the format that its name says."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from garment_jax.api.arguments import a_flag, a_path, a_text, an_integer, optional, takes
from garment_jax.api.early_page import EarlyPage
from garment_jax.api.model_argument import a_model
from garment_jax.api.motions import a_motion, from_arrays, motion_file, moving
from garment_jax.api.opened import Opened, Wanted, infer_motion
from garment_jax.api.outputs import Output, plan_outputs
from garment_jax.api.written_as import Shape, check_able, check_frames, write_as

if TYPE_CHECKING:
    from garment_jax.api.loaded import LoadedModel
    from garment_jax.importers.sources import Options
    from garment_jax.model.scene_file import Sample
    from garment_jax.structs import Motion


@takes(
    model=a_model,
    motion=optional(a_motion),
    out=optional(a_path),
    collision=a_flag,
    preroll=an_integer,
    force=a_flag,
    body=a_flag,
    unit=optional(a_text),
    up=optional(a_text),
    height=an_integer,
)
def animate(
    model: "LoadedModel",
    motion: "Motion | tuple | str | Path | None" = None,
    out: str | Path | None = None,
    *,
    collision: bool = True,
    preroll: int = 0,
    force: bool = False,
    body: bool = True,
    unit: str | None = None,
    up: str | None = None,
    height: int = 480,
) -> np.ndarray | list[Path]:
    """Return the garment's vertices `[t, n, 3]`, metres, world; or write them to `out` and return the files.

    `motion`: a file (`motion` says which), arrays on the model's body, which are (rotations, root) at its
    rate or (rotations, root, fps) as of `motion`, or the model's sample.
    `collision` off leaves the cloth where it is inside the body; `preroll`: so many frames from the canonical
    pose go before. `out` is a file whose ending says the format: .html .glb .usdc .usd .usda .usdz .abc .pc2
    .mdd .obj/ .npz .h5 .mp4 .webp .gif .png; `force` replaces what is there, `body` off writes the garment
    alone, meshes are in `unit` (m, cm, mm) with `up` (Y, Z) upwards, pictures `height` pixels high. Raises
    `ValueError` or `OSError` in one sentence; then nothing is written.

        V = gj.animate(model)
        gj.animate(model, "walk.bvh", out="walk.glb")
    """
    if out is None:
        return _vertices(model, motion, collision=collision, preroll=preroll)
    return _files(
        model,
        motion,
        str(out),
        Wanted(no_collision=not collision, preroll=preroll),
        Shape(body=body, unit=unit, up=up, height=height),
        force=force,
    )


def _vertices(
    model: "LoadedModel", given: "tuple | str | Path | None", *, collision: bool, preroll: int
) -> np.ndarray:
    from garment_jax.animation.animate import animator_for
    from garment_jax.animation.plan import make_plan
    from garment_jax.aot_cache import compiling
    from garment_jax.api.loaded import opened_of, trained_of
    from garment_jax.model.store import check_rate
    from garment_jax.progress import FrameProgress

    scene, motion, name = moving(model, given)
    opened = opened_of(model)
    check_rate(opened.facts, motion, name)
    plan = make_plan(opened.facts, scene, motion, collision=collision)
    run = animator_for(trained_of(model), scene, plan, opened.here.store, name, opened.animators)
    V = np.zeros((len(motion.root), len(scene.garment.template), 3), np.float32)
    with FrameProgress(name) as progress:
        progress.say(compiling(opened.here.store))
        done = 0
        for piece in run(motion, preroll=preroll, name=name):
            V[done : done + len(piece.V)] = piece.V
            done += len(piece.V)
            progress(done, len(V))
    return V


def _files(
    model: "LoadedModel",
    given: "tuple | str | Path | None",
    out: str,
    asked: Wanted,
    shape: Shape,
    *,
    force: bool,
) -> list[Path]:
    from garment_jax.api.loaded import opened_of
    from garment_jax.importers.sources import Options
    from garment_jax.io.sequence_writer import SequenceWriter
    from garment_jax.model.scene_file import Sample
    from garment_jax.model.store import check_rate
    from garment_jax.storage.scratch import scratch, unmade

    file = Path(given) if isinstance(given, str | Path) else None
    (output,) = plan_outputs([file], out, None, name=model.name, force=force)
    check_able({output.format}, shape)
    write = partial(
        write_animation,
        opened_of(model),
        Sample(model.scene, model.motion, model.name),
        shape=shape,
        own=Options(floor=True, skip=None),
        asked=asked,
        force=force,
    )
    if isinstance(given, str | Path):
        return write(output)
    motion, title = from_arrays(model, model.motion if given is None else given), output.path.stem
    check_rate(opened_of(model).facts, motion, "the motion")
    with unmade(output.path.parent), scratch(output.path.parent) as place:
        path = place / "motion.h5"
        with SequenceWriter(path, model.scene, motion, encoding="none", attributes={"name": title}):
            pass
        return write(output._replace(motion=path), title=title)


def write_animation(
    opened: Opened,
    sample: "Sample | None",
    output: Output,
    shape: Shape,
    own: "Options",
    asked: Wanted,
    *,
    force: bool,
    planning: bool = False,
    title: str | None = None,
    say: Callable[[str], None] = lambda line: None,
    show_early: Callable[[Path], bool] | None = None,
) -> list[Path]:
    """Animate one motion, write it as `output` says and return the files; none while only `planning`.

    `own` is what the user says of the motion's file, `say` gets the lines to print. `show_early` gets a page
    of the first frames, where contact handling has to be compiled, and returns whether it is open. Built in a
    scratch folder: the files appear when they are whole. Raises `ValueError` or `OSError` in one sentence.
    """
    from garment_jax.animation.animate import Early
    from garment_jax.storage.scratch import scratch, unmade

    into = output.path.parent
    with unmade(into), scratch(into) as place, _without(place):
        moves, notes = motion_file(opened.path, sample, output.motion, opened.facts.fps, own, place)
        of_frames = check_frames(moves, output, shape)
        for note in (*notes, *(() if planning else of_frames)):
            say(note)
        title = title or (output.path.stem if output.motion is None else output.motion.stem)
        made = None if planning else place / f"{title}.animation.h5"
        page, kept = None, opened.here.folder
        if show_early is not None and kept is not None:
            page = EarlyPage(place, kept, title, body=shape.body, show=show_early)
        early = Early(page.sequence, page) if page else None
        for line in infer_motion(opened, moves, made, asked, early=early, stop=shape.stop):
            say(line.replace(f"{made}: ", f"{title}: "))
        files = [] if made is None else write_as(made, output, shape, place, title=title, force=force)
        if page and files:
            page.give_way(files[0])
        return files


@contextmanager
def _without(place: Path) -> Iterator[None]:
    """Leave the scratch folder, which nobody knows, out of what is refused."""
    try:
        yield
    except (ValueError, OSError) as error:
        if f"{place}{os.sep}" not in str(error):
            raise
        raise ValueError(str(error).replace(f"{place}{os.sep}", "")) from error
