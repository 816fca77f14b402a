"""Marks in bits, and the marked places in order: compaction without a scatter per candidate.

`jnp.nonzero` sums and scatters over every place, marked or not; here 32 places share an integer, and
the k-th marked one is found by counting bits.
"""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int, UInt32

from garment_jax.geometry.noinline import fusion_barrier, noinline

WORD = 32  # places whose marks share an integer
STEP = 32  # rows that are passed at once, a power of two

T = TypeVar("T")


def pack(mask: Bool[Array, "r k"]) -> UInt32[Array, "r w"]:
    """Return the marks, the first of each 32 in the lowest bit; places beyond `k` are not marked."""
    r, places = mask.shape
    return pack_words(jnp.pad(mask, ((0, 0), (0, -places % WORD))).reshape(r, -1, WORD))


def pack_words(mask: Bool[Array, "r w 32"]) -> UInt32[Array, "r w"]:
    """Return the marks of places that lie in words already; XLA fuses it into what made the mask."""
    return jnp.where(mask, word_bits()[None, None], jnp.uint32(0)).sum(axis=-1, dtype=jnp.uint32)


def word_bits() -> UInt32[Array, "32"]:
    """Return the bit of each place in a word."""
    return jnp.asarray(np.uint32(1) << np.arange(WORD, dtype=np.uint32))


@noinline
def marked_up_to(words: UInt32[Array, "r w"]) -> Int[Array, " r"]:
    """Return the number of marks up to and including each row."""
    return _long_sum(jax.lax.population_count(words).sum(axis=1, dtype=jnp.int32))


@noinline
def select(
    first: Int[Array, ""] | int, size: int, words: UInt32[Array, "r w"], up_to: Int[Array, " r"]
) -> tuple[Int[Array, " size"], Int[Array, " size"], Bool[Array, " size"]]:
    """Return row, place and whether there is one, of the marks number `first` to `first + size - 1`.

    Counted row by row; `up_to` comes from `marked_up_to`.
    """
    row, rank = _row_of(first + jnp.arange(size, dtype=jnp.int32), up_to)
    return row, _place_of(words, row, rank), first + jnp.arange(size, dtype=jnp.int32) < up_to[-1]


@noinline
def marked(mask: Bool[Array, " n"]) -> tuple[UInt32[Array, "r 1"], Int[Array, " r"]]:
    """Return the marks in words, and the number of marks up to and including each word."""
    words = pack_words(jnp.pad(mask, (0, -len(mask) % WORD)).reshape(-1, 1, WORD))
    return words, marked_up_to(words)


@noinline
def places(
    first: Int[Array, ""] | int, size: int, words: UInt32[Array, "r 1"], up_to: Int[Array, " r"], n: int
) -> tuple[Int[Array, " size"], Int[Array, " size"]]:
    """Return the `size` places of `n` that are `marked`, from the mark number `first` on, twice.

    Beyond the last one the first answer is some place, to read from; the second one n, to write nowhere.
    """
    word, bit, valid = select(first, size, words, up_to)
    to = jnp.where(valid, word * WORD + bit, n)
    return jnp.minimum(to, n - 1), to


def in_chunks(mask: Bool[Array, " n"], chunk: Callable[[Array, Array, T], T], made: T, size: int) -> T:
    """Return what is made after `chunk(places, where to write, made)` for all that are marked (`places`).

    `size` at a time: few are.
    """
    words, up_to = marked(mask)

    def one(state: tuple[Array, T]) -> tuple[Array, T]:
        first, made = state
        return first + size, chunk(*places(first, size, words, up_to, len(mask)), made)

    return jax.lax.while_loop(lambda state: state[0] < up_to[-1], one, (jnp.int32(0), made))[1]


@noinline
def _row_of(mark: Int[Array, " k"], up_to: Int[Array, " r"]) -> tuple[Int[Array, " k"], Int[Array, " k"]]:
    """Return the row of each mark, by steps and halves, and which of the row's it is; the last beyond all."""
    r = len(up_to)
    passed = up_to[STEP - 1 :: STEP, None] <= mark[None]  # rows that end a step, all at once: they vectorise
    row = STEP * passed.sum(axis=0, dtype=jnp.int32)
    for bit in reversed(range(STEP.bit_length() - 1)):
        further = row + (1 << bit)
        ended = up_to.at[jnp.minimum(further, r) - 1].get(mode="promise_in_bounds") <= mark
        row = jnp.where(ended & (further < r), further, row)
    row = jnp.minimum(row, r - 1)
    before = up_to.at[jnp.maximum(row - 1, 0)].get(mode="promise_in_bounds")
    return row, mark - jnp.where(row > 0, before, 0)


@noinline
def _place_of(words: UInt32[Array, "r w"], row: Int[Array, " k"], rank: Int[Array, " k"]) -> Int[Array, " k"]:
    """Return the place of each row's mark number `rank`."""
    w = words.shape[1]
    if w == 1:
        return _place_in(words[row, 0], rank)
    count = jax.lax.population_count(words[row]).astype(jnp.int32)
    total = before = word = jnp.zeros_like(rank)
    for k in range(w):
        total = total + count[:, k]
        passed = total <= rank
        word, before = word + passed, jnp.where(passed, total, before)
    word = jnp.minimum(word, w - 1)
    # in one piece with the sums above, the halving is not done eight at a time
    return word * WORD + _place_in(*fusion_barrier((words.reshape(-1)[row * w + word], rank - before)))


def _place_in(value: UInt32[Array, " k"], rank: Int[Array, " k"]) -> Int[Array, " k"]:
    """Return the place of the mark number `rank` in each word, by halving."""
    place = jnp.zeros_like(rank)
    for half in (16, 8, 4, 2, 1):
        low = (value >> place.astype(jnp.uint32)) & jnp.uint32((1 << half) - 1)
        count = jax.lax.population_count(low).astype(jnp.int32)
        beyond = count <= rank
        rank, place = jnp.where(beyond, rank - count, rank), jnp.where(beyond, place + half, place)
    return place


def _short_sum(counts: Int[Array, "r k"]) -> Int[Array, "r k"]:
    """Return running sums along short rows, by a triangle of ones; exact below 2^24."""
    k = counts.shape[-1]
    ones = jnp.asarray(np.triu(np.ones((k, k), np.float32)))
    return jnp.rint(counts.astype(jnp.float32) @ ones).astype(jnp.int32)


def _long_sum(counts: Int[Array, " n"]) -> Int[Array, " n"]:
    """Return running sums of a long row, cut into pieces of 32."""
    n = len(counts)
    within = _short_sum(jnp.pad(counts, (0, -n % WORD)).reshape(-1, WORD))
    total = within[:, -1]
    before = jnp.cumsum(total) - total if len(total) > 256 else _short_sum(total[None])[0] - total
    return (within + before[:, None]).reshape(-1)[:n]
