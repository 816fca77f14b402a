"""Newton's conjugate gradients in one native function: five to ten times as fast on a CPU.

The engine's own solver launches seven small kernels an iteration, some 14,000 a frame, and each costs
more Python than arithmetic. Here one call runs the same iterations: on a CPU on padded vectors of four
floats, which the compiler turns into vector instructions; on a GPU every clip has a block of threads, which
wait for each other at the sums and for no other clip, and hold all vectors while they fit. Sums are taken in
another order: equal but for rounding.
"""

# pyright: reportInvalidTypeForm=false, reportMissingImports=false

from typing import Any, NamedTuple, no_type_check

import numpy as np

from garment_jax.simulation.conjugate_gradients_cuda import HELD, MOST_HELD, STREAMED, THREADS
from garment_jax.simulation.engine import wp

_SOLVE_CPU = """
    typedef float f4 __attribute__((vector_size(16)));
    struct block {
        f4 x, y, z;  // columns
        f4 times(f4 v) const { return x * v[0] + y * v[1] + z * v[2]; }
    };
    const int n = start.shape[0] - 1;
    const long first = (long)clip * n;
    const int* at = start.data;
    const int* j = column.data;
    const float* a = value.data;
    f4* x = (f4*)work.data + 10 * first;
    f4 *r = x + n, *p = r + n, *Ap = p + n;
    block *A = (block*)(Ap + n), *M = A + n;  // diagonal blocks, and the preconditioner
    auto inner = [](f4 s) { return s[0] + s[1] + s[2]; };
    auto ratio = [](float s, float t) { return t > 1e-30f || t < -1e-30f ? s / t : 0.0f; };
    auto multiply = [=](f4* v, int i) {
        f4 sum = A[i].times(v[i]);
        for (int k = at[i]; k < at[i + 1]; ++k) sum += a[k] * v[j[k]];
        return sum;
    };
    for (int i = 0; i < n; ++i) {
        const auto &h = contact.data[first + i].data, &m = inverse.data[first + i].data;
        const float d = diagonal.data[i];
        A[i] = {{h[0][0] + d, h[1][0], h[2][0], 0}, {h[0][1], h[1][1] + d, h[2][1], 0},
                {h[0][2], h[1][2], h[2][2] + d, 0}};
        M[i] = {{m[0][0], m[1][0], m[2][0], 0}, {m[0][1], m[1][1], m[2][1], 0},
                {m[0][2], m[1][2], m[2][2], 0}};
        const auto &b = right.data[first + i], &s = solution.data[first + i];
        r[i] = f4{b[0], b[1], b[2], 0};
        x[i] = warm ? f4{s[0], s[1], s[2], 0} : f4{0, 0, 0, 0};
    }
    f4 sum = {0, 0, 0, 0};
    for (int i = 0; i < n; ++i) {
        if (warm) r[i] -= multiply(x, i);
        p[i] = M[i].times(r[i]);
        sum += r[i] * p[i];
    }
    float rz = inner(sum);
    for (int step = 0; step < iterations; ++step) {
        sum = f4{0, 0, 0, 0};
        for (int i = 0; i < n; ++i) {
            Ap[i] = multiply(p, i);
            sum += p[i] * Ap[i];
        }
        const float alpha = ratio(rz, inner(sum)), before = rz;
        sum = f4{0, 0, 0, 0};
        for (int i = 0; i < n; ++i) {
            x[i] += alpha * p[i];
            r[i] -= alpha * Ap[i];
            Ap[i] = M[i].times(r[i]);  // no longer needed: takes the preconditioned residual
            sum += r[i] * Ap[i];
        }
        rz = inner(sum);
        const float beta = ratio(rz, before);
        for (int i = 0; i < n; ++i) p[i] = Ap[i] + beta * p[i];
    }
    for (int i = 0; i < n; ++i) solution.data[first + i] = wp::vec3(x[i][0], x[i][1], x[i][2]);
"""
_SOLVE = f"#ifdef __CUDA_ARCH__\n{STREAMED}\n#else\n{_SOLVE_CPU}\n#endif\n"
_HELD = f"#ifdef __CUDA_ARCH__\n{HELD}\n#endif\n"  # launched on a GPU alone
_WORK = 10  # vectors of four per vertex: x, r, p, Ap and two blocks of three columns


@no_type_check
@wp.func_native(_SOLVE)
def _solve(
    clip: int,
    iterations: int,
    warm: int,
    start: wp.array(dtype=wp.int32),
    column: wp.array(dtype=wp.int32),
    value: wp.array(dtype=wp.float32),
    diagonal: wp.array(dtype=wp.float32),
    contact: wp.array(dtype=wp.mat33),
    inverse: wp.array(dtype=wp.mat33),
    right: wp.array(dtype=wp.vec3),
    solution: wp.array(dtype=wp.vec3),
    work: wp.array(dtype=wp.vec4),
): ...


@no_type_check
@wp.kernel(enable_backward=False, launch_bounds=THREADS)
def _solve_kernel(
    threads: int,
    iterations: int,
    warm: int,
    start: wp.array(dtype=wp.int32),
    column: wp.array(dtype=wp.int32),
    value: wp.array(dtype=wp.float32),
    diagonal: wp.array(dtype=wp.float32),
    contact: wp.array(dtype=wp.mat33),
    inverse: wp.array(dtype=wp.mat33),
    right: wp.array(dtype=wp.vec3),
    solution: wp.array(dtype=wp.vec3),
    work: wp.array(dtype=wp.vec4),
):
    clip = wp.tid() // threads
    _solve(clip, iterations, warm, start, column, value, diagonal, contact, inverse, right, solution, work)


@no_type_check
@wp.func_native(_HELD)
def _solve_held(
    clip: int,
    iterations: int,
    warm: int,
    start: wp.array(dtype=wp.int32),
    column: wp.array(dtype=wp.uint16),
    value: wp.array(dtype=wp.float32),
    diagonal: wp.array(dtype=wp.float32),
    contact: wp.array(dtype=wp.mat33),
    inverse: wp.array(dtype=wp.mat33),
    right: wp.array(dtype=wp.vec3),
    solution: wp.array(dtype=wp.vec3),
): ...


@no_type_check
@wp.kernel(enable_backward=False, launch_bounds=THREADS)
def _solve_held_kernel(
    threads: int,
    iterations: int,
    warm: int,
    start: wp.array(dtype=wp.int32),
    column: wp.array(dtype=wp.uint16),
    value: wp.array(dtype=wp.float32),
    diagonal: wp.array(dtype=wp.float32),
    contact: wp.array(dtype=wp.mat33),
    inverse: wp.array(dtype=wp.mat33),
    right: wp.array(dtype=wp.vec3),
    solution: wp.array(dtype=wp.vec3),
):
    clip = wp.tid() // threads
    _solve_held(clip, iterations, warm, start, column, value, diagonal, contact, inverse, right, solution)


class Matrix(NamedTuple):
    """What is off the diagonal of the solver's matrix, the same for every clip of a garment."""

    start: Any  # [n + 1] first entry of each row
    column: Any  # of each entry; on a GPU `[w n]`: every row's first, every row's second, ...
    value: Any


def make_matrix(solver: Any, device: Any = "cpu", *, padded: bool | None = None) -> Matrix:
    """Return the matrix of a `SolverStyle3D` on the CPU for `device`; `padded`, as a GPU reads it, or not."""
    padded = wp.get_device(device).is_cuda if padded is None else padded
    count, entries = solver.pd_non_diags.num_nz.numpy(), solver.pd_non_diags.nz_ell.numpy()
    used = np.arange(len(entries))[None] < count[:, None]
    held = padded and len(count) <= MOST_HELD  # then the matrix is what an iteration reads
    column, value = entries["column_index"].T, entries["value"].T
    if padded:  # neighbouring threads read neighbouring numbers; what is padded is 0
        width = max(int(count.max(initial=0)), 1)
        column = np.where(used, column, 0)[:, :width].T.ravel()
        value = np.where(used, value, 0.0)[:, :width].T.ravel()
    else:
        column, value = column[used], value[used]
    return Matrix(
        wp.array(np.append(0, np.cumsum(count)), dtype=wp.int32, device=device),
        wp.array(column, dtype=wp.uint16 if held else wp.int32, device=device),
        wp.array(value, dtype=wp.float32, device=device),
    )


def make_work(n: int, clips: int = 1, device: Any = "cpu") -> Any:
    """Return the memory that `solve` needs for `clips` clips of `n` vertices."""
    held = _held(n, device)
    return wp.zeros(1 if held else _WORK * n * clips, dtype=wp.vec4, device=device)


def solve(
    matrix: Matrix,
    diagonal: Any,
    contact: Any,
    inverse: Any,
    right: Any,
    solution: Any,
    work: Any,
    *,
    iterations: int,
    warm: bool,
) -> None:
    """Solve (matrix + diagonal + contact) x = right for each clip, begun from `solution` if `warm`.

    `diagonal` `[n]` serves all clips; `contact` and `inverse`, the blocks of the preconditioner, `right` and
    `solution` hold one clip after the other, `[clips n]`.
    """
    n, device = len(diagonal), solution.device
    threads = THREADS if device.is_cuda else 1
    inputs = [threads, iterations, int(warm), *matrix, diagonal, contact, inverse, right, solution]
    held = _held(n, device)
    kernel, inputs = (_solve_held_kernel, inputs) if held else (_solve_kernel, [*inputs, work])
    wp.launch(kernel, dim=len(solution) // n * threads, inputs=inputs, device=device, block_dim=threads)


def _held(n: int, device: Any) -> bool:
    return wp.get_device(device).is_cuda and n <= MOST_HELD


class ConjugateGradients:
    """Takes the place of `SolverStyle3D.linear_solver` (CPU only, one thread)."""

    def __init__(self, solver: Any) -> None:
        self._collision, self._matrix = solver.collision, make_matrix(solver)
        self._work = make_work(solver.model.particle_count)

    def solve(
        self, _matrix: Any, diagonal: Any, x0: Any, b: Any, inverse: Any, x: Any, iterations: int, _more: Any
    ) -> None:
        """Solve A x = b from `x0`, which is `x` itself or None for zero, as newton's `PcgSolver.solve`."""
        contact, warm = self._collision.contact_hessian_diags, x0 is not None
        solve(self._matrix, diagonal, contact, inverse, b, x, self._work, iterations=iterations, warm=warm)
