"""Names of the arrays that pass between functions, by what they hold."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import IO, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Complexes = NDArray[np.complex128]
Ints = NDArray[np.int64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Labels = NDArray[np.int8]

Number = TypeVar("Number", bound=np.generic)


def distinct(values: NDArray[Number]) -> NDArray[Number]:
    """Values of an array, each once, ascending."""
    # Asked for nothing else np.unique loads numpy.ma, which takes longer than a PSF's arithmetic may.
    found: NDArray[Number] = np.unique(values, return_counts=True)[0]
    return found


def write_arrays(file: IO[bytes], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays by name as one npz; ValueError for an array of Python's objects, which would be pickled."""
    if any(array.dtype.hasobject for array in arrays.values()):
        raise ValueError("an array of objects is no data")
    # To numpy before 2.2 allow_pickle would be one more array.
    np.savez(file, **dict[str, Any](arrays))


@lru_cache(maxsize=256)
def fast_length(least: int, primes: tuple[int, ...] = (2, 3, 5)) -> int:
    """The least length of at least so many points that is a product of primes, of which transforms are fast."""
    length = least
    while True:
        rest = length
        for prime in primes:
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return length
        length += 1


def expanded(counts: Indices) -> tuple[Indices, Indices]:
    """Whose each of so many items is, and its number among them."""
    owner = np.repeat(np.arange(counts.size), counts)
    return owner, np.arange(owner.size) - np.repeat(np.cumsum(counts) - counts, counts)
