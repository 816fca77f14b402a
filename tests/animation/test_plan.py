"""The scene plan: what is left out, why, and that free omissions change nothing."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.animation import stream
from garment_jax.animation.animate import make_animator
from garment_jax.animation.plan import CLEARANCE, make_plan, reachable_triangles
from garment_jax.animation.plan_report import part_costs, parts, plan_lines
from garment_jax.animation.reach import cloth_reach
from garment_jax.model.store import facts_of, load_model, model_facts, save_model
from garment_jax.structs import Collider, Motion, Scene
from tests.animation.tiny_model import SCENE, tiny_model
from tests.reference.scene import make_motion

MOTION = make_motion(SCENE, 18)


def apart(scene: Scene = SCENE, up: float = 3.0) -> Scene:
    """The scene with its collider's surface `up` metres above, carried by the root: no contact.

    The body's own vertices stay in the collider, without triangles: the garment's seeds lie on them.
    """
    body, collider = scene.body, scene.collider
    assert collider is not None
    cap = body.vertices[collider.cap_loop].mean(axis=0, keepdims=True)
    own = [body.vertices[collider.body_vertices], *([cap] if len(collider.cap_loop) else [])]
    moved = np.concatenate(own) + np.array([0.0, up, 0.0], np.float32)
    rigid = np.tile(np.eye(body.skin_weights.shape[1], dtype=np.float32)[0], (len(moved), 1))
    vertices = np.concatenate([body.vertices, moved]).astype(np.float32)
    body = body._replace(vertices=vertices, skin_weights=np.concatenate([body.skin_weights, rigid]))
    added = np.arange(len(vertices) - len(moved), len(vertices))
    used = np.concatenate([collider.body_vertices, added]).astype(np.int32)
    faces = (collider.faces + len(collider.body_vertices)).astype(np.int32)
    return scene._replace(body=body, collider=Collider(used, collider.cap_loop[:0], faces))


def plan_of(scene: Scene = SCENE, motion: Motion = MOTION, **options):
    return make_plan(facts_of(tiny_model()), scene, motion, **options)


def test_a_skirt_on_its_body_runs_everything():
    plan = plan_of()
    assert (plan.previous_state, plan.detail, plan.collision, plan.out_of_reach) == (True, True, True, False)
    assert plan.why["collision"] == "wanted; the cloth is long enough to touch the body"
    assert plan.leave_out == ("generative/E_gen",)
    assert plan.writes[-1] == "extra/collision_*"


def test_flags_override():
    plan = plan_of(detail=False, collision=False)
    assert (plan.detail, plan.collision, plan.out_of_reach) == (False, False, False)
    assert plan.why["detail"] == plan.why["collision"] == "not wanted"
    assert plan.leave_out == ("generative/E_gen", "detail")
    assert plan.writes == ("vertices", "extra/outside_training_range")


def test_what_is_not_there_is_off():
    facts = facts_of(tiny_model())._replace(parts=frozenset({"generative", "motion"}))
    plan = make_plan(facts, SCENE._replace(collider=None), MOTION)
    assert plan.why["detail"] == "not trained"
    assert plan.why["collision"] == "the scene has no collider"
    loose = plan_of(SCENE._replace(pins=None))
    assert loose.collision
    assert "hang on no pin" in loose.why["collision"]


def test_a_body_out_of_reach_is_left_out():
    plan = plan_of(apart())
    assert (plan.collision, plan.out_of_reach) == (False, True)
    assert plan.nearest is not None
    assert plan.nearest > CLEARANCE
    assert f"the body stays {100 * plan.nearest:.0f} cm away" in plan.why["collision"]
    reachable = reachable_triangles(apart(), MOTION, margin=0.01)
    assert reachable is not None
    assert not reachable.any()


@pytest.mark.parametrize(
    ("pixel", "moved", "runs"), [(None, 1.0, True), (1.0, None, True), (1.0, 0.6, True), (1.0, 0.4, False)]
)
def test_detail_too_fine_to_see_is_left_out(pixel, moved, runs):
    assert plan_of(pixel_mm=pixel, detail_mm=moved).detail is runs


def test_a_pixel_without_size_is_refused():
    with pytest.raises(ValueError, match="--lod 0 is not a size; give what a pixel covers"):
        plan_of(pixel_mm=0.0)


def test_parameters_that_nobody_reads_are_not_loaded_and_change_nothing(tmp_path: Path):
    folder = save_model(tiny_model(), tmp_path)
    assert model_facts(folder).parts == {"generative", "motion", "detail"}
    whole, part = load_model(folder), load_model(folder, leave_out=("generative/E_gen", "detail"))
    assert set(part.params) == {"generative", "motion"}
    assert "E_gen" not in part.params["generative"]
    a, b = (
        np.concatenate([c.V for c in make_animator(m, SCENE, detail=False, collision=False)(MOTION)])
        for m in (whole, part)
    )
    np.testing.assert_array_equal(a, b)


def stretched(monkeypatch: pytest.MonkeyPatch, stretch: float) -> None:
    """Let animations hold the cloth to another stretch than the usual one."""
    monkeypatch.setattr(stream, "cloth_reach", lambda g, p: cloth_reach(g, p, stretch=stretch))


def test_collision_out_of_reach_changes_nothing(monkeypatch: pytest.MonkeyPatch):
    stretched(monkeypatch, 4.0)  # an untrained garment knows no length
    far, model = apart(), tiny_model()
    solved = list(make_animator(model, far)(MOTION))
    left = list(make_animator(model, far, out_of_reach=True)(MOTION))
    for a, b in zip(solved, left, strict=True):
        assert not np.asarray(a.collision.steps).any()
        assert b.collision is None
        np.testing.assert_allclose(b.V, a.V, atol=1e-6, rtol=0)


def test_a_frame_that_leaves_the_bound_brings_the_solver_back(monkeypatch: pytest.MonkeyPatch):
    model = tiny_model()
    solved = np.concatenate([c.V for c in make_animator(model, SCENE)(MOTION)])
    stretched(monkeypatch, -0.9)
    chunks = list(make_animator(model, SCENE, out_of_reach=True)(MOTION))
    assert chunks[0].collision is not None
    np.testing.assert_array_equal(np.concatenate([c.V for c in chunks]), solved)


def test_the_report_adds_up():
    ms = {"no collision, no detail": 2.0, "no collision": 2.5, "whole": 7.0}
    assert parts(True, True) == tuple(ms)
    costs = part_costs(ms, detail=True, collision=True)
    assert costs == {"networks": 2.0, "detail": 0.5, "collision": 4.5}
    lines = plan_lines(
        plan_of(detail=False), costs, variant="whole model", reachable=np.arange(4) < 3, frames=1000
    )
    text = "\n".join(lines)
    assert "saves 0.50" in text
    assert "estimate: 6.5 ms a frame, 6.5 s for 1000 frames; what is left out saves 0.5 ms" in text
    assert f"3 of {plan_of().triangles} triangles" in text
    assert parts(False, True) == ("no collision, no detail", "no detail")
    without = part_costs({"no collision, no detail": 2.0, "no detail": 6.0}, detail=False, collision=True)
    assert without == {"networks": 2.0, "collision": 4.0}
