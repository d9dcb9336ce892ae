r"""The far field by fast Fourier transforms that skip what is dark and what is not asked for.

On a lattice of equal dots d and frequencies k h, or (k + 1/2) h, the sum over dots is a discrete Fourier transform
of 1 / (d h) points where that is a whole number (on a sensor, λf / (d step)), and d sinc(ud) d sinc(vd) makes it the
exact field. Rows without light need no transform along x, and columns outside the window none along y.

Notes:
    The transform repeats every 1 / d in frequency and must not reach half of that along u; a point beyond it would
    still be right, but numpy's half spectrum does not hold it. Sizes with large prime factors are slow, not inexact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.errors import InternalError
from maskfab.optics.field.parity import ParityField, PreparedField, parity_of, rim_terms
from maskfab.optics.field.waves import Precision, Reals, is_even, is_symmetric, real_type, reduced_cycles
from maskfab.optics.pupil.aperture import Lattice
from maskfab.optics.pupil.pupil import Pupil

_COMMENSURATE = 1e-12


@dataclass(frozen=True, eq=False)
class PrunedField:
    """A pupil and the precision in which to transform it.

    Attributes:
        pupil: dots on lattices without gutters.
        rim: the dots that the stop cuts, which fit no discrete transform; None if there are none.
        precision: of transforms and products.
    """

    pupil: Pupil
    rim: PreparedField | None
    precision: Precision

    def field(self, u: Floats, v: Floats) -> ParityField:
        """The field at frequencies that :func:`pruned_refusal` accepts, [nu] and [nv].

        Raises:
            InternalError: MF901 if it gives a reason.
        """
        reason = pruned_refusal(self.pupil.x, self.pupil.y, bool(self.pupil.rim_row.size), u, v)
        if reason:
            raise InternalError("MF901", reason)
        whole = self._whole(u, v)
        if self.rim is None:
            return whole
        cut = self.rim.field(u, v)
        return ParityField(
            whole.even_even + cut.even_even,
            whole.even_odd + cut.even_odd,
            whole.odd_even + cut.odd_even,
            whole.odd_odd + cut.odd_odd,
            whole.on_axis,
        )

    def _whole(self, u: Floats, v: Floats) -> ParityField:
        on_axis = bool(u[0] == 0)
        live = np.flatnonzero(self.pupil.whole.any(axis=1))
        rows: Reals = self.pupil.whole[live].astype(real_type(self.precision), copy=False)
        kind = np.result_type(rows.dtype, np.complex64)
        size = transform_size(self.pupil.y, v)
        columns = np.zeros((u.size, size), dtype=kind)
        if live.size:
            along_x = _row_transform(rows, self.pupil.x, u, on_axis)
            columns[:, live] = (along_x * _dot_factor(self.pupil.x, u)).T
        if not on_axis:
            columns *= _half_step(size).astype(kind)
        spectrum = scipy.fft.fft(columns, axis=1, overwrite_x=True).T
        factor = _dot_factor(self.pupil.y, v)[:, None]
        bins = np.arange(v.size)
        mirrored = -bins if on_axis else -1 - bins
        above = (spectrum[bins % size] * factor).astype(np.complex128, copy=False)
        below = (spectrum[mirrored % size] * factor.conj()).astype(np.complex128, copy=False)
        return parity_of(above, below, on_axis)


def prepare_pruned(pupil: Pupil, highest_u: float, highest_v: float, precision: Precision = "double") -> PrunedField:
    """A pupil ready to be transformed; the arguments are those of :func:`maskfab.optics.field.parity.prepare`."""
    rim = None
    if pupil.rim_row.size:
        rim = PreparedField(rim_terms(pupil, highest_u, highest_v, precision), highest_u, highest_v, precision)
    return PrunedField(pupil, rim, precision)


def pruned_refusal(x: Lattice, y: Lattice, rim: bool, u: Floats, v: Floats) -> str | None:
    """Why a pupil on two lattices, with dots cut by the stop or not, cannot be transformed; None if it can."""
    if x.has_gutter or y.has_gutter:
        return "a lattice with gutters has dots at uneven distances"
    if rim and not (is_symmetric(x) and is_symmetric(y)):
        return "the rim needs a lattice that is symmetric about the axis"
    for lattice, frequency in ((x, u), (y, v)):
        if frequency.size < 2 or not is_even(frequency):
            return "the frequencies are not evenly spaced"
        step = _step(frequency)
        if abs(frequency[0]) > _COMMENSURATE * step and abs(frequency[0] - step / 2) > _COMMENSURATE * step:
            return "the frequencies begin neither at 0 nor half a step from it"
        points = 1 / (lattice.dot_um * step)
        size = round(points)
        if abs(points - size) > _COMMENSURATE * points:
            return f"the frequencies divide the dot's period of 1 / {lattice.dot_um:g} um into {points:.6g} parts"
        if lattice.cells * lattice.dots > size:
            return f"{lattice.cells * lattice.dots} dots do not fit a transform of {size} points"
    if u.size - 1 > transform_size(x, u) // 2:
        return f"{u[-1]:g} cycles/um is beyond half the dot's period of 1 / {x.dot_um:g} um"
    return None


def transform_size(lattice: Lattice, frequency: Floats) -> int:
    """Points of the discrete transform, 1 / (dot x frequency step)."""
    return round(1 / (lattice.dot_um * _step(frequency)))


def _step(frequency: Floats) -> float:
    return float((frequency[-1] - frequency[0]) / (frequency.size - 1))


def _row_transform(rows: Reals, lattice: Lattice, u: Floats, on_axis: bool) -> NDArray[np.complexfloating[Any]]:
    """Rows at the frequencies u, [rows, nu], the first dot at the origin."""
    size = transform_size(lattice, u)
    if on_axis:
        spectrum: NDArray[np.complexfloating[Any]] = scipy.fft.rfft(rows, size, axis=1)[:, : u.size]
        return spectrum
    turned = rows * _half_step(size)[: rows.shape[1]].astype(np.result_type(rows.dtype, np.complex64))
    spectrum = scipy.fft.fft(turned, size, axis=1, overwrite_x=True)[:, : u.size]
    return spectrum


def _half_step(size: int) -> NDArray[np.complex128]:
    """Moves the bins of a transform by half of one."""
    half: NDArray[np.complex128] = np.exp(-1j * np.pi * np.arange(size, dtype=np.float64) / size)
    return half


def _dot_factor(lattice: Lattice, frequency: Floats) -> NDArray[np.complex128]:
    """Transform of one dot, at the place of the first."""
    centre = np.array([lattice.start_um + lattice.dot_um / 2])
    factor: NDArray[np.complex128] = np.exp(-2j * np.pi * reduced_cycles(centre, frequency)[0])
    return factor * lattice.dot_um * np.sinc(lattice.dot_um * frequency)
