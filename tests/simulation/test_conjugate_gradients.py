"""The native conjugate gradients against Newton's own, kernel by kernel, and a GPU's on one thread."""

# pyright: reportInvalidTypeForm=false

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


# what CUDA has and a CPU has not, for a block of one thread: there is no other lane to add
ONE_THREAD = """
    struct float4 { float x, y, z, w; };
    struct float3 { float x, y, z; };
    struct { int x; } threadIdx = {0}, blockDim = {1};
#define make_float4(x, y, z, w) float4{x, y, z, w}
#define make_float3(x, y, z) float3{x, y, z}
#define __shfl_xor_sync(lanes, sum, d) 0.0f
#define __syncthreads()
#define __shared__
"""


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("warm", [False, True])
def test_a_gpus_code_solves_the_same_equations_clip_by_clip(warm: bool, held: bool):
    import warp as wp

    from garment_jax.simulation import conjugate_gradients as native
    from garment_jax.simulation import conjugate_gradients_cuda as cuda
    from garment_jax.simulation.newton_cloth import make_solver

    scene = make_scene(8, 24)
    solver = make_solver(scene.garment, ClothSettings(), None)
    n, rng, clips = len(scene.garment.template), np.random.default_rng(1), 3
    diagonal = solver.pd_diags.numpy() + 50.0
    diagonal[:5] = 0.0  # pinned
    blocks = rng.normal(size=(clips, n, 3, 3)) * (rng.uniform(size=(clips, n, 1, 1)) < 0.3)
    blocks = 200 * blocks @ blocks.swapaxes(-1, -2)
    blocks[:, :5] = 0.0
    pinned = (diagonal == 0)[:, None, None]
    inverse = np.where(pinned, 0.0, np.linalg.inv(blocks + (diagonal[:, None, None] + pinned) * np.eye(3)))
    b, start = rng.normal(size=(clips, n, 3)), 1e-3 * rng.normal(size=(clips, n, 3))
    start[:, :5] = 0.0

    def arrays() -> list:
        blocky = [wp.array(a.reshape(-1, 3, 3), dtype=wp.mat33, device="cpu") for a in (blocks, inverse)]
        return [*blocky, *(wp.array(a.reshape(-1, 3), dtype=wp.vec3, device="cpu") for a in (b, start))]

    d = wp.array(diagonal, dtype=wp.float32, device="cpu")
    ours, theirs = arrays(), arrays()
    work = native.make_work(n, clips)
    native.solve(native.make_matrix(solver), d, *ours, work, iterations=20, warm=warm)
    code = cuda.HELD if held else cuda.STREAMED
    code = code.replace("threads / 32", "1")  # a whole warp at least, but here
    code = code.replace(f"EACH = {cuda.EACH}, MOST = {cuda.MOST_HELD}", f"EACH = {n + 1}, MOST = {n}")
    matrix = native.make_matrix(solver, padded=True)
    assert matrix.column.dtype == wp.uint16  # of garments as small as this one
    if not held:
        matrix = matrix._replace(column=wp.array(matrix.column.numpy(), dtype=wp.int32, device="cpu"))
    kernel = _kernel(wp, ONE_THREAD + code, matrix.column.dtype)
    wp.launch(kernel, clips, [20, int(warm), *matrix, d, *theirs, work], device="cpu")
    found, expected = theirs[-1].numpy(), ours[-1].numpy()
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4 * abs(expected).max())
    assert not found.reshape(clips, n, 3)[:, :5].any()


def _kernel(wp, code: str, index):
    """Return a kernel that runs `code` as the solver's for each clip."""

    @wp.func_native(code)
    def one(
        clip: int,
        iterations: int,
        warm: int,
        start: wp.array(dtype=wp.int32),
        column: wp.array(dtype=index),
        value: wp.array(dtype=wp.float32),
        diagonal: wp.array(dtype=wp.float32),
        contact: wp.array(dtype=wp.mat33),
        inverse: wp.array(dtype=wp.mat33),
        right: wp.array(dtype=wp.vec3),
        solution: wp.array(dtype=wp.vec3),
        work: wp.array(dtype=wp.vec4),
    ): ...

    @wp.kernel(enable_backward=False, module="unique")
    def kernel(
        iterations: int,
        warm: int,
        start: wp.array(dtype=wp.int32),
        column: wp.array(dtype=index),
        value: wp.array(dtype=wp.float32),
        diagonal: wp.array(dtype=wp.float32),
        contact: wp.array(dtype=wp.mat33),
        inverse: wp.array(dtype=wp.mat33),
        right: wp.array(dtype=wp.vec3),
        solution: wp.array(dtype=wp.vec3),
        work: wp.array(dtype=wp.vec4),
    ):
        one(
            wp.tid(),
            iterations,
            warm,
            start,
            column,
            value,
            diagonal,
            contact,
            inverse,
            right,
            solution,
            work,
        )

    return kernel
