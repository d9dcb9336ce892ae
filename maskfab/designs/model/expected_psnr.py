"""Expected restored PSNR of a unit opening in about a millisecond: a protocol without its pictures' transforms.

The squared error of the restored picture is the sum of

* noise, σ² times the mean of G² over the sensor's square of frequencies;
* what the filter holds back at high frequencies, the mean of P (1 - GH)² with the scenes' mean spectrum P;
* the same below 1/16 cycle per pixel, **with the leak**: halo that crosses the sensor's edge. It is found by blurring,
  mirroring and restoring a low-passed scene on pixels eight times as wide.

The autocorrelation is that of the mean over all random layouts, without the cells that the stop cuts,

    A(t) = S(t) (C(t mod n) + V(t)),

S of the open stop, C circular of the unit averaged over the orientations, V linear: mean of the oriented units' minus
that of their mean. Sampled at whole lags: all short ones, and a fixed random choice of long ones, weighted.

Behind a job's own camera by protocol ``camera`` the scenes are linear light, brought to one contrast with their noise,
and the error in linear light gives the order of openings: with the PSNR of sRGB code values, as that protocol scores
them, its rank correlation over 16 openings of 100 dots was .95, .99 and .99 at 24, 32 and 40 dB (5.56 mm, f/1.6, 1.12
um pixels; drawn scenes against the mean of these and three photographs). How far the two PSNRs lie apart depends on the
level alone, nearly: it is found once, for a square opening, with the curve of sRGB at pixels of the scenes.

Where light has a phase, that of a depth or of a lens, S is the open stop's with that phase and complex: means over
layouts and over where a cell begins are products of the lens's autocorrelation and the unit's, as long as the phase
changes little over a cell. A gap between panel and stop changes no mean: a free wave keeps its autocorrelation.

Notes:
    The camera is that of the lattice, protocol F1's by default; its middle wavelength stands for all.
    Random layouts scatter about their mean. Where a phase takes the mean below that, as several waves at the rim do,
    restored pictures are better than is expected, and openings rank less surely.
    Full wells, mosaics and brackets are left out. Highlights are white.

Far from the sensor's edge the error is the surrogate's formula without the leak, at every lag. For a transfer H real
and at least 0, a scene of power P = c f^-p and the filter H/(H² + R), R = ε (f/0.1)²,

    E = mean over frequencies of  σ² H²/(H² + R)² + P R²/(H² + R)²

(Wiener 1949; the sum of what the filter makes of the noise and of what it holds back). H is sampled at every whole lag
within the square of frequencies, so E is a mean over lags. The lags and their weights have the symmetry of the square,
so the lags 0 <= y <= x are enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from types import MappingProxyType

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Complexes, Floats, Indices, Ints, Mask, Singles
from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, orient
from maskfab.camera.imaging import Transfer
from maskfab.camera.restorers.wiener import PRIOR_CY_PER_PX, wiener
from maskfab.camera.scenes import Photograph
from maskfab.camera.stop_cells import CellGrid, Lagged, OpenStop
from maskfab.designs.model.statistics import (
    COLUMNS,
    F1_SETTINGS,
    FACTOR,
    ROWS,
    WIDTH,
    CaptureSettings,
    PixelNoise,
    SceneStatistics,
    scene_statistics,
)
from maskfab.job.camera import REFERENCE_TRANSMISSION
from maskfab.mask.opening_masks import closed
from maskfab.optics.colour import code_of_light
from maskfab.optics.restoration import squared_modulus
from maskfab.optics.stop import Waves

_LONG_LAGS = 3000

_LEAK_EVERY = 5
"""For other photographs than protocol F1's: their ε lie wider apart, and with them what leaks."""

_AROUND = 3
"""Steps of ε below and above the best of all levels behind a square opening that are tried behind others."""

_NORMAL_NODES = 15

_NEAR = 168 / 165.625
"""Share of the lag of the highest low frequency up to which lags are held: just beyond it."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Mean squared errors behind one unit, by ε.

    Attributes:
        noise: of the noise, over its variance.
        bias: of what the filter holds back.
        leak: of the low-passed scenes.
    """

    pixels: PixelNoise
    noise: Floats
    bias: Floats
    leak: Floats

    def __call__(self, level: float, open_share: float) -> Floats:
        """Error of all three together at a level of light."""
        return self.pixels.variance(level, open_share) * self.noise + self.bias + self.leak


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Everything that no opening changes; call it with an opening.

    Attributes:
        lags: int64 [2, m], y and x of the sampled lags.
        clear: [m], S times the pixel's sinc at them.
        folded: [m], what sampling folds back at them from a uniform grey panel.
        weight: [m], share of the square of frequencies; sums to 1.
        signal: [m], weight times P, 0 where the low-passed scene takes over.
        inverse_prior: [m], (f / 0.1)².
        near: S at the lags -k to k that reach the low frequencies, 168 um for protocol F1, [2 k + 1] twice.
        along: matrices from these lags to the low frequencies of y and x, the pixel's sinc in them.
        low: complex64 [scenes, 128, 97], low-passed scenes; their own part on the sensor is ``low_truth``.
        low_prior: (f / 0.1)² at their frequencies.
        strengths: ε to choose from, ascending.
        leak_every: step between those at which the leak is computed; in between it is interpolated.
        amplitude: behind the open stop, [side, side], where light has a phase; then ``clear``, ``folded`` and ``near``
            may be complex.
    """

    lattice: CellGrid
    lags: Ints
    clear: Lagged
    folded: Lagged
    weight: Floats
    signal: Floats
    inverse_prior: Floats
    near: Lagged
    along: tuple[Floats, Floats]
    low: NDArray[np.complex64]
    low_truth: Singles
    low_prior: Singles
    noise: PixelNoise
    strengths: tuple[float, ...]
    leak_every: int = 7
    amplitude: Complexes | None = None

    @property
    def levels(self) -> tuple[float, ...]:
        """Levels of light, dB."""
        return self.noise.settings.levels

    @property
    def dots(self) -> int:
        """Along the unit's side."""
        return self.lattice.dots

    def __call__(
        self, unit: Mask, *, periodic: bool = False, levels: Sequence[float] | None = None
    ) -> tuple[float, ...]:
        """Expected restored PSNR in dB at each level, each with its best ε.

        Args:
            unit: bool [dots, dots], some of it clear.
            periodic: every cell has the unit as it is; otherwise each is turned at random.
            levels: of light; None for the surrogate's own.

        Raises:
            JobError: MF105 for a unit of other dots; MF104 for a level that is not known.
            OpeningError: MF203 if it is closed.
        """
        asked = self.levels if levels is None else levels
        self._require(unit, asked)
        errors, share = self.errors(unit, periodic=periodic)
        return tuple(self.decibels(level, float(errors(level, share).min())) for level in asked)

    def decibels(self, level: float, error: float) -> float:
        """The PSNR that a mean squared error stands for at a level of light."""
        return float(-10 * np.log10(error)) + self.noise.added_db(level)

    def errors(self, unit: Mask, *, periodic: bool = False) -> tuple[Errors, float]:
        """Errors of a unit by ε, and its clear share."""
        circular, linear = _correlations(unit, periodic)
        leak = self._leak(circular, linear, np.array(self.strengths))
        share = float(unit.mean())
        return self._of_lags(circular, linear, share, leak), share

    def _of_lags(self, circular: Floats, linear: Floats, share: float, leak: Floats) -> Errors:
        wrapped, short, within = self._places
        transfer = self.clear * circular.ravel()[wrapped] + self.folded * share
        transfer[short] += self.clear[short] * linear.ravel()[within]
        squared = squared_modulus(transfer)
        epsilons, shared = self._regular
        below = squared + shared
        below *= below
        np.reciprocal(below, out=below)
        noise = below @ (self.weight * squared)
        bias = epsilons**2 * (below @ (self.signal * self.inverse_prior**2))
        return Errors(self.noise, noise, bias, leak)

    @cached_property
    def _places(self) -> tuple[Ints, Indices, Ints]:
        """The lags as flat indices into circular correlations; which are short, and these into linear ones."""
        n, (y, x) = self.dots, self.lags
        short = np.flatnonzero((abs(y) < n) & (abs(x) < n))
        return y % n * n + x % n, short, y[short] % (2 * n) * 2 * n + x[short] % (2 * n)

    @cached_property
    def _regular(self) -> tuple[Floats, Floats]:
        """ε, and what it adds to the squared transfer at each lag, [ε, m]."""
        epsilons = np.array(self.strengths)
        return epsilons, epsilons[:, None] * self.inverse_prior

    def _require(self, unit: Mask, levels: Sequence[float]) -> None:
        if unit.shape != (self.dots, self.dots):
            what = f"the opening is {unit.shape}, the cell {self.dots} x {self.dots} dots"
            raise JobError("MF105", what, where="design.dots", cure="Give one value per dot")
        if not unit.any():
            raise closed(0, unit.size)
        self.noise.settings.require(levels)

    def _leak(self, circular: Floats, linear: Floats, epsilons: Floats) -> Floats:
        """Mean squared error of the low-passed scenes at every ε, interpolated between every few."""
        reach = len(self.near) // 2
        lags = np.arange(-reach, reach + 1)
        table = circular[np.ix_(lags % self.dots, lags % self.dots)]
        within = np.flatnonzero(abs(lags) <= self.dots)
        table[np.ix_(within, within)] += linear[np.ix_(lags[within], lags[within])]
        low = self.along[0] @ (table * self.near) @ self.along[1].T
        transfer: Transfer = low.astype(np.complex64) if np.iscomplexobj(low) else low.astype(np.float32)
        seen = _mirrored(_on_sensor(self.low * transfer))
        computed = epsilons[:: self.leak_every].astype(np.float32)
        filters = np.stack([wiener(transfer, self.low_prior, epsilon) for epsilon in computed])
        missed = _on_sensor(seen * filters[:, None])
        missed -= self.low_truth
        errors = np.square(missed, out=missed).mean(axis=(1, 2, 3), dtype=np.float64)
        return np.asarray(np.exp(np.interp(np.log(epsilons), np.log(computed), np.log(np.maximum(errors, 1e-12)))))


def _on_sensor(spectra: NDArray[np.complex64]) -> Singles:
    """The sensor's part of pictures of spectra [.., 128, 97], overwritten; rows beyond it are not transformed."""
    rows = scipy.fft.ifft(spectra, axis=-2, overwrite_x=True, workers=1)[..., WIDTH:-WIDTH, :]
    return np.asarray(scipy.fft.irfft(rows, COLUMNS, axis=-1, workers=1)[..., WIDTH:-WIDTH])


def _mirrored(record: Singles) -> NDArray[np.complex64]:
    """Spectrum of records mirrored at their edges, whose pixels are doubled; mirrored rows are transformed once."""
    rows = scipy.fft.rfft(np.pad(record, [(0, 0), (0, 0), (WIDTH, WIDTH)], mode="symmetric"), axis=2, workers=1)
    tall = np.pad(rows, [(0, 0), (WIDTH, WIDTH), (0, 0)], mode="symmetric")
    return np.asarray(scipy.fft.fft(tall, axis=1, workers=1))


def surrogate_behind(
    scenes: Sequence[Photograph], room: CellGrid, *, settings: CaptureSettings = F1_SETTINGS, leak_scenes: int = 2
) -> Surrogate:
    """Prepare the surrogate for units of given cells, from scenes of 1024 x 1536 pixels (others are left out).

    The spectrum P is c f^-p, fitted to the scenes' rings from 0.02 to 0.4 cycles per pixel; the scenes' own low
    frequencies are used as they are.

    Args:
        leak_scenes: pictures that the leak is computed on; what is designed on few fits them and not others.

    Raises:
        JobError: MF121 if no scene has that size, or one is the same grey everywhere.
    """
    return surrogate_of(scene_statistics(scenes, leak_scenes=leak_scenes, settings=settings), room)


def surrogate_of(statistics: SceneStatistics, room: CellGrid, waves: Waves | None = None) -> Surrogate:
    """The surrogate for the units of given cells, in light of a phase at the stop where there is one."""
    wavelength_nm = room.camera.middle_nm
    per_cycle = room.per_cycle(wavelength_nm)
    amplitude = None if waves is None else room.turned(waves)
    open_stop = OpenStop.of(room, wavelength_nm, amplitude=amplitude)
    lags, count = _choose_lags(room.dots, int(per_cycle / 2))
    nu = lags / per_cycle
    distance = np.hypot(nu[0], nu[1])
    weight = count / count.sum()
    edge = 0.5 / FACTOR
    low = (abs(nu[0]) < edge) & (abs(nu[1]) < edge)
    density = statistics.factor * np.maximum(distance, 1e-3) ** -statistics.power
    axes = scipy.fft.fftfreq(ROWS) / FACTOR, scipy.fft.rfftfreq(COLUMNS) / FACTOR
    # Rounding must not add a dot where that is a whole number of them.
    reach = math.ceil(_NEAR * edge * per_cycle - 1e-9)
    near = np.arange(-reach, reach + 1)
    made = Surrogate(
        room,
        lags,
        open_stop(nu[0], nu[1]),
        open_stop.folded(nu[0], nu[1]),
        weight,
        np.where(low, 0, weight * density),
        (distance / PRIOR_CY_PER_PX) ** 2 + 1e-12,
        open_stop.at(near[:, None], near),
        (interpolation(axes[0], per_cycle, reach), interpolation(axes[1], per_cycle, reach)),
        statistics.low,
        statistics.low_truth,
        ((axes[0][:, None] ** 2 + axes[1] ** 2) / PRIOR_CY_PER_PX**2).astype(np.float32),
        statistics.noise,
        statistics.noise.settings.protocol.strengths,
        amplitude=amplitude,
    )
    return made if statistics.noise.settings.is_f1 else _coded(_narrowed(made), statistics.pixels)


def _narrowed(estimate: Surrogate) -> Surrogate:
    """With the ε round those that are best behind a square opening, whose number the leak's own suit."""
    errors, share = estimate.errors(_square(estimate.dots))
    best = [int(errors(level, share).argmin()) for level in estimate.levels]
    steps = max(best) - min(best) + 2 * _AROUND
    count = _LEAK_EVERY * max(1, math.ceil(steps / _LEAK_EVERY)) + 1
    start = min(max(0, (min(best) + max(best) - count + 1) // 2), max(0, len(estimate.strengths) - count))
    return replace(estimate, strengths=estimate.strengths[start : start + count], leak_every=_LEAK_EVERY)


def _coded(estimate: Surrogate, scenes: Sequence[tuple[Floats, float]]) -> Surrogate:
    """With what the PSNR of sRGB code values has above that of light, behind a square opening.

    A pixel of light L errs normally, with the variance of its own noise, of the leak's mean, and of what the filter
    holds back its share by L², as contrasts are in proportion to the light. Behind 16 openings of one camera the means
    that are expected so lay within 1 dB of protocol ``camera``'s for drawn scenes, within 3 dB for three photographs;
    differences between openings do not depend on it.
    """
    errors, share = estimate.errors(_square(estimate.dots))
    nodes, shares = np.polynomial.hermite_e.hermegauss(_NORMAL_NODES)
    shares = shares / shares.sum()
    added = {}
    for level in estimate.levels:
        mean = errors(level, share)
        best, white = int(mean.argmin()), estimate.noise.white(level, share)
        decibels = []
        for light, scale in scenes:
            own = light / white + (estimate.noise.settings.read_noise(white) / white) ** 2
            rest = errors.bias[best] * light**2 / np.mean(light**2) + errors.leak[best]
            variance = errors.noise[best] * own + rest / scale**2
            coded = code_of_light(light)
            missed = code_of_light(light + np.sqrt(variance) * nodes[:, None, None]) - coded
            decibels.append(-10 * np.log10(float(shares @ (missed**2).mean(axis=(1, 2)))))
        added[level] = float(np.mean(decibels) + 10 * np.log10(mean[best]))
    return replace(estimate, noise=replace(estimate.noise, coded_db=MappingProxyType(added)))


def _square(dots: int) -> Mask:
    """A unit with a square opening of about the published display's light."""
    unit = np.zeros((dots, dots), dtype=np.bool_)
    side = max(1, round(dots * REFERENCE_TRANSMISSION**0.5))
    unit[:side, :side] = True
    return unit


def _choose_lags(dots: int, longest: int) -> tuple[Ints, Floats]:
    """Lags [2, m] of the upper half plane, and how many each stands for: short ones all, long ones by chance."""
    y, x = (v.ravel() for v in np.mgrid[0 : longest + 1, -longest : longest + 1])
    upper = (y > 0) | (x >= 0)
    y, x = y[upper], x[upper]
    short = np.maximum(y, abs(x)) <= dots
    far = np.flatnonzero(~short)
    chance = 1 / np.hypot(y[far], x[far])
    chance = np.minimum(1, _LONG_LAGS * chance / chance.sum())
    drawn = np.random.default_rng(0).random(len(far)) < chance
    index = np.concatenate([np.flatnonzero(short), far[drawn]])
    return np.stack([y[index], x[index]]), np.concatenate([np.ones(int(short.sum())), 1 / chance[drawn]])


def interpolation(frequency: Floats, per_cycle: float, reach: int) -> Floats:
    """[frequencies, 2 reach + 1]: bilinear weights at lags -reach to reach, times the pixel's sinc."""
    lags = np.arange(-reach, reach + 1)
    hat = np.maximum(0, 1 - abs(frequency[:, None] * per_cycle - lags))
    return np.asarray(hat * np.sinc(frequency)[:, None])


@dataclass(frozen=True, eq=False)
class Interior:
    """The lags 0 <= y <= x within the square of frequencies, and all that no opening changes at them.

    Attributes:
        lags: int64 [2, m], y and x in dots.
        count: [m], lags of the whole plane that each stands for: 1, 4 or 8.
        weight: [m], share of the square of frequencies; sums to 1.
        stop: [m], the open stop's autocorrelation, 1 at lag 0.
        pixel: [m], the pixel's sinc at them.
        folded: [m], what sampling folds back at them from a uniform grey panel.
        power: [m], P at them, white is 1.
        inverse_prior: [m], (f / 0.1)².
        strengths: ε to choose from.
        per_cycle: lag in dots that belongs to one cycle per pixel.
    """

    lattice: CellGrid
    lags: Ints
    count: Floats
    weight: Floats
    stop: Floats
    pixel: Floats
    folded: Floats
    power: Floats
    inverse_prior: Floats
    noise: PixelNoise
    strengths: tuple[float, ...]
    per_cycle: float
    stop_dots: float

    @property
    def dots(self) -> int:
        """Along the unit's side."""
        return self.lattice.dots

    @property
    def levels(self) -> tuple[float, ...]:
        """Levels of light, dB."""
        return self.noise.settings.levels

    def decibels(self, level: float, error: float) -> float:
        """The PSNR that a mean squared error stands for at a level of light."""
        return float(-10 * np.log10(max(error, 1e-30))) + self.noise.added_db(level)

    def transfer(self, modulation: Floats, grey: float) -> Floats:
        """H of a pupil's autocorrelation [..., m], 1 at lag 0, folded as that of a panel of transmittance ``grey``."""
        return np.asarray(modulation * self.pixel + grey * self.folded)

    def psnr(
        self, modulation: Floats, open_share: float, grey: float, levels: Sequence[float] | None = None
    ) -> tuple[float, ...]:
        """The PSNR of E in dB at each level, each with its best ε.

        Args:
            modulation: the pupil's autocorrelation at the lags, 1 at lag 0, [m] or [images, m] to take the mean over.
            grey: modulation between far dots, which sampling folds back.
            levels: of light; None for the photographs' own.
        """
        squared = np.atleast_2d(self.transfer(modulation, grey)) ** 2
        asked, errors = self.levels if levels is None else levels, []
        for epsilon in self.strengths:
            regular = epsilon * self.inverse_prior
            filtered = 1 / (squared + regular) ** 2
            noise = float(((squared * filtered) @ self.weight).mean())
            bias = float((filtered @ (self.weight * self.power * regular**2)).mean())
            errors.append([self.noise.variance(level, open_share) * noise + bias for level in asked])
        return tuple(self.decibels(level, error) for level, error in zip(asked, np.min(errors, axis=0), strict=True))

    def of_unit(
        self, unit: Mask, *, periodic: bool = False, levels: Sequence[float] | None = None
    ) -> tuple[float, ...]:
        """Expected PSNR in dB of a unit [dots, dots] turned at random, or as it is in every cell."""
        y, x = self.lags
        images = [(y, x), (-y, x), (x, y), (-x, y)] if periodic else [(y, x)]
        table = unit_modulation(unit, periodic=periodic)
        far = np.maximum(abs(y), abs(x)) >= self.dots
        size = 2 * self.dots
        rows = []
        for v, u in images:
            near = table[1][v % size, u % size]
            rows.append(self.stop * np.where(far, table[0][v % self.dots, u % self.dots], near))
        return self.psnr(np.stack(rows), float(unit.mean()), float(unit.mean()), levels)


@lru_cache(maxsize=1)
def interior(estimate: Surrogate) -> Interior:
    """The interior part of a surrogate, at every lag instead of its sample of them, low frequencies included."""
    distance = 0.1 * np.sqrt(np.maximum(estimate.inverse_prior - 1e-12, 0))
    farthest = int(np.argmax(distance))
    per_cycle = float(np.hypot(*estimate.lags[:, farthest]) / distance[farthest])
    # The surrogate's power is exactly c f^-p where it is not 0.
    powered = np.flatnonzero(estimate.signal)
    ends = powered[np.argmin(distance[powered])], powered[np.argmax(distance[powered])]
    logs = [(np.log(distance[i]), np.log(estimate.signal[i] / estimate.weight[i])) for i in ends]
    slope = (logs[1][1] - logs[0][1]) / (logs[1][0] - logs[0][0])
    longest = int(per_cycle / 2)
    y, x = (v.ravel() for v in np.mgrid[0 : longest + 1, 0 : longest + 1])
    half = y <= x
    y, x = y[half], x[half]
    count = np.where(y == x, 4.0, 8.0) / np.where(y == 0, 2, 1)
    count[0] = 1
    open_stop = OpenStop.of(estimate.lattice, estimate.lattice.camera.middle_nm, per_cycle)
    frequency = np.hypot(y, x) / per_cycle
    power = np.exp(logs[0][1] + slope * (np.log(np.maximum(frequency, 1e-3)) - logs[0][0]))
    return Interior(
        estimate.lattice,
        np.stack([y, x]),
        count,
        count / count.sum(),
        open_stop.at(y, x),
        np.sinc(y / per_cycle) * np.sinc(x / per_cycle),
        open_stop.folded(y / per_cycle, x / per_cycle),
        power,
        (frequency / PRIOR_CY_PER_PX) ** 2 + 1e-12,
        estimate.noise,
        estimate.strengths,
        per_cycle,
        open_stop.dots,
    )


def unit_modulation(unit: Mask, *, periodic: bool = False) -> tuple[Floats, Floats]:
    """Mean autocorrelation of the tiled unit over that of the stop, cut cells left out.

    Returns:
        [n, n] at lags of n dots and more along an axis, by lag modulo n; [2n, 2n] at shorter lags, modulo 2n.
    """
    circular, linear = _correlations(unit, periodic)
    return circular, np.tile(circular, (2, 2)) + linear


def _correlations(unit: Mask, periodic: bool) -> tuple[Floats, Floats]:
    """C [dots, dots] and V [2 dots, 2 dots], negative lags wrapped round, divided by the clear dots."""
    n, total = len(unit), unit.sum()
    turned = np.stack([orient(unit, k) for k in range(1 if periodic else ORIENTATIONS)]).astype(np.float64)
    circular = scipy.fft.irfft2(abs(scipy.fft.rfft2(turned.mean(axis=0))) ** 2, (n, n)) / total
    wide = scipy.fft.rfft2(turned, (2 * n, 2 * n))
    spread = (abs(wide) ** 2).mean(axis=0) - abs(wide.mean(axis=0)) ** 2
    return circular, scipy.fft.irfft2(spread, (2 * n, 2 * n)) / total
