r"""Transfer of lens and pixels behind a panel that fills a stop of 4 mm: the camera of protocol F1.

The stop's open dots make the pupil p. With A its autocorrelation divided by A(0) (all transmitted energy counts, no
window is laid on the PSF), the transfer from scene samples to pixels is

    H(ν) = sum over k of A(λf (ν + k) / (pixel · dot)) sinc(ν_x + k_x) sinc(ν_y + k_y),    k from -3 to 3 on each axis,

ν in cycles per pixel: optics times pixel (Goodman, Introduction to Fourier Optics, 6.3), and what sampling folds back.
Between whole dots A is bilinear, exactly so for square dots. Every factor is separable but A, and A is real, so H is
two real products with matrices of a dozen entries per row.

Notes:
    The stop is the dots whose middle lies within 2 mm of the axis; no dot is cut. The axis is where four cells meet, so
    the panel has an even number of cells along a side, the least that covers the stop: 24 of 168 um, 48 of 84 um.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy import sparse

from maskfab.errors import JobError, OpeningError
from maskfab.model import ORIENTATIONS, orient

Floats = NDArray[np.float64]

CELLS = 24
"""Cells of 168 um along the panel's side."""
PANEL_UM = 4032.0
"""Side of a panel of such cells, which is what is meant where no dot is given."""
STOP_UM = 4000.0
"""Diameter of the stop."""
MOST_DOTS = 2048
"""Along the panel's side; its autocorrelation then takes half a gigabyte."""
FOCAL_UM = 10_000.0
PIXEL_UM = 2.0
WAVELENGTHS_NM = (610.0, 530.0, 470.0)
"""Of red, green and blue."""

_ORDERS = 3


@dataclass(frozen=True)
class Lattice:
    """Cells of dots that cover the stop.

    Attributes:
        dots: along a cell's side.
        cells: along the panel's side; even.
        dot_um: side of a dot.
    """

    dots: int
    cells: int
    dot_um: float

    @property
    def side(self) -> int:
        """Dots along the panel's side."""
        return self.cells * self.dots


def lattice(dots: int, dot_nm: int | None = None, *, where: str = "design.dots") -> Lattice:
    """The fewest cells of ``dots`` dots a side that cover the stop.

    Args:
        dots: along a cell's side.
        dot_nm: side of a dot; None for cells of 168 um, however many dots they have.
        where: named in errors.

    Raises:
        JobError: MF104 for a number below 1, or dots so large that half a cycle per pixel is a lag of less than one;
            MF115 for more than 2048 dots along the panel's side.
    """
    if dots < 1 or (dot_nm is not None and dot_nm < 1):
        raise JobError(
            "MF104", f"{dots} dots of {dot_nm} nm make no cell", where=where, cure="Give at least 1 dot of 1 nm"
        )
    if dot_nm is None:
        made = Lattice(dots, CELLS, PANEL_UM / (CELLS * dots))
    else:
        made = Lattice(dots, 2 * math.ceil(STOP_UM * 1000 / (2 * dots * dot_nm)), dot_nm / 1000)
    coarsest = min(WAVELENGTHS_NM) / 1000 * FOCAL_UM / (2 * PIXEL_UM)
    if made.dot_um > coarsest:
        raise JobError(
            "MF104",
            f"a dot of {made.dot_um:g} um is wider than {coarsest:g} um, the lag of half a cycle per pixel",
            where=where,
            cure="Draw the opening with smaller dots",
        )
    if made.side > MOST_DOTS:
        raise JobError(
            "MF115",
            f"the stop of {STOP_UM:g} um takes {made.cells} cells of {dots} dots of {made.dot_um:g} um, {made.side} "
            f"dots along a side; the limit is {MOST_DOTS}",
            where=where,
            cure=f"Draw the opening with dots of {STOP_UM / MOST_DOTS:.3g} um or more",
        )
    return made


@dataclass(frozen=True, eq=False)
class Laid:
    """A panel of cells, as light sees it inside the stop.

    Attributes:
        name: of the design.
        pupil: float64 [n, n], amplitude of every dot, 0 outside the stop.
        dot_um: side of a dot; None is 4032 / n.
    """

    name: str
    pupil: Floats
    dot_um: float | None = None

    @property
    def open_share(self) -> float:
        """Share of the stop's area that is clear; of its light, for a grey pupil."""
        return float((self.pupil**2).sum() / stop(len(self.pupil), self.dot_um).sum())


def stop(dots: int, dot_um: float | None = None) -> NDArray[np.bool_]:
    """The stop on a panel of ``dots`` x ``dots``; without the side of a dot the panel is one of 4032 um."""
    distance = (np.arange(dots) - (dots - 1) / 2) ** 2
    radius = STOP_UM / 2 / (PANEL_UM / dots if dot_um is None else dot_um)
    return np.asarray(distance[:, None] + distance <= radius**2)


def lay(
    name: str,
    units: NDArray[np.bool_],
    orientations: NDArray[np.int8] | None = None,
    seed: int = 0,
    *,
    dot_nm: int | None = None,
) -> Laid:
    """Lay one opening, or several, over the panel.

    Args:
        name: of the design.
        units: bool [dots, dots] or [units, dots, dots], True is clear, row 0 the lowest.
        orientations: integers [cells, cells], 24 x 24 of 168 um, 8 u + k for unit u under element k of D4 as in
            :func:`maskfab.model.orient`; None draws them as protocol F1 does, with
            ``default_rng(seed).integers(8 · units)``.
        seed: of that draw.
        dot_nm: side of a dot; None for cells of 168 um.

    Raises:
        OpeningError: MF201 if the openings are not square; MF202 if they are neither clear nor opaque; MF203 if closed.
        JobError: MF122 for orientations of another shape, or of units that are not there; MF104, MF115 as
            :func:`lattice`.
    """
    stack = np.asarray(units)
    stack = stack[None] if stack.ndim == 2 else stack
    if stack.ndim != 3 or stack.shape[1] != stack.shape[2] or stack.size == 0:
        raise OpeningError(
            "MF201", f"the opening has the shape {np.shape(units)}", where=name, cure="Give an array of dots x dots"
        )
    if stack.dtype != np.bool_ and not np.isin(stack, (0, 1)).all():
        raise OpeningError(
            "MF202",
            "the opening has other values than 0 and 1",
            where=name,
            cure="Threshold the opening to 0 (opaque) and 1 (clear)",
        )
    if not stack.any():
        raise OpeningError(
            "MF203", "no dot of the opening is clear", where=name, cure="Give an opening with at least 1 clear dot"
        )
    kinds = ORIENTATIONS * len(stack)
    room = lattice(stack.shape[1], dot_nm, where=name)
    size = room.cells, room.cells
    if orientations is None:
        orientations = np.random.default_rng(seed).integers(kinds, size=size).astype(np.int8)
    turned = np.asarray(orientations)
    if turned.shape != size or turned.min() < 0 or turned.max() >= kinds:
        told = f" and reach from {turned.min()} to {turned.max()}" if turned.size else ""
        raise JobError(
            "MF122",
            f"the orientations have the shape {turned.shape}{told}",
            where=name,
            cure=f"Give {room.cells} x {room.cells} integers from 0 to {kinds - 1}",
        )
    cells = np.stack([orient(unit, k) for unit in stack for k in range(ORIENTATIONS)]).astype(np.float64)
    whole = cells[turned].transpose(0, 2, 1, 3).reshape(room.side, room.side)
    return Laid(name, whole * stop(room.side, room.dot_um), room.dot_um)


def autocorrelation(pupil: NDArray[np.float64]) -> Floats:
    """Of a real pupil [n, n]: [2n - 1, 2n - 1], lag 0 in the middle, not normalised."""
    size = 2 * len(pupil) - 1
    fast = int(scipy.fft.next_fast_len(size, real=True))
    spectrum = scipy.fft.rfft2(pupil, (fast, fast), workers=1)
    table = scipy.fft.irfft2(spectrum.real**2 + spectrum.imag**2, (fast, fast), workers=1)
    lags = np.arange(-len(pupil) + 1, len(pupil)) % fast
    return np.asarray(table[np.ix_(lags, lags)])


@dataclass(frozen=True, eq=False)
class TransferGrid:
    """The frequencies of one size of picture, ready to be filled with any pupil of one size.

    Attributes:
        shape: rows and columns of the picture.
        dots: dots along the panel's side.
        lines: for each colour, the matrices from lags to frequencies along y (both signs, in FFT order) and x (from 0).
    """

    shape: tuple[int, int]
    dots: int
    lines: tuple[tuple[sparse.csr_array, sparse.csr_array], ...]

    def __call__(self, pupil: Floats) -> NDArray[np.float32]:
        """H of a pupil [dots, dots], float32 [3, rows, columns / 2 + 1]; 1 at frequency 0."""
        table = autocorrelation(pupil)
        table /= table[self.dots - 1, self.dots - 1]
        half = self.shape[1] // 2 + 1
        found = np.empty((len(self.lines), self.shape[0], half), dtype=np.float32)
        for colour, (along_y, along_x) in enumerate(self.lines):
            found[colour] = (along_x @ np.ascontiguousarray((along_y @ table).T)).T
        return found


def transfer_grid(shape: tuple[int, int], dots: int, dot_um: float | None = None) -> TransferGrid:
    """Prepare H for pictures of ``shape`` behind panels of ``dots`` x ``dots``, 4032 um wide unless a dot's side is
    given."""
    frequency_y, frequency_x = scipy.fft.fftfreq(shape[0]), scipy.fft.rfftfreq(shape[1])
    lines = tuple((_line(frequency_y, dots, nm, dot_um), _line(frequency_x, dots, nm, dot_um)) for nm in WAVELENGTHS_NM)
    return TransferGrid(shape, dots, lines)


def lags_per_frequency(dots: int, wavelength_nm: float, dot_um: float | None = None) -> float:
    """Lag in dots that belongs to one cycle per pixel; ``dots`` are those of 4032 um unless a dot's side is given."""
    return wavelength_nm / 1e3 * FOCAL_UM / (PIXEL_UM * PANEL_UM / dots if dot_um is None else PIXEL_UM * dot_um)


def _line(frequency: Floats, dots: int, wavelength_nm: float, dot_um: float | None) -> sparse.csr_array:
    """[frequencies, 2 dots - 1]: bilinear weights times the pixel's sinc, summed over the orders."""
    orders = np.arange(-_ORDERS, _ORDERS + 1)
    nu = frequency[:, None] + orders
    lag = nu * lags_per_frequency(dots, wavelength_nm, dot_um)
    below = np.floor(lag).astype(np.int64)
    beyond = lag - below
    pixel = np.sinc(nu)
    row = np.broadcast_to(np.arange(len(frequency))[:, None], nu.shape)
    column = np.concatenate([below, below + 1], axis=1) + dots - 1
    weight = np.concatenate([pixel * (1 - beyond), pixel * beyond], axis=1)
    kept = (column >= 0) & (column < 2 * dots - 1) & (weight != 0)
    place = np.concatenate([row, row], axis=1)[kept], column[kept]
    return sparse.csr_array((weight[kept], place), shape=(len(frequency), 2 * dots - 1))
