"""Random numbers that a protocol states, the same on every machine."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

WORDS = 624  # of a Mersenne twister's state
_LEFT, _RIGHT = 306, 317  # p and q of `seed_words`


def uniforms(seed: int, *shape: int) -> NDArray[np.float64]:
    """Uniforms in [0, 1) from raw bits of PCG64, whose stream numpy guarantees across versions."""
    generator = np.random.PCG64(np.random.SeedSequence(seed))
    raw = np.asarray(generator.random_raw(math.prod(shape)), dtype=np.uint64)
    return ((raw >> np.uint64(11)).astype(np.float64) * 2.0**-53).reshape(shape)


def _mixed(word: int) -> int:
    return word ^ (word >> 27)


def seed_words(values: Sequence[int]) -> list[int]:
    """State that C++'s `std::seed_seq` gives `std::mt19937` from seeds ([rand.util.seedseq]).

    With s seeds, n = 624, t = 11, p = 306, q = 317 and T(x) = x xor (x >> 27), all modulo 2^32.
    """
    n, count, mask = WORDS, len(values), 0xFFFFFFFF
    words = [0x8B8B8B8B] * n
    for k in range(n):
        first = 1664525 * _mixed(words[k] ^ words[(k + _LEFT) % n] ^ words[k - 1]) & mask
        more = count if k == 0 else k + values[k - 1] if k <= count else k
        second = (first + more) & mask
        words[(k + _LEFT) % n] = (words[(k + _LEFT) % n] + first) & mask
        words[(k + _RIGHT) % n] = (words[(k + _RIGHT) % n] + second) & mask
        words[k] = second
    for k in range(n):
        total = (words[k] + words[(k + _LEFT) % n] + words[k - 1]) & mask
        third = 1566083941 * _mixed(total) & mask
        fourth = (third - k) & mask
        words[(k + _LEFT) % n] ^= third
        words[(k + _RIGHT) % n] ^= fourth
        words[k] = fourth
    if words[0] >> 31 and not any(words[1:]):
        words[0] = 1 << 31
    return words


class SeededTwister:
    """A Mersenne twister seeded as C++ seeds it, and the draws of the teleop-walking-benchmark.

    Args:
        seeds: of `std::seed_seq`.
    """

    def __init__(self, *seeds: int):
        self._generator = np.random.MT19937(0)
        state = self._generator.state
        state["state"] = {"key": np.array(seed_words(seeds), dtype=np.uint32), "pos": WORDS}
        self._generator.state = state

    def raw(self) -> int:
        """The next 32 bits."""
        return int(self._generator.random_raw())

    def unit(self) -> float:
        """In [0, 1), by the upper 24 bits."""
        return (self.raw() >> 8) / 2**24

    def between(self, low: float, high: float) -> float:
        """In [low, high)."""
        return low + (high - low) * self.unit()

    def below(self, count: int) -> int:
        """An integer in [0, count), each as likely."""
        span = 2**32 // count
        while (draw := self.raw()) >= span * count:
            pass
        return draw // span
