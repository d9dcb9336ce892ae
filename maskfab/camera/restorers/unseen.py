r"""Least squares for scenes of which the sensor sees a part: what lies beyond its edge is unknown and solved for.

With S the cut to the sensor, H the blur on a frame that is wider than it, W weights of the pixels and a penalty that
is diagonal in frequency, the scene x makes

    1/2 || W^(1/2) (S H x - y) ||² + 1/2 <x, penalty x>

least. Conjugate gradients, preconditioned by the circulant 1 / (|H|² + penalty), run on spectra, so that a step takes
two transforms, of which a third is spared (Shewchuk, An introduction to the conjugate gradient method, 1994, B3).

Notes:
    Light far outside is seen by the halo alone, and takes the most steps. It is smooth, so a frame of a quarter of the
    pixels along a side finds it first, at a sixteenth of the cost, and that one asks one of a quarter again.
    All sums are over pixels; spectra are those of ``rfft2``, whose columns but the first and the last count twice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.camera.restorers.restorer import Transfer
from maskfab.camera.restorers.wiener import Margin

Spectrum = NDArray[np.complex64]

_MOST_STEPS = 100
_STALLED = 1e-4
"""Of the whole fall of the sum so far: a step that gains less is the last."""
_COARSER = 4
_COARSEST = 32
"""Pixels along a side of the sensor on the coarsest frame, at least."""


@dataclass(frozen=True, eq=False)
class Seen:
    """A record on a frame that is wider than the sensor.

    Attributes:
        margin: the frame, and the sensor in it.
        transfer: H, [colours, rows, columns / 2 + 1] of the frame.
        values: of the record, float32 [colours, sensor rows, sensor columns].
        weight: of every pixel, of the same shape, about 1; 0 where nothing is known.
    """

    margin: Margin
    transfer: Transfer
    values: Singles
    weight: Singles

    def colour(self, one: slice) -> Seen:
        """Part of the colours."""
        return replace(self, transfer=self.transfer[one], values=self.values[one], weight=self.weight[one])

    def light(self, spectrum: Spectrum) -> Singles:
        """S H x, of the spectrum of x."""
        return self.margin.blurred(spectrum, self.transfer)

    def back(self, light: Singles) -> Spectrum:
        """The adjoint of :meth:`light`, the spectrum of Hᵀ Sᵀ of what lies on the sensor."""
        return np.asarray(spread(self.margin, light) * self.transfer.conj())

    def _inverse(self, penalty: Singles) -> Singles:
        below = abs(self.transfer) ** 2 + penalty
        return np.asarray(np.divide(1, below, out=np.zeros_like(below), where=below > 0))

    def solve(self, penalty: Singles, start: Spectrum) -> Spectrum:
        """Spectrum of the scene of one colour on the whole frame.

        Args:
            penalty: at every frequency, at least 0, float32 [rows, columns / 2 + 1].
            start: spectrum of a first guess, [1, rows, columns / 2 + 1].
        """
        coarse = self._coarse()
        if coarse is not None:
            low = _Low(self.margin.shape, coarse.margin.shape)
            first = low.of(start)
            start = start + low.back(coarse.solve(low.cut(penalty), first) - first, start.shape)
        return self._descend(penalty, start)

    def _descend(self, penalty: Singles, start: Spectrum) -> Spectrum:
        inverse = self._inverse(penalty)
        scene = start.copy()
        rest = self.back(self.weight * (self.values - self.light(scene))) - scene * penalty
        way: Spectrum = np.multiply(rest, inverse)
        aim, fallen = _dot(rest, way), 0.0
        towards: Spectrum = way
        for _ in range(_MOST_STEPS):
            bent = self.back(self.weight * self.light(towards)) + towards * penalty
            bend = _dot(towards, bent)
            if bend <= 0:  # nothing is left that could be better
                break
            step = np.float32(aim / bend)
            scene += towards * step
            rest -= bent * step
            gained = float(step) * aim
            fallen += gained
            if gained <= _STALLED * fallen:
                break
            way = np.multiply(rest, inverse)
            before, aim = aim, _dot(rest, way)
            towards = way + towards * np.float32(aim / before)
        return scene

    def _coarse(self) -> Seen | None:
        rows, columns = self.values.shape[1:]
        sides = (rows, columns, self.margin.width)
        if min(rows, columns) < _COARSER * _COARSEST or any(side % (2 * _COARSER) for side in sides):
            return None
        margin = Margin((self.margin.shape[0] // _COARSER, self.margin.shape[1] // _COARSER), sides[2] // _COARSER)
        weight = _blocks(self.weight)
        mean = np.divide(_blocks(self.weight * self.values), weight, out=np.zeros_like(weight), where=weight > 0)
        return Seen(margin, _Low(self.margin.shape, margin.shape).cut(self.transfer), mean, weight)


@dataclass(frozen=True)
class _Low:
    """The lowest frequencies of a frame as those of one of larger pixels, each the mean of its block.

    Attributes:
        fine: rows and columns.
        coarse: the same of the other, even.
    """

    fine: tuple[int, int]
    coarse: tuple[int, int]

    def cut(self, values: NDArray[Any]) -> NDArray[Any]:
        """Of [..., rows, columns / 2 + 1]."""
        half = self.coarse[0] // 2
        below, above = values[..., :half, :], values[..., -half:, :]
        return np.concatenate([below, above], axis=-2)[..., : self.coarse[1] // 2 + 1]

    def of(self, spectrum: Spectrum) -> Spectrum:
        """Spectrum of the means over blocks."""
        picture = scipy.fft.irfft2(spectrum, s=self.fine, axes=(1, 2), workers=1)
        return np.asarray(scipy.fft.rfft2(_blocks(picture), axes=(1, 2), workers=1))

    def back(self, spectrum: Spectrum, shape: tuple[int, ...]) -> Spectrum:
        """Spectrum of the smooth picture with such values in the middles of the blocks."""
        y, x = scipy.fft.fftfreq(self.fine[0])[:, None], scipy.fft.rfftfreq(self.fine[1])
        middle = _COARSER**2 * np.exp(-1j * np.pi * (_COARSER - 1) * (y + x))
        moved = (spectrum * self.cut(middle)).astype(np.complex64)
        half, last = self.coarse[0] // 2, self.coarse[1] // 2
        moved[:, half] = 0  # neither sign of the highest frequency is the other's
        found = np.zeros(shape, dtype=np.complex64)
        found[:, :half, :last] = moved[:, :half, :last]
        found[:, -half:, :last] = moved[:, half:, :last]
        return found


def _blocks(values: Singles) -> Singles:
    """Means over blocks of pixels."""
    rows, columns = values.shape[1] // _COARSER, values.shape[2] // _COARSER
    return np.asarray(values.reshape(-1, rows, _COARSER, columns, _COARSER).mean(axis=(2, 4), dtype=np.float32))


def on_sensor(margin: Margin, spectrum: Spectrum) -> Singles:
    """The part of a picture that lies on the sensor, of its spectrum."""
    return margin.blurred(spectrum, np.ones(1, dtype=np.float32))


def spread(margin: Margin, light: Singles) -> Spectrum:
    """``rfft2`` of a frame that is dark outside the sensor."""
    width = margin.width
    lines = scipy.fft.rfft(np.pad(light, [(0, 0), (0, 0), (width, width)]), axis=2, workers=1)
    tall = np.pad(lines, [(0, 0), (width, width), (0, 0)])
    return np.asarray(scipy.fft.fft(tall, axis=1, overwrite_x=True, workers=1))


def _dot(one: Spectrum, other: Spectrum) -> float:
    """Sum over all frequencies, of which half the columns are kept; those of an even number of columns."""
    a, b = one.view(np.float32), other.view(np.float32)
    ends = sum(float(np.sum(a[..., k] * b[..., k], dtype=np.float64)) for k in (0, 1, -2, -1))
    return 2 * float(np.vdot(a, b)) - ends
