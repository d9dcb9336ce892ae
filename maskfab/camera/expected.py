"""Errors that the Wiener filter leaves on the mean over a sensor's noise, in closed form: no noise is drawn.

A restored pixel is m + s z. Its m is the record without noise, restored. As a filter sums over many pixels, z is nearly
normal, and of a record's variance v there

    s² = v · mean over frequencies of |G|².

The squared error of its code value, c of light cut to 0 to 1, against the true t is then (E c - t)² + var c. Both are
functions of m and s alone, and kept as tables. It is exact for noise that is normal and even over the filter's reach;
at the edges, where a record is mirrored, noise meets its own image, and s² grows by the filter's correlation with it.

To choose ε, pictures of a few give those of all. At one frequency the filter is G = x / (x + 1) / H,
x = |H|² / ε (f / 0.1)², and as a function of ε a sum of those of ε_k,

    1 / (q + ε) = sum over k of w_k / (q + ε_k),        q = |H|² / (f / 0.1)²,

nearly, with sum w_k = 1 so that brightness stays. The weights w are the best for the error that they add: squares of
the misfit times (x + 1)² / x, by which a scene of the filter's own prior exceeds its least error.

Notes:
    Of 512 rows or more every second one is scored. By ε that was chosen its pixels are restored exactly.
    Clipping by a full well, rounding, banding, mosaics and merged exposures are left to draws.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.imaging import Blur, Margin, Transfer
from maskfab.camera.record import Noise
from maskfab.camera.restorers.wiener import filters, prior, wiener
from maskfab.optics.colour import code_of_light
from maskfab.optics.restoration import squared_modulus

_FEW = 4
"""Pixels from one to the next, both ways, that ε is chosen by; it divides all sides."""
_MANY_ROWS = 512
"""Of so many every second one tells PSNR of a scene within 0.03 dB; of fewer it may err by 0.1."""
_MOST_APART = 3.2
"""Ratio of neighbouring ε that pictures are restored by to choose one; between them PSNR errs by 0.01 dB."""
_AT_A_TIME = 32
"""Rows that errors, and columns that sums are found of at a time."""
_SPREADS = np.geomspace(2e-4, 2, 96)
_LEAST, _MOST, _PER_LIGHT, _BEYOND = -1, 2, 4096, 4
"""Light that the tables hold, their steps in 1, and how far to either side the curve goes on for them."""


@cache
def _of_normal(linear: bool) -> NDArray[np.complex64]:
    """Mean of the code value of normal light, and as its imaginary part its variance over that of the light, [spreads,
    lights] raveled: one place of memory is read for both."""
    light = np.arange((_LEAST - _BEYOND) * _PER_LIGHT, (_MOST + _BEYOND) * _PER_LIGHT) / _PER_LIGHT
    code = code_of_light(light) if linear else np.clip(light, 0, 1)
    kept = slice(_BEYOND * _PER_LIGHT, -_BEYOND * _PER_LIGHT)
    # A cosine transform mirrors the curve at its ends, where it is level.
    terms = scipy.fft.dct(np.stack([code, code**2]), workers=1)
    f = np.arange(light.size) * (_PER_LIGHT / (2 * light.size))
    table = np.empty((len(_SPREADS), (_MOST - _LEAST) * _PER_LIGHT), dtype=np.complex64)
    for spread, both in zip(_SPREADS, table, strict=True):
        damped = terms * np.exp(-2 * (np.pi * spread * f) ** 2)
        mean, square = scipy.fft.idct(damped, workers=1, overwrite_x=True)[:, kept]
        both.real, both.imag = mean, np.maximum(square - mean**2, 0) / spread**2
    return table.ravel()


@lru_cache(maxsize=4)
def _between(shape: tuple[int, ...]) -> Singles:
    """Numbers of 0 to 1, evenly spread [rows, columns]: added before a place is cut, they interpolate on the mean."""
    rows, columns = shape
    # M. Roberts' sequence in two dimensions, by powers of the plastic number.
    return np.asarray((0.7548777 * np.arange(rows)[:, None] + 0.5698403 * np.arange(columns)) % 1, dtype=np.float32)


Passed = tuple[Singles | Floats, ...]
"""Share of a record's variance that passes a filter, as factors by row, by column or neither."""


@dataclass(frozen=True, eq=False)
class Still:
    """One scene behind one design without noise."""

    true: Singles
    seen: Singles
    spectrum: NDArray[np.complex64]
    margin: Margin

    @classmethod
    def of(cls, true: Singles, seen: Singles) -> Still:
        """A scene's code values, and its light on the sensor."""
        margin = Margin.around(seen)
        return cls(true, seen, margin.mirrored(seen), margin)


@dataclass(frozen=True, eq=False)
class Stills:
    """Scenes behind one design without noise, restored by a few ε, which tell every ε between them.

    Attributes:
        few: one pixel of 16: light restored by every one of these ε, [nodes, 3, rows, columns], code values, and light
            on the sensor, [3, rows, columns].
        products: mean of the products of two of their filters over all frequencies by size, [3, nodes, nodes].
    """

    blur: Blur
    linear: bool
    nodes: tuple[float, ...]
    stills: Mapping[int, Still]
    few: Mapping[int, tuple[Singles, Singles, Singles]]
    products: Mapping[tuple[int, int], Floats]

    @classmethod
    def of(cls, blur: Blur, stills: Mapping[int, Still], between: tuple[float, float], *, linear: bool) -> Stills:
        """Restore scenes by ε from the first to the last, or by none where these are one."""
        low, high = between
        count = 0 if low == high else 2 + int(math.log(high / low) / math.log(_MOST_APART))
        nodes = tuple(np.geomspace(low, high, count).tolist())
        few = {}
        for key, still in stills.items():
            true, seen = (np.ascontiguousarray(each[:, ::_FEW, ::_FEW]) for each in (still.true, still.seen))
            few[key] = np.empty((count, *seen.shape), np.float32), true, seen
        products = {still.margin.shape: np.empty((len(still.seen), count, count)) for still in stills.values()}
        for shape, means in products.items() if nodes else ():
            alike = {key: still for key, still in stills.items() if still.margin.shape == shape}
            margin = next(iter(alike.values())).margin
            # Colour by colour, whose filters take a third.
            for colour, transfer in enumerate(blur.on(shape)):
                gains = np.empty((count, *transfer.T.shape), dtype=transfer.dtype)
                for gain, node in zip(gains, nodes, strict=True):
                    gain[:] = wiener(transfer, prior(shape), node).T
                means[colour] = _products(gains)
                for key, still in alike.items():
                    for k, waves in enumerate(_summed(gains, still.spectrum[colour].T)):
                        few[key][0][k, colour] = margin.few(waves, _FEW)
        return cls(blur, linear, nodes, stills, few, products)

    def best(self, keys: Iterable[int], noise: Noise, strengths: Sequence[float], start: int) -> int:
        """Place of the strength that is best for some scenes, looked for from ``start``."""
        return climb(lambda k: self.height(keys, noise, strengths[k]), start, len(strengths))

    def height(self, keys: Iterable[int], noise: Noise, epsilon: float) -> float:
        """Sum of the PSNRs of scenes' expected errors, by one pixel of 16."""
        mixed, total = weights(epsilon, self.nodes), 0.0
        for key in keys:
            restored, true, seen = self.few[key]
            passed = [
                (share,) for share in (self.products[self.stills[key].margin.shape] @ mixed @ mixed)[:, None, None]
            ]
            light = np.tensordot(mixed.astype(np.float32), restored, axes=1)
            total += _decibels(_errors(light, true, seen, passed, noise, linear=self.linear))
        return total

    def psnrs(
        self, keys: Iterable[int], epsilon: float, noise: Noise, trim: int
    ) -> Iterator[tuple[int, tuple[float, float]]]:
        """PSNRs of scenes' expected errors in dB, and without so many pixels, an even number, at each edge; by key."""
        passed: dict[tuple[int, int], list[Passed]] = {}
        for key in keys:
            still, shape = self.stills[key], self.stills[key].margin.shape
            step, gains = _step(still.seen.shape[1]), filters(self.blur, shape, epsilon)
            if shape not in passed:
                passed = {shape: [_passed(gain, still.seen.shape[1:], step) for gain in gains]}
            light = still.margin.blurred(still.spectrum, gains, step)
            true, seen = still.true[:, ::step], still.seen[:, ::step]
            errors = _errors(light, true, seen, passed[shape], noise, linear=self.linear)
            yield key, (_decibels(errors), _decibels(errors[:, trim // step : -trim // step, trim:-trim]))


def _errors(
    restored: Singles, true: Singles, seen: Singles, passed: Sequence[Passed], noise: Noise, *, linear: bool
) -> Singles:
    """Expected squared errors of code values, [3, rows, columns], in place of the restored light."""
    table = _of_normal(linear)
    lights, apart = (_MOST - _LEAST) * _PER_LIGHT, math.log(_SPREADS[1] / _SPREADS[0])
    from_first = _between(restored.shape[1:]) - np.float32(math.log(_SPREADS[0]) / apart)
    # Some rows of a colour at a time, which fit a processor's own memory.
    for colour, start in product(range(len(restored)), range(0, restored.shape[1], _AT_A_TIME)):
        rows = slice(start, start + _AT_A_TIME)
        error, variance = restored[colour, rows], noise.variance(seen[colour, rows])
        for share in passed[colour]:
            variance *= share[rows] if len(share) > 1 else share
        spread = np.log(np.maximum(variance, np.float32(_SPREADS[0] ** 2)))
        spread *= np.float32(0.5 / apart)
        spread += from_first[rows]
        # Places are whole numbers that float32 holds.
        place = np.floor(np.minimum(spread, np.float32(len(_SPREADS) - 1), out=spread), out=spread)
        place *= np.float32(lights)
        error *= np.float32(_PER_LIGHT)
        error += np.float32(0.5 - _LEAST * _PER_LIGHT)
        place += np.floor(np.clip(error, 0, lights - 1, out=error), out=error)
        found = table.take(place.astype(np.intp), mode="clip")
        np.subtract(found.real, true[colour, rows], out=error)
        error *= error
        variance *= found.imag
        error += variance
    return restored


def _step(rows: int) -> int:
    """From one row to the next that is scored; it divides all sides."""
    return 2 if rows >= _MANY_ROWS else 1


def _decibels(errors: Singles) -> float:
    mean = float(errors.mean(dtype=np.float64))
    return -10 * math.log10(mean) if mean > 0 else math.inf


def _passed(gain: Transfer, sides: tuple[int, int], step: int = 1) -> Passed:
    """Share of a record's variance that a filter [rows, half] lets through at every pixel of every so many-th row of
    the sensor, as factors [y, 1] and [x].

    At d pixels from an edge, beyond which the record is mirrored, noise meets its own image 2 d away: that adds the
    filter's correlation there, less what the edge's own pixels, which are not doubled, have in it.
    """
    # Every few frequencies tell as much, for the filter's spread is a part of the picture.
    some = np.ascontiguousarray(gain.T[::_FEW])
    ends = np.full(len(some), 2.0)
    ends[[0, -1]] = 1
    turned = some[:, -np.arange(some.shape[1])]
    alike, lines = ends @ (some * turned.conj()) / ends.sum(), scipy.fft.ifft(some, axis=1, workers=1)
    own = ends @ squared_modulus(lines) / ends.sum()
    up = _at_edges(scipy.fft.ifft(alike).real, own, sides[0])
    some = np.ascontiguousarray(gain[::_FEW])
    turned = some[-np.arange(len(some))]
    lines = scipy.fft.irfft(some, axis=1, workers=1)
    across = _at_edges(scipy.fft.irfft((some * turned).mean(axis=0)), (lines * lines).mean(axis=0), sides[1])
    down = _products(gain.T[None])[0, 0] * up[::step, None]
    return down.astype(np.float32), across[None].astype(np.float32)


def _at_edges(alike: Floats, own: Floats, side: int) -> Floats:
    """Factor of the noise at every pixel along a side, by the filter's correlation and its energy by distance."""
    near = np.arange(min(side, len(own) // 8))
    more = np.zeros(side)
    more[near] = (alike[2 * near] - own[near]) / alike[0]
    return np.asarray(1 + more + more[::-1])


def _summed(gains: Transfer, spectrum: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Filters times a spectrum [columns / 2 + 1, rows], summed over frequencies that are one of few rows, [filters,
    columns / 2 + 1, few rows]."""
    total = np.empty((*gains.shape[:2], gains.shape[2] // _FEW), dtype=np.complex64)
    # Some columns by all filters, while they are in a processor's own memory.
    for start in range(0, gains.shape[1], _AT_A_TIME):
        some = slice(start, start + _AT_A_TIME)
        waves = spectrum[some].reshape(-1, _FEW, total.shape[2])
        real, imaginary = np.ascontiguousarray(waves.real), np.ascontiguousarray(waves.imag)
        for sums, every in zip(total[:, some], gains[:, some], strict=True):
            gain = every.reshape(waves.shape)
            sums.real, sums.imag = (np.einsum("jar,jar->jr", gain.real, part) for part in (real, imaginary))
            if np.iscomplexobj(gain):
                sums.real -= np.einsum("jar,jar->jr", gain.imag, imaginary)
                sums.imag += np.einsum("jar,jar->jr", gain.imag, real)
    return total


def _products(gains: Transfer) -> Floats:
    """Means of the products of filters [filters, ..., columns / 2 + 1, rows] two by two over all frequencies."""
    # Frequencies stand for their negatives too, but for those of the first and the last column.
    every, ends = (part.reshape(len(gains), -1) for part in (gains, gains[..., [0, -1], :]))
    sums = 2 * (every.conj() @ every.T).real - (ends.conj() @ ends.T).real
    return np.asarray(sums / (2 * every.shape[1] - ends.shape[1]), dtype=np.float64)


_RATIOS = np.geomspace(1e-4, 1e4, 401)


@lru_cache(maxsize=64)
def weights(epsilon: float, nodes: tuple[float, ...]) -> Floats:
    """Weights w of filters of other ε that make the one of an ε, [k]; their sum is 1."""
    q = (_RATIOS * epsilon)[:, None]
    cost = ((1 + _RATIOS) / np.sqrt(_RATIOS))[:, None]
    wanted, have = cost * q / (q + epsilon), cost * q / (q + np.array(nodes))
    rest = np.linalg.lstsq(have[:, 1:] - have[:, :1], (wanted - have[:, :1])[:, 0], rcond=None)[0]
    return np.concatenate([[1 - rest.sum()], rest])


def climb(height: Callable[[int], float], start: int, count: int) -> int:
    """Place, below ``count``, without a higher neighbour, by steps to the better one; no height is asked for twice."""
    height = cache(height)
    best, following = -1, start
    while following != best:
        best = following
        following = max((k for k in (best, best - 1, best + 1) if 0 <= k < count), key=height)
    return best
