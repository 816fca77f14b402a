"""The two stride-2 convolutions by loops over texels and taps, float64, one map `[h, w, c]`."""

import numpy as np


def down(x: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Return the 4 x 4 stride-2 convolution padded by 1; `kernel` `[4, 4, c, o]`."""
    h, w, _ = x.shape
    y = np.zeros((h // 2, w // 2, kernel.shape[-1]))
    for i in range(h // 2):
        for j in range(w // 2):
            for k in range(4):
                for m in range(4):
                    row, column = 2 * i + k - 1, 2 * j + m - 1
                    if 0 <= row < h and 0 <= column < w:
                        y[i, j] += x[row, column] @ kernel[k, m]
    return y


def up(x: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Return the transpose of a 4 x 4 stride-2 convolution padded by 1: every texel scatters its taps."""
    h, w, _ = x.shape
    y = np.zeros((2 * h, 2 * w, kernel.shape[-1]))
    for i in range(h):
        for j in range(w):
            for k in range(4):
                for m in range(4):
                    row, column = 2 * i + k - 1, 2 * j + m - 1
                    if 0 <= row < 2 * h and 0 <= column < 2 * w:
                        y[row, column] += x[i, j] @ kernel[k, m]
    return y


def four_by_four(phases):
    """Return the `[4, 4, c, o]` kernel whose transposed convolution the `[2, 2, c, 4 o]` one is.

    Output texel 2 i + a takes its taps d = 0, 1 from inputs i + a + d - 1, and so tap 3 - a - 2 d. Works on
    NumPy and JAX arrays, indexing alone.
    """
    c, o = phases.shape[2], phases.shape[3] // 4
    split = phases.reshape(2, 2, c, 2, 2, o)  # tap y, tap x, c, phase a, phase b, o
    tap = [(1, 1), (1, 0), (0, 1), (0, 0)]  # (d, a) of k = 0..3: k = 3 - a - 2 d
    flat = split.transpose(0, 3, 1, 4, 2, 5).reshape(4, 4, c, o)  # (d, a), (d, a)
    order = np.array([2 * d + a for d, a in tap])
    return flat[order][:, order]
