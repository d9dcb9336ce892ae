"""Expected squared error of restored pictures behind one realised panel, with its slope by the autocorrelation.

The error is that of :mod:`maskfab.designs.model.expected_psnr`, noise + what the filter holds back + the leak at low
frequencies, for the panel that is there, cut cells and all, in place of the mean over random ones. It is a function of
the pupil's autocorrelation A alone: the light is A(0), and with L lags to one cycle per pixel

    H(t / L) = sum over k of A(t + kL) / A(0) sinc(t / L + k),    k = -1, 0, 1 on each axis for protocol F1,

exact for square dots at whole lags t once L is a whole odd number M. Protocol F1 takes M for L (331 for 331.25 of 8 µm,
so that lags are off by 0.08 %, which moves no comparison of layouts; by one dot in L at most) and leaves out what the
stop's outermost hundredth passes. For other cameras A is interpolated at the lags t L / M first, which is exact for
square dots, and as many k are summed as the stop passes. The middle wavelength stands for all, 530 nm for F1.

The slope by the pupil is a field that costs two transforms: with g = ∂E/∂A,

    ∂E/∂p(x) = 2 sum over t of g(t) p(x + t).

Light with a phase at the stop has a complex amplitude p q with the open stop's q, and A is complex; the slope by p is
then found through the transforms themselves. Pairs of dots within a cell are taken to have one phase.

Expected error of a panel over the distances of a scene: the mean of decibels, each photograph restored by its own
blur.

Expected restored PSNR of one panel in the conditions of a scene, by the transfer that photographs are taken by.

Of each distance and place it is the die's own transfer (:mod:`maskfab.camera.die_transfer`), as the plan has it, with
the gap's shift and diffraction, depth and aberrations; the middle line stands for all. As in photographs, the camera
knows the blur of the axis at the distance of what is photographed, and restores the whole picture by it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.fft
import torch
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError
from maskfab.base.model import Panel
from maskfab.camera.die_transfer import DieTransfer, die_transfer
from maskfab.camera.lens import CellGrid, PhotoCamera, lay
from maskfab.camera.record import Transfer
from maskfab.camera.restorers.wiener import PRIOR_CY_PER_PX
from maskfab.camera.sensor import REFERENCE_TRANSMISSION
from maskfab.designs.model.conditions import Condition, SceneConditions
from maskfab.designs.model.expected_psnr import Surrogate
from maskfab.designs.model.statistics import FACTOR, PixelNoise
from maskfab.optics.gap import AXIS

Transfers = tuple[Transfer, Transfer]

_LOW = 1 / 16
"""Cycles per pixel below which, on both axes, the surrogate's low-passed scenes take over."""
_RIM = 0.01
"""Outer share of the stop's diameter that protocol F1 leaves out: its lags pass next to nothing."""
_FEWEST_FREQUENCIES = 129
"""Along an axis, where a camera has fewer dots of lag to one cycle per pixel."""


@dataclass(frozen=True, eq=False)
class Slope:
    """Slope of the loss, to first order in the autocorrelation.

    Attributes:
        near: g at the lags within a unit, float64 [2 dots - 1, 2 dots - 1], lag 0 in the middle; dB per dot.
        field: ∂loss/∂p, float32 like the pupil; dB per dot.
    """

    near: Floats
    field: NDArray[np.float32]


class Judged(Protocol):
    """The loss of one pupil."""

    @property
    def loss(self) -> float:
        """Minus the weighted mean over the levels of the expected restored PSNR, dB."""

    def slope(self) -> Slope:
        """The slopes; to be asked for once."""


class PanelError(Protocol):
    """Judgement of panels of cells, by which maps are designed; :class:`PupilError` says what each part is."""

    @property
    def lattice(self) -> CellGrid: ...
    @property
    def inside(self) -> NDArray[np.bool_]: ...
    @property
    def levels(self) -> tuple[float, ...]: ...
    @property
    def weights(self) -> tuple[float, ...]: ...
    @property
    def dots(self) -> int: ...
    @property
    def cells(self) -> int: ...
    def laid(self, units: NDArray[np.bool_], orientations: NDArray[np.int8] | None = None, seed: int = 0) -> Floats: ...
    def psnr(self, pupil: Floats) -> tuple[float, ...]: ...
    def epsilons(self, pupil: Floats) -> tuple[float, ...]: ...
    def judge(self, pupil: Floats, epsilons: Sequence[float]) -> Judged: ...


@dataclass(frozen=True, eq=False)
class JudgedPupil(ABC):
    """The loss of one pupil, and what its slope takes.

    Attributes:
        dots: along the unit's side.
        lags: its autocorrelation in the upper half plane.
        value: the loss as a function of it.
    """

    dots: int
    lags: torch.Tensor
    value: torch.Tensor

    @property
    def loss(self) -> float:
        """Minus the weighted mean over the levels of the expected restored PSNR, dB."""
        return float(self.value.detach())

    @abstractmethod
    def slope(self) -> Slope:
        """The slopes; to be asked for once."""

    def _near(self, half: NDArray[np.float32]) -> Floats:
        """g at the lags within a unit, of the slopes in the upper half plane, each shared with its mirror image."""
        reach = half.shape[1] // 2
        upper = np.zeros((self.dots, 2 * self.dots - 1))
        # Cells wider than the stop have lags at which nothing is seen.
        kept = min(self.dots - 1, reach)
        upper[: kept + 1, self.dots - 1 - kept : self.dots + kept] = half[: kept + 1, reach - kept : reach + kept + 1]
        return np.concatenate([upper[:0:-1, ::-1], upper])


@dataclass(frozen=True, eq=False)
class _PlainPupil(JudgedPupil):
    """In light without a phase.

    Attributes:
        side: dots along the panel's side.
        spectrum: the pupil's transform, complex64, frequencies along x from 0.
    """

    side: int
    spectrum: torch.Tensor

    def slope(self) -> Slope:
        """The slopes; to be asked for once."""
        (given,) = torch.autograd.grad(self.value, self.lags)
        # Rows of lags above 0 stand for their mirror images too.
        half = _shared(given.numpy())
        reach, size = half.shape[1] // 2, len(self.spectrum)
        wrapped = np.zeros((len(half), size), dtype=np.float32)
        wrapped[:, : reach + 1], wrapped[:, -reach:] = half[:, reach:], half[:, :reach]
        # The slopes are real and even, so their transform is real.
        slopes = torch.fft.hfft(torch.fft.rfft(torch.from_numpy(wrapped), dim=1), n=size, dim=0)
        by_row = torch.fft.ifft(self.spectrum * slopes, dim=0)[: self.side]
        field = 2 * torch.fft.irfft(by_row, n=size, dim=1)[:, : self.side].numpy()
        return Slope(self._near(half), field)


@dataclass(frozen=True, eq=False)
class _TurnedPupil(JudgedPupil):
    """In light with a phase.

    Attributes:
        pupil: float32 [side, side], of which the lags are a function.
    """

    pupil: torch.Tensor

    def slope(self) -> Slope:
        """The slopes; to be asked for once."""
        field, given = torch.autograd.grad(self.value, (self.pupil, self.lags))
        return Slope(self._near(_shared(given.real.numpy().copy())), field.numpy())


def _shared(half: NDArray[np.float32]) -> NDArray[np.float32]:
    """Slopes in the upper half plane, changed in place into those of both halves: row 0 holds both signs."""
    half[0] = 0.5 * (half[0] + half[0, ::-1])
    half[1:] *= 0.5
    return half


@dataclass(frozen=True, eq=False)
class _Errors:
    """Mean squared errors of what Wiener filters restore, by ε; white is 1.

    Attributes:
        noise_gain: of the noise, over its variance.
        bias: of the signal that the filter holds back.
        leak: of the low-passed scenes, see :meth:`PupilError._leaks`.
    """

    noise_gain: torch.Tensor
    bias: torch.Tensor
    leak: torch.Tensor


@dataclass(frozen=True, eq=False)
class PupilError:
    """Everything that no layout changes.

    Attributes:
        lattice: of the cells behind the stop.
        size: points of the transforms along each side; no lag wraps.
        inside: the stop, bool [side, side], side = ``lattice.side``.
        reach: largest whole lag that is asked for.
        levels: of light, dB.
        weights: of the levels in the loss; they sum to 1.
        cycle: M, whole and odd: frequencies are multiples of 1 / M cycles per pixel.
        stretch: for each of these from 0 on, the whole lag below it and how far it lies beyond; None where all are
            whole lags themselves.
        pixel: sinc of the frequencies from -(k + 0.5) to k + 0.5 along one axis, k the orders folded back.
        share: of the square of frequencies, [(M + 1) / 2, M], its upper half; sums to 1.
        signal: the same times the scenes' mean spectrum, 0 where the leak counts.
        inverse_prior: (f / 0.1)² at the same places.
        along: matrices from the lags that reach the low frequencies, [.., 2 k + 1], to these, of y and x.
        low, low_truth, low_prior: the low-passed scenes as in :class:`maskfab.designs.model.expected_psnr.Surrogate`.
        mirror: for y and x, where the mirrored record takes its rows and columns from.
        noise: of the photographs' pixels.
        strengths: ε to choose from.
        amplitude: complex64 behind the open stop, [side, side], where light has a phase.
    """

    lattice: CellGrid
    size: int
    inside: NDArray[np.bool_]
    reach: int
    levels: tuple[float, ...]
    weights: tuple[float, ...]
    cycle: int
    stretch: tuple[torch.Tensor, torch.Tensor] | None
    pixel: torch.Tensor
    share: torch.Tensor
    signal: torch.Tensor
    inverse_prior: torch.Tensor
    along: tuple[torch.Tensor, torch.Tensor]
    low: torch.Tensor
    low_truth: torch.Tensor
    low_prior: torch.Tensor
    mirror: tuple[torch.Tensor, torch.Tensor]
    noise: PixelNoise
    strengths: tuple[float, ...]
    amplitude: torch.Tensor | None = None

    @property
    def dots(self) -> int:
        """Along the unit's side."""
        return self.lattice.dots

    @property
    def cells(self) -> int:
        """Along the panel's side: 24 of 168 µm."""
        return self.lattice.cells

    def laid(self, units: NDArray[np.bool_], orientations: NDArray[np.int8] | None = None, seed: int = 0) -> Floats:
        """The pupil of units laid on these cells, [side, side] of 0 and 1, as :func:`maskfab.camera.lens.lay`."""
        return lay("panel", units, orientations, seed, room=self.lattice).pupil

    def psnr(self, pupil: Floats) -> tuple[float, ...]:
        """Expected restored PSNR in dB at each level, each with its best ε.

        Args:
            pupil: of :meth:`laid`, [side, side] of 0 and 1.
        """
        return _best(self._tabulated(self._lags(pupil)))

    @property
    def frequencies(self) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
        """Cycles per pixel along y and x, first of the upper half of the square, then of the low-passed scenes."""
        nu = np.arange(-(self.cycle // 2), self.cycle // 2 + 1) / self.cycle
        low = scipy.fft.fftfreq(len(self.mirror[0])) / FACTOR, scipy.fft.rfftfreq(len(self.mirror[1])) / FACTOR
        return (nu[self.cycle // 2 :], nu), (np.asarray(low[0]), np.asarray(low[1]))

    def squared_errors(self, seen: Transfers, open_share: float, known: Transfers | None = None) -> Floats:
        """Mean squared errors of restored photographs by level and ε, [levels, ε]; white is 1.

        Args:
            seen: H at ``frequencies`` of what photographs are taken through, whatever it is.
            open_share: of the stop's light that it passes.
            known: H of what restores them; as ``seen`` if None.
        """
        with torch.no_grad():
            transfer, low = (torch.from_numpy(each) for each in seen)
            by = None if known is None else (torch.from_numpy(known[0]), torch.from_numpy(known[1]))
            errors = self._errors(_precise(transfer), low, self.strengths, by)
        found = [
            (self.noise.variance(level, open_share) * errors.noise_gain + errors.bias + errors.leak).numpy()
            for level in self.levels
        ]
        return np.stack(found)

    def decibels(self, level: float, error: float) -> float:
        """The PSNR that a mean squared error stands for at a level of light."""
        return -10 * math.log10(error) + self.noise.added_db(level)

    def table(self, pupil: NDArray[np.bool_] | Floats) -> NDArray[np.float32]:
        """Autocorrelation of a pupil in dots, at the lags (y, x) of the upper half plane within reach, in light without
        a phase."""
        return self._table(pupil)[1]

    def psnr_of_table(self, table: NDArray[np.float32]) -> tuple[float, ...]:
        """Expected restored PSNR in dB at each level, of an autocorrelation as :meth:`table` has it."""
        return _best(self._tabulated(torch.from_numpy(table)))

    def epsilons(self, pupil: Floats) -> tuple[float, ...]:
        """The best ε of each level."""
        return tuple(self.strengths[int(k)] for k in self._tabulated(self._lags(pupil)).argmax(axis=1))

    def judge(self, pupil: Floats, epsilons: Sequence[float]) -> JudgedPupil:
        """The loss of a pupil with the ε given for each level."""
        if self.amplitude is not None:
            dots = torch.from_numpy(pupil.astype(np.float32)).requires_grad_()
            lags = self._turned(dots, self.amplitude)
            return _TurnedPupil(self.dots, lags, self._loss(lags, epsilons), dots)
        spectrum, table = self._table(pupil)
        lags = torch.from_numpy(table).requires_grad_()
        return _PlainPupil(self.dots, lags, self._loss(lags, epsilons), len(pupil), spectrum)

    def _lags(self, pupil: Floats) -> torch.Tensor:
        """Autocorrelation of the amplitude behind the stop, as :meth:`table` has that of a pupil."""
        if self.amplitude is None:
            return torch.from_numpy(self.table(pupil))
        with torch.no_grad():
            return self._turned(torch.from_numpy(pupil.astype(np.float32)), self.amplitude)

    def _turned(self, pupil: torch.Tensor, amplitude: torch.Tensor) -> torch.Tensor:
        """Σ a(r) a*(r + s) at the lags of :meth:`table`, complex64."""
        size, reach = self.size, self.reach
        spectrum = torch.fft.fft2(pupil * amplitude, s=(size, size))
        power = spectrum.real**2 + spectrum.imag**2
        # The forward transform of |a|² is that of the opposite lags of the inverse one.
        rows = torch.fft.fft(power, dim=0, norm="forward")[: reach + 1]
        wide = torch.fft.fft(rows, dim=1, norm="forward")
        return torch.cat([wide[:, -reach:], wide[:, : reach + 1]], dim=1)

    def _table(self, pupil: NDArray[np.bool_] | Floats) -> tuple[torch.Tensor, NDArray[np.float32]]:
        """The pupil's transform, and its autocorrelation at the lags (y, x) of the upper half plane within reach.

        In single precision, and with the transform kept for the slope; else as in camera.transfer.
        """
        size, reach = self.size, self.reach
        lines = torch.fft.rfft(torch.from_numpy(pupil.astype(np.float32)), n=size, dim=1)
        spectrum = torch.fft.fft(lines, n=size, dim=0)
        power = spectrum.real**2 + spectrum.imag**2
        # The autocorrelation is real and even, so the sign of the transforms does not matter.
        rows = torch.fft.rfft(power, dim=0, norm="forward")[: reach + 1].conj()
        wide = torch.fft.irfft(rows, n=size, dim=1)
        # Pairs of clear dots are counted, so rounding makes single precision exact.
        return spectrum, torch.cat([wide[:, -reach:], wide[:, : reach + 1]], dim=1).round_().numpy()

    def _transfers(self, table: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """H on the upper half of the square of frequencies, at the low ones, and the light in dots."""
        reach, near_reach, cycle = self.reach, self.along[0].shape[1] // 2, self.cycle
        light = table[0, reach].real.to(torch.float64)
        seen = self._stretched(table) * self.pixel
        lines = seen.reshape(len(seen), -1, cycle).sum(dim=1) * self.pixel[len(self.pixel) // 2 :, None]
        half = cycle // 2 + 1
        folded = lines[:half]
        for start in range(cycle, len(lines), cycle):
            # Rows from below 0 are rows above it, mirrored.
            folded = folded + lines[start : start + half] + lines[start - half + 1 : start + 1].flip(0, 1).conj()
        folded = _precise(folded) / light
        upper = _precise(table[: near_reach + 1, reach - near_reach : reach + near_reach + 1])
        near = torch.cat([upper[1:].flip(0, 1).conj(), upper]) / light
        up, across = (matrix.to(near.dtype) for matrix in self.along)
        return folded, up @ near @ across.T, light

    def _stretched(self, table: torch.Tensor) -> torch.Tensor:
        """The autocorrelation at the lags of the frequencies, those of y from 0."""
        if self.stretch is None:
            return table
        below, beyond = self.stretch
        beyond = beyond.to(table.dtype)
        rows = torch.lerp(table[below], table[below + 1], beyond[:, None])
        right = self.reach + below
        # At lags to the left everything is mirrored.
        left = torch.lerp(rows[:, self.reach - below[1:]], rows[:, self.reach - below[1:] - 1], beyond[1:])
        return torch.cat([left.flip(1), torch.lerp(rows[:, right], rows[:, right + 1], beyond)], dim=1)

    def _loss(self, table: torch.Tensor, epsilons: Sequence[float]) -> torch.Tensor:
        transfer, low, light = self._transfers(table)
        errors = self._errors(transfer, low, epsilons)
        found = [
            weight * self._decibels(level, light, errors)[k]
            for k, (level, weight) in enumerate(zip(self.levels, self.weights, strict=True))
        ]
        return -torch.stack(found).sum()

    def _errors(
        self,
        transfer: torch.Tensor,
        low: torch.Tensor,
        epsilons: Sequence[float],
        known: tuple[torch.Tensor, torch.Tensor] | None = None,
    ) -> _Errors:
        """The mean squared errors of filters, whatever the light; those of ``known`` transfers if there are any."""
        by = None if known is None else _precise(known[0])
        squared = _squared_modulus(transfer if by is None else by)
        noise, bias = [], []
        for epsilon in epsilons:
            regular = epsilon * self.inverse_prior
            below = 1 / (squared + regular) ** 2
            noise.append((self.share * squared * below).sum())
            if by is None:
                bias.append((self.signal * regular**2 * below).sum())
            else:
                missed = 1 - wiener_tensor(by, regular) * transfer
                bias.append((self.signal * _squared_modulus(missed)).sum())
        return _Errors(torch.stack(noise), torch.stack(bias), self._leaks(low, epsilons, known and known[1]))

    def _decibels(self, level: float, light: torch.Tensor, errors: _Errors) -> torch.Tensor:
        white = self.noise.settings.electrons[level] / REFERENCE_TRANSMISSION * light / float(self.inside.sum())
        error = self.noise.of_white(white) * errors.noise_gain + errors.bias + errors.leak
        return -10 * torch.log10(error) + self.noise.added_db(level)

    def _leaks(
        self, transfer: torch.Tensor, epsilons: Sequence[float], known: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Mean squared errors of the low-passed scenes, whose halo crosses the sensor's edge, by ε."""
        single = transfer.to(torch.complex64 if transfer.is_complex() else torch.float32)
        by = single if known is None else known
        rows, columns = len(self.mirror[0]), len(self.mirror[1])
        height, width = self.low_truth.shape[-2:]
        top, left = (rows - height) // 2, (columns - width) // 2
        record = torch.fft.irfft2(self.low * single, s=(rows, columns))
        # The places are those of the whole scene, so that nothing needs to be cut out first.
        seen = torch.fft.rfft2(record.index_select(-2, self.mirror[0]).index_select(-1, self.mirror[1]))
        found = []
        for epsilon in epsilons:
            filtered = wiener_tensor(by, epsilon * self.low_prior)
            restored = torch.fft.irfft2(seen * filtered, s=(rows, columns))
            missed = restored[..., top : top + height, left : left + width] - self.low_truth
            found.append((missed**2).mean().to(torch.float64))
        return torch.stack(found)

    def _tabulated(self, table: torch.Tensor) -> Floats:
        """Expected PSNR by level and ε."""
        with torch.no_grad():
            transfer, low, light = self._transfers(table)
            errors = self._errors(transfer, low, self.strengths)
            return np.stack([self._decibels(level, light, errors).numpy() for level in self.levels])


def wiener_tensor(transfer: torch.Tensor, noise_to_signal: torch.Tensor | float) -> torch.Tensor:
    """:func:`maskfab.optics.restoration.wiener_filter` with a slope, for R above 0."""
    return transfer.conj() / (_squared_modulus(transfer) + noise_to_signal)


def _precise(transfer: torch.Tensor) -> torch.Tensor:
    return transfer.to(torch.complex128 if transfer.is_complex() else torch.float64)


def _squared_modulus(transfer: torch.Tensor) -> torch.Tensor:
    return transfer.real**2 + transfer.imag**2 if transfer.is_complex() else transfer**2


def _best(by_epsilon: Floats) -> tuple[float, ...]:
    return tuple(float(v) for v in by_epsilon.max(axis=1))


def pupil_error(
    estimate: Surrogate, levels: Sequence[float] | None = None, weights: Sequence[float] | None = None
) -> PupilError:
    """The error of realised panels, with the scenes of a surrogate.

    Args:
        estimate: of :func:`maskfab.designs.model.expected_psnr.surrogate`; its dots are those of the units.
        levels: whose decibels are averaged; None for the surrogate's own.
        weights: of the levels, positive in sum; None for equal ones.

    Raises:
        JobError: MF104 for another number of weights than of levels, or weights that are no weights.
    """
    levels = estimate.levels if levels is None else levels
    share = np.ones(len(levels)) if weights is None else np.asarray(weights, dtype=np.float64)
    if len(share) != len(levels) or not np.isfinite(share).all() or share.min() < 0 or share.sum() <= 0:
        raise JobError(
            "MF104",
            f"the weights {tuple(weights or ())} are not {len(levels)} numbers of 0 or more, some above",
            where="weights",
            cure="Give one for each level",
        )
    room = estimate.lattice
    side, camera = room.side, room.camera
    per_cycle = room.per_cycle(camera.middle_nm)
    cycle = 2 * round((per_cycle - 1) / 2) + 1
    if not camera.is_f1:
        cycle = max(cycle, _FEWEST_FREQUENCIES)
    half = cycle // 2 + _orders(camera) * cycle
    stretch = None if camera.is_f1 else _parts(np.arange(half + 1, dtype=np.float64) * (per_cycle / cycle))
    reach = half if stretch is None else int(stretch[0].max()) + 1
    reach = max(reach, len(estimate.near) // 2)
    nu = np.arange(-(cycle // 2), cycle // 2 + 1) / cycle
    upper = nu[cycle // 2 :, None]
    distance = np.hypot(upper, nu)
    factor, power = _power_law(estimate, per_cycle)
    square = np.where(upper > 0, 2.0, 1.0) / cycle**2 * np.ones(cycle)
    signal = square * factor * np.maximum(distance, 1e-3) ** -power
    height, width = estimate.low_truth.shape[-2:]
    rows = estimate.along[0].shape[0]
    columns = 2 * (estimate.along[1].shape[0] - 1)
    signal[(upper < _LOW) & (abs(nu) < _LOW)] = 0
    return PupilError(
        room,
        int(scipy.fft.next_fast_len(max(2 * side - 1, side + reach, 2 * reach + 1), real=True)),
        room.stop,
        reach,
        tuple(levels),
        tuple(float(w) for w in share / share.sum()),
        cycle,
        stretch,
        torch.from_numpy(np.sinc(np.arange(-half, half + 1) / cycle).astype(np.float32)),
        torch.from_numpy(square),
        torch.from_numpy(signal),
        torch.from_numpy((distance / PRIOR_CY_PER_PX) ** 2 + 1e-12),
        (torch.from_numpy(estimate.along[0]), torch.from_numpy(estimate.along[1])),
        torch.from_numpy(np.array(estimate.low)),
        torch.from_numpy(np.array(estimate.low_truth)),
        torch.from_numpy(np.array(estimate.low_prior)),
        (_mirrored(rows, height), _mirrored(columns, width)),
        estimate.noise,
        estimate.strengths,
        None if estimate.amplitude is None else torch.from_numpy(estimate.amplitude.astype(np.complex64)),
    )


def _orders(camera: PhotoCamera) -> int:
    """Multiples of the sampling frequency that are folded back."""
    passed = 1 - _RIM if camera.is_f1 else 1
    return max(1, math.ceil(passed * camera.reach(camera.middle_nm) - 0.5))


def _parts(lags: Floats) -> tuple[torch.Tensor, torch.Tensor]:
    """The whole lags below these, and how far they lie beyond."""
    below = np.floor(lags)
    return torch.from_numpy(below.astype(np.int64)), torch.from_numpy((lags - below).astype(np.float32))


def _power_law(estimate: Surrogate, per_cycle: float) -> tuple[float, float]:
    """c and p of the surrogate's spectrum c f^-p."""
    kept = estimate.signal > 0
    distance = np.hypot(*estimate.lags[:, kept]) / per_cycle
    slope, offset = np.polyfit(np.log(distance), np.log(estimate.signal[kept] / estimate.weight[kept]), 1)
    return float(np.exp(offset)), float(-slope)


def _mirrored(whole: int, kept: int) -> torch.Tensor:
    """Where a record in the middle of a scene, mirrored with its edge pixels doubled, takes its pixels from."""
    margin = (whole - kept) // 2
    return torch.from_numpy(np.pad(np.arange(margin, margin + kept), margin, mode="symmetric"))


@dataclass(frozen=True, eq=False)
class OverDistances:
    """Judgement of panels by the mean over distances; a :class:`maskfab.designs.model.panel_error.PanelError`.

    Attributes:
        errors: at every distance, of one lattice and alike in levels and weights.
    """

    errors: tuple[PupilError, ...]

    @property
    def lattice(self) -> CellGrid:
        """Of the cells behind the stop."""
        return self.errors[0].lattice

    @property
    def inside(self) -> NDArray[np.bool_]:
        """The stop."""
        return self.errors[0].inside

    @property
    def levels(self) -> tuple[float, ...]:
        """Of light, dB."""
        return self.errors[0].levels

    @property
    def weights(self) -> tuple[float, ...]:
        """Of the levels."""
        return self.errors[0].weights

    @property
    def dots(self) -> int:
        """Along the unit's side."""
        return self.lattice.dots

    @property
    def cells(self) -> int:
        """Along the panel's side."""
        return self.lattice.cells

    def laid(self, units: NDArray[np.bool_], orientations: NDArray[np.int8] | None = None, seed: int = 0) -> Floats:
        """The pupil of units laid on the cells."""
        return self.errors[0].laid(units, orientations, seed)

    def psnr(self, pupil: Floats) -> tuple[float, ...]:
        """Mean over the distances of the expected restored PSNR in dB, at each level."""
        return tuple(np.mean([each.psnr(pupil) for each in self.errors], axis=0).tolist())

    def epsilons(self, pupil: Floats) -> tuple[float, ...]:
        """The best ε of each level, distance by distance."""
        return tuple(epsilon for each in self.errors for epsilon in each.epsilons(pupil))

    def judge(self, pupil: Floats, epsilons: Sequence[float]) -> MeanJudged:
        """The mean loss of a pupil with the ε of :meth:`epsilons`."""
        count = len(self.levels)
        parts = (epsilons[start : start + count] for start in range(0, len(epsilons), count))
        return MeanJudged(tuple(each.judge(pupil, part) for each, part in zip(self.errors, parts, strict=True)))


@dataclass(frozen=True, eq=False)
class MeanJudged:
    """Mean over what judged one pupil."""

    judged: tuple[Judged, ...]

    @property
    def loss(self) -> float:
        """Minus the mean over levels and distances of the expected restored PSNR, dB."""
        return sum(each.loss for each in self.judged) / len(self.judged)

    def slope(self) -> Slope:
        """Mean of the slopes; to be asked for once."""
        slopes = [each.slope() for each in self.judged]
        return Slope(np.mean([each.near for each in slopes], axis=0), np.mean([each.field for each in slopes], axis=0))


_MIDDLE = 1


@dataclass(frozen=True)
class SceneAppraisal:
    """A panel's expected restored PSNR over a scene, dB.

    Attributes:
        conditions: of a scene, distance by distance.
        psnr: in each of them, by level, with the ε that is best for all of its photograph.
        mean: by level, over the distances, of photographs with the mean error of their places.
    """

    conditions: tuple[Condition, ...]
    psnr: tuple[tuple[float, ...], ...]
    mean: tuple[float, ...]


def appraise_over(panel: Panel, seen: SceneConditions, errors: Sequence[PupilError]) -> SceneAppraisal:
    """Appraise a panel.

    Args:
        panel: that covers the stop from every place.
        seen: the conditions.
        errors: for each distance, that of panels in its light, or one for all; scenes and noise are taken from it.

    Raises:
        JobError: as :func:`maskfab.camera.die_transfer.die_transfer`.
    """
    each_error = tuple(errors) if len(errors) > 1 else tuple(errors) * len(seen.distances_um)
    places, shares = zip(*seen.places, strict=True)
    psnr: list[tuple[float, ...]] = []
    means = []
    for distance, error in zip(seen.distances_um, each_error, strict=True):
        die = die_transfer("the design", panel, seen.camera, seen.scene, seen.plan, object_um=distance)
        lines, samples = die.resolution.lines[_MIDDLE], die.resolution.samples
        open_share = die.view.passed_um2(lines.gap.centroid_nm, samples) / seen.camera.stop.area_um2
        axis = transfers(die, error)
        by_place = np.stack(
            [
                error.squared_errors(axis, open_share)
                if place == AXIS
                else error.squared_errors(transfers(die.at(place), error), open_share, known=axis)
                for place in places
            ]
        )
        whole = np.tensordot(np.array(shares), by_place, axes=1)
        best = whole.argmin(axis=1)
        means.append([error.decibels(level, whole[k, best[k]]) for k, level in enumerate(error.levels)])
        psnr += [
            tuple(error.decibels(level, each[k, best[k]]) for k, level in enumerate(error.levels)) for each in by_place
        ]
    return SceneAppraisal(tuple(seen), tuple(psnr), tuple(np.mean(means, axis=0).tolist()))


def transfers(die: DieTransfer, error: PupilError) -> Transfers:
    """H of the middle line at the frequencies that an error is summed over."""
    lines, samples = die.resolution.lines[_MIDDLE], die.resolution.samples
    square, low = (die.view.transfer(lines, samples, y, x) for y, x in error.frequencies)
    return square, low
