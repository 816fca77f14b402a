"""Motions drawn from those that are there, of many kinds by turns, to simulate and learn from.

Turns, quick spins and raised legs are rare in captured dances and common in use; `vary_motion` and
`cross_motions` make them.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from garment_jax.body.crossed_motion import cross_motions
from garment_jax.body.vary import Variation, cut, vary_motion
from garment_jax.config import SimulationConfig
from garment_jax.farm.local import LocalFarm, in_order
from garment_jax.structs import Motion, RiggedBody

_MADE_OF = {"varied": 1, "crossed": 3}  # motions


class Kind(NamedTuple):
    """How a motion is made."""

    made_of: int  # motions: 1, or 3 that are crossed
    variation: Variation


def parse_kinds(texts: Sequence[str]) -> list[Kind]:
    """Return the kinds that `simulation.kinds` names.

    Each is "varied" or "crossed" (limbs of one motion with another's, on the path of a third) and bounds of
    a `Variation`, such as "crossed turn=100 spins=0.7 tempo=0.65:1.45". One number is the largest; of tempo
    and legs the value itself, of turn in both directions. Raises `ValueError` for other words.
    """
    if not texts:
        raise ValueError('simulation.kinds is empty; name one at least, such as "varied turn=60".')
    return [_parse_kind(text) for text in texts]


def check_kinds(kinds: Sequence[Kind], motions: int) -> None:
    """Raise `ValueError` where none of `kinds` can be made out of so few motions."""
    fewest = min(kind.made_of for kind in kinds)
    if fewest > motions:
        raise ValueError(
            f"simulation.kinds are all crossed of {fewest} motions, and {motions} are there; add a kind that "
            'is "varied".'
        )


def _parse_kind(text: str) -> Kind:
    first, *pairs = text.split() or [""]
    if first not in _MADE_OF:
        raise ValueError(f"simulation.kinds {text!r} must begin with {' or '.join(_MADE_OF)}.")
    bounds = {}
    for pair in pairs:
        name, _, numbers = pair.partition("=")
        if name not in Variation._fields:
            known = ", ".join(Variation._fields)
            raise ValueError(f"simulation.kinds {text!r}: {name!r} cannot be varied; choose of {known}.")
        bounds[name] = _parse_bounds(text, name, numbers)
    if first == "crossed":  # out of parts that begin together
        if "begin" in bounds:
            raise ValueError(f"simulation.kinds {text!r}: a crossed motion has no begin; leave it out.")
        bounds["begin"] = (0.0, 0.0)
    variation = Variation(**bounds)
    return Kind(_MADE_OF[first], variation)


def _parse_bounds(text: str, name: str, numbers: str) -> tuple[float, float]:
    try:
        found = [float(number) for number in numbers.split(":")]
    except ValueError:
        found = []
    if len(found) == 1:
        low = {"turn": -found[0], "tempo": found[0], "legs": found[0]}.get(name, 0.0)
        found = [low, *found]
    smallest = {"turn": -math.inf, "tempo": 0.1}.get(name, 0.0)
    largest = 1.0 if name == "begin" else math.inf
    if len(found) != 2 or not smallest <= found[0] <= found[1] <= largest or not math.isfinite(sum(found)):
        raise ValueError(
            f"simulation.kinds {text!r}: {name}={numbers} is no number, nor two as LOW:HIGH"
            f"{' from 0 to 1' if name == 'begin' else ' of 0.1 or more' if name == 'tempo' else ''}."
        )
    return found[0], found[1]


def drawn_motions(
    motions: Sequence[Motion],
    body: RiggedBody,
    count: int,
    *,
    seed: int,
    longest: int,
    kinds: Sequence[Kind] | None = None,
    workers: int = 1,
) -> list[Motion]:
    """Return `count` motions of `longest` frames at most; of fewer than three motions, none is crossed.

    The k-th hangs on `seed`, k, `kinds` (those of a configuration by default) and `motions` alone.
    """
    kinds = parse_kinds(SimulationConfig().kinds) if kinds is None else kinds
    check_kinds(kinds, len(motions))
    kinds = [kind for kind in kinds if kind.made_of <= len(motions)]
    draw = partial(_draw, motions=list(motions), body=body, kinds=kinds, seed=seed, longest=longest)
    return in_order(LocalFarm(workers), draw, range(count))


def _draw(
    k: int, *, motions: list[Motion], body: RiggedBody, kinds: list[Kind], seed: int, longest: int
) -> Motion:
    rng = np.random.default_rng([seed, k])
    count, variation = kinds[k % len(kinds)]
    parts = [
        cut(vary_motion(motions[i], body, rng, variation=variation), longest, rng)
        for i in rng.choice(len(motions), count, replace=False)
    ]
    return cross_motions(parts[0], parts[1], parts[2], body) if count == 3 else parts[0]
