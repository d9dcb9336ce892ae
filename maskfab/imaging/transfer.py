r"""What the lens and the pixels pass of a scene, behind a panel of 24 x 24 cells: the camera of protocol F1.

The stop's open dots make the pupil p. With A its autocorrelation divided by A(0) (all transmitted energy counts, no
window is laid on the PSF), the transfer from scene samples to pixels is

    H(ν) = sum over k of A(λf (ν + k) / (pixel · dot)) sinc(ν_x + k_x) sinc(ν_y + k_y),    k from -3 to 3 on each axis,

ν in cycles per pixel: optics times pixel (Goodman, Introduction to Fourier Optics, 6.3), and what sampling folds back.
Between whole dots A is bilinear, exactly so for square dots. Every factor is separable but A, and A is real, so H is
two real products with matrices of a dozen entries per row.

Notes:
    The stop is the dots whose middle lies within 250/504 of the panel's side from the axis; no dot is cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy import sparse

from maskfab.errors import JobError, OpeningError
from maskfab.model import ORIENTATIONS, orient

Floats = NDArray[np.float64]

CELLS = 24
"""Cells along the panel's side."""
PANEL_UM = 4032.0
FOCAL_UM = 10_000.0
PIXEL_UM = 2.0
WAVELENGTHS_NM = (610.0, 530.0, 470.0)
"""Of red, green and blue."""

_ORDERS = 3
_STOP_SHARE = 250 / 504


@dataclass(frozen=True, eq=False)
class Laid:
    """A panel of 24 x 24 cells, as light sees it inside the stop.

    Attributes:
        name: of the design.
        pupil: float64 [n, n], amplitude of every dot, 0 outside the stop; a dot is 4032 / n micrometres wide.
    """

    name: str
    pupil: Floats

    @property
    def open_share(self) -> float:
        """Share of the stop's area that is clear; of its light, for a grey pupil."""
        return float((self.pupil**2).sum() / stop(len(self.pupil)).sum())


def stop(dots: int) -> NDArray[np.bool_]:
    """The stop on a panel of ``dots`` x ``dots``."""
    distance = (np.arange(dots) - (dots - 1) / 2) ** 2
    return np.asarray(distance[:, None] + distance <= (_STOP_SHARE * dots) ** 2)


def lay(name: str, units: NDArray[np.bool_], orientations: NDArray[np.int8] | None = None, seed: int = 0) -> Laid:
    """Lay one opening, or several, over the panel.

    Args:
        name: of the design.
        units: bool [dots, dots] or [units, dots, dots], True is clear, row 0 the lowest.
        orientations: integers [24, 24], 8 u + k for unit u under element k of D4 as in :func:`maskfab.model.orient`;
            None draws them as protocol F1 does, ``default_rng(seed).integers(8 · units)``.
        seed: of that draw.

    Raises:
        OpeningError: MF201 if the openings are not square; MF202 if they are neither clear nor opaque; MF203 if closed.
        JobError: MF122 for orientations of another shape, or of units that are not there.
    """
    stack = np.asarray(units)
    stack = stack[None] if stack.ndim == 2 else stack
    if stack.ndim != 3 or stack.shape[1] != stack.shape[2] or stack.size == 0:
        raise OpeningError("MF201", f"the opening has the shape {np.shape(units)}", where=name, cure="Give a square")
    if stack.dtype != np.bool_ and not np.isin(stack, (0, 1)).all():
        raise OpeningError("MF202", "the opening has other values than 0 and 1", where=name, cure="Threshold it")
    if not stack.any():
        raise OpeningError("MF203", "no dot of the opening is clear", where=name, cure="Open some dots")
    kinds = ORIENTATIONS * len(stack)
    if orientations is None:
        orientations = np.random.default_rng(seed).integers(kinds, size=(CELLS, CELLS)).astype(np.int8)
    turned = np.asarray(orientations)
    if turned.shape != (CELLS, CELLS) or turned.min() < 0 or turned.max() >= kinds:
        raise JobError(
            "MF122",
            f"the orientations have the shape {turned.shape} and reach from {turned.min()} to {turned.max()}",
            where=name,
            cure=f"Give {CELLS} x {CELLS} integers from 0 to {kinds - 1}",
        )
    cells = np.stack([orient(unit, k) for unit in stack for k in range(ORIENTATIONS)]).astype(np.float64)
    side = CELLS * stack.shape[1]
    return Laid(name, cells[turned].transpose(0, 2, 1, 3).reshape(side, side) * stop(side))


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


def transfer_grid(shape: tuple[int, int], dots: int) -> TransferGrid:
    """Prepare H for pictures of ``shape`` behind panels of ``dots`` x ``dots``."""
    frequency_y, frequency_x = scipy.fft.fftfreq(shape[0]), scipy.fft.rfftfreq(shape[1])
    lines = tuple((_line(frequency_y, dots, nm), _line(frequency_x, dots, nm)) for nm in WAVELENGTHS_NM)
    return TransferGrid(shape, dots, lines)


def lags_per_frequency(dots: int, wavelength_nm: float) -> float:
    """Lag in dots that belongs to one cycle per pixel."""
    return wavelength_nm / 1e3 * FOCAL_UM / (PIXEL_UM * PANEL_UM / dots)


def _line(frequency: Floats, dots: int, wavelength_nm: float) -> sparse.csr_array:
    """[frequencies, 2 dots - 1]: bilinear weights times the pixel's sinc, summed over the orders."""
    orders = np.arange(-_ORDERS, _ORDERS + 1)
    nu = frequency[:, None] + orders
    lag = nu * lags_per_frequency(dots, wavelength_nm)
    below = np.floor(lag).astype(np.int64)
    beyond = lag - below
    pixel = np.sinc(nu)
    row = np.broadcast_to(np.arange(len(frequency))[:, None], nu.shape)
    column = np.concatenate([below, below + 1], axis=1) + dots - 1
    weight = np.concatenate([pixel * (1 - beyond), pixel * beyond], axis=1)
    kept = (column >= 0) & (column < 2 * dots - 1) & (weight != 0)
    place = np.concatenate([row, row], axis=1)[kept], column[kept]
    return sparse.csr_array((weight[kept], place), shape=(len(frequency), 2 * dots - 1))
