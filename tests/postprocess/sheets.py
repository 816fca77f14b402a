"""A flat sheet and what it looks like in loops, for the tests of edge lengths and self-crossings."""

import numpy as np

SIDE, EDGE = 24, 0.02


def flat_sheet() -> tuple[np.ndarray, np.ndarray]:
    """Return a flat sheet of `SIDE` x `SIDE` vertices, `EDGE` metres apart, and its faces."""
    u, v = np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij")
    V = np.stack([EDGE * u.ravel(), np.zeros(SIDE * SIDE), EDGE * v.ravel()], axis=1)
    a = (u[:-1, :-1] * SIDE + v[:-1, :-1]).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + SIDE], 1), np.stack([a + 1, a + SIDE + 1, a + SIDE], 1)])
    return V.astype(np.float32), faces.astype(np.int32)


T, FACES = flat_sheet()


def looped(size: float) -> np.ndarray:
    """Return the sheet along two turns of a trochoid, metres: it loops through itself from 0.037 on."""
    x, _, z = T.T.astype(np.float64)
    turn = 4 * np.pi * x / (EDGE * (SIDE - 1))
    return np.stack([x - size * np.sin(turn), -size * np.cos(turn), z], axis=1).astype(np.float32)


TWO_FACES = np.concatenate([FACES, FACES + len(T)]).astype(np.int32)


def two_sheets(bump: float, apart: float = 0.02) -> np.ndarray:
    """Return a flat sheet and, `apart` metres below, one with a `bump` that may go through it."""
    above = T.astype(np.float64) - T.mean(axis=0)
    below = 0.97 * above
    below[:, 1] += bump * np.exp(-np.square(below / 0.1).sum(axis=1)) - apart
    return np.concatenate([above, below]).astype(np.float32)
