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

Over the distances of a scene the mean of decibels counts, each photograph restored by its own blur.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
import torch

from maskfab.base.arrays import Floats, Mask, Singles
from maskfab.base.errors import JobError
from maskfab.camera.imaging import Transfer
from maskfab.camera.restorers.wiener import PRIOR_CY_PER_PX
from maskfab.camera.stop_cells import CellGrid
from maskfab.designs.model.expected_psnr import Surrogate, interpolation
from maskfab.designs.model.panel_judgement import Judged, PanelError, Slope, parted
from maskfab.designs.model.statistics import FACTOR, PixelNoise
from maskfab.job.camera import REFERENCE_TRANSMISSION

Transfers = tuple[Transfer, Transfer]
"""H on the upper half of the square of frequencies, and at the low ones."""

Errors = tuple[torch.Tensor, torch.Tensor, torch.Tensor]
"""Mean squared errors after Wiener filters, by ε, white is 1: noise over its variance, signal held back, and leak."""

_LOW = 1 / 16
"""Cycles per pixel below which, on both axes, the surrogate's low-passed scenes take over."""

_RIM = 0.01
"""Outer share of the stop's diameter that protocol F1 leaves out: its lags pass next to nothing."""

_MOST_FREQUENCIES = 400
"""Along an axis by which steps of a map are judged: maps that fewer lags lead to are no worse by 0.01 dB."""

_COLUMNS, _ROWS = 64, 16
"""That are worked on at once, so that they stay in the processor's cache."""

_FEWEST_FREQUENCIES = 129
"""Along an axis, where a camera has fewer dots of lag to one cycle per pixel."""


@dataclass(frozen=True, eq=False)
class PupilError(PanelError):
    """Everything that no layout changes.

    Attributes:
        size: points of the transforms along each side; no lag wraps.
        reach: largest whole lag that is asked for.
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
        strengths: ε to choose from.
        amplitude: complex64 behind the open stop, [side, side], where light has a phase.
        stride: dots from one lag to the next: all that is said of lags above counts them.
        coarse: the error by fewer lags, where dots are fine.
    """

    lattice: CellGrid
    size: int
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
    stride: int = 1
    coarse: PupilError | None = None

    @property
    def of_steps(self) -> PupilError:
        return self.coarse or self

    def psnr(self, pupil: Floats) -> tuple[float, ...]:
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
            transfer, low = (torch.from_numpy(part) for part in seen)
            by = None if known is None else (torch.from_numpy(known[0]), torch.from_numpy(known[1]))
            noise, bias, leak = self._errors(_precise(transfer), low, self.strengths, by)
        variances = (self.noise.variance(level, open_share) for level in self.levels)
        return np.stack([(variance * noise + bias + leak).numpy() for variance in variances])

    def decibels(self, level: float, error: float) -> float:
        """The PSNR that a mean squared error stands for at a level of light."""
        return -10 * math.log10(error) + self.noise.added_db(level)

    def table(self, pupil: Mask | Floats) -> Singles:
        """Autocorrelation of a pupil in dots, without a phase, at lags (y, x) of the upper half plane within reach."""
        # Pairs of clear dots are counted, so rounding makes single precision exact.
        return self.mean_table([pupil], [1.0]).round()

    def mean_table(self, pupils: Iterable[Mask | Floats], shares: Sequence[float]) -> Singles:
        """Sum of the autocorrelations of pupils, each times its share, but for rounding in single precision."""
        size, reach = self.size, self.reach
        power = np.zeros((size, size // 2 + 1), dtype=np.float32)
        blocks = [slice(start, start + _COLUMNS) for start in range(0, power.shape[1], _COLUMNS)]
        # Dots a whole number of strides apart are of one part.
        parts = (
            (part, share)
            for pupil, share in zip(pupils, shares, strict=True)
            for part in parted(pupil.astype(np.float32), self.stride)
        )
        for part, share in parts:
            lines = scipy.fft.rfft(part, size, axis=1, workers=1)
            for block in blocks:
                spectrum = scipy.fft.fft(lines[:, block], size, axis=0, workers=1)
                power[:, block] += np.float32(share) * (spectrum.real**2 + spectrum.imag**2)
        # The autocorrelation is real and even, so the sign of the transforms does not matter.
        rows = [scipy.fft.rfft(power[:, block], axis=0, norm="forward", workers=1)[: reach + 1] for block in blocks]
        wide = scipy.fft.irfft(np.concatenate(rows, axis=1).conj(), size, axis=1, workers=1)
        return np.concatenate([wide[:, -reach:], wide[:, : reach + 1]], axis=1)

    def psnr_of_table(self, table: Singles) -> tuple[float, ...]:
        """Expected restored PSNR in dB at each level, of an autocorrelation as :meth:`table` has it."""
        return _best(self._tabulated(torch.from_numpy(table)))

    def epsilons(self, pupil: Floats) -> tuple[float, ...]:
        return tuple(self.strengths[int(k)] for k in self._tabulated(self._lags(pupil)).argmax(axis=1))

    def judge(self, pupil: Floats, epsilons: Sequence[float]) -> Judged:
        if self.amplitude is not None:
            dots = torch.from_numpy(pupil.astype(np.float32)).requires_grad_()
            lags = self._turned(dots, self.amplitude)
            value = self._loss(lags, epsilons)

            def turned_slope() -> Slope:
                field, by_lag = torch.autograd.grad(value, (dots, lags))
                return Slope(self._near(_shared(by_lag.real.numpy().copy())), field.numpy())

            return Judged(float(value.detach()), turned_slope)
        spectra, table = self._table(pupil)
        lags = torch.from_numpy(table).requires_grad_()
        value = self._loss(lags, epsilons)

        def slope() -> Slope:
            (by_lag,) = torch.autograd.grad(value, lags)
            # Rows of lags above 0 stand for their mirror images too.
            half = _shared(by_lag.numpy())
            return Slope(self._near(half), self._field(half, spectra))

        return Judged(float(value.detach()), slope)

    def _field(self, half: Singles, spectra: Sequence[torch.Tensor]) -> Singles:
        """∂loss/∂p in light without a phase, from g in the upper half plane and the transform of :meth:`_table`."""
        reach, size, side = half.shape[1] // 2, self.size, self.lattice.side
        wrapped = np.zeros((len(half), size), dtype=np.float32)
        wrapped[:, : reach + 1], wrapped[:, -reach:] = half[:, reach:], half[:, :reach]
        # The slopes are real and even, so their transform is real.
        slopes = torch.fft.hfft(torch.fft.rfft(torch.from_numpy(wrapped), dim=1), n=size, dim=0)
        count, stride = -(-side // self.stride), self.stride
        field = np.empty((count * stride, count * stride), dtype=np.float32)
        for place, spectrum in enumerate(spectra):
            by_row = torch.fft.ifft(spectrum * slopes, dim=0)[:count]
            part = 2 * torch.fft.irfft(by_row, n=size, dim=1)[:, :count].numpy()
            field[place // stride :: stride, place % stride :: stride] = part
        return field[:side, :side]

    def _near(self, half: Singles) -> Floats:
        """g at the lags within a unit, of the slopes in the upper half plane, each shared with its mirror image."""
        reach, stride = half.shape[1] // 2, self.stride
        upper = np.zeros((self.dots, 2 * self.dots - 1))
        # Cells wider than the stop have lags at which nothing is seen.
        within = min((self.dots - 1) // stride, reach)
        columns = slice(self.dots - 1 - within * stride, self.dots + within * stride, stride)
        upper[: within * stride + 1 : stride, columns] = half[: within + 1, reach - within : reach + within + 1]
        return np.concatenate([upper[:0:-1, ::-1], upper])

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

    def _table(self, pupil: Mask | Floats) -> tuple[list[torch.Tensor], Singles]:
        """Transforms of every so many dots, for the slope; autocorrelation at lags (y, x) of the upper half plane."""
        size, reach = self.size, self.reach
        parts = torch.from_numpy(parted(pupil.astype(np.float32), self.stride))
        lines = (torch.fft.rfft(part, n=size, dim=1) for part in parts)
        spectra = [torch.fft.fft(line, n=size, dim=0) for line in lines]
        power = _squared_modulus(spectra[0])
        for spectrum in spectra[1:]:
            power += _squared_modulus(spectrum)
        # The autocorrelation is real and even, so the sign of the transforms does not matter.
        rows = torch.fft.rfft(power, dim=0, norm="forward")[: reach + 1].conj()
        wide = torch.fft.irfft(rows, n=size, dim=1)
        # Pairs of clear dots are counted, so rounding makes single precision exact.
        return spectra, torch.cat([wide[:, -reach:], wide[:, : reach + 1]], dim=1).round_().numpy()

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
        weighted = [
            weight * self._decibels(level, light, errors)[k]
            for k, (level, weight) in enumerate(zip(self.levels, self.weights, strict=True))
        ]
        return -torch.stack(weighted).sum()

    def _errors(
        self,
        transfer: torch.Tensor,
        low: torch.Tensor,
        epsilons: Sequence[float],
        known: tuple[torch.Tensor, torch.Tensor] | None = None,
    ) -> Errors:
        """Errors of Wiener filters, whatever the light; those of ``known`` transfers if there are any."""
        by = None if known is None else _precise(known[0])
        noise, bias = self._filtered(transfer, epsilons, slice(None), by)
        return noise, bias, self._leaks(low, epsilons, known and known[1])

    def _filtered(
        self, transfer: torch.Tensor, epsilons: Sequence[float], rows: slice, by: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Noise, and signal held back, of these rows of frequencies."""
        transfer, prior, share, signal = (
            each[rows] for each in (transfer, self.inverse_prior, self.share, self.signal)
        )
        squared = _squared_modulus(transfer if by is None else by[rows])
        noise, bias = [], []
        for epsilon in epsilons:
            regular = epsilon * prior
            below = 1 / (squared + regular) ** 2
            noise.append((share * squared * below).sum())
            if by is None:
                bias.append((signal * regular**2 * below).sum())
            else:
                missed = 1 - wiener_tensor(by[rows], regular) * transfer
                bias.append((signal * _squared_modulus(missed)).sum())
        return torch.stack(noise), torch.stack(bias)

    def _decibels(self, level: float, light: torch.Tensor, errors: Errors) -> torch.Tensor:
        noise, bias, leak = errors
        white = self.noise.settings.electrons[level] / REFERENCE_TRANSMISSION * light / float(self.inside.sum())
        error = self.noise.of_white(white) * noise + bias + leak
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
        errors = []
        for epsilon in epsilons:
            filtered = wiener_tensor(by, epsilon * self.low_prior)
            restored = torch.fft.irfft2(seen * filtered, s=(rows, columns))
            missed = restored[..., top : top + height, left : left + width] - self.low_truth
            errors.append((missed**2).mean().to(torch.float64))
        return torch.stack(errors)

    def _tabulated(self, table: torch.Tensor) -> Floats:
        with torch.no_grad():
            transfer, low, light = self._transfers(table)
            parts = [
                self._filtered(transfer, self.strengths, slice(start, start + _ROWS))
                for start in range(0, len(transfer), _ROWS)
            ]
            noise, bias = (torch.stack(sums).sum(dim=0) for sums in zip(*parts, strict=True))
            errors = noise, bias, self._leaks(low, self.strengths)
            return np.stack([self._decibels(level, light, errors).numpy() for level in self.levels])


def pupil_error(
    estimate: Surrogate, levels: Sequence[float] | None = None, weights: Sequence[float] | None = None
) -> PupilError:
    """The error of realised panels, with the scenes of a surrogate.

    Args:
        estimate: its dots are those of the units.
        levels: whose decibels are averaged; None for the surrogate's own.
        weights: of the levels, positive in sum; None for equal ones.

    Raises:
        JobError: MF104 for another number of weights than of levels, or weights that are no weights.
    """
    levels = estimate.levels if levels is None else levels
    share = np.ones(len(levels)) if weights is None else np.asarray(weights, dtype=np.float64)
    if len(share) != len(levels) or not np.isfinite(share).all() or share.min() < 0 or share.sum() <= 0:
        what = f"the weights {tuple(weights or ())} are not {len(levels)} numbers of 0 or more, some above"
        raise JobError("MF104", what, where="weights", cure="Give one for each level")
    weights = tuple(float(w) for w in share / share.sum())
    per_cycle = estimate.lattice.per_cycle(estimate.lattice.camera.middle_nm)
    stride = 1 if estimate.amplitude is not None else max(1, math.ceil(per_cycle / _MOST_FREQUENCIES))
    fine = _at_lags(estimate, tuple(levels), weights, 1)
    return fine if stride == 1 else replace(fine, coarse=_at_lags(estimate, fine.levels, weights, stride))


def _at_lags(estimate: Surrogate, levels: tuple[float, ...], weights: tuple[float, ...], stride: int) -> PupilError:
    """The error of panels by lags that lie so many dots apart."""
    room = estimate.lattice
    count, camera = -(-room.side // stride), room.camera
    per_cycle = room.per_cycle(camera.middle_nm) / stride
    cycle = 2 * round((per_cycle - 1) / 2) + 1
    if not camera.is_f1:
        cycle = max(cycle, _FEWEST_FREQUENCIES)
    # Multiples of the sampling frequency are folded back as far as the stop passes them.
    orders = max(1, math.ceil((1 - _RIM if camera.is_f1 else 1) * camera.reach(camera.middle_nm) - 0.5))
    half = cycle // 2 + orders * cycle
    stretch, reach = None, half
    if not camera.is_f1:
        lags = np.arange(half + 1, dtype=np.float64) * (per_cycle / cycle)
        below = np.floor(lags)
        stretch = torch.from_numpy(below.astype(np.int64)), torch.from_numpy((lags - below).astype(np.float32))
        reach = int(below.max()) + 1
    reach = max(reach, -(-(len(estimate.near) // 2) // stride))
    nu = np.arange(-(cycle // 2), cycle // 2 + 1) / cycle
    upper = nu[cycle // 2 :, None]
    distance = np.hypot(upper, nu)
    # The surrogate's spectrum is c f^-p.
    seen = estimate.signal > 0
    lengths = np.log(np.hypot(*estimate.lags[:, seen]) / (per_cycle * stride))
    slope, offset = np.polyfit(lengths, np.log(estimate.signal[seen] / estimate.weight[seen]), 1)
    square = np.where(upper > 0, 2.0, 1.0) / cycle**2 * np.ones(cycle)
    signal = square * float(np.exp(offset)) * np.maximum(distance, 1e-3) ** float(slope)
    height, width = estimate.low_truth.shape[-2:]
    rows = estimate.along[0].shape[0]
    columns = 2 * (estimate.along[1].shape[0] - 1)
    signal[(upper < _LOW) & (abs(nu) < _LOW)] = 0
    along = estimate.along
    if stride > 1:
        low = scipy.fft.fftfreq(rows) / FACTOR, scipy.fft.rfftfreq(columns) / FACTOR
        near = -(-(len(estimate.near) // 2) // stride)
        along = interpolation(low[0], per_cycle, near), interpolation(low[1], per_cycle, near)
    return PupilError(
        room,
        int(scipy.fft.next_fast_len(max(2 * count - 1, count + reach, 2 * reach + 1), real=True)),
        reach,
        levels,
        weights,
        cycle,
        stretch,
        torch.from_numpy(np.sinc(np.arange(-half, half + 1) / cycle).astype(np.float32)),
        torch.from_numpy(square),
        torch.from_numpy(signal),
        torch.from_numpy((distance / PRIOR_CY_PER_PX) ** 2 + 1e-12),
        (torch.from_numpy(along[0]), torch.from_numpy(along[1])),
        torch.from_numpy(np.array(estimate.low)),
        torch.from_numpy(np.array(estimate.low_truth)),
        torch.from_numpy(np.array(estimate.low_prior)),
        (_mirrored(rows, height), _mirrored(columns, width)),
        estimate.noise,
        estimate.strengths,
        None if estimate.amplitude is None else torch.from_numpy(estimate.amplitude.astype(np.complex64)),
        stride,
    )


def wiener_tensor(transfer: torch.Tensor, noise_to_signal: torch.Tensor | float) -> torch.Tensor:
    """:func:`maskfab.optics.restoration.wiener_filter` with a slope, for R above 0."""
    return transfer.conj() / (_squared_modulus(transfer) + noise_to_signal)


def _precise(transfer: torch.Tensor) -> torch.Tensor:
    return transfer.to(torch.complex128 if transfer.is_complex() else torch.float64)


def _squared_modulus(transfer: torch.Tensor) -> torch.Tensor:
    return transfer.real**2 + transfer.imag**2 if transfer.is_complex() else transfer**2


def _best(by_epsilon: Floats) -> tuple[float, ...]:
    return tuple(float(v) for v in by_epsilon.max(axis=1))


def _shared(half: Singles) -> Singles:
    """Slopes in the upper half plane, changed in place into those of both halves: row 0 holds both signs."""
    half[0] = 0.5 * (half[0] + half[0, ::-1])
    half[1:] *= 0.5
    return half


def _mirrored(whole: int, inner: int) -> torch.Tensor:
    """Where a record in the middle of a scene, mirrored with its edge pixels doubled, takes its pixels from."""
    margin = (whole - inner) // 2
    return torch.from_numpy(np.pad(np.arange(margin, margin + inner), margin, mode="symmetric"))
