"""Many predictions measured on a farm."""

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from garment_jax.evaluation.command import evaluate_files
from garment_jax.farm.work import Farm, Outcome, Work
from garment_jax.progress import FrameProgress


class Pair(NamedTuple):
    """A prediction and what it is measured against."""

    pred: Path
    truth: Path
    again: Path | None = None  # a second simulation of the truth's motion


class _How(NamedTuple):
    every: int  # slow metrics on every N-th frame
    show: bool  # frames' progress, where no other process has the line


def evaluate_many(pairs: Sequence[Pair], farm: Farm, *, every: int) -> Iterator[tuple[int, Outcome]]:
    """Yield the number of each pair and its figures, as of `evaluate_files`, as they are done."""
    how = _How(every, show=farm.here(len(pairs)))
    jobs = dict(enumerate(pairs)) if how.show else {i: _placed(pair) for i, pair in enumerate(pairs)}
    for i, outcome in farm.map(Work(partial(_itself, how), _evaluate), jobs):
        if not outcome.error:
            named = {"prediction": pairs[i].pred, "truth": pairs[i].truth, "again": pairs[i].again}
            outcome.value.update({key: str(named[key]) for key in named if key in outcome.value})
        yield i, outcome


def _placed(pair: Pair) -> Pair:
    """Return a pair as workers find it, which may be in folders of their own."""
    return Pair(*(None if path is None else path.absolute() for path in pair))  # type: ignore[arg-type]


def _itself(how: _How) -> _How:
    return how


def _evaluate(how: _How, pair: Pair) -> dict[str, Any]:
    with FrameProgress(pair.pred.stem) if how.show else nullcontext() as progress:
        if progress:
            progress.say("measuring")
        return evaluate_files(pair.pred, pair.truth, every=how.every, again=pair.again, progress=progress)
