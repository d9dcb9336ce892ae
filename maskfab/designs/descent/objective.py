"""Objectives of a descent, and the stop filled with oriented units whose autocorrelation they read.

An objective is a frozen object that turns a relaxed unit, float [dots, dots] within 0 to 1, into a scalar: **lower is
better**, gradients go through. Most read nothing but the autocorrelation of the stop filled with oriented units, so a
sum of them transforms the pupil once.

With A the transform of the pupil p on N x N points, the autocorrelation is the inverse transform of |A|² (Goodman,
Introduction to Fourier Optics, 6.3). |A|² is real, so the transform along y is a real one, and only rows of lags from
0 to the reach go on to the transform along x. The adjoint is written by hand: slopes g of a loss by the lags become

    ∂/∂p = 2 IFFT( Re FFT(g) · A ),

again with a real transform along y, which only the rows inside the pupil leave. Nothing but A is kept for it. A second
derivative is taken through these steps, with A made anew.

The transfer at the frequency ν is the autocorrelation at the lag λfν, divided by lag 0, times the square pixel's
sinc(ν_x p) sinc(ν_y p) (Goodman, 6.4). Between whole dots it is bilinear, which is exact for square dots.

Notes:
    Lags are whole dots, so the table is exact for square dots. Designs take dots that the stop cuts in or out. A table
    to be told takes them with their mean transmission, and lag 0 with what they pass, as
    :mod:`maskfab.optics.lags` does.
    Sizes are even, because real transforms of odd length cost three times as much.
    On CUDA the scatter-add adds in any order, so gradients there repeat to rounding only; on the CPU they repeat.
    An objective may differ from step to step (an area that is led down, another batch of pictures). ``at`` gives the
    one of a step as a function of the step's number alone; that is why runs can be resumed.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from maskfab.base.arrays import Ints, Labels, Mask
from maskfab.base.cell_size import CellSize
from maskfab.base.errors import JobError
from maskfab.base.model import unit_dots
from maskfab.base.units import NM_PER_UM
from maskfab.job.camera import Camera, Stop
from maskfab.optics.stop import stop_dots


@dataclass(frozen=True, eq=False)
class Autocorrelation:
    """The constants of one layout and stop; a function of the unit's dots.

    Attributes:
        index: int64 [rows x columns], the unit's dot at each place of the pupil, flat; dots outside the stop have the
            number after the last dot.
        shape: dots of the pupil along y and x.
        size: points N of the transforms along each side.
        reach: longest lag along y, in dots; |x| of a lag may be as long.
        share: of that shape, of each dot inside the stop; None where dots are in or out.
        spread: [dots, dots], what lag 0 gains with the square of each dot over that of its mean; None without shares.
    """

    index: torch.Tensor
    shape: tuple[int, int]
    dots: int
    size: int
    reach: int
    share: torch.Tensor | None = None
    spread: torch.Tensor | None = None

    def pupil(self, unit: torch.Tensor) -> torch.Tensor:
        """The stop filled with oriented units, [..., *shape]."""
        dots = torch.cat([unit.flatten(-2), unit.new_zeros((*unit.shape[:-2], 1))], -1)
        laid = dots.index_select(-1, self.index).view(*unit.shape[:-2], *self.shape)
        return laid if self.share is None else laid * self.share

    def transform(self, unit: torch.Tensor) -> torch.Tensor:
        """The pupil's transform, [..., size, size / 2 + 1]."""
        spectrum: torch.Tensor = torch.fft.rfft2(self.pupil(unit), s=(self.size, self.size))
        return spectrum

    def __call__(self, unit: torch.Tensor) -> torch.Tensor:
        """Autocorrelation in dots, [..., reach + 1, size]; lag (y, x) at [..., y, x % size]. Differentiable twice.

        Args:
            unit: amplitude of the unit's dots, [..., dots, dots], float32 or float64.
        """
        table: torch.Tensor = _Autocorrelation.apply(unit, self)  # type: ignore[no-untyped-call]
        if self.spread is not None:
            table[..., 0, 0] += (self.spread * unit**2).sum((-2, -1))
        return table


def autocorrelation(dots: int, orientations: Labels, inside: Mask, reach: int) -> Autocorrelation:
    """The autocorrelation of units of ``dots`` dots a side, laid in these orientations.

    Args:
        orientations: int8 [rows, columns], elements of D4, row 0 lowest.
        inside: bool [rows x dots, columns x dots], dots inside the stop.
        reach: longest lag in dots, shorter than the pupil.
    """
    size = transform_size(max(inside.shape), reach)
    flat = torch.from_numpy(np.where(inside, unit_dots(orientations, dots), dots * dots).ravel())
    return Autocorrelation(flat, (inside.shape[0], inside.shape[1]), dots, size, reach)


def transform_size(side: int, reach: int) -> int:
    """Points of a transform in which lags up to the reach of so many dots fold onto none of each other."""
    # Twice a fast length is fast and even.
    return 2 * int(next_fast_len((side + reach + 1) // 2))


class _Autocorrelation(torch.autograd.Function):
    """Rows 0 to the reach of the autocorrelation table, with their adjoint."""

    @staticmethod
    def forward(ctx: Any, unit: torch.Tensor, layout: Autocorrelation) -> torch.Tensor:
        spectrum = layout.transform(unit)
        power = torch.addcmul(spectrum.real * spectrum.real, spectrum.imag, spectrum.imag)
        rows = torch.fft.ihfft(power, dim=-2)[..., : layout.reach + 1, :]
        ctx.layout = layout
        ctx.save_for_backward(unit, spectrum)
        table: torch.Tensor = torch.fft.irfft(rows, n=layout.size, dim=-1)
        return table

    @staticmethod
    def backward(ctx: Any, slope: torch.Tensor) -> tuple[torch.Tensor, None]:
        layout: Autocorrelation = ctx.layout
        unit, spectrum = ctx.saved_tensors
        if torch.is_grad_enabled():
            # What is differentiated once more must depend on the unit.
            spectrum = layout.transform(unit)
        size, (height, width) = layout.size, layout.shape
        rows = torch.fft.rfft(slope, dim=-1)
        # Row 0 holds both signs of its lags, the others stand for their mirror images too.
        rows[..., 0, :] = 2 * rows[..., 0, :].real
        weighted = spectrum * torch.fft.hfft(rows, n=size, dim=-2)
        by_row = torch.fft.ifft(weighted, dim=-2)[..., :height, :]
        by_dot = torch.fft.irfft(by_row, n=size, dim=-1)[..., :width]
        if layout.share is not None:
            by_dot = by_dot * layout.share
        by_place = by_dot.flatten(-2)
        home = by_place.new_zeros((*by_place.shape[:-1], layout.dots**2 + 1))
        home.scatter_add_(-1, layout.index.expand(by_place.shape), by_place)
        return home[..., :-1].reshape(unit.shape), None


class Objective(ABC):
    """A loss of one relaxed unit, of its pupil's ``correlation``; None for a loss that reads the unit alone."""

    correlation: Autocorrelation | None

    @abstractmethod
    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """The loss, a scalar, from the table that ``correlation`` makes of the unit (the unit itself without one)."""

    def __call__(self, unit: torch.Tensor) -> torch.Tensor:
        """The loss of a unit, float [dots, dots] in 0 to 1: a scalar, lower is better."""
        return self.of_table(unit if self.correlation is None else self.correlation(unit), unit)

    def at(self, iteration: int, iterations: int) -> Objective:
        """The objective of one step out of so many; iteration -1 stands for the judgement of a finished unit."""
        return self


@dataclass(frozen=True, eq=False)
class Weighted(Objective):
    r"""Σ α_k L_k: the target function of Yang & Sankaranarayanan 2021, section 4.2, with any losses in it.

    Attributes:
        terms: (weight α, objective) pairs. Those that share one ``correlation`` share its transform.
    """

    terms: tuple[tuple[float, Objective], ...]
    correlation: Autocorrelation | None = None

    def __post_init__(self) -> None:
        if not self.terms:
            what = "a sum of objectives has no terms"
            raise JobError("MF105", what, where="design.objectives", cure="Give at least one objective with its weight")

    def __call__(self, unit: torch.Tensor) -> torch.Tensor:
        """Σ α L; every table is made once."""
        tables: dict[int, torch.Tensor] = {}
        total = unit.new_zeros(())
        for weight, term in self.terms:
            if term.correlation is None:
                value = term(unit)
            else:
                key = id(term.correlation)
                if key not in tables:
                    tables[key] = term.correlation(unit)
                value = term.of_table(tables[key], unit)
            total = total + weight * value
        return total

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """The objective from a given table; its terms make their own tables."""
        return self(unit)

    def at(self, iteration: int, iterations: int) -> Weighted:
        """Every term as it is at that step."""
        return Weighted(tuple((weight, term.at(iteration, iterations)) for weight, term in self.terms))


@dataclass(frozen=True)
class AreaPenalty(Objective):
    r"""weight (mean transmission - c)², with c led from 1 down to the target: the αarea term of the target function.

    Good for keeping a relaxed unit on the way to a count; a binary unit has its count anyway.

    Attributes:
        settled: share of the run after which c is the target; on the way there it falls evenly.
        stair: height of the published stairs, 0 for an even slope. Steps are then even in time too.
        now: c of this step; None before ``at``, which means the target.
    """

    target: float
    weight: float
    settled: float = 0.4
    stair: float = 0.0
    now: float | None = None
    correlation = None

    def wanted(self, iteration: int, iterations: int) -> float:
        """c at a step."""
        done = iteration / max(iterations - 1, 1)
        if self.stair > 0:
            stairs = max(round((1 - self.target) / self.stair), 1)
            return max(self.target, 1 - self.stair * int(iteration / max(iterations, 1) / self.settled * stairs + 1e-9))
        return 1 + (self.target - 1) * min(done / self.settled, 1)

    def at(self, iteration: int, iterations: int) -> AreaPenalty:
        """The penalty with the c of that step."""
        now = self.target if iteration < 0 else self.wanted(iteration, iterations)
        return AreaPenalty(self.target, self.weight, self.settled, self.stair, now)

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """The penalty of a unit."""
        return self.weight * (unit.mean() - (self.target if self.now is None else self.now)) ** 2


@dataclass(frozen=True, eq=False)
class Invertibility(Objective):
    """Survival of the worst spatial frequencies under a Wiener filter, with photons counted.

    The OTF at the frequency nu is the pupil's autocorrelation AC at the lag lambda f nu (Goodman, Introduction to
    Fourier Optics, 6.4). With it

        O = AC / (clear area of the bare stop x target open ratio),  H = O^2 / (O^2 + epsilon),
        loss = -mean of the smallest ``worst_fraction`` of H,

    over all lags of at least one dot up to half a cycle per sensor pixel (Yang & Sankaranarayanan 2021, equation 9
    and L_inv; thirty percent is meant where the text once says ten).

    O is divided by the light that a pattern of the target's open ratio passes, not by the PSF's own sum. With the
    latter a grey filter is free of charge: its O is that of the bare stop however dark it is, holes of the open ratio
    r have r times that on average, and the optimum is uniform grey. With photons counted, grey of the share r has
    r times the bare stop's O as well; all it keeps is its evenness, which binarisation takes away.

    Good for worst cases whatever the picture. It knows neither the picture's spectrum nor the sensor's edge: for
    photographs use :class:`maskfab.designs.descent.losses.ExpectedError`.

    Attributes:
        lags: per wavelength, int64 flat indices into the autocorrelation table: integer lags of a half plane (the
            other half is its mirror image).
        light: clear area of the stop, in dots, x target open ratio: AC(0) of an opening that meets the target.
        epsilon: noise-to-signal ratio of the Wiener filter.
        worst_fraction: share of the lags that counts.
        own_sum: divide by the PSF's own sum, AC(0), as published, so that darkness is free; its optimum is grey.
    """

    correlation: Autocorrelation
    lags: tuple[torch.Tensor, ...]
    light: float
    epsilon: float = 0.015
    worst_fraction: float = 0.3
    own_sum: bool = False

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """The loss from the unit's autocorrelation table; a scalar between -1 and 0."""
        autocorrelation = table.flatten()
        light = autocorrelation[0] if self.own_sum else self.light
        worst = []
        for lags in self.lags:
            otf = autocorrelation.index_select(0, lags) / light
            survival = otf**2 / (otf**2 + self.epsilon)
            count = math.ceil(self.worst_fraction * lags.numel())
            worst.append(torch.topk(survival, count, largest=False, sorted=False).values.mean())
        return -torch.stack(worst).mean()


MAX_SIDE = 4096
"""Dots across the stop; one step of a descent then takes seconds and a gigabyte."""


def cells_across(stop: Stop, dots: int, dot_nm: int) -> int:
    """Cells along the side of the smallest square of cells that covers the stop."""
    return math.ceil(stop.diameter_um * NM_PER_UM / CellSize(dots, dot_nm).pitch_nm - 1e-9)


def lags_within(reach: float, table: int) -> Ints:
    """Flat table indices of the integer lags with 0 < |lag| <= reach in the half plane y > 0, or y = 0 and x > 0."""
    whole = math.floor(reach)
    y, x = np.mgrid[0 : whole + 1, -whole : whole + 1]
    wanted = (x**2 + y**2 <= reach**2) & ((y > 0) | (x > 0))
    return np.asarray(y[wanted] * table + x[wanted] % table, dtype=np.int64)


Transfer = Callable[[torch.Tensor], torch.Tensor]
"""Transfer at chosen frequencies as a function of the autocorrelation table."""

Precision = Literal["float32", "float64"]

FEWEST_DOTS = 2
"""Inside a stop: one dot has no lag but 0."""

DTYPES: dict[str, torch.dtype] = {"float32": torch.float32, "float64": torch.float64}


@dataclass(frozen=True, eq=False)
class TiledStop:
    """One layout of units behind one camera's stop; correlation to a dot past the lag of half a cycle per pixel."""

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

    def on_grid(self, shape: tuple[int, int]) -> Transfer:
        """The transfer at the frequencies of ``rfft2`` of pictures of that shape, for every wavelength."""
        reach = self.correlation.reach
        lags = np.arange(-reach, reach + 1)

        def matrix(frequency: NDArray[np.floating[Any]], wavelength_nm: float) -> torch.Tensor:
            hat = np.maximum(0, 1 - abs(frequency[:, None] * self.per_cycle(wavelength_nm) - lags))
            return self.here(hat * np.sinc(frequency)[:, None])

        y, x = np.fft.fftfreq(shape[0]), np.fft.rfftfreq(shape[1])
        pairs = [(matrix(y, nm), matrix(x, nm).T.contiguous()) for nm in self.camera.wavelengths_nm]

        def transfer(table: torch.Tensor) -> torch.Tensor:
            columns = torch.arange(-reach, reach + 1, device=table.device) % table.shape[1]
            upper = table.index_select(1, columns)
            # A real pupil's autocorrelation is the same at opposite lags.
            whole = torch.cat([upper[1:].flip(0, 1), upper]) / table[0, 0]
            return torch.stack([along_y @ whole @ along_x for along_y, along_x in pairs])

        return transfer


def tiled_stop(
    dots: int,
    dot_nm: int,
    orientations: Labels,
    camera: Camera,
    *,
    precision: Precision = "float32",
    device: str = "cpu",
) -> TiledStop:
    """Fill a stop with units of ``dots`` dots a side.

    Args:
        orientations: int8 [cells, cells], elements of D4; the square of cells is centred on the stop and covers it.

    Raises:
        JobError: MF104 if half a cycle per pixel is less than a lag of one dot, or the stop holds no two dots; MF115 if
            the cells are too many dots.
    """
    side = len(orientations) * dots
    if side > MAX_SIDE:
        what = (
            f"the stop of {camera.stop.diameter_um:g} um is {side} dots of {dot_nm / NM_PER_UM:g} um across; the limit "
            f"is {MAX_SIDE}"
        )
        cure = "Design with a smaller stop, or with fewer dots per pitch"
        raise JobError("MF115", what, where="camera.stop", cure=cure)
    inside = stop_dots(camera.stop, side, dot_nm / NM_PER_UM)
    if inside.sum() < FEWEST_DOTS:
        what = (
            f"the stop of {camera.stop.diameter_um:g} um holds the middles of {int(inside.sum())} dots of "
            f"{dot_nm / NM_PER_UM:g} um; a transfer needs at least {FEWEST_DOTS}"
        )
        raise JobError("MF104", what, where="camera.stop", cure="Use smaller dots, or a larger stop")
    nyquist = max(camera.wavelengths_nm) * camera.focal_um / (2 * camera.pixel_um) / dot_nm
    if nyquist < 1:
        what = f"half a cycle per pixel of {camera.pixel_um:g} um is a lag of {nyquist:.3g} dots; it must be at least 1"
        raise JobError("MF104", what, where="camera.pixel", cure="Use smaller dots, or a smaller sensor pixel")
    made = autocorrelation(dots, orientations, inside, min(math.floor(nyquist) + 1, min(inside.shape) - 1))
    moved = replace(made, index=made.index.to(device))
    return TiledStop(moved, camera, dot_nm, int(inside.sum()), DTYPES[precision])


def invertibility_of(stop: TiledStop, target: float = 0.2, *, own_sum: bool = False) -> Invertibility:
    """The invertibility loss that shares this stop's autocorrelation with other objectives.

    Args:
        target: open ratio at which O(0) = 1.
        own_sum: the published normalisation, whose optimum is grey.
    """
    size, reach = stop.correlation.size, stop.correlation.reach
    lags = tuple(stop.here(lags_within(min(stop.per_cycle(nm) / 2, reach), size)) for nm in stop.camera.wavelengths_nm)
    return Invertibility(stop.correlation, lags, stop.bare * target, own_sum=own_sum)
