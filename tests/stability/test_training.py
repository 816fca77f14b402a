from garment_jax.stability import training
from garment_jax.stability.case import LEFT_OUT
from garment_jax.training import loop
from tests.stability.small import reds, small_subject


def test_a_run_that_goes_wrong_says_so_and_keeps_the_last_good_state(monkeypatch):
    found = training.training_cases(small_subject())
    assert reds(found.cases) == []
    assert [c.quantity.split(" (")[0] for c in found.cases] == [
        "the run says",
        "loss of the checkpoint kept",
        "the run says",
        "the run says",
        "loss of the checkpoint kept",
    ]
    assert {curve.label for curve in found.curves} == {"raised", "broken"}
    # a loop that looks at NaN alone lets a finite leap take the place of the good state
    monkeypatch.setattr(loop, "DIVERGED", float("inf"))
    lines = reds(training.training_cases(small_subject()).cases)
    assert "60 steps, nothing noticed" in lines[0]
    assert "loss of the checkpoint kept (step 60)" in lines[1]


def test_without_motions_it_is_left_out():
    (case,) = training.training_cases(small_subject()._replace(motions=())).cases
    assert case.verdict == LEFT_OUT
