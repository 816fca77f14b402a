"""Animations of many motions on a farm: each worker opens the model once and keeps its programs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from garment_jax.api.animated import forget, is_begun, record
from garment_jax.api.animating import write_animation
from garment_jax.api.opened import Opened, Wanted, open_model
from garment_jax.api.outputs import Output
from garment_jax.api.written_as import Shape
from garment_jax.farm.work import Farm, Outcome, Work

if TYPE_CHECKING:
    from garment_jax.importers.sources import Options
    from garment_jax.model.scene_file import Sample


class Asked(NamedTuple):
    """What the animations of a call have in common."""

    model: Path
    shape: Shape
    own: "Options"  # what the user says of the motions' files
    wanted: Wanted
    force: bool
    planning: bool = False


class Animated(NamedTuple):
    """What became of one motion."""

    files: list[Path]
    said: list[str]  # lines to print, where they were not printed at once


class _Opened(NamedTuple):
    asked: Asked
    opened: Opened
    sample: "Sample | None"


class _Job(NamedTuple):
    output: Output
    key: str  # of its record; "" where it has none


def animate_many(
    asked: Asked,
    outputs: Sequence[Output],
    farm: Farm,
    *,
    keys: Mapping[Output, str],
    say: Callable[[str], None],
    show_early: Callable[[Path], bool] | None = None,
) -> Iterator[tuple[Output, Outcome]]:
    """Yield each output and what became of it, `Animated`, as they are done.

    `keys`: what the outputs are made of, of those that shall have a record. `say` and `show_early` as in
    `write_animation`, where the motions are animated in this process; elsewhere lines come with the outcome.
    """
    jobs = {i: _Job(output, keys.get(output, "")) for i, output in enumerate(outputs)}
    if farm.here(len(outputs)):
        run = partial(_animate_one, say=say, show_early=show_early)
    else:  # workers may be in folders of their own
        run, asked = _animate_one, asked._replace(model=asked.model.absolute(), own=_absolute(asked.own))
        jobs = {i: job._replace(output=_placed(job.output)) for i, job in jobs.items()}
    for i, outcome in farm.map(Work(partial(_open, asked), run), jobs):
        yield outputs[i], outcome


def _absolute(own: "Options") -> "Options":
    return own if own.joints is None else own._replace(joints=own.joints.absolute())


def _placed(output: Output) -> Output:
    motion = None if output.motion is None else output.motion.absolute()
    return output._replace(motion=motion, path=output.path.absolute())


def _open(asked: Asked) -> _Opened:
    from garment_jax.model.scene_file import read_sample

    return _Opened(asked, open_model(str(asked.model), asked.wanted), read_sample(asked.model))


def _animate_one(
    opened: _Opened,
    job: _Job,
    *,
    say: Callable[[str], None] | None = None,
    show_early: Callable[[Path], bool] | None = None,
) -> Animated:
    asked, (output, key), said = opened.asked, job, []
    replacing = asked.force or bool(key and is_begun(output, key))
    if key:
        record(output, key)
    try:
        files = write_animation(
            opened.opened,
            opened.sample,
            output,
            asked.shape,
            asked.own,
            asked.wanted,
            force=replacing,
            planning=asked.planning,
            say=said.append if say is None else say,
            show_early=show_early,
        )
    except BaseException:
        if key:
            forget(output)
        raise
    if key:
        record(output, key, files)
    return Animated(files, said)
