import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.evaluation.penetration import neighbour_faces
from garment_jax.stability import precision
from garment_jax.stability.case import INFO, LEFT_OUT
from garment_jax.stability.meshes import ball, cylinder
from garment_jax.stability.network_routines import rollout_routine
from garment_jax.stability.routine import Routine, errors_of
from tests.stability.small import reds, small_subject


def test_float32_keeps_every_bound_and_bfloat16_is_shown():
    found = precision.precision_cases(small_subject(), rows=(8,), frames=(10,))
    assert reds(found.cases) == []
    shown = [c for c in found.cases if c.verdict == INFO]
    assert len(shown) == 8
    assert all(c.value > 0 for c in shown)
    missing = [(c.case, c.value) for c in found.cases if c.verdict == LEFT_OUT]
    assert missing == [
        ("signed distance, size 66", "bfloat16: it needs 32 bits"),
        ("rollout", "no RUN given"),
    ]


def test_a_routine_that_loses_digits_is_red(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(precision, "laplacian", lambda V, table: jnp.sin(1e4 * V))
    monkeypatch.setattr(precision, "gru_routine", lambda frames: _square(1))
    lines = reds(precision.precision_cases(small_subject(), rows=(8,), frames=(1,)).cases)
    assert len(lines) == 1
    assert lines[0].startswith("Laplacian")


def _square(size: int) -> Routine:
    x = np.linspace(1.0, 2.0, 50 * size)
    return Routine("square", size, lambda x: x * x, (x,), 1.0, "", 1e-6)


def test_errors_are_those_of_the_type():
    errors = errors_of([_square(1), _square(2)])
    assert errors.sizes == [1, 2]
    assert all(0 < error <= 4 * 2**-24 for error in errors.single)
    assert all(2**-12 < error <= 4 * 2**-9 for error in errors.half)
    assert jnp.zeros(1).dtype == jnp.float32  # float64 is switched off again


def test_a_rollout_in_float32_is_that_in_float64():
    subject = small_subject(trained=True)
    assert subject.model is not None
    errors = errors_of([rollout_routine(subject.model, subject, 3)])
    assert 0 < errors.single[0] < 0.1  # mm
    assert errors.half[0] > 10 * errors.single[0]


def test_the_ball_is_closed_and_outward():
    vertices, faces = ball(cylinder(8))
    neighbour_faces(faces)  # raises for an open or ill-oriented surface
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = (a * np.cross(b, c)).sum() / 6
    assert 0.05 < volume < 4 / 3 * np.pi * 0.32**3
