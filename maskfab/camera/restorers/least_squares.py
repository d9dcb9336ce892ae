"""Least squares for scenes of which the sensor sees a part: what lies beyond its edge is unknown and solved for.

With S the cut to the sensor, H the blur on a frame that is wider than it, W weights of the pixels and a penalty that
is diagonal in frequency, the scene x makes

    1/2 || W^(1/2) (S H x - y) ||² + 1/2 <x, penalty x>

least. Conjugate gradients, preconditioned by the circulant 1 / (|H|² + penalty), run on spectra, so that a step takes
two transforms, of which a third is spared (Shewchuk, An introduction to the conjugate gradient method, 1994, B3).

Small gradients, ``gradient``, have the Wiener filter's own prior, a penalty of ε (f / 0.1)², and start from the Wiener
filter, which they are where nothing is unseen. For scenes of edges and even parts total variation, ``tv``, makes

    1/2 || S H x - y ||² + μ sum over pixels of |∇x|

least, |∇x| the root of the sum of squared differences to the right and down, over all three colours, so that edges
stand in one place (Rudin, Osher, Fatemi, Physica D 60, 259, 1992; Blomgren, Chan, IEEE Trans. Image Process. 7, 304,
1998). It is found by alternating directions: the light z = H x is known on the sensor alone and the gradients d = ∇x
are shrunk, each pixel by itself, and x follows from both by a division of spectra, exactly (Almeida, Figueiredo, IEEE
Trans. Image Process. 22, 3074, 2013). Its start is the answer of small gradients for one middling ε.

Notes:
    Light far outside is seen by the halo alone, and takes the most steps. It is smooth, so a frame of a quarter of the
    pixels along a side finds it first, at a sixteenth of the cost, and that one asks one of a quarter again.
    All sums are over pixels; spectra are those of ``rfft2``, whose columns but the first and the last count twice.
    All pixels that are not clipped weigh the same, although those in bright light are noisier. Weights of 1 / variance
    would be right if scenes had the same contrast everywhere; but contrast grows with the light as noise does.
    A full well says that there was at least so much light. Such pixels are left out at first, and then held at the
    full well where the answer is darker.
    What ε means for total variation. ε (f / 0.1)² is a penalty of κ |∇x|² with κ = ε / (0.2 π)², which is the prior
    that expects E |∇x|² = 6 σ² / κ of six differences in noise of variance σ²; the prior of μ |∇x| / σ² expects
    42 σ⁴ / μ². Both are the same for μ = σ √(7 κ). Photographs have most of that square in few edges: half of this μ is
    taken, and the best ε of an opening made for it is then 0.01 to 0.02 from 24 to 40 dB.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.camera.imaging import MARGIN, Blur, Margin, Transfer
from maskfab.camera.record import Record
from maskfab.camera.restorers.wiener import PRIOR_CY_PER_PX, prior
from maskfab.optics.restoration import wiener_filter

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

    def inverse(self, penalty: Singles) -> Singles:
        """1 / (|H|² + penalty), 0 where both are."""
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
            fine, shape = self.margin.shape, coarse.margin.shape
            picture = scipy.fft.irfft2(start, s=fine, axes=(1, 2), workers=1)
            first = np.asarray(scipy.fft.rfft2(_blocks(picture), axes=(1, 2), workers=1))
            start = start + _finer(coarse.solve(_lowest(penalty, shape), first) - first, fine, start.shape)
        return self._descend(penalty, start)

    def _descend(self, penalty: Singles, start: Spectrum) -> Spectrum:
        inverse = self.inverse(penalty)
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
        return Seen(margin, _lowest(self.transfer, margin.shape), mean, weight)


def _lowest(values: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
    """Values [..., rows, columns / 2 + 1] at the lowest frequencies, those of an even frame of larger pixels."""
    half = shape[0] // 2
    below, above = values[..., :half, :], values[..., -half:, :]
    return np.concatenate([below, above], axis=-2)[..., : shape[1] // 2 + 1]


def _finer(spectrum: Spectrum, fine: tuple[int, int], shape: tuple[int, ...]) -> Spectrum:
    """Spectrum, of a shape, of the smooth picture on fine pixels with such values in the middles of their blocks."""
    y, x = scipy.fft.fftfreq(fine[0])[:, None], scipy.fft.rfftfreq(fine[1])
    middle = _COARSER**2 * np.exp(-1j * np.pi * (_COARSER - 1) * (y + x))
    moved = (spectrum * _lowest(middle, (fine[0] // _COARSER, fine[1] // _COARSER))).astype(np.complex64)
    half, last = fine[0] // _COARSER // 2, fine[1] // _COARSER // 2
    moved[:, half] = 0  # neither sign of the highest frequency is the other's
    wide = np.zeros(shape, dtype=np.complex64)
    wide[:, :half, :last] = moved[:, :half, :last]
    wide[:, -half:, :last] = moved[:, half:, :last]
    return wide


def _blocks(values: Singles) -> Singles:
    rows, columns = values.shape[1] // _COARSER, values.shape[2] // _COARSER
    return np.asarray(values.reshape(-1, rows, _COARSER, columns, _COARSER).mean(axis=(2, 4), dtype=np.float32))


def on_sensor(margin: Margin, spectrum: Spectrum) -> Singles:
    """The part of a picture that lies on the sensor, of its spectrum."""
    return margin.blurred(spectrum, np.ones(1, dtype=np.float32))


def on_frame(margin: Margin, spectrum: Spectrum) -> Singles:
    """The whole picture [colours, rows, columns] of a spectrum."""
    return np.asarray(scipy.fft.irfft2(spectrum, s=margin.shape, axes=(1, 2), workers=1))


def spread(margin: Margin, light: Singles) -> Spectrum:
    """``rfft2`` of a frame that is dark outside the sensor."""
    width = margin.width
    lines = scipy.fft.rfft(np.pad(light, [(0, 0), (0, 0), (width, width)]), axis=2, workers=1)
    tall = np.pad(lines, [(0, 0), (width, width), (0, 0)])
    return np.asarray(scipy.fft.fft(tall, axis=1, overwrite_x=True, workers=1))


def _dot(one: Spectrum, other: Spectrum) -> float:
    """Sum over all frequencies, of which half the columns are kept; those of an even number of columns."""
    a, b = (np.ascontiguousarray(each).view(np.float32) for each in (one, other))  # some lie column by column
    ends = sum(float(np.sum(a[..., k] * b[..., k], dtype=np.float64)) for k in (0, 1, -2, -1))
    return 2 * float(np.vdot(a, b)) - ends


_MOST_ROUNDS = 4


@dataclass(frozen=True)
class Gradient:
    """Least squares with a penalty on squared gradients.

    Attributes:
        width: of the surroundings, pixels on every side; less than the sensor's sides.
    """

    width: int = MARGIN
    name: str = "gradient"

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        problem = Smooth.of(record, blur, self.width)
        return lambda epsilon: np.clip(on_sensor(problem.seen.margin, problem.solve(epsilon)), 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Smooth:
    """A record on a wider frame, ready to be solved for a smooth scene.

    Attributes:
        seen: all colours; clipped pixels weigh 0.
        mirrored: spectrum of the record mirrored at its edges, [3, rows, columns / 2 + 1] of the frame.
    """

    seen: Seen
    clipped: NDArray[np.bool_]
    mirrored: Spectrum
    prior: Singles

    @classmethod
    def of(cls, record: Record, blur: Blur, width: int) -> Smooth:
        """A record with surroundings of a width in pixels."""
        margin, clipped = Margin.around(record.values, width), record.clipped
        seen = Seen(margin, blur.on(margin.shape), record.values, (~clipped).astype(np.float32))
        return cls(seen, clipped, margin.mirrored(record.values), prior(margin.shape))

    def solve(self, epsilon: float) -> Spectrum:
        """Spectrum of the scene on the whole frame, [3, rows, columns / 2 + 1]."""
        penalty = np.float32(epsilon) * self.prior
        colours = range(len(self.mirrored))
        return np.concatenate([self._colour(slice(c, c + 1), penalty) for c in colours])

    def _colour(self, one: slice, penalty: Singles) -> Spectrum:
        seen, clipped = self.seen.colour(one), self.clipped[one]
        scene = seen.solve(penalty, self.mirrored[one] * wiener_filter(seen.transfer, penalty))
        held = np.zeros_like(clipped)
        for _ in range(_MOST_ROUNDS if clipped.any() else 0):
            darker = clipped & (seen.light(scene) < seen.values)
            if not (darker & ~held).any():
                break
            held |= darker
            seen = replace(seen, weight=np.where(held, np.float32(1), self.seen.weight[one]))
            scene = seen.solve(penalty, scene)
        return scene


START = 0.01
"""ε of small gradients, from whose answer others start."""
_WEAKEST = 1e-6
"""ε for less than that, for the constraint d = ∇x must pull a little."""
_SHARE = 0.5
_STIFFNESS = 2.0
"""Of the constraint d = ∇x, over κ; that of z = H x is 1, the weight of the pixels."""
_TV_MOST_STEPS = 40
_STILL = 0.02
"""Of the noise: a step that moves the picture by less, root mean square on the sensor, is the last."""


@dataclass(frozen=True)
class TotalVariation:
    """Least squares with a penalty on gradients."""

    width: int = MARGIN
    name: str = "tv"

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        problem = Smooth.of(record, blur, self.width)
        start = problem.solve(START)
        shown = np.minimum(record.values, 1)  # of merged exposures highlights have most of the noise
        noise = math.sqrt(float(record.noise.variance(shown).mean(dtype=np.float64)))

        def restored(epsilon: float) -> Singles:
            kappa = max(epsilon, _WEAKEST) / (2 * math.pi * PRIOR_CY_PER_PX) ** 2
            penalty = _SHARE * noise * math.sqrt(7 * kappa)
            picture = _few_edges(problem, start, penalty, _STIFFNESS * kappa, _STILL * noise)
            return np.clip(picture, 0.0, 1.0)

        return restored


RESTORERS = (Gradient(), TotalVariation())


def _few_edges(problem: Smooth, scene: Spectrum, penalty: float, stiffness: float, still: float) -> Singles:
    """The scene of least total variation on the sensor, by alternating directions."""
    seen, clipped = problem.seen, problem.clipped
    margin, transfer = seen.margin, seen.transfer
    y, x = scipy.fft.fftfreq(margin.shape[0])[:, None], scipy.fft.rfftfreq(margin.shape[1])
    square = 4 * (np.sin(np.pi * y) ** 2 + np.sin(np.pi * x) ** 2)
    inverse, stiff = seen.inverse((stiffness * square).astype(np.float32)), np.float32(stiffness)

    picture, light = on_frame(margin, scene), seen.light(scene)
    down, across = np.zeros_like(picture), np.zeros_like(picture)
    owed = np.zeros_like(light)
    for _ in range(_TV_MOST_STEPS):
        before = margin.sensor(picture)
        shrunk = _shrunk(picture, down, across, np.float32(penalty / stiffness))
        slope = scipy.fft.rfft2(shrunk, axes=(1, 2), workers=1)
        owed += light
        # The light on the sensor nearest to the record and to what is owed; of full wells what is above them.
        nearest = (seen.weight * seen.values + owed) / (seen.weight + 1)
        nearest = np.where(clipped, np.maximum(owed, seen.values), nearest)
        owed -= nearest
        wide = scene * transfer + spread(margin, nearest - owed - light)  # beyond the sensor z is H x
        scene = (wide * transfer.conj() + slope * stiff) * inverse
        picture, light = on_frame(margin, scene), seen.light(scene)
        if float(np.square(margin.sensor(picture) - before).mean(dtype=np.float64)) < still**2:
            break
    return margin.sensor(picture)


def _shrunk(picture: Singles, down: Singles, across: Singles, least: np.float32) -> Singles:
    """The divergence of d less what its constraint is owed, which is kept in ``down`` and ``across``."""
    down += np.roll(picture, -1, axis=1) - picture
    across += np.roll(picture, -1, axis=2) - picture
    length = np.sqrt((down * down + across * across).sum(axis=0))
    cut = np.minimum(least / np.maximum(length, np.float32(1e-20)), 1)
    slope = np.zeros_like(picture)
    for axis, owed in ((1, down), (2, across)):
        change = owed * (1 - 2 * cut)
        slope += np.roll(change, 1, axis=axis) - change
        np.multiply(owed, cut, out=owed)
    return slope
