"""Extreme motion through a trained model: finite, still cloth, and soon itself again.

What is measured is what `infer.py` writes, collision handling and pins included.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from garment_jax.animation.animate import animate, training_range
from garment_jax.body.motion_features import chosen_joints
from garment_jax.body.root_frame import heading, to_root
from garment_jax.evaluation.cloth import rest_lengths
from garment_jax.geometry.boundary import hem_vertices
from garment_jax.geometry.topology import unique_edges
from garment_jax.io.validation import check_motion
from garment_jax.model.store import Model, template_for
from garment_jax.stability.case import Case, Curve, Findings, at_most, info, left_out, refused
from garment_jax.stability.extreme_motions import calmest_pose, extreme_motions, looped
from garment_jax.stability.script import HOLD, Part, make_script
from garment_jax.stability.subject import Subject
from garment_jax.structs import Garment, Motion

GROUP = "extreme motion"
STRAIN = 30.0  # per cent, 99th percentile over the edges of a frame
RECOVERED = 60  # frames after the motion has calmed down
# Simulated cloth hangs elsewhere after a motion than where the same pose, reached slowly, had it: by up to
# 0.173 of its length, its hem 0.022 of it higher or lower (experiments/hysteresis.py, six clips).
NORMAL, NORMAL_HEM = 0.175, 0.0225  # of the garment's length: RMSE, change of the hem's mean height
DRIFT_CM = 1.0  # RMSE between a frozen pose's or a loop's early and late garments
SETTLED = 90  # frames after which a frozen pose's garment hangs
FORGOTTEN = 2  # cycles after which a loop's garment has forgotten how it began
SAMPLES = 8  # phases of the loop that are compared


class Watched(NamedTuple):
    """What was measured of every frame of a long rollout."""

    bad: np.ndarray  # [t] numbers that are not finite
    strain: np.ndarray  # [t] |length / rest - 1|, 99th percentile over edges, per cent
    stretch: np.ndarray  # [t] the same of lengthened edges alone: short ones are what blurred folds leave
    apart: np.ndarray  # [t] cm, RMSE from the calm pose's garment; NaN before it is known
    hem: np.ndarray  # [t] cm, mean height of the hem above the root; of the whole garment where it has no hem
    kept: dict[int, np.ndarray]  # frame -> V [n, 3] metres, root frame


def extreme_cases(subject: Subject, *, collision: bool = True) -> Findings:
    """Return the cases of extreme motion, or why they are left out."""
    why = why_no_rollout(subject)
    if why or subject.model is None:
        return Findings([left_out(GROUP, "all rollouts", why)])
    model = subject.model
    calm = calmest_pose(subject.motions, subject.scene.body)
    joints = chosen_joints(subject.scene.body, model.config.body.motion_joints)
    parts = extreme_motions(subject, calm, joints)
    motion, places = make_script(calm, parts)
    # frames whose garments are compared: the reference, the frozen pose's, the loop's
    frozen, loop = places[-2], places[-1]
    period = looped(subject)[1]
    early, late = _same_phases(loop, period)
    keep = {places[0].end - 1, frozen.start + SETTLED, frozen.stop - 1, *early, *late}
    seen = watch(model, subject, motion, keep, reference=places[0].end - 1, collision=collision)
    frames = f"all {len(motion.root)} frames"
    cases = [at_most(GROUP, frames, "numbers that are not finite", seen.bad.sum(), 0.0, "")]
    length, before = 100.0 * garment_length(subject.scene.garment), seen.hem[places[0].end - 1]
    cases += [case for place in places for case in _part_cases(place, seen, length, before)]
    outside, _ = training_range(model, subject.scene, motion)
    worst = max(places, key=lambda p: outside[p.start : p.stop].max())
    furthest = float(outside[worst.start : worst.stop].max())
    cases.append(info(GROUP, worst.name, "farthest outside the training range", furthest, "ranges"))
    pairs = ((frozen, [frozen.start + SETTLED], [frozen.stop - 1]), (loop, early, late))
    for place, a, b in pairs:
        drift = max(_rmse_cm(seen.kept[i], seen.kept[j]) for i, j in zip(a, b, strict=True))
        cases.append(at_most(GROUP, place.name, "drift, early to late", drift, DRIFT_CM, "cm RMSE"))
    return Findings(cases + _refusals(model, subject, motion), _curves(places, seen))


def why_no_rollout(subject: Subject) -> str:
    """Return why there can be no rollout; empty where there can."""
    if subject.model is None:
        return "no RUN given"
    if not subject.motions:
        return "no motions: the body lacks the joints of the embedded ones; give --clips"
    try:
        template_for(subject.model, subject.scene, subject.name)
    except ValueError as error:
        return str(error)
    fps = {motion.fps for _, motion in subject.motions}
    return "" if len(fps) == 1 else f"the clips have several frame rates ({sorted(fps)})"


def watch(
    model: Model, subject: Subject, motion: Motion, keep: set[int], *, reference: int, collision: bool
) -> Watched:
    """Return the figures of every frame; only the frames `keep` stay in memory.

    From frame `reference` on each frame is also compared with that one.
    """
    garment, t = subject.scene.garment, len(motion.root)
    edges = unique_edges(garment.faces)
    rest = rest_lengths(garment.template, edges)
    seen = Watched(np.zeros(t), np.zeros(t), np.zeros(t), np.full(t, np.nan), np.zeros(t), {})
    hem = lowest_border(subject)
    yaw, done = heading(motion.rotations[:, 0]), 0
    for piece in animate(model, subject.scene, motion, collision=collision):
        frames = slice(done, done + len(piece.V))
        V = to_root(piece.V.astype(np.float64), motion.root[frames], yaw[frames])
        seen.bad[frames] = (~np.isfinite(V)).sum(axis=(1, 2))
        change = signed_strain(V, edges, rest)
        seen.strain[frames] = np.percentile(np.abs(change), 99, axis=1)
        seen.stretch[frames] = np.percentile(np.maximum(change, 0.0), 99, axis=1)
        seen.hem[frames] = 100.0 * V[:, hem, 1].mean(axis=1)
        seen.kept.update({k: V[k - done].copy() for k in keep if frames.start <= k < frames.stop})
        if reference in seen.kept:
            seen.apart[frames] = [_rmse_cm(v, seen.kept[reference]) for v in V]
        done = frames.stop
    return seen


def lowest_border(subject: Subject) -> np.ndarray:
    """Return the vertices whose height says whether the garment hangs: the hem's, else all of them."""
    garment, pins = subject.scene.garment, subject.scene.pins
    try:
        return hem_vertices(garment.template, garment.faces, None if pins is None else pins.vertices)
    except ValueError:
        return np.arange(len(garment.template))


def signed_strain(V: np.ndarray, edges: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Return length / rest - 1 of every edge in per cent, `[t, e]`; its size is `cloth.edge_strain`."""
    return 100.0 * (np.linalg.norm(V[:, edges[:, 1]] - V[:, edges[:, 0]], axis=-1) / rest - 1.0)


def garment_length(garment: Garment) -> float:
    """Return how far the template hangs down, metres: its vertical extent."""
    return float(np.ptp(garment.template[:, 1].astype(np.float64)))


def _rmse_cm(a: np.ndarray, b: np.ndarray) -> float:
    return 100.0 * float(np.sqrt(np.square(a - b).sum(axis=-1).mean()))


def _same_phases(loop: Part, period: int) -> tuple[list[int], list[int]]:
    """Return frames of an early cycle of the loop and of its last whole one, phase by phase."""
    cycles = (loop.stop - loop.start) // period
    phases = [loop.start + k * period // SAMPLES for k in range(SAMPLES)]
    first = min(FORGOTTEN, cycles - 2)
    return [f + first * period for f in phases], [f + (cycles - 1) * period for f in phases]


def _part_cases(part: Part, seen: Watched, length: float, hem: float) -> list[Case]:
    """Return the cases of one part: strain, stretch, and how soon after it all is in its normal range again.

    Normal is finite, within `STRAIN`, within `NORMAL` of the garment of the calm pose reached slowly and
    with the hem within `NORMAL_HEM` of its height `hem` there (cm); `length` of the garment in cm.
    """
    frames, calm = slice(part.start, part.end), slice(part.calm, part.end)
    cases = [
        at_most(
            GROUP, part.name, "edge strain, p99, mean of frames", seen.strain[frames].mean(), STRAIN, "%"
        ),
        at_most(GROUP, part.name, "stretch, p99, worst frame", seen.stretch[frames].max(), STRAIN, "%"),
    ]
    if not np.isfinite(seen.apart[calm]).any() and not seen.bad[frames].any():
        return cases  # before there is anything to compare with
    tests = {
        "shape": seen.apart[calm] <= NORMAL * length,
        "hem": np.abs(seen.hem[calm] - hem) <= NORMAL_HEM * length,
        "strain": (seen.strain[calm] <= STRAIN) & (seen.stretch[calm] <= STRAIN) & (seen.bad[calm] == 0),
    }
    for name, normal in tests.items():
        quantity = f"{name} back to normal after"
        cases.append(at_most(GROUP, part.name, quantity, _frames_until(normal), RECOVERED, "frames"))
    return cases


def _frames_until(normal: np.ndarray) -> float:
    """Return after how many frames `normal` `[k]` holds to the end."""
    away = np.flatnonzero(~normal)
    return float(away[-1] + 1) if len(away) else 0.0


def _refusals(model: Model, subject: Subject, motion: Motion) -> list[Case]:
    """Return the cases of motions that must not be animated at all."""
    short = Motion(motion.rotations[:10], motion.root[:10], motion.fps)

    def attempt(fps: float):
        return lambda: next(animate(model, subject.scene, short._replace(fps=fps), collision=False))

    rates = [fps for fps in (15.0, 120.0) if abs(fps / model.fps - 1) > 0.1]
    cases = [
        refused(
            GROUP, f"a motion at {fps:g} fps for a {model.fps:g} fps model", attempt(fps), ["fps", "resample"]
        )
        for fps in rates
    ]
    root = short.root.copy()
    root[5:] += [5.0, 0.0, 0.0]
    jump = short._replace(root=root)
    teleport = refused(
        GROUP, "a file whose root jumps 5 m", lambda: check_motion(jump, "clip"), ["m/s", "jump"]
    )
    return [*cases, teleport]


def _curves(places: Sequence[Part], seen: Watched) -> list[Curve]:
    """Return the strain over each part, and the way back to normal after it."""
    curves = []
    for part in places:
        strain = seen.strain[part.start : part.end]
        every = max(len(strain) // 2000, 1)
        curves.append(
            Curve("strain", part.name, list(range(0, len(strain), every)), strain[::every].tolist())
        )
        back = seen.apart[part.calm : part.end]
        if np.isfinite(back).any():
            curves.append(Curve("recovery", part.name, list(range(HOLD)), back.tolist()))
    return curves
