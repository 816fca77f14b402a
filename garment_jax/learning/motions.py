"""Which motions are learnt from and which are kept back: the user's, or the package's own."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np

from garment_jax.body.joint_names import roles_of
from garment_jax.body.vary import LEGS, cut, vary_motion
from garment_jax.importers.motions import read_motion
from garment_jax.io.sequence_writer import SequenceWriter
from garment_jax.procedural.motions import MOTIONS, make_dance, make_motion
from garment_jax.procedural.scene import make_scene
from garment_jax.simulation.clips import Job
from garment_jax.simulation.command import DANCE_SEED
from garment_jax.simulation.drawn_motions import drawn_motions
from garment_jax.structs import Motion, RiggedBody

SHORTEST = 60  # frames of a piece: a window of training is 50
MANY = 4  # motions of which whole ones are kept back; of fewer, the ends
THREE = 3  # motions that one is crossed out of
END = 0.25  # part of a motion that is its end
FIGURE = 112  # frames of one figure of the package's own; fewer where there is no time for all of them


class Recorded:
    """The user's motions: some are kept back, or the end of each where there are few.

    `digest` says all that they are.
    """

    def __init__(self, motions: Mapping[str, Motion], test: Sequence[str] = ()) -> None:
        """`test` names the motions to keep back. Raises `ValueError` where it names none, or all of them."""
        names = sorted(motions)
        self.digest = _digest(motions, test)
        missing = sorted(set(test) - set(names))
        if missing:
            raise ValueError(f"--test {missing[0]}: there is no such motion; there are {', '.join(names)}.")
        if len(set(test)) == len(names):
            raise ValueError(f"--test names all of the {len(names)} motions; leave one to learn from.")
        kept = list(test)
        if not kept and len(names) >= MANY:
            count = len(names) // MANY
            kept = [names[(2 * k + 1) * len(names) // (2 * count)] for k in range(count)]
        if kept:
            self._test = {name: motions[name] for name in kept}
            self._train = {name: motions[name] for name in names if name not in kept}
            return
        self._train, self._test = {}, {}
        for name in names:
            first = round((1 - END) * len(motions[name].root))
            long = len(motions[name].root) - first >= SHORTEST
            self._train[name] = part_of(motions[name], 0, first) if long else motions[name]
            if long:
                self._test[f"{name}_end"] = part_of(motions[name], first)
        if not self._test:
            longest = max(len(motion.root) for motion in motions.values())
            raise ValueError(
                f"the longest motion has {longest} frames, and its end is too short to keep back; give one "
                f"of {round(SHORTEST / END)} or more, or several and --test NAME."
            )

    def kept_back(self, frames: int) -> dict[str, Motion]:
        """Return motions to measure on, about `frames` frames in all."""
        each = max(frames // len(self._test), SHORTEST)
        return {name: part_of(motion, 0, each) for name, motion in self._test.items()}

    def to_learn(self, frames: int, longest: int) -> dict[str, Motion]:
        """Return all motions to learn from, in pieces of `longest` frames at most."""
        return pieces(self._train, longest)

    def to_draw_from(self, frames: int, longest: int) -> list[Motion]:
        """Return motions that others are made of; three at least, where they are long enough to be cut."""
        third = -(-max(len(motion.root) for motion in self._train.values()) // THREE)
        if len(self._train) >= THREE or third < 2 * SHORTEST:
            return list(self._train.values())
        return list(pieces(self._train, third).values())


class Own:
    """The package's own motions, made for the mannequin and put on any body; there are always more."""

    def __init__(self, body: RiggedBody, place: Path, *, fps: float, seed: int) -> None:
        """`place` is a folder for motions on their way to a body with other joints than the mannequin."""
        self._mannequin = make_scene("skirt", vertices=100)
        self.digest = f"the package's own, of {fps:g} fps"
        names = self._mannequin.body.joint_names
        self._same = set(names) <= set(body.joint_names)
        self._body, self._place, self._fps, self._seed = body, place, fps, seed

    def kept_back(self, frames: int) -> dict[str, Motion]:
        """Return dances, whose order and gestures no motion to learn from has."""
        count = max(frames // 300, 1)
        return {
            f"dance_{k + 1}" if count > 1 else "dance": self._dance(frames // count, DANCE_SEED + k)
            for k in range(count)
        }

    def to_learn(self, frames: int, longest: int) -> dict[str, Motion]:
        """Return each figure, then dances that fill half of the frames: the others are drawn of them."""
        figure = min(max(frames // len(MOTIONS), SHORTEST), FIGURE)
        seconds, seed = figure / self._fps, self._seed
        body = self._body if self._same else self._mannequin.body
        made = {
            kind: self._put(make_motion(kind, body, seconds=seconds, fps=self._fps, seed=seed), kind)
            for kind in MOTIONS
        }
        dances = max((frames // 2 - len(made) * figure) // longest, 0)
        return made | {f"dancing_{k + 1:03d}": self._dance(longest, k) for k in range(dances)}

    def to_draw_from(self, frames: int, longest: int) -> list[Motion]:
        """Return motions that others are made of: all to learn from."""
        return list(self.to_learn(frames, longest).values())

    def _dance(self, frames: int, k: int) -> Motion:
        body = self._body if self._same else self._mannequin.body
        dance = make_dance(body, seconds=frames / self._fps, fps=self._fps, seed=self._seed + k)
        return self._put(dance, f"dance {k}")

    def _put(self, motion: Motion, name: str) -> Motion:
        if self._same:
            return motion
        file = self._place / f"{name}.h5"
        with SequenceWriter(file, self._mannequin, motion, encoding="none", attributes={"name": name}):
            pass
        try:
            return read_motion(file, self._body, fps=self._fps, floor=True)
        finally:
            file.unlink()


Source = Recorded | Own


def training_jobs(
    source: Source, body: RiggedBody, *, frames: int, longest: int, seed: int, workers: int = 1
) -> list[Job]:
    """Return clips to learn from of about `frames` frames: the source's, then motions drawn out of them."""
    given = source.to_learn(frames, longest)
    jobs = _until(frames, [Job(name, "train", motion) for name, motion in given.items()])
    missing = frames - sum(len(job.motion.root) for job in jobs)
    if missing < SHORTEST:
        return jobs
    count = -(-2 * missing // longest)  # most are shorter than the longest
    drawn = _drawn(
        source.to_draw_from(frames, longest), body, count, seed=seed, longest=longest, workers=workers
    )
    more = [Job(f"drawn_{k:03d}", "train", motion) for k, motion in enumerate(drawn, 1)]
    return jobs + _until(missing, [job for job in more if len(job.motion.root) >= SHORTEST])


def pieces(motions: Mapping[str, Motion], longest: int) -> dict[str, Motion]:
    """Return the motions in equal pieces of `longest` frames at most, one of each motion in turn."""
    rows = []
    for name, motion in motions.items():
        ends = np.array_split(np.arange(len(motion.root)), -(-len(motion.root) // longest))
        several = len(ends) > 1
        rows.append(
            [(f"{name}_{k:02d}" if several else name, part_of(motion, int(e[0]), int(e[-1]) + 1))
             for k, e in enumerate(ends, 1)]
        )  # fmt: skip
    return dict(pair for turn in zip_longest(*rows) for pair in turn if pair is not None)


def part_of(motion: Motion, start: int, stop: int | None = None) -> Motion:
    """Return the frames `start` to `stop` of a motion."""
    return Motion(motion.rotations[start:stop], motion.root[start:stop], motion.fps)


def with_plain_names(body: RiggedBody) -> RiggedBody:
    """Return the body with the names that variations know joints by, whatever its file calls them."""
    names = list(body.joint_names)
    for role, joint in roles_of(body.joint_names, body.parents).items():
        names[joint] = role
    return body._replace(joint_names=tuple(names))


def _digest(motions: Mapping[str, Motion], test: Sequence[str]) -> str:
    digest = hashlib.sha256(json.dumps([sorted(motions), sorted(test)]).encode())
    for name in sorted(motions):
        for array in (motions[name].rotations, motions[name].root):
            digest.update(np.ascontiguousarray(array, "<f4").tobytes())
    return digest.hexdigest()[:16]


def _until(frames: int, jobs: Sequence[Job]) -> list[Job]:
    """Return the first of `jobs` that have `frames` frames together, one at least."""
    before = np.cumsum([0, *(len(job.motion.root) for job in jobs)])
    return [job for job, count in zip(jobs, before, strict=False) if count < frames]


def _drawn(
    motions: list[Motion], body: RiggedBody, count: int, *, seed: int, longest: int, workers: int
) -> list[Motion]:
    plain = with_plain_names(body)
    if set(LEGS) <= set(plain.joint_names):
        return drawn_motions(motions, plain, count, seed=seed, longest=longest, workers=workers)
    rngs = [np.random.default_rng([seed, k]) for k in range(count)]  # legs of no known name: whole bodies
    return [
        cut(vary_motion(motions[k % len(motions)], plain, rng), longest, rng) for k, rng in enumerate(rngs)
    ]
