"""The stiff and the deep cases, which share one compiled solve."""

from types import SimpleNamespace

import numpy as np
import pytest

from garment_jax.postprocess.collision import Outcome
from garment_jax.stability import contact, deep, stiff
from garment_jax.stability.case import GREEN, LEFT_OUT, RED
from garment_jax.stability.subject import Subject
from tests.stability.small import reds, small_subject


def test_stiff_cases_are_green_and_the_long_one_is_left_out_by_name():
    found = stiff.stiff_cases(small_subject())
    assert reds(found.cases) == []
    assert [c.case for c in found.cases if c.verdict == LEFT_OUT] == ["100000 vertices"]
    before = next(c.quantity for c in found.cases if c.case == "Laplacian × 1")
    assert before == "deepest after (before: 10 mm)"


def armless() -> Subject:
    """Return the subject with a body that names no arm: one solve fewer to compile."""
    scene = small_subject().scene
    names = tuple(name.replace("LeftArm", "Left arm") for name in scene.body.joint_names)
    return small_subject()._replace(scene=scene._replace(body=scene.body._replace(joint_names=names)))


def test_deep_cases_are_green_and_what_the_body_lacks_is_left_out_by_name():
    found = deep.deep_cases(armless())
    assert reds(found.cases) == []
    left_out = [(c.case, c.value) for c in found.cases if c.verdict == LEFT_OUT]
    assert left_out == [("arm in the hip", "the body names no LeftArm")]
    assert any(c.case == "cloth between crossing legs" for c in found.cases)
    assert not any("between crossing parts" in c.quantity for c in found.cases)  # nothing stays between them


def test_a_solver_that_does_nothing_and_says_all_is_well_is_red(monkeypatch: pytest.MonkeyPatch):
    class Nothing:
        outcome = Outcome.CONVERGED

        def __init__(self, V: np.ndarray) -> None:
            self.V = V

    monkeypatch.setattr(contact, "_resolve", lambda V, *_: Nothing(V))
    lines = reds(deep.deep_cases(armless()).cases)
    assert any("5 cm into the hip: deepest after" in line for line in lines)
    assert any("5 cm into the hip: the solver says CONVERGED" in line for line in lines)


@pytest.mark.parametrize("eps", [1e-3, 1e-2, 4e-2])
def test_a_solver_that_leaves_out_the_margin_and_says_all_is_well_is_red(
    eps, monkeypatch: pytest.MonkeyPatch
):
    """Its cloth is outside everywhere, but a hundredth of a millimetre, not `eps`."""
    made = contact.make_contact(small_subject().scene)
    n = len(made.T)
    monkeypatch.setattr(contact, "_resolve", lambda V, *_: SimpleNamespace(V=V, outcome=Outcome.CONVERGED))
    monkeypatch.setattr(contact, "_measure", lambda *_: (np.full(n, 1e-5), np.zeros(n, bool)))
    solve = contact.solve(made, made.T, eps=eps)
    assert solve.short == pytest.approx(1e3 * (0.95 * eps - 1e-5), rel=1e-3)
    assert [c.verdict for c in contact.contact_cases("g", "c", solve)] == [GREEN, RED]


@pytest.mark.parametrize(
    ("changes", "verdicts"),
    [
        ({}, [GREEN, GREEN]),
        ({"after": 0.2}, [RED, RED]),
        ({"short": 0.3}, [GREEN, RED]),
        ({"after": 12.0, "outcome": Outcome.STILL_INSIDE}, [RED, GREEN]),
        ({"after": 9.0, "outcome": Outcome.STILL_INSIDE}, [GREEN, GREEN]),
        ({"after": 9.0, "outcome": Outcome.MARGIN_MISSED}, [RED, RED]),
        ({"after": np.nan, "short": np.nan, "outcome": Outcome.NOT_FINITE}, [RED, GREEN]),
    ],
)
def test_what_is_promised_of_a_solve(changes, verdicts):
    good = contact.Solve(np.zeros((1, 3)), 10.0, 0.0, 0, 0.0, Outcome.CONVERGED)
    assert [c.verdict for c in contact.contact_cases("g", "c", good._replace(**changes))] == verdicts


def test_without_a_collider_both_groups_are_left_out():
    bare = small_subject()._replace(scene=small_subject().scene._replace(collider=None))
    for group in (stiff.stiff_cases, deep.deep_cases):
        assert [(c.verdict, c.value) for c in group(bare).cases] == [(LEFT_OUT, "there is no collider")]
