"""Whether a blur explains a record, by the record alone, and whether it may be undone without harm.

Light is never below 0. Who undoes a halo that is not there takes from what is dark beside what is bright, light that
it does not have. So of a picture x̂ that a Wiener filter restores from a record y,

    q = (sum of min(x̂, 0)² less what noise does) / sum of (x̂ - y)²

is the share of the change that is wrong for certain, however the scene looks. Behind the right panel it is next to 0.
Noise alone makes at most half of its variance in x̂. (That light is not negative is what blind deconvolution has long
gone by: G. R. Ayers, J. C. Dainty, Opt. Lett. 13, 547, 1988.) Where a scene has nothing dark, q says nothing. It can be
told: x̂ itself is undone once more as if it were a record, and must then show what a wrong blur does.

A scene's power spectrum P is smooth: it falls as a power of f, alike in all directions but for a few lowest harmonics
(Field, J. Opt. Soc. Am. A 4, 2379, 1987). A panel's |H|² is not, so that a record shows the panel's structure,

    S(ν) = |H(ν)|² P(ν) + N(ν),

with N of the noise. P and N are fitted to the record's periodogram I by Whittle's likelihood,

    L = - sum over ν of log S + I / S        (P. Whittle, Ark. Mat. 2, 423, 1953),

once with |H|² and once with its smooth part m alone. The difference is what the record says of the panel. As it is
compared for many scales and angles, the panel's fit is found; at angles that no camera has, the same says how large it
gets by chance. P, which stands in the record, tells the strength of the filter too.

Notes:
    A blur that is wrong and does no harm that light below 0 would tell is undone: another die with as much halo.
    Defocus, a wider pixel and a soft scene look alike and are not told apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import ndimage, optimize

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.imaging import Blur, Margin, Transfer
from maskfab.camera.noise_spectrum import NoiseSpectrum, WhitenedBlur, tapered_power, whitened
from maskfab.camera.record import Record
from maskfab.camera.restorers.wiener import PRIOR_CY_PER_PX, prior, wiener

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
_LEAST_SHARE, _PLAIN, _OBVIOUS = 0.25, 100.0, 1000.0
"""Share of a structure from which it is seen; expected log-likelihoods from which it ought to be, and must be."""
_DROWNED = 30.0
"""Times by which a scene with structure of its own pretends more strength."""
_DOUBTFUL, _WRONG, _STILL_WRONG, _DOUBT = 0.005, 0.015, 0.04, 16.0
"""Shares of a change, as light below 0, from which ε is so many times as large, from which a blur is wrong where no
structure is seen, and from which it is wrong where one is."""
_FAR_SCALES, _FAR_GAIN, _FAR_CLEAR, _MILD = np.geomspace(0.15, 2.0, 60), 100.0, 10.0, 0.2
"""Scales of a camera that was guessed; log-likelihood and standard deviations over chance, from which one is taken; and
the least ε then, for little of the structure is known."""
_ROOM = 128
"""Pixels by which a square is mirrored beyond its edges."""
_OF_LEVEL, _OF_BEND, _FARTHEST_OFF = (0.2,), (0.3, 0.3, 0.3), 2.0
"""Standard deviations of the logarithms of noise: its level, and its change along f² and f⁴."""
_STRONGEST = 1e6
"""ε of a record in which nothing is seen."""
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
    """Frequencies of a square's half plane that count, and bins of them."""

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
    """Values of the smooth spectrum that are likeliest, log factors of the noise, and log-likelihood below 0."""
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
    """A blur's transfer and the smooth part of its power, as a square of some pixels sees them."""

    transfer: Transfer
    power: Floats
    smooth: tuple[Floats, ...]

    @classmethod
    def of(cls, blur: Blur, plane: _Plane) -> _Shape:
        transfer = blur.on((2 * plane.side, 2 * plane.side))
        power = _fine_power(transfer)
        at = _warped(power, plane.y, plane.x, 1.0, 0.0)
        return cls(transfer, power, tuple(_smoothed(plane, one) for one in at))


def _likelihood(seen: Floats, signal: Floats, structure: Floats) -> float:
    """Gain of log-likelihood by a structure: relative power less 1, where so much of the power is signal."""
    factor = 1 + signal * structure
    return float((seen * (1 - 1 / factor) - np.log(factor)).sum())


@dataclass(frozen=True, eq=False)
class _Seen:
    """A record's spectrum over its smooth fit, where the signal stands above the noise."""

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
            # A picture that holds nothing at all would have no noise either.
            change = np.pad(np.clip(off, -_FARTHEST_OFF, _FARTHEST_OFF), (0, 3 - len(off)))
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
    """A blur beside its design: its frequencies' scale and turn in radians, and what log-likelihood that gains."""

    scale: float = 1.0
    turn: float = 0.0
    gain: float = 0.0

    @property
    def as_drawn(self) -> bool:
        """Whether the blur lies as it was designed."""
        return self.scale == 1 and self.turn == 0


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
        return np.stack([_smooth(scale * plane.f[at], cos, sin, values) for values in self.shape.smooth])

    def expected(self, at: NDArray[np.int64]) -> float:
        """Gain that a record of this very blur would have, on the average."""
        factor = 1 + self.seen.signal[:, at] * 0.92 * self.structure(at, 1.0, 0.0)
        return float((factor - 1 - np.log(factor)).sum())

    def share(self, at: NDArray[np.int64], setting: Fitted) -> float:
        structure = self.structure(at, setting.scale, setting.turn)
        found = optimize.minimize_scalar(
            lambda share: -_likelihood(self.seen.seen[:, at], self.seen.signal[:, at], share * structure),
            bounds=(0.0, 0.98),
            method="bounded",
        )
        return float(found.x)

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

    def far(self, low: NDArray[np.int64], at: NDArray[np.int64]) -> Fitted:
        """The likeliest of scales that a guessed camera may be off by; none at the ends of what is tried."""
        gains = [self.gain(low, float(scale), 0.0) for scale in _FAR_SCALES]
        best = int(np.argmax(gains[1:-1])) + 1
        if gains[best] < max(gains[0], gains[-1]):
            return Fitted()
        scale = float(_FAR_SCALES[best])
        return Fitted(scale, 0.0, self.gain(at, scale, 0.0))

    def strength(self) -> float:
        """ε of the 1/f² prior that goes with the record's own spectrum, where light and noise are about equal."""
        seen, plane, total, weight = self.seen, self.seen.plane, 0.0, 0.0
        for noise, smooth, power in zip(seen.noise, seen.smooth, self.shape.smooth, strict=True):
            light, dark = plane.smooth(smooth), noise.on(plane.f)
            equal = light * dark / np.square(light + dark)
            ratio = np.log(dark / light * plane.smooth(power)) - 2 * np.log(plane.f / PRIOR_CY_PER_PX)
            total, weight = total + float(equal @ ratio), weight + float(equal.sum())
        return min(math.exp(total / weight), _STRONGEST)


@dataclass(frozen=True, eq=False)
class Explained:
    """Findings of a record on a blur.

    Attributes:
        verdict: :data:`EXPLAINED`, :data:`UNSURE` or :data:`FOREIGN`; then the record stays as it is.
        share: of its structure that the record shows, of power.
        expected: gain of log-likelihood that a record of this blur would have.
        chance: mean and standard deviation of the gain at angles that no camera has.
        wrong: q, and what it would be if the blur were none, see the head of this file.
        rival: name and gain of another blur that explains the record better, if one does.
    """

    verdict: str
    setting: Fitted
    share: float
    expected: float
    chance: tuple[float, float]
    wrong: tuple[float, float]
    rival: tuple[str, float] | None
    blur: Blur
    strength: float
    noise: tuple[NoiseSpectrum, ...]
    trusted: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Numbers for a document."""
        return {
            "verdict": self.verdict,
            "trusted": self.trusted,
            "told": [self.sentence],
            "next": list(self.advice),
            "scale": self.setting.scale,
            "turn_deg": math.degrees(self.setting.turn),
            "gain": self.setting.gain,
            "gain_expected": self.expected,
            "gain_by_chance": list(self.chance),
            "share": self.share,
            "light_below_0": self.wrong[0],
            "light_below_0_without_display": self.wrong[1],
            "rival": None if self.rival is None else {"die": self.rival[0], "gain": self.rival[1]},
        }

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        setting = self.setting
        evidence = f"log-likelihood {setting.gain:.0f}, by chance {self.chance[0]:.0f} ± {self.chance[1]:.0f}"
        if self.verdict == EXPLAINED:
            return (
                f"The PSF explains the photograph: {100 * self.share:.0f} % of its structure is seen, at "
                f"{setting.scale:.3f} of its size and a turn of {math.degrees(setting.turn):+.2f} degrees "
                f"({evidence})."
            )
        if self.verdict == UNSURE:
            size = f"at {setting.scale:.2f} of its size, where" if abs(setting.scale - 1) > SCALE else "for"
            undone = "as it is said to be" if self.trusted else f"{size} nothing speaks against it"
            return f"Cannot tell whether the PSF explains the photograph ({evidence}). It was undone, {undone}."
        undone = "The PSF was undone as it is said to be." if self.trusted else "The picture stays as it was taken."
        why = f"the structure that the PSF makes is not there ({evidence})"
        if self.wrong[0] > _WRONG:
            why = f"of what undoing the PSF changes, {100 * self.wrong[0]:.1f} % would be light below 0"
        return f"Not this display, as far as the photograph tells: {why}. {undone}"

    @property
    def advice(self) -> tuple[str, ...]:
        """Steps that a lab takes next."""
        off = abs(self.setting.scale - 1) > _FAR_SCALE or abs(self.setting.turn) > _FAR_TURN
        steps = ["State the pixel, the focal length and the turn that were fitted."] if off else []
        if abs(self.setting.scale - 1) > SCALE:
            steps = [f"It fits at {self.setting.scale:.2f} of its size: check pixel and focal length."]
        if self.verdict == EXPLAINED:
            return (
                *steps,
                "Capture a point light through the die (maskfab measure): its PSF tells lens and focus too.",
            )
        again = (
            "Where the picture is covered with waves: leave --trust out, or give a strength, --epsilon 0.1 or more."
            if self.trusted
            else "Undo the PSF as it is said to be, whatever the photograph says: --trust."
        )
        if self.verdict == UNSURE:
            return (
                *(steps if abs(self.setting.scale - 1) > SCALE else ()),
                "Photograph something with detail all over, in more light, and keep the RAW file.",
                "Or capture a point light through the die, and restore by its PSF (--psf).",
                again,
            )
        return (
            *([] if self.rival is None else [f"Try --die {self.rival[0]}: it explains the photograph better."]),
            "Check the die, the way that it stands (--stands), the camera's pixel and focal length, and the focus.",
            again,
        )


@dataclass(frozen=True, eq=False)
class FittedBlur:
    """A blur at another scale and angle.

    Attributes:
        transfer: on frequencies half as far apart as those of the square that it was fitted to.
    """

    transfer: Transfer
    setting: Fitted
    _kept: dict[tuple[int, int], Transfer] = field(default_factory=dict, init=False, repr=False)

    def on(self, shape: tuple[int, int]) -> Transfer:
        if shape not in self._kept:
            rows, columns = shape
            odd = np.iscomplexobj(self.transfer)
            empty: Any = np.empty((3, rows, columns // 2 + 1), dtype=np.complex64 if odd else np.float32)
            found: Transfer = empty
            fy, fx = np.asarray(scipy.fft.fftfreq(rows)), np.asarray(scipy.fft.rfftfreq(columns))[None]
            strip = max(1, 2_000_000 // fx.size)
            for first in range(0, rows, strip):
                part = slice(first, first + strip)
                y, x = np.broadcast_arrays(fy[part, None], fx)
                found[:, part] = _warped(self.transfer, y, x, self.setting.scale, self.setting.turn)
            found.flags.writeable = False
            self._kept.clear()
            self._kept[shape] = found
        return self._kept[shape]


def explain(
    record: Record,
    blur: Blur,
    noise: Sequence[NoiseSpectrum],
    rivals: Mapping[str, Callable[[], Blur]] = MappingProxyType({}),
) -> Explained:
    """Hold a blur against a record, and fit what is usually unknown.

    Args:
        record: of at least 128 pixels along a side.
        rivals: makers of other blurs by name, of which one may explain it better; tried where this one does not.
    """
    square = _middle(record, LARGEST)
    seen = _Seen.of(square.values, noise)
    mine = _Comparison(seen, _Shape.of(blur, seen.plane))
    at, low = _places(seen)
    even, strength = whitened(square, seen.noise), mine.strength()
    tried, share, expected, chance, clear = [Fitted()], 0.0, 0.0, (0.0, 0.0), False
    if len(low) >= _FEWEST:
        by_chance = [mine.gain(at, scale, turn) for scale, turn in _DECOYS]
        chance = float(np.mean(by_chance)), float(np.std(by_chance))
        drawn, best = Fitted(1.0, 0.0, mine.gain(at, 1.0, 0.0)), mine.best(low, at)
        # A scene has structure of its own, which lies better somewhere by as much as chance has it.
        tried = [drawn, best] if best.gain > drawn.gain + _CLEAR else [drawn]
        tried = [best] if best.gain > drawn.gain + _CLEAR * (1 + chance[1]) else tried
    blurs = [blur if one.as_drawn else FittedBlur(mine.shape.transfer, one) for one in tried]
    wrongs = [_wrong(even, WhitenedBlur(undone, seen.noise), strength) for undone in blurs]
    wrong, setting, undone = min(zip(wrongs, tried, blurs, strict=True), key=lambda one: one[0][0])
    if len(low) >= _FEWEST:
        clear = setting.gain > max(_LEAST, chance[0] + _CLEAR * chance[1])
        expected, share = mine.expected(at), mine.share(at, setting)
    if wrong[0] > _WRONG or (share < _LEAST_SHARE and expected > _PLAIN):
        far = mine.far(low, at)
        if far.gain > max(_FAR_GAIN, chance[0] + _FAR_CLEAR * chance[1]):
            blur_far = FittedBlur(mine.shape.transfer, far)
            wrong_far = _wrong(even, WhitenedBlur(blur_far, seen.noise), strength)
            if wrong_far[0] == 0:
                setting, undone, wrong, strength = far, blur_far, wrong_far, max(strength, _MILD)
                clear, share, expected = True, mine.share(at, far), 0.0
    seen_clearly, missing = clear and share >= _LEAST_SHARE, share < _LEAST_SHARE and expected > _PLAIN
    verdict = EXPLAINED if seen_clearly else UNSURE
    missing_surely = missing and (wrong[1] < _WRONG or expected > _OBVIOUS)
    if missing_surely or wrong[0] > (_STILL_WRONG if seen_clearly else _WRONG):
        verdict = FOREIGN
    elif missing or wrong[0] > _DOUBTFUL:
        strength *= _DOUBT
    elif verdict == UNSURE and setting.as_drawn:
        # A scene's own structure, as a chart has, looks like noise to a smooth spectrum.
        weaker = strength / _DROWNED
        if _wrong(even, WhitenedBlur(undone, seen.noise), weaker)[0] == 0:
            strength = weaker
    rival = _rival(record, blur, noise, rivals) if verdict == FOREIGN else None
    return Explained(verdict, setting, share, expected, chance, wrong, rival, undone, strength, seen.noise)


def _wrong(square: Record, blur: Blur, strength: float) -> tuple[float, float]:
    """q of a record, and of the picture that is restored from it."""
    side = square.values.shape[1]
    margin = Margin((side + 2 * _ROOM, side + 2 * _ROOM), _ROOM)
    inverse = wiener(blur.on(margin.shape), prior(margin.shape), strength)
    inner = (slice(None), *(slice(side // 4, -(side // 4)),) * 2)
    variance = square.variance.mean(axis=(1, 2), dtype=np.float64)
    noise = float((np.square(abs(inverse)).mean(axis=(1, 2), dtype=np.float64) * variance).mean())

    def share(seen: Singles) -> tuple[float, Singles]:
        picture = margin.blurred(margin.mirrored(seen), inverse)
        # At the edges light that came from beyond them is missing.
        below = float(np.square(np.minimum(picture, 0)[inner]).mean(dtype=np.float64)) - noise / 2
        change = float(np.square((picture - seen)[inner]).mean(dtype=np.float64))
        return max(below, 0.0) / max(change, 1e-30), picture

    first, picture = share(square.values)
    return first, share(np.maximum(picture, 0))[0]


def _middle(record: Record, most: int) -> Record:
    side = min(*record.values.shape[1:], most) // 2 * 2
    top, left = ((whole - side) // 2 for whole in record.values.shape[1:])
    return replace(record, values=record.values[:, top : top + side, left : left + side])


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
    seen = _Seen.of(_middle(record, LARGEST // 2).values, noise)
    at, low = _places(seen)
    if len(low) < _FEWEST:
        return None
    own = _Comparison(seen, _Shape.of(blur, seen.plane)).best(low, at).gain
    gains = {name: _Comparison(seen, _Shape.of(made(), seen.plane)).best(low, at).gain for name, made in rivals.items()}
    best = max(gains, key=lambda name: gains[name])
    return (best, gains[best] - own) if gains[best] > max(_RIVAL * own, own + _LEAST) else None


_FAR_SCALE, _FAR_TURN = 0.01, math.radians(0.5)
