"""Cloth in itself: the cases are green, and red for an untangling that does not keep its promises."""

from functools import lru_cache

import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.evaluation.self_intersections import self_intersections
from garment_jax.procedural.scene import make_scene
from garment_jax.stability import self_contact
from garment_jax.stability.case import LEFT_OUT
from garment_jax.stability.self_contact import Cloth, loops, make_cloth, rolled, stacked, wrapped
from tests.stability.small import reds, small_subject


@lru_cache
def cloth_of(name: str = "skirt") -> Cloth:
    return make_cloth(make_scene(name, vertices=900))


def test_they_are_green_and_the_long_one_is_left_out_by_name():
    subject = small_subject()._replace(scene=make_scene("skirt", vertices=900))
    found = self_contact.self_contact_cases(subject)
    assert reds(found.cases) == []
    assert [c.case for c in found.cases if c.verdict == LEFT_OUT] == ["50000 frames"]


def test_the_long_one(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(self_contact, "LONG", 80)
    monkeypatch.setattr(self_contact, "PERIOD", 20)
    monkeypatch.setattr(self_contact, "PIECE", 20)
    cases = list(self_contact._long(cloth_of()))
    assert reds(cases) == []
    assert "80 frames" in cases[0].case


@pytest.mark.parametrize(
    ("does", "said"),
    [
        (lambda state, V: (state, V, jnp.int32(0)), "a fold closed on itself: it says 0"),
        (lambda state, V: (state, V + 1e-3, jnp.int32(0)), "no thickness: pins move by"),
        (lambda state, V: (state, jnp.where(V > 0, V, jnp.nan), jnp.int32(0)), "no thickness: vertices"),
        (lambda state, V: (state, V, jnp.int32(9)), "a fold closed on itself: edges through faces"),
    ],
)
def test_one_that_lies_moves_or_loses_what_it_should_not_is_red(does, said):
    cloth = cloth_of()._replace(step=does)
    assert any(line.startswith(said) for line in reds(list(self_contact._shapes(cloth))))


def test_shapes_are_what_they_are_called():
    cloth = cloth_of()
    counts = [
        self_intersections(V, cloth.faces).edges
        for V in (
            loops(cloth.T, 1.6),
            loops(cloth.T, 0.95),
            stacked(cloth.T),
            wrapped(cloth.T),
            rolled(cloth.T),
        )
    ]
    assert counts[0] > 0
    assert counts[1] == 0
    assert min(counts[2:]) > 0
    assert all(np.isfinite(V).all() for V in (stacked(cloth.T), wrapped(cloth.T), rolled(cloth.T)))


def test_what_flattening_would_tangle_more_is_left_as_it_was():
    """Waves of a wound circle skirt lie in its other turns' waves: without them all turns would meet."""
    cloth = cloth_of("circle_skirt")
    V = wrapped(cloth.T)
    before = self_intersections(V, cloth.faces).edges
    state, x, left = cloth.step(self_contact.init_untangle(cloth.tables), V)
    assert before > 0
    assert np.array_equal(x, V)
    assert int(left) > 0
    assert not state.weight.any()
