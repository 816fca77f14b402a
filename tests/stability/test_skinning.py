import jax.numpy as jnp
import pytest

from garment_jax.stability import skinning
from tests.stability.small import reds, small_subject


def test_every_case_is_green():
    found = skinning.skinning_cases(small_subject())
    assert reds(found.cases) == []
    assert len(found.cases) == 2 * 2 * len(skinning.TAUS) + 3 + 2 * len(skinning.ANGLES)
    assert {curve.plot for curve in found.curves} == {"skinning"}


@pytest.mark.parametrize(
    ("broken", "where"),
    [
        # the error is real and nothing flags it
        (lambda V, W, R, t: (V, jnp.ones(len(V))), "unskin(skin(x))"),
        (lambda V, W, R, t: (V * jnp.nan, jnp.ones(len(V))), "unskin(skin(x))"),
        # flagged everywhere, as if nothing were well posed
        (lambda V, W, R, t: (V, jnp.full(len(V), 1e4)), "is off by"),
    ],
)
def test_a_wrong_inverse_is_red(monkeypatch, broken, where):
    monkeypatch.setattr(skinning, "_unskin", broken)
    assert any(where in line for line in reds(skinning.skinning_cases(small_subject()).cases))
