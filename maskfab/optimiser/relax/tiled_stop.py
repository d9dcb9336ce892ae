r"""A camera's stop filled with oriented units, and its transfer wherever an objective looks.

The transfer at the frequency ν is the autocorrelation at the lag λfν, divided by lag 0, times the square pixel's
sinc(ν_x p) sinc(ν_y p) (Goodman, Introduction to Fourier Optics, 6.4). Between whole dots it is bilinear, which is
exact for square dots.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.cell_size import CellSize
from maskfab.errors import JobError
from maskfab.model import ORIENTATIONS, Camera
from maskfab.optics.pupil.stop_shape import stop_dots
from maskfab.optimiser.relax.autocorrelation import Autocorrelation, autocorrelation
from maskfab.optimiser.relax.invertibility import Invertibility
from maskfab.optimiser.relax.stop_grid import MAX_SIDE, cells_across, lags_within
from maskfab.units import NM_PER_UM

Precision = Literal["float32", "float64"]
TINY = 1e-30
"""In place of an epsilon of 0, so that a frequency which is nil has a value and a slope."""
FEWEST_DOTS = 2
"""Inside a stop: one dot has no lag but 0."""
DTYPES: dict[str, torch.dtype] = {"float32": torch.float32, "float64": torch.float64}


@dataclass(frozen=True, eq=False)
class TiledStop:
    """One layout of units behind one camera's stop.

    Attributes:
        correlation: of the pupil, one dot farther than the lag of half a cycle per pixel at any wavelength.
        camera: the lens, its wavelengths and the sensor.
        dot_nm: side of a dot.
        bare: dots of the stop.
        dtype: of the constants.
    """

    correlation: Autocorrelation
    camera: Camera
    dot_nm: int
    bare: int
    dtype: torch.dtype

    @property
    def device(self) -> torch.device:
        """Where it is computed."""
        return self.correlation.index.device

    def per_cycle(self, wavelength_nm: float) -> float:
        """Lag in dots of one cycle per pixel."""
        return wavelength_nm * self.camera.focal_um / self.camera.pixel_um / self.dot_nm

    def here(self, array: NDArray[np.generic]) -> torch.Tensor:
        """A constant on this device; floating ones in this type."""
        tensor = torch.from_numpy(np.ascontiguousarray(array))
        return tensor.to(self.device, self.dtype if tensor.is_floating_point() else None)

    def share(self, table: torch.Tensor) -> torch.Tensor:
        """Share of the bare stop's light that a table's unit passes, 0 to 1: lag 0 over the bare stop's dots."""
        return table[0, 0] / self.bare

    def at_points(self, wavelength_nm: float, y: Floats, x: Floats) -> PointTransfer:
        """The transfer at points in cycles per pixel, y >= 0, |x| and y at most one half."""
        lag_y, lag_x = (self.per_cycle(wavelength_nm) * v for v in (y, x))
        low_y, low_x = (np.floor(lag).astype(np.int64) for lag in (lag_y, lag_x))
        part_y, part_x = lag_y - low_y, lag_x - low_x
        size, reach = self.correlation.size, self.correlation.reach
        index, weight = [], []
        for up, share_y in ((0, 1 - part_y), (1, part_y)):
            for right, share_x in ((0, 1 - part_x), (1, part_x)):
                row, column = low_y + up, low_x + right
                known = (row <= reach) & (abs(column) <= reach)
                index.append(np.where(known, row * size + column % size, 0))
                weight.append(np.where(known, share_y * share_x * np.sinc(y) * np.sinc(x), 0.0))
        return PointTransfer(self.here(np.stack(index)), self.here(np.stack(weight)))

    def on_grid(self, shape: tuple[int, int]) -> GridTransfer:
        """The transfer at the frequencies of ``rfft2`` of pictures of that shape, for every wavelength."""
        reach = self.correlation.reach
        lags = np.arange(-reach, reach + 1)

        def matrix(frequency: NDArray[np.floating[Any]], wavelength_nm: float) -> torch.Tensor:
            hat = np.maximum(0, 1 - abs(frequency[:, None] * self.per_cycle(wavelength_nm) - lags))
            return self.here(hat * np.sinc(frequency)[:, None])

        y, x = np.fft.fftfreq(shape[0]), np.fft.rfftfreq(shape[1])
        pairs = tuple((matrix(y, nm), matrix(x, nm).T.contiguous()) for nm in self.camera.wavelengths_nm)
        return GridTransfer(pairs, reach)


@dataclass(frozen=True, eq=False)
class PointTransfer:
    """The transfer at scattered points: index and weight of the four whole lags about each, [4, points]."""

    index: torch.Tensor
    weight: torch.Tensor

    def __call__(self, table: torch.Tensor) -> torch.Tensor:
        """[points], 1 at frequency 0."""
        around = table.flatten().index_select(0, self.index.flatten()).view(self.index.shape)
        return (around * self.weight).sum(0) / table[0, 0]


@dataclass(frozen=True, eq=False)
class GridTransfer:
    """The transfer on a picture's frequencies: for each wavelength, matrices from whole lags to those of y and of x."""

    lines: tuple[tuple[torch.Tensor, torch.Tensor], ...]
    reach: int

    def __call__(self, table: torch.Tensor) -> torch.Tensor:
        """[wavelengths, rows, columns / 2 + 1], 1 at frequency 0."""
        columns = torch.arange(-self.reach, self.reach + 1, device=table.device) % table.shape[1]
        upper = table.index_select(1, columns)
        # A real pupil's autocorrelation is the same at opposite lags.
        whole = torch.cat([upper[1:].flip(0, 1), upper]) / table[0, 0]
        return torch.stack([along_y @ whole @ along_x for along_y, along_x in self.lines])


def tiled_stop(
    dots: int,
    dot_nm: int,
    orientations: NDArray[np.int8],
    camera: Camera,
    *,
    precision: Precision = "float32",
    device: str = "cpu",
) -> TiledStop:
    """Fill a stop with units of ``dots`` dots a side.

    Args:
        dots: dots along the unit's side.
        dot_nm: side of one dot.
        orientations: int8 [cells, cells], elements of D4; the square of cells is centred on the stop and covers it.
        camera: lens, wavelengths, sensor.
        precision: of the computation.
        device: "cpu", "cuda", or "auto" for CUDA where there is any.

    Raises:
        JobError: MF104 if half a cycle per pixel is less than a lag of one dot, or the stop holds no two dots; MF105
            for a device that is not there; MF114 if the cells do not cover the stop; MF115 if they are too many dots;
            MF122 for orientations that are no square of elements of D4.
    """
    chosen = ("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else device
    if chosen not in ("cpu", "cuda") or (chosen == "cuda" and not torch.cuda.is_available()):
        raise JobError("MF105", f"there is no device {device!r} here", where="design.device", cure='Use "cpu"')
    _require_square(orientations)
    cells = len(orientations)
    side = cells * dots
    if side > MAX_SIDE:
        raise JobError(
            "MF115",
            f"the stop of {camera.stop.diameter_um:g} um is {side} dots of {dot_nm / NM_PER_UM:g} um across; the limit "
            f"is {MAX_SIDE}",
            where="camera.stop",
            cure="Design with a smaller stop, or with fewer dots per pitch",
        )
    if side * dot_nm < camera.stop.diameter_um * NM_PER_UM - 1:
        raise JobError(
            "MF114",
            f"{cells} x {cells} cells of {CellSize(dots, dot_nm).pitch_um:g} um do not cover a stop of "
            f"{camera.stop.diameter_um:g} um",
            where="camera.stop",
            cure=f"Give {cells_across(camera.stop, dots, dot_nm)} x {cells_across(camera.stop, dots, dot_nm)} cells",
        )
    inside = stop_dots(camera.stop, side, dot_nm / NM_PER_UM)
    if inside.sum() < FEWEST_DOTS:
        raise JobError(
            "MF104",
            f"the stop of {camera.stop.diameter_um:g} um holds the middles of {int(inside.sum())} dots of "
            f"{dot_nm / NM_PER_UM:g} um; a transfer needs at least {FEWEST_DOTS}",
            where="camera.stop",
            cure="Use smaller dots, or a larger stop",
        )
    nyquist = max(camera.wavelengths_nm) * camera.focal_um / (2 * camera.pixel_um) / dot_nm
    if nyquist < 1:
        raise JobError(
            "MF104",
            f"half a cycle per pixel of {camera.pixel_um:g} um is a lag of {nyquist:.3g} dots; it must be at least 1",
            where="camera.pixel",
            cure="Use smaller dots, or a smaller sensor pixel",
        )
    made = autocorrelation(dots, orientations, inside, min(math.floor(nyquist) + 1, min(inside.shape) - 1))
    moved = replace(made, index=made.index.to(chosen))
    return TiledStop(moved, camera, dot_nm, int(inside.sum()), DTYPES[precision])


def _require_square(orientations: NDArray[np.int8]) -> None:
    shape = orientations.shape
    if len(shape) == 2 and shape[0] == shape[1] > 0 and 0 <= orientations.min() <= orientations.max() < ORIENTATIONS:
        return
    within = f", {orientations.min()} to {orientations.max()}" if orientations.size else ""
    raise JobError(
        "MF122",
        f"the orientations have the shape {shape}{within}; a square of elements 0 to {ORIENTATIONS - 1} is needed",
        where="design.orientations",
        cure="Give as many rows as columns",
    )


def invertibility_of(
    stop: TiledStop,
    target: float = 0.2,
    *,
    epsilon: float = 0.015,
    worst_fraction: float = 0.3,
    own_sum: bool = False,
) -> Invertibility:
    """The invertibility loss that shares this stop's autocorrelation with other objectives.

    Args:
        stop: the layout.
        target: open ratio at which O(0) = 1.
        epsilon: noise-to-signal ratio of the Wiener filter; with 0 every frequency that is not nil counts as kept.
        worst_fraction: share of the frequencies that counts.
        own_sum: the published normalisation, whose optimum is grey.

    Raises:
        JobError: MF104 for numbers out of range.
    """
    if not (epsilon >= 0 and 0 < worst_fraction <= 1 and 0 < target <= 1):
        raise JobError(
            "MF104",
            f"epsilon = {epsilon:g}, worst_fraction = {worst_fraction:g}, target = {target:g}: shares lie within 0 to "
            "1 and epsilon is not negative",
            where="design.invertibility",
            cure="Take the defaults: 0.015, 0.3, 0.2",
        )
    size, reach = stop.correlation.size, stop.correlation.reach
    lags = tuple(stop.here(lags_within(min(stop.per_cycle(nm) / 2, reach), size)) for nm in stop.camera.wavelengths_nm)
    return Invertibility(stop.correlation, lags, stop.bare * target, max(epsilon, TINY), worst_fraction, own_sum)
