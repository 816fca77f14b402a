"""What a scene can leave out, decided once for a model, a body, a motion and the wanted outputs (host).

Not in the paper. Two kinds of omissions: those that change nothing (a part that is not trained, a collider
that the cloth cannot reach, parameters that no stage reads), and those that the user allows, whose error
`garment-jax variants` has measured (`stored.py`). Parts that are off are neither imported, read nor
compiled.
"""

from typing import NamedTuple

import numpy as np

from garment_jax.animation.reach import cloth_reach, motion_gaps
from garment_jax.body.carried import carried_points
from garment_jax.model.store import ModelFacts
from garment_jax.structs import Motion, Scene

CLEARANCE = 0.01  # metres beyond the margin: float32, and the solver's own look-out


class ScenePlan(NamedTuple):
    """Which stages run, and why."""

    column_rnn: bool  # the column RNN corrects the latents
    previous_state: bool  # the last frame is read; without it, frames are decoded all at once
    detail: bool
    lengths: bool  # edges that are too short or too long come back to their lengths
    collision: bool
    out_of_reach: bool  # collision is wanted, and a distance bound says that there is none
    why: dict[str, str]  # a sentence for each of the five
    leave_out: tuple[str, ...]  # parameters that nobody reads
    triangles: int  # of the collider
    nearest: float | None  # metres between cloth and collider at least, where that decided; None elsewhere
    writes: tuple[str, ...]  # datasets of the output file


def make_plan(
    model: ModelFacts,
    scene: Scene,
    motion: Motion,
    *,
    column_rnn: bool = True,
    detail: bool = True,
    collision: bool = True,
    pixel_mm: float | None = None,
    detail_mm: float | None = None,
) -> ScenePlan:
    """Return the plan of `motion` for the model; `column_rnn`, `detail` and `collision` off count before all.

    `pixel_mm`: what a pixel covers of the garment; detail that moves the cloth by less than half of it
    (`detail_mm`, measured) is left out. Raises `ValueError` for a pixel that is not positive.
    """
    if pixel_mm is not None and not pixel_mm > 0:
        raise ValueError(f"--lod {pixel_mm:g} is not a size; give what a pixel covers, in millimetres.")
    state = model.config.motion.previous_state
    has_column_rnn, why_column_rnn = _column_rnn(model, column_rnn)
    fine, why_fine = _detail(model, detail, pixel_mm, detail_mm)
    lengths = model.config.rollout.lengths
    solve, far, nearest, why_solve = _collision(model, scene, motion, collision)
    why = {
        "column_rnn": why_column_rnn,
        "previous state": "trained with it: frame after frame"
        if state
        else "trained without it: decoded at once",
        "detail": why_fine,
        "edge lengths": "wanted" if lengths else "not wanted",
        "collision": why_solve,
    }
    unread = _unread(model, has_column_rnn, fine)
    triangles = 0 if scene.collider is None else len(scene.collider.faces)
    writes = ("vertices", "extra/outside_training_range", *(("extra/collision_*",) if solve else ()))
    return ScenePlan(
        has_column_rnn, state, fine, lengths, solve, far, why, unread, triangles, nearest, writes
    )


def _column_rnn(model: ModelFacts, wanted: bool) -> tuple[bool, str]:
    if "column_rnn" not in model.parts:
        return False, "not trained"
    if not wanted or not model.config.rollout.column_rnn:
        return False, "not wanted: latents alone move the cloth"
    return True, f"wanted: {model.config.rollout.column_rnn:.0%} of the way from the latents to it"


def _unread(model: ModelFacts, has_column_rnn: bool, fine: bool) -> tuple[str, ...]:
    """Return the parameters that no stage of the plan reads."""
    off = [
        name
        for name, on in (("detail", fine), ("column_rnn", has_column_rnn))
        if not on and name in model.parts
    ]
    return ("generative/E_gen", *off)


def _detail(
    model: ModelFacts, wanted: bool, pixel_mm: float | None, detail_mm: float | None
) -> tuple[bool, str]:
    if "detail" not in model.parts:
        return False, "not trained"
    if not wanted:
        return False, "not wanted"
    if pixel_mm is None:
        return True, "wanted"
    if detail_mm is None:
        return (
            True,
            f"wanted; how far it moves the cloth is not measured, so a pixel of {pixel_mm:g} mm says nothing",
        )
    moved = f"it moves the cloth by {detail_mm:.2g} mm, a pixel covers {pixel_mm:g} mm"
    return (False, f"too fine to see: {moved}") if 2 * detail_mm < pixel_mm else (True, f"visible: {moved}")


def _collision(
    model: ModelFacts, scene: Scene, motion: Motion, wanted: bool
) -> tuple[bool, bool, float | None, str]:
    """Return if it runs, if it is out of reach, the least distance where that decided, and why.

    Raises `ValueError` for untangling, which is part of it, without it.
    """
    untangle = model.config.collision.untangle
    if untangle and (scene.collider is None or not wanted):
        missing = "collision handling is left out" if scene.collider else "the body has no collider"
        raise ValueError(f"untangling is part of collision handling, and {missing}; leave --untangle out.")
    if scene.collider is None:
        return False, False, None, "the scene has no collider"
    if not wanted:
        return False, False, None, "not wanted"
    if untangle:
        return True, False, None, "wanted, with untangling"
    carried = carried_points(scene, collider=True)
    reach = cloth_reach(scene.garment, carried.pins)
    if reach is None:
        return (
            True,
            False,
            None,
            "wanted; parts of the cloth hang on no pin, so nothing bounds where they get",
        )
    needed = model.config.collision.eps + CLEARANCE
    gaps, inside = motion_gaps(reach, carried, scene, motion, stop_below=needed)
    nearest = float(gaps.min())
    if inside or nearest < needed:
        return True, False, None, "wanted; the cloth is long enough to touch the body"
    return (
        False,
        True,
        nearest,
        f"out of reach: the body stays {100 * nearest:.0f} cm away from where the cloth can get",
    )


def reachable_triangles(scene: Scene, motion: Motion, *, margin: float) -> np.ndarray | None:
    """Return which of the collider's triangles the cloth can get within `margin` metres of, `[f]`.

    None where there is no collider, or no bound (a part that hangs on no pin).
    """
    if scene.collider is None:
        return None
    carried = carried_points(scene, collider=True)
    reach = cloth_reach(scene.garment, carried.pins)
    if reach is None:
        return None
    return motion_gaps(reach, carried, scene, motion)[0] < margin
