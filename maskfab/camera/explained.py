"""Whether a blur explains a record, by the record alone, and the blur that may be undone without harm.

A scene's power spectrum P is smooth: it falls as a power of f, alike in all directions but for a few lowest harmonics
(Field, J. Opt. Soc. Am. A 4, 2379, 1987). A panel's |H|² is not, so that a record shows the panel's structure,

    S(ν) = |H(ν)|² P(ν) + N(ν),

with N of the noise. P and N are fitted to the record's periodogram I by Whittle's likelihood,

    L = - sum over ν of log S + I / S        (P. Whittle, Ark. Mat. 2, 423, 1953),

once with |H|² and once with its smooth part m alone. The difference is what the record says of the panel. As it is
compared for many scales and angles, the panel's fit is found; at angles that no camera has, the same says how large it
gets by chance. What is not explained stays unknown. With M the smooth part of H, r the share of the structure that the
record shows and V the power of the rest,

    S = (|M + r (H - M)|² + (1 - r²) V) P + N,        V = m - M²,

tells r. The linear filter of the least expected error behind a blur that is known in part is then

    G = H̄* / (|H̄|² + (1 - r²) V + N / P),        H̄ = M + r (H - M)        (D. Slepian, J. Opt. Soc. Am. 57, 918, 1967).

Restorers know no such thing. They are given the blur that leads them to G by the Wiener filter,

    1 / G = B + N / (P B):

H itself where the record explains all of it, and a milder one elsewhere.

Notes:
    What is smooth in |H|² cannot be told from the scene's own softness: defocus, a wider pixel, a smudge on the glass.
    If the panel is not explained, how deep its halo is follows from how straight log P is over log f alone.
    Where the record has more power locally than is explained, it passes more than H says; where less, it passes less.
    G shrinks at both, for of what is not explained too much is undone, or noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any, cast

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import ndimage, optimize

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.imaging import Blur, Transfer
from maskfab.camera.noise_spectrum import NoiseSpectrum, tapered_power
from maskfab.camera.record import Record
from maskfab.camera.restorers.wiener import PRIOR_CY_PER_PX

LARGEST = 512
"""Pixels along a side of what is looked at, from the record's middle."""
SCALE, TURN = 0.06, math.radians(4)
"""Bounds of what is fitted: of scale to either side of 1, and of the angle."""
EXPLAINED, UNSURE, FOREIGN = "explained", "cannot tell", "not this display"

_KNOTS = np.log(np.array([0.004, 0.008, 0.016, 0.03, 0.06, 0.12, 0.25, 0.6]) / 0.1)
_RADIAL = len(_KNOTS)
_BEND = np.diff(np.eye(_RADIAL), 2, axis=0)
_SECTORS, _PER_OCTAVE = 12, 4
_STIFF, _ROUND = 2.0, 2.0
"""Weights of second differences over the knots, and of directions, squared."""
_SHARES = (0.1, 0.25, 0.5, 0.75, 0.92)
"""Shares r² at which settings are compared."""
_POINTS, _LOW_POINTS = 12000, 6000
_SEARCHED = 0.15
"""Cycles per pixel of the largest square up to which settings are searched for: beyond, the steps would miss them."""
_STEPS_SCALE, _STEPS_TURN = 19, 11
_DECOYS = tuple((scale, math.radians(turn)) for turn in (-43, -31, -22, -13, 13, 22, 31, 43) for scale in (0.93, 1.07))
_FEWEST = 200
_SEEN = 0.22
"""Share of the signal in a frequency's power from which it counts."""
_CLEAR = 3.0
"""Standard deviations over chance from which a structure is seen."""
_LEAST, _RIVAL = 10.0, 1.1
"""Log-likelihood from which it is evidence, and the factor by which another die has more."""
_DROWNED, _DROWNED_TIMES = 0.3, 30.0
"""Factor of the expected gain above which any structure is seen by chance, and of the strength that it pretends."""
_EXCESS, _HARDLY, _NEARLY = 1.5, 0.05, 3.0
"""Factors of the expected gain above which a record has more structure than the PSF makes, and below which it has next
to none; and a gain that is none."""
_LEAST_SHARE, _ALMOST_ALL = 0.25, 0.9
_ABOVE = 1.4
"""Times P, local power from which the filter shrinks."""
_OF_LEVEL, _OF_BEND = (0.2,), (0.3, 0.3, 0.3)
"""Standard deviations of the logarithms of noise: its level, and its change along f² and f⁴."""
_TAPER = np.array([0.032, 0.25, 0.72, 1, 0.72, 0.25, 0.032])
_TAPER = _TAPER / _TAPER.sum()
"""Power of Hann's window at halves of a bin."""


def _smooth(f: Floats, cos: Floats, sin: Floats, values: Floats) -> Floats:
    """exp of a line over the knots of log f, and harmonics of the direction, whose cosine and sine are given."""
    slope = np.log(np.maximum(f, 1e-4) / 0.1)
    total = np.interp(slope, _KNOTS, values[:_RADIAL])
    level, tilt = values[_RADIAL : _RADIAL + 4], values[_RADIAL + 4 :]
    double_cos, double_sin = cos * cos - sin * sin, 2 * cos * sin
    angular = (double_cos, double_sin, double_cos**2 - double_sin**2, 2 * double_cos * double_sin)
    for wave, one, other in zip(angular, level, tilt, strict=True):
        total += wave * (one + other * slope)
    return np.asarray(np.exp(total))


def _basis(f: Floats, cos: Floats, sin: Floats) -> Floats:
    """Logarithms of :func:`_smooth` for each of its values alone, [n, values]."""
    eye = np.eye(_RADIAL + 8)
    return np.stack([np.log(_smooth(f, cos, sin, row)) for row in eye], axis=1)


@dataclass(frozen=True, eq=False)
class _Plane:
    """Frequencies of a square's half plane that count, and bins of them.

    Attributes:
        side: pixels of the square.
        use: [side, half] those that count: not the axes, which a frame's edges and rows of noise fill.
        y, x, f, cos, sin: of these, [n].
        bins: of each.
        counts: of every bin.
        basis: of the smooth spectra, mean over every bin, [bins, values].
        squares: mean of (2 f)^0, ^2 and ^4 over every bin.
    """

    side: int
    use: NDArray[np.bool_]
    y: Floats
    x: Floats
    f: Floats
    cos: Floats
    sin: Floats
    bins: NDArray[np.int64]
    counts: Floats
    basis: Floats
    squares: Floats

    def means(self, values: Floats) -> Floats:
        """Over every bin, of [n]."""
        return np.asarray(np.bincount(self.bins, values) / self.counts)

    def smooth(self, values: Floats) -> Floats:
        """:func:`_smooth` at the frequencies that count."""
        return _smooth(self.f, self.cos, self.sin, values)


@lru_cache(maxsize=2)
def _plane(side: int) -> _Plane:
    fy, fx = np.broadcast_arrays(scipy.fft.fftfreq(side)[:, None], scipy.fft.rfftfreq(side)[None])
    rows, columns = abs(np.round(fy * side)), np.round(fx * side)
    last = side // 2 - 1
    use = (np.hypot(fy, fx) > 2.5 / side) & (rows > 1) & (columns > 1) & (rows < last) & (columns < last)
    y, x = fy[use], fx[use]
    f = np.hypot(y, x)
    sector = np.minimum(((np.arctan2(y, x) / np.pi + 0.5) * _SECTORS).astype(int), _SECTORS - 1)
    _, bins = np.unique((np.log2(f * side) * _PER_OCTAVE).astype(int) * _SECTORS + sector, return_inverse=True)
    counts = np.bincount(bins).astype(np.float64)

    def means(table: Floats) -> Floats:
        return np.stack([np.bincount(bins, column) / counts for column in table.T], axis=1)

    cos, sin = x / f, y / f
    squares = np.stack([np.ones_like(f), (2 * f) ** 2, (2 * f) ** 4], axis=1)
    return _Plane(side, use, y, x, f, cos, sin, bins, counts, means(_basis(f, cos, sin)), means(squares))


def _penalty(values: Floats, stiff: float) -> tuple[float, Floats]:
    bend = _BEND @ values[:_RADIAL]
    slope = np.zeros_like(values)
    slope[:_RADIAL], slope[_RADIAL:] = 2 * stiff * _BEND.T @ bend, 2 * _ROUND * values[_RADIAL:]
    return float(stiff * bend @ bend + _ROUND * values[_RADIAL:] @ values[_RADIAL:]), slope


def _fitted(
    plane: _Plane, power: Floats, noise: Floats, spread: Sequence[float], stiff: float
) -> tuple[Floats, Floats, float]:
    """Values of the smooth spectrum that are likeliest, log factors of the noise, and log-likelihood below 0.

    Args:
        plane: of the bins.
        power: mean of the periodogram in every bin.
        noise: as it is expected in every bin.
        spread: of the log of its level, and of its change along f² and f⁴.
        stiff: weight of second differences over the knots.
    """
    basis, squares = plane.basis, plane.squares[:, : len(spread)]
    known, size = np.array(spread), plane.basis.shape[1]

    def cost(values: Floats) -> tuple[float, Floats]:
        smooth, dark = np.exp(basis @ values[:size]), noise * np.exp(squares @ values[size:])
        total = smooth + dark
        change = plane.counts * (1 / total - power / total**2)
        penalty, slope = _penalty(values[:size], stiff)
        off = values[size:] / known
        gradient = np.concatenate([basis.T @ (change * smooth) + slope, squares.T @ (change * dark) + off / known])
        return float((plane.counts * (np.log(total) + power / total)).sum() + penalty + off @ off / 2), gradient

    weight = np.sqrt(plane.counts)
    stiffness = np.zeros((len(_BEND) + 8, size))
    stiffness[: len(_BEND), :_RADIAL] = stiff**0.5 * _BEND
    stiffness[len(_BEND) :, _RADIAL:] = _ROUND**0.5 * np.eye(8)
    above = np.log(np.maximum(power - noise, 0.05 * power))
    start, *_ = np.linalg.lstsq(
        np.concatenate([basis * weight[:, None], stiffness]),
        np.concatenate([above * weight, np.zeros(len(stiffness))]),
        rcond=None,
    )
    best = optimize.minimize(
        cost, np.concatenate([start, np.zeros(len(spread))]), jac=True, method="L-BFGS-B", options={"maxiter": 150}
    )
    return np.asarray(best.x[:size]), np.asarray(best.x[size:]), float(best.fun)


def _smoothed(plane: _Plane, values: Floats) -> Floats:
    """Values of the smooth spectrum that is nearest to positive numbers [n]."""
    power = np.maximum(plane.means(values), 1e-9)
    return _fitted(plane, power, np.full_like(power, 1e-12), (1e-3,), 0.5)[0]


def _fine_power(transfer: Transfer) -> Floats:
    """|H|² as a tapered square sees it, of H on twice its frequencies, [3, rows, half]."""
    power = np.square(abs(transfer)).astype(np.float64)
    power = ndimage.convolve1d(power, _TAPER, axis=1, mode="wrap")
    opposite = power[:, -np.arange(power.shape[1]) % power.shape[1]]
    wide = np.concatenate([opposite[:, :, 3:0:-1], power, opposite[:, :, -2:-5:-1]], axis=2)
    return np.asarray(ndimage.convolve1d(wide, _TAPER, axis=2)[:, :, 3:-3])


def _warped(grid: NDArray[Any], y: Floats, x: Floats, scale: float, turn: float) -> NDArray[Any]:
    """Values [3, rows, half] of a real picture's transform at frequencies turned and scaled, [3, *y.shape]."""
    rows, odd = grid.shape[1], np.iscomplexobj(grid)
    along, across = scale * math.cos(turn), scale * math.sin(turn)
    up, right = along * y + across * x, along * x - across * y
    right = (right + 0.5) % 1 - 0.5
    negative = right < 0
    places = np.stack([np.where(negative, -up, up) % 1 * rows, abs(right) * rows])

    def at(values: NDArray[Any]) -> Floats:
        return np.stack([ndimage.map_coordinates(one, places, order=1, mode="grid-wrap") for one in values])

    if not odd:
        return at(grid)
    return at(grid.real) + 1j * np.where(negative, -1, 1) * at(grid.imag)


def _turned(cos: Floats, sin: Floats, turn: float) -> tuple[Floats, Floats]:
    """Directions as :func:`_warped` turns frequencies."""
    return math.cos(turn) * cos - math.sin(turn) * sin, math.cos(turn) * sin + math.sin(turn) * cos


@dataclass(frozen=True, eq=False)
class _Shape:
    """A blur's transfer and its smooth parts, as a square of some pixels sees them."""

    transfer: Transfer
    power: Floats
    smooth_power: tuple[Floats, ...]
    smooth: tuple[Floats, ...]

    @classmethod
    def of(cls, blur: Blur, plane: _Plane) -> _Shape:
        transfer = blur.on((2 * plane.side, 2 * plane.side))
        power = _fine_power(transfer)
        at = _warped(power, plane.y, plane.x, 1.0, 0.0)
        real = _warped(np.ascontiguousarray(transfer.real), plane.y, plane.x, 1.0, 0.0)
        return cls(
            transfer,
            power,
            tuple(_smoothed(plane, one) for one in at),
            tuple(_smoothed(plane, np.maximum(one, 0)) for one in real),
        )


def _likelihood(seen: Floats, signal: Floats, structure: Floats) -> float:
    """Gain of log-likelihood by a structure: relative power less 1, where so much of the power is signal."""
    factor = 1 + signal * structure
    return float((seen * (1 - 1 / factor) - np.log(factor)).sum())


@dataclass(frozen=True, eq=False)
class _Seen:
    """A record's spectrum over its smooth fit, where the signal stands above the noise.

    Attributes:
        plane: its frequencies.
        seen: periodogram over the smooth fit, [3, n].
        signal: share of the fit that is signal, [3, n].
        smooth: values of the signal's smooth power, of each colour.
        noise: of each colour.
        power: mean periodogram in bins, of each colour.
        counts: places that count.
    """

    plane: _Plane
    seen: Floats
    signal: Floats
    smooth: tuple[Floats, ...]
    noise: tuple[NoiseSpectrum, ...]
    power: tuple[Floats, ...]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, square: Singles, noise: Sequence[NoiseSpectrum]) -> _Seen:
        plane = _plane(square.shape[1])
        seen, signal, smooth, kept, binned = [], [], [], [], []
        for power, dark in zip(tapered_power(square), noise, strict=True):
            spread = _OF_LEVEL if dark.white else _OF_BEND
            at = power[plane.use]
            means = plane.means(at)
            values, off, _ = _fitted(plane, means, plane.means(dark.on(plane.f)), spread, _STIFF)
            change = np.pad(off, (0, 3 - len(off)))
            now = NoiseSpectrum(dark.level * math.exp(change[0]), (dark.bend[0] + change[1], dark.bend[1] + change[2]))
            light, floor = plane.smooth(values), now.on(plane.f)
            seen.append(at / (light + floor))
            signal.append(light / (light + floor))
            smooth.append(values)
            kept.append(now)
            binned.append(means)
        signals = np.array(signal)
        counts = np.flatnonzero((np.square(signals).mean(axis=0) > _SEEN**2) & (plane.f < 0.5))
        return cls(plane, np.array(seen), signals, tuple(smooth), tuple(kept), tuple(binned), counts)


@dataclass(frozen=True)
class Fitted:
    """A blur beside its design.

    Attributes:
        scale: of its frequencies.
        turn: of them, in radians.
        gain: of log-likelihood over the smooth part alone.
    """

    scale: float = 1.0
    turn: float = 0.0
    gain: float = 0.0


@dataclass(frozen=True, eq=False)
class _Comparison:
    """A blur held against a record's spectrum."""

    seen: _Seen
    shape: _Shape

    def gain(self, at: NDArray[np.int64], scale: float, turn: float, shares: Sequence[float] = _SHARES) -> float:
        """Of log-likelihood by the structure of a setting, at some frequencies and the best of some shares."""
        structure = self.structure(at, scale, turn)
        return max(_likelihood(self.seen.seen[:, at], self.seen.signal[:, at], share * structure) for share in shares)

    def structure(self, at: NDArray[np.int64], scale: float, turn: float) -> Floats:
        """|H|² over its smooth part, less 1."""
        plane = self.seen.plane
        power = _warped(self.shape.power, plane.y[at], plane.x[at], scale, turn)
        relative = power / self._smooth_power(at, scale, turn)
        return np.asarray(relative / relative.mean(axis=1, keepdims=True) - 1)

    def _smooth_power(self, at: NDArray[np.int64], scale: float, turn: float) -> Floats:
        plane = self.seen.plane
        cos, sin = _turned(plane.cos[at], plane.sin[at], turn)
        return np.stack([_smooth(scale * plane.f[at], cos, sin, values) for values in self.shape.smooth_power])

    def expected(self, at: NDArray[np.int64]) -> float:
        """Gain that a record of this very blur would have, on the average."""
        factor = 1 + self.seen.signal[:, at] * 0.92 * self.structure(at, 1.0, 0.0)
        return float((factor - 1 - np.log(factor)).sum())

    def share(self, at: NDArray[np.int64], setting: Fitted) -> float:
        """r, the likeliest share of the structure."""
        structure = self.structure(at, setting.scale, setting.turn)
        found = optimize.minimize_scalar(
            lambda share: -_likelihood(self.seen.seen[:, at], self.seen.signal[:, at], share * structure),
            bounds=(0.0, 0.98),
            method="bounded",
        )
        return math.sqrt(float(found.x))

    def best(self, low: NDArray[np.int64], at: NDArray[np.int64]) -> Fitted:
        """The likeliest scale and angle within bounds, by some low frequencies first."""
        tried = [
            (self.gain(low, scale, turn), scale, turn)
            for scale in np.linspace(1 - SCALE, 1 + SCALE, _STEPS_SCALE)
            for turn in np.linspace(-TURN, TURN, _STEPS_TURN)
        ]
        _, scale, turn = max(tried)
        step = SCALE / _STEPS_SCALE, TURN / _STEPS_TURN
        simplex = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])

        def setting(place: Floats) -> tuple[float, float]:
            return (
                float(np.clip(scale + place[0] * step[0], 1 - SCALE, 1 + SCALE)),
                float(np.clip(turn + place[1] * step[1], -TURN, TURN)),
            )

        found = optimize.minimize(
            lambda place: -self.gain(at, *setting(place)),
            np.zeros(2),
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": 30, "xatol": 0.02, "fatol": 0.5},
        )
        return Fitted(*setting(found.x), -float(found.fun))

    @cached_property
    def bends(self) -> Floats:
        """Oddness of a scene's spectrum, were the halo as deep as each of :data:`_DEPTHS`: half a chi squared.

        A natural spectrum is about straight over log f: its slope changes by a half or so from octave to octave.
        """
        plane, odd = self.seen.plane, np.zeros(len(_DEPTHS))
        knots = 0.1 * np.exp(_KNOTS)
        seen = self.seen.signal.mean(axis=0) > _SEEN
        most = float(np.max(plane.f[seen], initial=0.0))
        counts = (knots >= 2 / plane.side) & (knots <= max(1.5 * most, float(knots[3])))
        for values, smooth in zip(self.seen.smooth, self.shape.smooth_power, strict=True):
            through = np.minimum(np.exp(smooth[:_RADIAL] / 2), 1)
            for k, depth in enumerate(_DEPTHS):
                scene = values[:_RADIAL] - 2 * np.log(1 - depth * (1 - through))
                odd[k] += np.square(np.diff(scene[counts], 2) / _BENT).sum() / 2
        return odd / len(self.seen.smooth)

    @property
    def depth(self) -> float:
        """Least share of the halo that the record shows, by a scene's spectrum that is about straight."""
        if self.bends.min() > _ODD:
            return 0.0
        return float(_DEPTHS[int(np.argmax(self.bends < self.bends.min() + 2))])


_DEPTHS = np.linspace(0, 1, 6)
_BENT, _ODD, _VERY_ODD = 0.35, 40.0, 80.0
"""Standard deviation of the change of slope, times an octave, and half chi squared from which a spectrum is odd."""


@dataclass(frozen=True, eq=False)
class Explained:
    """Findings of a record on a blur.

    Attributes:
        verdict: :data:`EXPLAINED`, :data:`UNSURE` or :data:`FOREIGN`.
        setting: of the blur.
        share: r, of its structure that the record shows.
        depth: of its halo, 1 as designed.
        expected: gain of log-likelihood that a record of this blur would have.
        chance: mean and standard deviation of the gain at angles that no camera has.
        rival: name and gain of another blur that explains it better, if one does.
        blur: that may be undone.
        noise: of every colour.
        trusted: whether the blur was undone as it is said to be, whatever the record says.
    """

    verdict: str
    setting: Fitted
    share: float
    depth: float
    expected: float
    chance: tuple[float, float]
    rival: tuple[str, float] | None
    blur: ExplainedBlur
    noise: tuple[NoiseSpectrum, ...]
    trusted: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Numbers for a document."""
        return {
            "verdict": self.verdict,
            "trusted": self.trusted,
            "told": list(self.sentences),
            "next": list(self.advice),
            "scale": self.setting.scale,
            "turn_deg": math.degrees(self.setting.turn),
            "gain": self.setting.gain,
            "gain_expected": self.expected,
            "gain_by_chance": list(self.chance),
            "share": self.share,
            "depth": self.depth,
            "rival": None if self.rival is None else {"die": self.rival[0], "gain": self.rival[1]},
        }

    @property
    def strength(self) -> float:
        """ε of the 1/f² prior that goes with the record's own spectrum, where light and noise are about equal."""
        seen, plane, total, weight = self.blur.seen, self.blur.seen.plane, 0.0, 0.0
        for noise, smooth, power in zip(seen.noise, seen.smooth, self.blur.shape.smooth_power, strict=True):
            light, dark = plane.smooth(smooth), noise.on(plane.f)
            equal = light * dark / np.square(light + dark)
            ratio = np.log(dark / light * plane.smooth(power)) - 2 * np.log(plane.f / PRIOR_CY_PER_PX)
            total, weight = total + float(equal @ ratio), weight + float(equal.sum())
        # A scene's own structure looks like noise to a smooth spectrum.
        return math.exp(total / weight) / (_DROWNED_TIMES if self.share == 1 else 1)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict in words."""
        setting, undone = self.setting, self._undone
        evidence = f"log-likelihood {setting.gain:.0f}, by chance {self.chance[0]:.0f} ± {self.chance[1]:.0f}"
        if self.verdict == EXPLAINED:
            return (
                f"The PSF explains the photograph: {100 * self.share**2:.0f} % of its structure is seen, at "
                f"{1 / setting.scale:.3f} of its size and a turn of {math.degrees(setting.turn):+.2f} degrees "
                f"({evidence}).",
            )
        if self.verdict == UNSURE:
            return (f"Cannot tell whether the PSF explains the photograph ({evidence}). {undone}",)
        why = "the photograph does not show what the PSF would make of it"
        if self.rival is not None:
            why = f"die {self.rival[0]} explains the photograph better"
        return (f"Not this display, as far as the photograph tells: {why} ({evidence}). {undone}",)

    @property
    def _undone(self) -> str:
        if self.trusted:
            return "The PSF was undone as it is said to be."
        if self.depth == 0:
            return "The picture is returned as it was taken."
        halo, structure = 100 * self.depth, 100 * self.share**2
        return f"The filter is mild: {halo:.0f} % of the halo and {structure:.0f} % of the structure."

    @property
    def advice(self) -> tuple[str, ...]:
        """Steps that a lab takes next."""
        again = (
            "Where the picture is covered with waves: --blind undoes only what the photograph bears out; or give a "
            "strength, --epsilon 0.1 or more."
            if self.trusted
            else "Undo the PSF as it is said to be, whatever the photograph says: leave --blind out."
        )
        if self.verdict == EXPLAINED:
            off = abs(self.setting.scale - 1) > _FAR_SCALE or abs(self.setting.turn) > _FAR_TURN
            steps = ["State the pixel, the focal length and the turn that were fitted."] if off else []
            return (
                *steps,
                "Capture a point light through the die (maskfab measure): its PSF tells lens and focus too.",
            )
        if self.verdict == UNSURE:
            return (
                "Photograph something with detail all over, in more light, and keep the RAW file.",
                "Or capture a point light through the die, and restore by its PSF (--psf).",
                again,
            )
        other = [] if self.rival is None else [f"Try --die {self.rival[0]}."]
        return (
            *other,
            "Check the die, the way that it stands (--stands), the camera's pixel and focal length, and the focus.",
            f"Tried were sizes within {100 * SCALE:.0f} % and turns up to {math.degrees(TURN):.0f} degrees.",
            again,
        )


@dataclass(frozen=True, eq=False)
class ExplainedBlur:
    """The blur that leads restorers to the filter of the least expected error, see the head of this file.

    Attributes:
        blur: as designed or measured.
        setting: of it, as fitted.
        share: r.
        depth: of the halo.
        shape: its smooth parts.
        seen: the record's spectrum.
        local: power of the signal over what the blur explains of it, [3, side, half].
    """

    blur: Blur
    setting: Fitted
    share: float
    depth: float
    shape: _Shape
    seen: _Seen
    local: Singles
    _kept: dict[tuple[int, int], Transfer] = field(default_factory=dict, init=False, repr=False)

    def on(self, shape: tuple[int, int]) -> Transfer:
        """See :class:`maskfab.camera.imaging.Blur`."""
        if shape not in self._kept:
            transfer = self._transfer(shape)
            transfer.flags.writeable = False
            self._kept.clear()
            self._kept[shape] = transfer
        return self._kept[shape]

    def _transfer(self, shape: tuple[int, int]) -> Transfer:
        rows, columns = shape
        exact = self.setting.scale == 1 and self.setting.turn == 0
        drawn = self.blur.on(shape) if exact else self.shape.transfer
        found = np.empty((3, rows, columns // 2 + 1), dtype=np.complex64 if np.iscomplexobj(drawn) else np.float32)
        fy, fx = np.asarray(scipy.fft.fftfreq(rows)), np.asarray(scipy.fft.rfftfreq(columns))[None]
        strip = max(1, 2_000_000 // fx.size)
        for first in range(0, rows, strip):
            part = slice(first, first + strip)
            y, x = np.broadcast_arrays(fy[part, None], fx)
            for colour in range(3):
                one = slice(colour, colour + 1)
                here = (
                    drawn[colour, part]
                    if exact
                    else _warped(drawn[one], y, x, self.setting.scale, self.setting.turn)[0]
                )
                found[colour, part] = self._milder(here, colour, y, x)
        found[:, 0, 0] = 1
        return cast(Transfer, found)

    def _milder(self, transfer: NDArray[Any], colour: int, y: Floats, x: Floats) -> NDArray[Any]:
        f = np.hypot(y, x)
        least = np.maximum(f, 1e-9)
        cos, sin, f = np.where(f > 0, x / least, 1.0), y / least, np.maximum(f, 2.5 / self.seen.plane.side)
        drawn = self.setting.scale * f, *_turned(cos, sin, self.setting.turn)
        power = _smooth(*drawn, self.shape.smooth_power[colour])
        smooth = np.minimum(_smooth(*drawn, self.shape.smooth[colour]), np.sqrt(power))
        ratio = self.seen.noise[colour].on(f) * power / _smooth(f, cos, sin, self.seen.smooth[colour])
        known = smooth + self.share * (transfer - smooth)
        unknown = (1 - self.share**2) * np.maximum(power - smooth**2, 0)
        if self.depth < 1:
            known = 1 - self.depth * (1 - known)
        whole = np.square(abs(known)) + unknown
        side = self.seen.plane.side
        places = np.stack([y % 1 * side, x * side])
        local = ndimage.map_coordinates(self.local[colour], places, order=1, mode="grid-wrap")
        ratio = ratio / np.minimum(local, 1)
        inverse = (whole + ratio) * np.sqrt(np.maximum(local / _ABOVE, 1)) / np.maximum(abs(known), 1e-6)
        root = np.sqrt(np.maximum(inverse**2 - 4 * ratio, 0))
        size = np.where(whole >= ratio, inverse + root, inverse - root) / 2
        return np.asarray(np.minimum(size, 1) * known / np.maximum(abs(known), 1e-6))


def explain(
    record: Record,
    blur: Blur,
    noise: Sequence[NoiseSpectrum],
    rivals: Mapping[str, Callable[[], Blur]] = MappingProxyType({}),
) -> Explained:
    """Hold a blur against a record, and fit what is usually unknown.

    Args:
        record: of at least 128 pixels along a side.
        blur: that it is said to have been taken through.
        noise: of every colour, as :func:`maskfab.camera.noise_spectrum.noise_of` tells it.
        rivals: makers of other blurs by name, of which one may explain it better; tried where this one might.
    """
    seen = _Seen.of(_middle(record, LARGEST), noise)
    mine = _Comparison(seen, _Shape.of(blur, seen.plane))
    at, low = _places(seen)
    setting, share, expected, chance, verdict = Fitted(), 0.0, 0.0, (0.0, 0.0), UNSURE
    odd, excess, drowned = float(mine.bends[-1]) > _ODD, False, False
    if len(low) >= _FEWEST:
        setting, drawn = mine.best(low, at), Fitted(1.0, 0.0, mine.gain(at, 1.0, 0.0))
        if setting.gain < drawn.gain + _NEARLY:
            setting = drawn
        by_chance = [mine.gain(at, scale, turn) for scale, turn in _DECOYS]
        chance = float(np.mean(by_chance)), float(np.std(by_chance))
        expected, share = mine.expected(at), mine.share(at, setting)
        clear = setting.gain > max(_LEAST, chance[0] + _CLEAR * chance[1])
        excess = setting.gain > max(_EXCESS * expected, expected + _LEAST)
        # A structure that is seen nearly whole speaks for a PSF although the scene is no usual one.
        if clear and not excess and share > _ALMOST_ALL and mine.bends[-1] < mine.bends.min() + _LEAST:
            odd = float(mine.bends[-1]) > _VERY_ODD
        if chance[0] > max(_LEAST, _DROWNED * expected):
            # The scene has as much structure of its own, as a chart has: nothing speaks against what is said.
            odd = excess = False
            setting, share, drowned = Fitted(1.0, 0.0, drawn.gain), 1.0, True
        elif clear and not odd and not excess and share**2 >= _LEAST_SHARE:
            verdict = EXPLAINED
        elif (odd and (excess or not clear or share < _ALMOST_ALL)) or (
            expected > 2 * _LEAST and share**2 < _LEAST_SHARE and setting.gain < _HARDLY * expected
        ):
            verdict = FOREIGN
    rival = None if verdict == FOREIGN else _rival(record, blur, noise, rivals)
    verdict = verdict if rival is None else FOREIGN
    depth = mine.depth if verdict == FOREIGN or odd or excess else 1.0
    local = _local(mine, setting, share)
    if drowned and verdict != FOREIGN:
        local = np.ones_like(local)
    undone = ExplainedBlur(blur, setting, share, depth, mine.shape, seen, local)
    return Explained(verdict, setting, share, depth, expected, chance, rival, undone, seen.noise)


def _middle(record: Record, most: int) -> Singles:
    """A square from the record's middle."""
    side = min(*record.values.shape[1:], most) // 2 * 2
    top, left = ((whole - side) // 2 for whole in record.values.shape[1:])
    return record.values[:, top : top + side, left : left + side]


def _places(seen: _Seen) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Some of the frequencies that count, and of these some low ones."""
    at = np.random.default_rng(0).permutation(seen.counts)[:_POINTS]
    return at, at[seen.plane.f[at] < _SEARCHED * LARGEST / seen.plane.side][:_LOW_POINTS]


def _rival(
    record: Record, blur: Blur, noise: Sequence[NoiseSpectrum], rivals: Mapping[str, Callable[[], Blur]]
) -> tuple[str, float] | None:
    """Name and gain, over that of a blur, of the one that explains a smaller square of the record best and better."""
    if not rivals:
        return None
    seen = _Seen.of(_middle(record, LARGEST // 2), noise)
    at, low = _places(seen)
    if len(low) < _FEWEST:
        return None
    own = _Comparison(seen, _Shape.of(blur, seen.plane)).best(low, at).gain
    gains = {name: _Comparison(seen, _Shape.of(made(), seen.plane)).best(low, at).gain for name, made in rivals.items()}
    best = max(gains, key=lambda name: gains[name])
    return (best, gains[best] - own) if gains[best] > max(_RIVAL * own, own + _LEAST) else None


def _local(mine: _Comparison, setting: Fitted, share: float) -> Singles:
    """Local power of the signal over what the blur explains of it, [3, side, half]."""
    plane, side = mine.seen.plane, mine.seen.plane.side
    signal = mine.seen.signal
    told = signal * (1 + share**2 * mine.structure(np.arange(plane.f.size), setting.scale, setting.turn))
    parts = []
    for values in (mine.seen.seen - (1 - signal), told):
        found = np.zeros((3, side, side // 2 + 1))
        found[:, plane.use] = values
        parts.append(ndimage.gaussian_filter(found, (0, _LOCAL, _LOCAL), mode=("nearest", "wrap", "nearest")))
    seen, explained = parts
    return np.asarray(np.clip((seen + _TRUST) / (explained + _TRUST), 0.02, 50), dtype=np.float32)


_TRUST = 0.1
"""Of all power, the signal below which what is local tells nothing."""
_FAR_SCALE, _FAR_TURN = 0.01, math.radians(0.5)
_LOCAL = 3.0
"""Frequencies of the square over which power is taken as local, a standard deviation."""
