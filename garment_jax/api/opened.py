"""A model opened for any motions: plan the scene, choose what fits the budget, read, animate."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from garment_jax.animation.animate import Animator, Early
    from garment_jax.animation.plan import ScenePlan
    from garment_jax.animation.variants import Measured
    from garment_jax.aot_cache import Here
    from garment_jax.config import Config
    from garment_jax.model.store import Model, ModelFacts
    from garment_jax.structs import Motion, Scene


class Wanted(NamedTuple):
    """What is to run of a model; by its names `infer.py` and `garment-jax animate` have options."""

    no_column_rnn: bool = False
    no_detail: bool = False
    no_lengths: bool = False
    no_collision: bool = False
    untangle: bool = False
    preroll: int = 0
    plan: bool = False
    budget_ms: float | None = None
    lod: float | None = None


def check_wanted(asked: Wanted) -> None:
    """Raise `ValueError` for a number that means nothing, before anything is opened or measured."""
    from garment_jax.body.preroll import check_preroll

    check_preroll(asked.preroll)
    if asked.budget_ms is not None and not 0 < asked.budget_ms < math.inf:
        raise ValueError(
            f"--budget-ms {asked.budget_ms:g} is no time; give milliseconds a frame, such as 10."
        )
    if asked.lod is not None and not 0 < asked.lod < math.inf:
        raise ValueError(f"--lod {asked.lod:g} is not a size; give what a pixel covers, in millimetres.")


class Opened(NamedTuple):
    """A model that is opened for any number of motions; what they share is read and compiled once."""

    path: str
    facts: "ModelFacts"
    here: "Here"
    models: "dict[tuple[str, ...], Model]"  # by the parameters left out
    animators: "dict[tuple, Animator]"  # by scene and plan, see `animation.animate`
    adjust: "Callable[[Config], Config]"  # the model's configuration to what is asked for


def open_model(model: str, asked: Wanted | None = None) -> Opened:
    """Open a run of `train.py`, a model's folder or a shipped model by its name; parameters come later.

    `asked`: what is going to run, all by default. Raises `ValueError` or `OSError` in one sentence.
    """
    from garment_jax.aot_cache import warm_start
    from garment_jax.model.shipped import find_model

    asked = asked or Wanted()
    path, adjust = str(find_model(model)), partial(_adjusted, asked)
    here = warm_start()
    here.store.read_ahead(f"{Path(path).resolve()} {asked}")  # beside the imports that follow
    facts, whole = _facts(path)
    models = {} if whole is None else {(): whole._replace(config=adjust(whole.config))}
    return Opened(path, facts._replace(config=adjust(facts.config)), here, models, {}, adjust)


def infer_motion(
    opened: Opened,
    motion: str | Path,
    out: str | Path | None,
    asked: Wanted,
    *,
    early: "Early | None" = None,
    stop: int | None = None,
) -> Iterator[str]:
    """Animate a sequence file's motion into `out` (None: nothing is written) and yield the lines to print.

    `early` and `stop` as in `animate_file`. Raises `ValueError` or `OSError` in one sentence for what does
    not fit.
    """
    from garment_jax.animation.animate import animate_file, until
    from garment_jax.animation.plan import make_plan
    from garment_jax.io.sequence import open_sequence
    from garment_jax.io.validation import check_input
    from garment_jax.model.store import check_rate

    model, facts, budget_ms = opened.path, opened.facts, asked.budget_ms
    read = partial(read_once, opened)
    with open_sequence(motion) as sequence:
        check_input(sequence, joints=facts.config.body.motion_joints)
        scene, moves = sequence.scene, until(sequence.long_motion, stop)
        check_rate(facts, moves, Path(motion).stem)  # a plan of what would be refused helps nobody
        scene_plan = make_plan(
            facts,
            scene,
            moves,
            column_rnn=not asked.no_column_rnn,
            detail=not asked.no_detail,
            collision=not asked.no_collision,
            pixel_mm=asked.lod,
            detail_mm=None if asked.lod is None else _detail_mm(model),
        )
        name, chosen = "whole model", None
        if budget_ms is not None:
            # with a column RNN that is not wanted, too: its variants have the names of the stored table
            found = _within(budget_ms, model, read(), scene, moves, scene_plan, opened.here)
            name, scene_plan, chosen, line = found
            yield line
        if asked.plan:
            planned = _as_planned(chosen or read(), scene_plan)
            yield from _explained(planned, scene, moves, scene_plan, name, opened.here)
    if out is None:
        return
    figures = animate_file(
        chosen or read(scene_plan.leave_out),
        motion,
        out,
        preroll=asked.preroll,
        plan=scene_plan,
        store=opened.here.store,
        animators=opened.animators if chosen is None else None,
        early=early,
        stop=stop,
    )
    rate = figures["frames"] / figures["seconds"]
    took = f"{figures['frames']} frames in {figures['seconds']:.1f} s ({rate:.0f} frames/s, start included)"
    yield f"{out}: {took}"


def read_once(opened: Opened, leave_out: tuple[str, ...] = ()) -> "Model":
    """Return the model without the parameters `leave_out`, read once; the whole one serves, too."""
    from garment_jax.model.store import load_model

    known = opened.models.get(leave_out) or opened.models.get(())
    if known is None:
        read = load_model(opened.path, leave_out=leave_out)
        known = opened.models[leave_out] = read._replace(config=opened.adjust(read.config))
    return known


def _as_planned(model: "Model", plan: "ScenePlan") -> "Model":
    from garment_jax.model.store import without_column_rnn

    return model if plan.column_rnn else without_column_rnn(model)


def _facts(path: str):
    """Return what the model at `path` says of itself, and the model where it had to be read whole (a run)."""
    from garment_jax.model.store import facts_of, model_facts
    from garment_jax.training.run_directory import CHECKPOINTS

    if not (Path(path) / CHECKPOINTS).is_dir():
        return model_facts(path), None
    from garment_jax.training.pipeline import trained_model

    model = trained_model(path)
    return facts_of(model), model


def _adjusted(asked: Wanted, config: "Config") -> "Config":
    """Return a model's configuration with what is asked for beside it."""
    from garment_jax.animation.variants import lengths_off, untangled

    if asked.no_lengths:
        config = lengths_off(config)
    if asked.untangle:
        config = untangled(config)
    return config


def _detail_mm(path: str) -> float | None:
    from garment_jax.animation.variants import stored_variants

    try:
        return stored_variants(path)[1]
    except FileNotFoundError:
        return None


def _within(
    budget_ms: float,
    path: str,
    model: "Model",
    scene: "Scene",
    motion: "Motion",
    plan: "ScenePlan",
    here: "Here",
):
    """Return the name, the plan and the model of the most accurate variant that fits, and a line on it."""
    from garment_jax.animation.calibration import frame_times
    from garment_jax.animation.variants import apply_variant, choose

    rows = _rows(path, plan)
    times = frame_times(model, scene, motion, [r.name for r in rows], folder=here.folder, store=here.store)
    chosen = choose(rows, times, budget_ms)
    v, why = chosen.variant, f"does not fit the budget of {budget_ms:g} ms"
    for part in ("column_rnn", "detail", "collision"):
        if getattr(plan, part) and not getattr(v, part):
            plan = plan._replace(**{part: False}, why={**plan.why, part: why})
    if plan.lengths and not v.lengths:
        plan = plan._replace(lengths=False, why={**plan.why, "edge lengths": why})
    line = (
        f"budget {budget_ms:g} ms: {chosen.name}, {times[chosen.name]:.1f} ms a frame here, "
        f"error {chosen.error_cm:.2f} cm on the validation clip (whole model {rows[0].error_cm:.2f} cm, "
        f"{times[rows[0].name]:.1f} ms)"
    )
    return chosen.name, plan, apply_variant(model, v), line


def _rows(path: str, plan: "ScenePlan") -> "list[Measured]":
    """Return the measured variants that leave out all that the plan leaves out.

    Raises `ValueError` where none leaves out no more: collisions would be left unhandled for no lack of time.
    """
    from garment_jax.animation.variants import stored_variants

    rows, wanted = stored_variants(path)[0], (plan.column_rnn, plan.detail, plan.collision)
    if wanted not in [(row.variant.column_rnn, row.variant.detail, row.variant.collision) for row in rows]:
        names = zip(("the column RNN", "detail", "collision handling"), wanted, strict=True)
        left_out = " and ".join(name for name, kept in names if not kept)
        raise ValueError(
            f"--budget-ms: of {path} no variant without just {left_out} has been measured, so its error "
            "is not known; leave one of them in, or --budget-ms out."
        )
    return [
        row
        for row in rows
        if row.variant.detail <= plan.detail
        and row.variant.column_rnn <= plan.column_rnn
        and row.variant.collision <= plan.collision
    ]


def _explained(
    model: "Model", scene: "Scene", motion: "Motion", plan: "ScenePlan", name: str, here: "Here"
) -> list[str]:
    """Return the plan's lines, with times measured on this machine."""
    from garment_jax.animation.calibration import frame_times
    from garment_jax.animation.plan import CLEARANCE, reachable_triangles
    from garment_jax.animation.plan_report import part_costs, parts, plan_lines

    collision, detail = scene.collider is not None, "detail" in model.params
    names = parts(detail, collision)
    times = frame_times(model, scene, motion, names, folder=here.folder, store=here.store)
    costs = part_costs(times, detail=detail, collision=collision)
    margin = model.config.collision.eps + CLEARANCE
    reachable = reachable_triangles(scene, motion, margin=margin)
    return plan_lines(plan, costs, variant=name, reachable=reachable, frames=len(motion.root))
