"""Rollouts by local dynamics: chunks, settling, plan, variants, and what is left out."""

import sys

import numpy as np
import pytest

from garment_jax.dynamics.pose import BodyFrame
from garment_jax.rollout.animate import make_animator
from garment_jax.rollout.dynamics import make_dynamics_rollout, roll_clip
from garment_jax.rollout.model import facts_of, without_dynamics
from garment_jax.rollout.plan import make_plan
from garment_jax.rollout.plan_report import part_costs, parts
from garment_jax.rollout.variants import VARIANTS, apply_variant, variants_of
from tests.reference.tiny_dynamics import dynamic_model, frames, hanging, motion, params, tables
from tests.rollout.tiny_model import CONFIG, SCENE, inputs_of, template, tiny_model


def rolled(chunk: int, settling: int = 5, t: int = 23) -> np.ndarray:
    roll = make_dynamics_rollout(tables(), template(), dynamic_model().config)
    M = inputs_of(motion(t)).x.M
    pieces = list(roll_clip(roll, params(), hanging().V[0], frames(t), M, chunk=chunk, settling=settling))
    assert [start for start, _ in pieces] == list(range(0, t, chunk))
    assert all(V.shape == (chunk, *hanging().V.shape[1:]) for _, V in pieces)
    return np.concatenate([V for _, V in pieces])[:t]


def test_chunked_is_whole():
    whole = rolled(40)
    for chunk in (3, 8, 23):
        np.testing.assert_allclose(rolled(chunk), whole, atol=1e-5)
    assert np.abs(whole[-1] - whole[0]).max() > 0.005


def test_settling_is_the_first_pose_held():
    t, first = 12, 7
    body, M = frames(t), inputs_of(motion(t)).x.M
    still = BodyFrame(*(np.repeat(leaf[:1], first, axis=0) for leaf in body))
    longer = BodyFrame(*(np.concatenate([a, b]) for a, b in zip(still, body, strict=True)))
    roll = make_dynamics_rollout(tables(), template(), dynamic_model().config)
    V = hanging().V[0]
    M_longer = np.concatenate([np.repeat(M[:1], first, axis=0), M])
    shown = np.concatenate(
        [v for _, v in roll_clip(roll, params(), V, longer, M_longer, chunk=8, settling=0)]
    )
    hidden = np.concatenate([v for _, v in roll_clip(roll, params(), V, body, M, chunk=8, settling=first)])
    np.testing.assert_allclose(hidden[:t], shown[first : first + t], atol=1e-5)


def test_the_animator_moves_by_dynamics_unless_they_are_taken_away():
    V, other, codes = (
        np.concatenate([c.V for c in make_animator(m, SCENE, collision=False)(motion(20))])
        for m in (dynamic_model(), without_dynamics(dynamic_model()), tiny_model())
    )
    assert np.isfinite(V).all()
    assert V.shape == codes.shape
    np.testing.assert_array_equal(other, codes)
    assert np.abs(V - codes).max() > 0.01


def test_a_model_of_dynamics_alone_animates():
    model = dynamic_model()._replace(params={"dynamics": params()})
    alone, beside = (
        np.concatenate([c.V for c in make_animator(m, SCENE, collision=False)(motion(9))])
        for m in (model, dynamic_model())
    )
    np.testing.assert_array_equal(alone, beside)
    with pytest.raises(ValueError, match="only local dynamics"):
        without_dynamics(model)
    with pytest.raises(ValueError, match="only local dynamics"):
        make_plan(facts_of(model), SCENE, motion(5), dynamics=False)


def test_the_plan_reads_the_dynamics_alone():
    plan = make_plan(facts_of(dynamic_model()), SCENE, motion(5))
    assert plan.dynamics
    assert not plan.detail
    assert plan.previous_state
    assert plan.leave_out == ("detail", "generative", "motion")
    assert plan.why["dynamics"] == "in place of the codes"
    off = make_plan(facts_of(dynamic_model()), SCENE, motion(5), dynamics=False)
    assert not off.dynamics
    assert off.detail
    assert off.leave_out == ("generative/E_gen", "dynamics")
    untrained = make_plan(facts_of(tiny_model()), SCENE, motion(5))
    assert not untrained.dynamics
    assert untrained.why["dynamics"] == "not trained: codes move the cloth"


def test_variants_of_a_model_with_dynamics():
    names = variants_of(dynamic_model().params)
    assert list(names)[:3] == ["whole", "10 solver steps", "no collision"]
    assert len(names) == 3 + len(VARIANTS)
    assert all(
        "dynamics" not in apply_variant(dynamic_model(), v).params
        for v in names.values()
        if not (v.dynamics or v.rank)
    )
    assert variants_of(tiny_model().params) == VARIANTS
    assert parts(False, True, True) == ("no collision", "whole")
    costs = part_costs({"no collision": 3.0, "whole": 5.0}, detail=False, collision=True, dynamics=True)
    assert costs == {"networks": 3.0, "collision": 2.0}


def test_codes_do_not_import_the_dynamics(monkeypatch: pytest.MonkeyPatch):
    for name in [name for name in sys.modules if name.startswith("garment_jax.dynamics")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "garment_jax.rollout.dynamics", raising=False)
    make_animator(tiny_model(), SCENE, collision=False)
    assert not any(name.startswith("garment_jax.dynamics") for name in sys.modules)
    assert CONFIG.dynamics.steps == 0
