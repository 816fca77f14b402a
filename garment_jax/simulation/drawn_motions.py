"""Motions drawn from those that are there, of twelve kinds by turns: what the column RNN learns from.

Turns, quick spins and raised legs are rare in captured dances and common in use; `vary_motion` and
`cross_motions` make them.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from garment_jax.body.crossed_motion import cross_motions
from garment_jax.body.vary import Variation, cut, vary_motion
from garment_jax.simulation.many import in_processes
from garment_jax.structs import Motion, RiggedBody

_WIDE = Variation(tempo=(0.65, 1.45), legs=(0.75, 1.35))
_STILL = Variation(tempo=(1, 1), legs=(1, 1), turn=(0, 0), begin=(0, 0))  # as it was danced
KINDS = (  # (motions that one is made of, variation)
    (3, _WIDE._replace(turn=(-100, 100), spins=(0, 0.7))),
    (3, _WIDE._replace(turn=(-100, 100), spins=(0, 1.5))),
    (3, Variation(turn=(-100, 100))),
    (3, Variation(turn=(-100, 100), spins=(0, 0.7), kicks=(0, 4))),
    (3, _WIDE._replace(turn=(-60, 60), kicks=(0, 2))),
    (1, _WIDE._replace(turn=(-120, 120), spins=(0, 0.7))),
    (1, Variation(turn=(-60, 60), kicks=(0, 2))),
    (3, _WIDE._replace(turn=(-40, 40))),
    (1, _STILL),
    (1, Variation()),
    (3, Variation(turn=(-60, 60), kicks=(2, 6))),
    (1, Variation(turn=(-60, 60), spins=(0, 0.7), kicks=(2, 6))),
)


def drawn_motions(
    motions: Sequence[Motion], body: RiggedBody, count: int, *, seed: int, longest: int, workers: int = 1
) -> list[Motion]:
    """Return `count` motions of `longest` frames at most; of fewer than three motions, none is crossed.

    The k-th hangs on `seed`, k and `motions` alone.
    """
    draw = partial(_draw, motions=list(motions), body=body, seed=seed, longest=longest)
    return in_processes(draw, range(count), workers)


def _draw(k: int, *, motions: list[Motion], body: RiggedBody, seed: int, longest: int) -> Motion:
    rng = np.random.default_rng([seed, k])
    kinds = [kind for kind in KINDS if kind[0] <= len(motions)]
    count, variation = kinds[k % len(kinds)]
    if count > 1:
        variation = variation._replace(begin=(0.0, 0.0))
    parts = [
        cut(vary_motion(motions[i], body, rng, variation=variation), longest, rng)
        for i in rng.choice(len(motions), count, replace=False)
    ]
    return cross_motions(parts[0], parts[1], parts[2], body) if count == 3 else parts[0]
