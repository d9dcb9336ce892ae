"""The record of a scene by a sensor: its colours, the noise that it is known to have, exposures merged, pixels binned.

Every two by two pixels of a mosaic record red, green, green and blue, red in the top left one. A missing colour is the
mean of its neighbours, corrected by the Laplacian of the colour that is there (H. S. Malvar, L. He, R. Cutler, Proc.
ICASSP 2004, 485): four filters of five by five, linear, so that what they do to noise and blur follows from the filters
alone.

Exposures of one scene are merged into one record: each pixel's mean with weights 1 / variance,

    x = sum of y_k / v_k over sum of 1 / v_k,        variance 1 / (sum of 1 / v_k),

over the exposures k in which the pixel is below its full well (Granados, Ajdin, Wand, Theobalt, Seidel, Lensch, CVPR
2010). That gives bright light from short exposures and dark from long ones, and halo becomes linear in the light again.

Of two by two pixels as one a record is the mean, and a blur what the mean of a scene's pixels becomes. With a scene
that is constant over the larger pixels,

    H'(ν) = sum over k of H((ν + k) / 2) cos²(π (ν_x + k_x) / 2) cos²(π (ν_y + k_y) / 2),        k_x, k_y = 0 or 1,

ν in cycles per larger pixel: one cos² is the mean on the sensor, the other the larger pixel of the scene.

Notes:
    Variances are those of the merged light, which is found twice: first with weights for the shortest exposure's.
    Of readings within noise of a full well those below it count, so light there is told too dark by up to 0.4 standard
    deviations of the longer exposure. Letting the shorter ones decide errs as far to the other side, and loses light.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.camera.imaging import Blur, Transfer

_RED, _BLUE = (slice(0, None, 2), slice(0, None, 2)), (slice(1, None, 2), slice(1, None, 2))


def sampled(light: Singles) -> Singles:
    """The one colour that every pixel records, [rows, columns] of [3, rows, columns]."""
    seen = np.array(light[1])
    seen[_RED], seen[_BLUE] = light[0][_RED], light[2][_BLUE]
    return seen


def interpolated(seen: Singles, red: tuple[int, int] = (0, 0)) -> Singles:
    """All three colours of every pixel, [3, rows, columns]; what was recorded stays as it is.

    Args:
        seen: [rows, columns] what every pixel recorded; even sides where red is not in the top left pixel.
        red: row and column, 0 or 1, of the uppermost left red pixel; blue is diagonal to it.
    """
    # Turned over, an even side's last pixel has the colour that its second one had.
    turned = tuple(axis for axis in (0, 1) if red[axis])
    seen = np.flip(seen, turned)
    # Mirroring without doubling the edge keeps every colour on its own places.
    wide = np.pad(seen, 2, mode="reflect")
    alike = {(y, x): np.ascontiguousarray(wide[y::2, x::2]) for y in (0, 1) for x in (0, 1)}
    colours, sixteen = np.empty((3, *seen.shape), dtype=seen.dtype), np.float32(16)
    for (y, x), colour in {(0, 0): 0, (0, 1): 1, (1, 0): 1, (1, 1): 2}.items():
        size = (seen.shape[0] - y + 1) // 2, (seen.shape[1] - x + 1) // 2
        moved = partial(_moved, alike, (y + 2, x + 2), size)
        here, beside, above = moved(0, 0), moved(0, -1) + moved(0, 1), moved(-1, 0) + moved(1, 0)
        across, down = moved(0, -2) + moved(0, 2), moved(-2, 0) + moved(2, 0)
        corners = moved(-1, -1) + moved(-1, 1) + moved(1, -1) + moved(1, 1)
        colours[colour, y::2, x::2] = here
        if colour == 1:
            colours[2 * y, y::2, x::2] = (10 * here + 8 * beside - 2 * (corners + across) + down) / sixteen
            colours[2 - 2 * y, y::2, x::2] = (10 * here + 8 * above - 2 * (corners + down) + across) / sixteen
        else:
            colours[1, y::2, x::2] = (8 * here + 4 * (beside + above) - 2 * (across + down)) / sixteen
            colours[2 - colour, y::2, x::2] = (12 * here + 4 * corners - 3 * (across + down)) / sixteen
    return np.flip(colours, tuple(axis + 1 for axis in turned))


def _moved(
    alike: dict[tuple[int, int], Singles], start: tuple[int, int], size: tuple[int, int], down: int, right: int
) -> Singles:
    """Neighbours of every second pixel from a start on; the pixels are apart by their places in two by two."""
    (top, y), (left, x) = divmod(start[0] + down, 2), divmod(start[1] + right, 2)
    return alike[y, x][top : top + size[0], left : left + size[1]]


@dataclass(frozen=True)
class Noise:
    """Noise of a record in units of white; ``step`` is the converter's, in electrons, 0 for none."""

    electrons: float
    read_noise: float
    step: float = 0.0

    @property
    def floor(self) -> float:
        """Variance in the dark: read noise and rounding."""
        return (self.read_noise**2 + self.step**2 / 12) / self.electrons**2

    def variance(self, light: Singles) -> Singles:
        """Variance of every pixel, for the light that falls on it."""
        return np.asarray(np.maximum(light, 0) / np.float32(self.electrons) + np.float32(self.floor))

    def times(self, factor: float) -> Noise:
        """Noise of so many times the variance, at every light."""
        return Noise(self.electrons / factor, self.read_noise / factor**0.5, self.step / factor**0.5)

    @property
    def zones(self) -> tuple[tuple[float, Noise], ...]:
        """Light up to which there is which noise: itself, whatever the light."""
        return ((math.inf, self),)


@dataclass(frozen=True)
class MergedNoise:
    """Noise of the mean of several exposures with weights 1 / variance, full wells left out.

    Attributes:
        exposures: each one's noise and full well, in units of white, the longest first.
    """

    exposures: tuple[tuple[Noise, float], ...]

    @property
    def electrons(self) -> float:
        """Electrons of white, in all exposures that hold it; the shortest's where none does."""
        return next(noise.electrons for top, noise in self.zones if top > 1)

    def variance(self, light: Singles) -> Singles:
        """Variance of every pixel; where all are at their full wells, the shortest's."""
        precision = np.zeros_like(light)
        for noise, ceiling in self.exposures[:-1]:
            precision += (light < np.float32(ceiling)) / noise.variance(light)
        return np.asarray(1 / (precision + 1 / self.exposures[-1][0].variance(light)))

    def times(self, factor: float) -> MergedNoise:
        return MergedNoise(tuple((noise.times(factor), ceiling) for noise, ceiling in self.exposures))

    @property
    def zones(self) -> tuple[tuple[float, Noise], ...]:
        """Light up to which there is which noise, in rising order.

        Of each zone it is that of one exposure with the electrons of all, and with their variance in the dark: between
        dark and bright that is up to a twentieth too little.
        """
        zones = []
        for first, (_, ceiling) in enumerate(self.exposures):
            open_still = [noise for noise, _ in self.exposures[first:]]
            electrons = sum(noise.electrons for noise in open_still)
            floors = [noise.floor for noise in open_still]
            floor = 0.0 if min(floors) == 0 else 1 / sum(1 / variance for variance in floors)
            zones.append((ceiling, Noise(electrons, electrons * floor**0.5)))
        return (*zones[:-1], (math.inf, zones[-1][1]))


@dataclass(frozen=True, eq=False)
class Record:
    """A photograph as recorded, black level taken off and colours complete.

    Attributes:
        values: float32 [3, rows, columns], white is 1, row 0 on top; below 0 where noise of the dark made it so.
        ceiling: what a full well reads, in units of white; infinite if nothing clips.
        interpolated: whether two colours of every pixel were found from its neighbours, so that noise is correlated as
            :func:`maskfab.camera.record.interpolated` makes it.
    """

    values: Singles
    noise: Noise | MergedNoise
    ceiling: float = math.inf
    interpolated: bool = False

    @property
    def variance(self) -> Singles:
        """Variance of every pixel, [3, rows, columns]."""
        return self.noise.variance(self.values)

    @property
    def clipped(self) -> NDArray[np.bool_]:
        """Pixels that a full well cut off."""
        return np.asarray(self.values >= np.float32(self.ceiling))


class Restorer(Protocol):
    """A way to undo the blur."""

    @property
    def name(self) -> str:
        """In tables and options."""

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        """Do once all that does not depend on the strength.

        Returns:
            A function of the strength epsilon of the 1/f² prior that gives the restored light on the sensor,
            float32 [3, rows, columns] within 0 to 1.
        """


def merged(exposures: Sequence[Record]) -> Record:
    """One record of several of the same light and white: with the noise of all, and the full well of the shortest."""
    ordered = sorted(exposures, key=lambda record: _exposures(record)[-1][0].electrons)
    values = ordered[0].values
    for _ in range(2):
        values = _mean(ordered, values)
    taken = [exposure for record in reversed(ordered) for exposure in _exposures(record)]
    return Record(values, MergedNoise(tuple(taken)), ordered[0].ceiling, ordered[0].interpolated)


def _exposures(record: Record) -> tuple[tuple[Noise, float], ...]:
    noise = record.noise
    return noise.exposures if isinstance(noise, MergedNoise) else ((noise, record.ceiling),)


def _mean(ordered: Sequence[Record], light: Singles) -> Singles:
    """The merged values, with weights for ``light``; the shortest's own where all are clipped."""
    total, precision = np.zeros_like(light), np.zeros_like(light)
    for record in ordered:
        weight = ~record.clipped / record.noise.variance(light)
        total += weight * record.values
        precision += weight
    return np.divide(total, precision, out=ordered[0].values.copy(), where=precision > 0)


@dataclass(frozen=True, eq=False)
class BinnedBlur:
    """Blur of means over 2 x 2 pixels."""

    fine: Blur

    def on(self, shape: tuple[int, int]) -> Transfer:
        rows, columns = shape
        half = self.fine.on((2 * rows, 2 * columns))
        y, x = np.asarray(scipy.fft.fftfreq(2 * rows))[:, None], np.asarray(scipy.fft.rfftfreq(2 * columns))
        half = half * (np.square(np.cos(np.pi * y)) * np.square(np.cos(np.pi * x))).astype(np.float32)
        folded = half[:, :rows] + half[:, rows:]
        keep = columns // 2 + 1
        # The other half of the columns is that of the opposite frequencies, conjugate.
        across = np.arange(columns, columns - keep, -1)
        opposite = folded[:, -np.arange(rows) % rows][:, :, across].conj()
        return np.asarray(folded[:, :, :keep] + opposite)


def binned(record: Record) -> Record:
    """Means over 2 x 2 pixels of a record of even sides; full where one of the four is."""
    _, rows, columns = record.values.shape
    cells = record.values.reshape(3, rows // 2, 2, columns // 2, 2)
    full = record.clipped.reshape(cells.shape).any(axis=(2, 4))
    values = np.where(full, np.float32(record.ceiling), cells.mean(axis=(2, 4), dtype=np.float32))
    share = _of_mosaic() if record.interpolated else 1 / 4
    return replace(record, values=values, noise=record.noise.times(share), interpolated=False)


def of_cells(places: NDArray[Any], colours: str) -> NDArray[Any]:
    """Cells of a mosaic of ``colours`` such as ``RGGB``, [3, rows, columns]; greens averaged, none interpolated."""
    return np.stack([places[[k for k in range(4) if colours[k] == colour]].mean(axis=0) for colour in "RGB"])


@cache
def _of_mosaic() -> float:
    """Variance of the mean over the four places of an interpolated mosaic with noise of 1, the mean of the colours."""
    total = 0.0
    for place in range(100):
        pixel = np.zeros(100, dtype=np.float32)
        pixel[place] = 1
        middle = interpolated(pixel.reshape(10, 10))[:, 4:6, 4:6].mean(axis=(1, 2), dtype=np.float64)
        total += float(np.square(middle).mean())
    return total
