r"""Expected restored PSNR of a unit opening in about a millisecond: a protocol without its pictures' transforms.

The squared error of the restored picture is the sum of

* noise, σ² times the mean of G² over the sensor's square of frequencies;
* what the filter holds back at high frequencies, the mean of P (1 - GH)² with the scenes' mean spectrum P;
* the same below 1/16 cycle per pixel, **with the leak**: halo that crosses the sensor's edge. It is found by blurring,
  mirroring and restoring a low-passed scene on pixels eight times as wide.

The autocorrelation is that of the mean over all random layouts, without the cells that the stop cuts,

    A(t) = S(t) (C(t mod n) + V(t)),

S of the open stop, C circular of the unit averaged over the orientations, V linear: mean of the oriented units' minus
that of their mean. Sampled at whole lags: all short ones, and a fixed random choice of long ones, weighted.

Notes:
    The camera is that of the lattice, protocol F1's by default; its middle wavelength stands for all, and the levels of
    light are F1's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from maskfab.camera.exposure import ELECTRONS, F1_SENSOR, REFERENCE_TRANSMISSION
from maskfab.camera.photo_camera import F1, PhotoCamera
from maskfab.camera.photographs import Photograph
from maskfab.camera.protocol import EPSILONS, LEVELS
from maskfab.camera.restorers.wiener import PRIOR_CY_PER_PX, wiener
from maskfab.camera.transfer import CellGrid, OpenStop, lattice
from maskfab.errors import JobError
from maskfab.model import ORIENTATIONS, orient
from maskfab.opening.clear_dots import closed

Floats = NDArray[np.float64]

_ROWS, _COLUMNS, _FACTOR = 128, 192, 8
_WIDTH = 32
_LONG_LAGS = 3000
_LEAK_EVERY = 7
_NEAR = 168 / 165.625
"""Share of the lag of the highest low frequency up to which lags are held: just beyond it."""
LEAST_CONTRAST = 1e-4
"""A tenth of what the smallest step of eight bits is, evenly spread."""


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Everything that no opening changes; call it with an opening.

    Attributes:
        lattice: of the cells behind the stop.
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
        light: mean of the scenes, white is 1.
    """

    lattice: CellGrid
    lags: NDArray[np.int64]
    clear: Floats
    folded: Floats
    weight: Floats
    signal: Floats
    inverse_prior: Floats
    near: Floats
    along: tuple[Floats, Floats]
    low: NDArray[np.complex64]
    low_truth: NDArray[np.float32]
    low_prior: NDArray[np.float32]
    light: float

    @property
    def dots(self) -> int:
        """Along the unit's side."""
        return self.lattice.dots

    def __call__(
        self, unit: NDArray[np.bool_], *, periodic: bool = False, levels: Sequence[int] = LEVELS
    ) -> tuple[float, ...]:
        """Expected restored PSNR in dB at each level, each with its best ε.

        Args:
            unit: bool [dots, dots], some of it clear.
            periodic: every cell has the unit as it is; otherwise each is turned at random.
            levels: keys of :data:`maskfab.camera.exposure.ELECTRONS`.

        Raises:
            JobError: MF105 for a unit of other dots; MF104 for a level that is not known.
            OpeningError: MF203 if it is closed.
        """
        self._require(unit, levels)
        circular, linear = self._correlations(np.asarray(unit, dtype=np.float64), periodic)
        y, x = self.lags
        transfer = self.clear * circular[y % self.dots, x % self.dots] + self.folded * unit.mean()
        short = (abs(y) < self.dots) & (abs(x) < self.dots)
        transfer[short] += self.clear[short] * linear[y[short], x[short]]
        epsilons = np.array(EPSILONS)
        regular = epsilons[:, None] * self.inverse_prior
        squared = 1 / (transfer**2 + regular) ** 2
        noise = squared @ (self.weight * transfer**2)
        bias = epsilons**2 * (squared @ (self.signal * self.inverse_prior**2))
        leak = self._leak(circular, linear, epsilons)
        found = []
        for level in levels:
            white = ELECTRONS[level] * float(unit.mean()) / REFERENCE_TRANSMISSION
            variance = self.light / white + (F1_SENSOR.read_noise / white) ** 2
            found.append(float(-10 * np.log10((variance * noise + bias + leak).min())))
        return tuple(found)

    def _require(self, unit: NDArray[np.bool_], levels: Sequence[int]) -> None:
        if unit.shape != (self.dots, self.dots):
            raise JobError(
                "MF105",
                f"the opening is {unit.shape}, the cell {self.dots} x {self.dots} dots",
                where="design.dots",
                cure="Give one value per dot",
            )
        if not unit.any():
            raise closed(0, unit.size)
        if unknown := [level for level in levels if level not in ELECTRONS]:
            raise JobError(
                "MF104",
                f"the level {unknown[0]} dB is not one of {', '.join(map(str, ELECTRONS))}",
                where="design.levels",
                cure="Use levels from that list only",
            )

    def _correlations(self, unit: Floats, periodic: bool) -> tuple[Floats, Floats]:
        """C [dots, dots] and V [2 dots, 2 dots], negative lags wrapped round, divided by the clear dots."""
        n, total = self.dots, unit.sum()
        turned = unit[None] if periodic else np.stack([orient(unit, k) for k in range(ORIENTATIONS)])
        mean = turned.mean(axis=0)
        circular = scipy.fft.irfft2(abs(scipy.fft.rfft2(mean)) ** 2, (n, n)) / total
        wide = scipy.fft.rfft2(turned, (2 * n, 2 * n))
        spread = (abs(wide) ** 2).mean(axis=0) - abs(wide.mean(axis=0)) ** 2
        return circular, scipy.fft.irfft2(spread, (2 * n, 2 * n)) / total

    def _leak(self, circular: Floats, linear: Floats, epsilons: Floats) -> Floats:
        """Mean squared error of the low-passed scenes at every ε, interpolated between every seventh."""
        reach = len(self.near) // 2
        lags = np.arange(-reach, reach + 1)
        table = circular[np.ix_(lags % self.dots, lags % self.dots)]
        within = np.flatnonzero(abs(lags) <= self.dots)
        table[np.ix_(within, within)] += linear[np.ix_(lags[within], lags[within])]
        transfer = (self.along[0] @ (table * self.near) @ self.along[1].T).astype(np.float32)
        record = scipy.fft.irfft2(self.low * transfer, (_ROWS, _COLUMNS), workers=1)[:, _WIDTH:-_WIDTH, _WIDTH:-_WIDTH]
        around = [(0, 0), (_WIDTH, _WIDTH), (_WIDTH, _WIDTH)]
        seen = scipy.fft.rfft2(np.pad(record, around, mode="symmetric"), workers=1)
        known = epsilons[::_LEAK_EVERY].astype(np.float32)
        errors = []
        for epsilon in known:
            filtered = wiener(transfer, self.low_prior, epsilon)
            restored = scipy.fft.irfft2(seen * filtered, (_ROWS, _COLUMNS), workers=1)
            missed = restored[:, _WIDTH:-_WIDTH, _WIDTH:-_WIDTH] - self.low_truth
            errors.append(float(np.square(missed).mean()))
        return np.asarray(np.exp(np.interp(np.log(epsilons), np.log(known), np.log(np.maximum(errors, 1e-12)))))


def surrogate(
    scenes: Sequence[Photograph],
    dots: int = 21,
    *,
    dot_nm: int | None = None,
    camera: PhotoCamera = F1,
    leak_scenes: int = 2,
) -> Surrogate:
    """Prepare the surrogate for units of ``dots`` x ``dots``, from scenes of 1024 x 1536 pixels (others are left out).

    The spectrum P is c f^-p, fitted to the scenes' rings from 0.02 to 0.4 cycles per pixel; the scenes' own low
    frequencies are used as they are.

    Args:
        scenes: photographs, or drawn ones.
        dots: along the unit's side.
        dot_nm: side of a dot; None for cells of 168 um, however many dots they have.
        camera: that looks through the panel.
        leak_scenes: pictures that the leak is computed on; what is designed on few fits them and not others.

    Raises:
        JobError: MF121 if no scene has that size, or one is the same grey everywhere; MF104, MF115, MF135 for dots as
            :func:`maskfab.camera.transfer.lattice`.
    """
    return surrogate_behind(scenes, lattice(dots, dot_nm, camera=camera), leak_scenes=leak_scenes)


def surrogate_behind(scenes: Sequence[Photograph], room: CellGrid, *, leak_scenes: int = 2) -> Surrogate:
    """A surrogate for the units of given cells; arguments and errors as of :func:`surrogate`."""
    return SceneStatistics.of(scenes, leak_scenes=leak_scenes).behind(room)


@dataclass(frozen=True, eq=False)
class SceneStatistics:
    """Knowledge of a surrogate about its scenes, whatever cells they are seen through.

    Attributes:
        light: mean of the scenes, white is 1.
        factor, power: c and p of their spectrum c f^-p.
        low: complex64 [scenes, 128, 97], low-passed scenes.
        low_truth: their own part on the sensor, float32.
    """

    light: float
    factor: float
    power: float
    low: NDArray[np.complex64]
    low_truth: NDArray[np.float32]

    @classmethod
    def of(cls, scenes: Sequence[Photograph], *, leak_scenes: int = 2) -> SceneStatistics:
        """Of scenes as :func:`surrogate` takes them; errors likewise."""
        kept = _of_use(scenes)
        light = float(np.mean([s.values.mean() for s in kept]))
        kept = _equalised(kept)
        factor, power = _spectrum(kept)
        spectra = np.stack([scipy.fft.rfft2(values) for values in _mixed(kept, leak_scenes)])
        rows = np.r_[0 : _ROWS // 2, -_ROWS // 2 : 0]
        cut = spectra[:, rows, : _COLUMNS // 2 + 1] / _FACTOR**2
        # The highest frequencies of an even grid stand for both signs; without them nothing is ambiguous.
        cut[:, _ROWS // 2] = 0
        cut[:, :, -1] = 0
        small = scipy.fft.irfft2(cut, (_ROWS, _COLUMNS)).astype(np.float32)
        return cls(light, factor, power, cut.astype(np.complex64), small[:, _WIDTH:-_WIDTH, _WIDTH:-_WIDTH])

    def behind(self, room: CellGrid) -> Surrogate:
        """The surrogate for the units of given cells."""
        wavelength_nm = room.camera.middle_nm
        per_cycle = room.per_cycle(wavelength_nm)
        open_stop = OpenStop.of(room, wavelength_nm)
        lags, count = _choose_lags(room.dots, int(per_cycle / 2))
        nu = lags / per_cycle
        distance = np.hypot(nu[0], nu[1])
        weight = count / count.sum()
        edge = 0.5 / _FACTOR
        low = (abs(nu[0]) < edge) & (abs(nu[1]) < edge)
        density = self.factor * np.maximum(distance, 1e-3) ** -self.power
        axes = scipy.fft.fftfreq(_ROWS) / _FACTOR, scipy.fft.rfftfreq(_COLUMNS) / _FACTOR
        # Rounding must not add a dot where that is a whole number of them.
        reach = math.ceil(_NEAR * edge * per_cycle - 1e-9)
        near = np.arange(-reach, reach + 1)
        return Surrogate(
            room,
            lags,
            open_stop(nu[0], nu[1]),
            open_stop.folded(nu[0], nu[1]),
            weight,
            np.where(low, 0, weight * density),
            (distance / PRIOR_CY_PER_PX) ** 2 + 1e-12,
            open_stop.at(near[:, None], near),
            (_interpolation(axes[0], per_cycle, reach), _interpolation(axes[1], per_cycle, reach)),
            self.low,
            self.low_truth,
            ((axes[0][:, None] ** 2 + axes[1] ** 2) / PRIOR_CY_PER_PX**2).astype(np.float32),
            self.light,
        )


def _of_use(scenes: Sequence[Photograph]) -> list[Photograph]:
    kept = [s for s in scenes if s.values.shape[1:] == (_ROWS * _FACTOR, _COLUMNS * _FACTOR)]
    if not kept:
        raise JobError(
            "MF121",
            "no scene has 1536 x 1024 pixels",
            where="scenes",
            cure="Give photographs of 1536 x 1024 pixels or more",
        )
    for scene in kept:
        contrast = float(scene.values[1].std(dtype=np.float64))
        if not contrast >= LEAST_CONTRAST:
            raise JobError(
                "MF121",
                f"the picture {scene.name} is the same grey everywhere: its green values deviate by {contrast:.2g} of "
                f"white, least {LEAST_CONTRAST:g}; it has no spectrum to design for",
                where=f"scenes.{scene.name}",
                cure="Take it away, or give a photograph",
            )
    return kept


def _choose_lags(dots: int, longest: int) -> tuple[NDArray[np.int64], Floats]:
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


def _interpolation(frequency: Floats, per_cycle: float, reach: int) -> Floats:
    """[frequencies, 2 reach + 1]: bilinear weights at lags -reach to reach, times the pixel's sinc."""
    lags = np.arange(-reach, reach + 1)
    hat = np.maximum(0, 1 - abs(frequency[:, None] * per_cycle - lags))
    return np.asarray(hat * np.sinc(frequency)[:, None])


def _equalised(scenes: Sequence[Photograph]) -> list[Photograph]:
    """The scenes with their contrasts scaled to the geometric mean, as a mean over decibels weighs them alike."""
    contrast = np.array([float(s.values[1].std(dtype=np.float64)) for s in scenes])
    scale = np.exp(np.log(np.maximum(contrast, 1e-6)).mean()) / np.maximum(contrast, 1e-6)
    return [Photograph(s.name, s.number, s.values * np.float32(k)) for s, k in zip(scenes, scale, strict=True)]


def _mixed(scenes: Sequence[Photograph], most: int) -> list[Floats]:
    """At most so many pictures that leak as much as all: sums with random signs, over the root of their number.

    The leak is a square of something linear in the picture, so products of different scenes cancel on average.
    """
    green = np.stack([s.values[1] for s in scenes]).astype(np.float64)
    if len(scenes) <= most:
        return list(green)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(most, len(scenes))) / np.sqrt(len(scenes))
    return list(np.tensordot(signs, green, axes=1))


def _spectrum(scenes: Sequence[Photograph]) -> tuple[float, float]:
    """c and p of the green channels' power c f^-p, per pixel of variance."""
    rows, columns = scenes[0].values.shape[1:]
    window = np.hanning(rows)[:, None] * np.hanning(columns)
    power = np.mean([abs(scipy.fft.rfft2((s.values[1] - s.values[1].mean()) * window)) ** 2 for s in scenes], axis=0)
    power /= (window**2).sum()
    distance = np.hypot(scipy.fft.fftfreq(rows)[:, None], scipy.fft.rfftfreq(columns))
    edges = np.geomspace(0.02, 0.4, 13)
    ring = np.digitize(distance, edges)
    middle = np.sqrt(edges[:-1] * edges[1:])
    level = [power[ring == k].mean() for k in range(1, len(edges))]
    slope, offset = np.polyfit(np.log(middle), np.log(level), 1)
    return float(np.exp(offset)), float(-slope)
