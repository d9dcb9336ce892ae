r"""Waves on a lattice, written in the few patterns that the window can tell apart.

Frequencies up to U over sources up to X from the axis hold about 2UX + a few independent waves of either parity, often
far fewer than there are sources. The factors W = Q R, with orthonormal columns in Q, shrink a core before the long
products with the waves: R_yᵀ (Q_yᵀ C Q_x) R_x instead of W_yᵀ C W_x.

Notes:
    Factoring costs more than one field saves, so factors are kept for the next pupil on the same lattice and window: a
    plate's dies, a design's iterations. Singular values below the precision's rounding are dropped, which leaves the
    field as far off as rounding does.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from maskfab.optics.waves import Positions, Precision, Reals, real_type

Floats = NDArray[np.float64]

_KEPT = 24
_DROPPED = {"double": 1e-15, "single": 1e-8}
# Below this saving the longer chain of smaller products is no faster.
_WORTHWHILE = 0.6


@dataclass(frozen=True, eq=False)
class Factors:
    """Waves of one parity, [n, m] = pattern [n, r] x wave [r, m]."""

    pattern: Reals
    wave: Reals


@dataclass(frozen=True)
class _Request:
    """Sources, frequencies and precision, equal if their numbers are."""

    token: bytes
    source: Positions
    frequency: Floats
    precision: Precision

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Request) and self.token == other.token

    def __hash__(self) -> int:
        return hash(self.token)


def factors(source: Positions, frequency: Floats, precision: Precision) -> tuple[Factors, Factors] | None:
    """Even and odd waves of the sources in factors, or None where these would be hardly smaller than the waves."""
    span = float(source.coarse_um[-1] + source.fine_um[-1]) if source.count else 0.0
    expected = 2 * span * float(frequency[-1]) + 20
    if expected > _WORTHWHILE * min(source.count, frequency.size):
        return None
    width = b"" if source.width_um is None else source.width_um.tobytes()
    parts = (source.coarse_um.tobytes(), source.fine_um.tobytes(), width, frequency.tobytes(), precision.encode())
    token = b"|".join([*parts, str((source.first, source.count)).encode()])
    return _factored(_Request(token, source, frequency, precision))


@lru_cache(maxsize=_KEPT)
def _factored(request: _Request) -> tuple[Factors, Factors]:
    even, odd = (_split(wave, request.precision) for wave in request.source.waves(request.frequency, "double"))
    return even, odd


def _split(waves: Reals, precision: Precision) -> Factors:
    left, size, right = linalg.svd(waves, full_matrices=False, overwrite_a=True, check_finite=False)
    rank = max(1, int((size > _DROPPED[precision] * size[0]).sum()))
    kind = real_type(precision)
    return Factors(
        np.ascontiguousarray(left[:, :rank], dtype=kind), (size[:rank, None] * right[:rank]).astype(kind, copy=False)
    )
