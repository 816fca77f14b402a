"""The native conjugate gradients against Newton's own, launched kernel by kernel."""

import numpy as np
import pytest

from garment_jax.simulation.settings import ClothSettings
from garment_jax.simulation.start import ClothState, canonical_motion
from tests.reference.scene import make_scene

newton = pytest.importorskip("newton")


@pytest.mark.parametrize("warm", [False, True])
@pytest.mark.parametrize("iterations", [1, 20])
def test_they_agree_with_newtons(warm: bool, iterations: int):
    import warp as wp

    from garment_jax.simulation.newton_cloth import NewtonCloth

    scene = make_scene(8, 24)
    cloth = NewtonCloth(scene, ClothSettings())
    rest = ClothState(scene.garment.template - scene.body.joints[0], 0 * scene.garment.template)
    list(cloth.frames(canonical_motion(scene.body, 2, 30.0), rest))  # fills the diagonals
    solver, n, rng = cloth._solver, len(scene.garment.template), np.random.default_rng(0)
    hessians = rng.normal(size=(n, 3, 3)) * (rng.uniform(size=(n, 1, 1)) < 0.3)
    solver.collision.contact_hessian_diags.assign(200 * hessians @ hessians.transpose(0, 2, 1))
    b = wp.array(rng.normal(size=(n, 3)), dtype=wp.vec3, device="cpu")
    start = 1e-3 * rng.normal(size=(n, 3))
    found = []
    theirs = type(newton.solvers.SolverStyle3D(cloth._model).linear_solver)(n, "cpu")
    for linear in (solver.linear_solver, theirs):
        x = wp.array(start, dtype=wp.vec3, device="cpu")
        matrix, diagonal, inverse = solver.pd_non_diags, solver.static_A_diags, solver.inv_A_diags
        multiply = solver.collision.hessian_multiply
        linear.solve(matrix, diagonal, x if warm else None, b, inverse, x, iterations, multiply)
        found.append(x.numpy().copy())
    np.testing.assert_allclose(found[0], found[1], rtol=1e-3, atol=1e-4 * abs(found[1]).max())
