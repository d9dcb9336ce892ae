"""Losses of a descent that look at more than the autocorrelation's weakest lags: expected error, real pictures.

**The error that protocol F1 is expected to leave in a photograph**, of this very layout. At a level, with H the
transfer, G = H / (H² + ε (f / 0.1)²) and P the scenes' mean spectrum,

    E_interior(ε) = σ² mean G² + mean P (1 - GH)²,        σ² = light / g + (read noise / g)²,

g the electrons of white that the design's own light leaves; and E_leak(ε) is the squared error of low-passed scenes
that are blurred with what lies round the sensor, mirrored at its edge and restored. The loss is

    mean over the levels of 10 log10 min_ε ( E_interior + E_leak ),

minus the expected PSNR in dB. It predicts measured PSNR with a rank correlation of .95 and more; without the leak .3
to .4. The spectrum, the sampled frequencies and the low-passed scenes are those of
:mod:`maskfab.designs.model.expected_psnr`, which judges the mean of all layouts; this judges one. Good for photographs,
and aware of photons: a darker unit is noisier, and gets no bonus. min over ε has the slope of the chosen ε (envelope
theorem), so ε costs no gradient. One wavelength, the camera's middle one: colours matter by a few hundredths of a
decibel.

**The paper's data-driven loss**, the largest tenth of what a Wiener filter leaves wrong in real pictures. Pictures x
are blurred by the transfer H, recorded on the sensor, and restored by

    G = H / (H² + nsr),        loss = ½ mean of the largest 10 % of |x - restored|²    of every picture,

Yang & Sankaranarayanan 2021, L_data ("top-10 L2"; Shrivastava et al., CVPR 2016, for mining the hard samples). Flat
parts are easy, so that the mean over everything would be theirs. Good for what is to be photographed; it costs twenty
times as much as a loss of the OTF alone. As published, light from outside the sensor does not exist
(``beyond="dark"``), no noise is added, and what is left is the error of the picture's edge, far above anything a design
changes within. With ``beyond="scene"`` the crop's surroundings are blurred in, and the record is mirrored.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch

from maskfab.base.arrays import Labels
from maskfab.base.errors import JobError
from maskfab.base.units import NM_PER_UM
from maskfab.camera.protocol import EPSILONS
from maskfab.camera.scenes import Photograph
from maskfab.camera.sensor import ELECTRONS, F1_SENSOR, LEVELS
from maskfab.designs.descent.objective import Autocorrelation, Objective, Precision, TiledStop, Transfer, tiled_stop
from maskfab.designs.model.expected_psnr import Surrogate
from maskfab.designs.model.panel_error import wiener_tensor
from maskfab.designs.model.statistics import LEAST_CONTRAST
from maskfab.job.camera import REFERENCE_TRANSMISSION, Camera

FEW_EPSILONS = EPSILONS[::2]


@dataclass(frozen=True, eq=False)
class BoundaryLeak:
    """Squared error of low-passed scenes, halo across the sensor's edge included, up to 1/16 cycle per pixel.

    Attributes:
        along: matrices from the lags -k to k to the low frequencies of y and x, the pixel's sinc in them.
        lags: flat table indices of these lags' upper half, [k + 1, 2 k + 1].
        spectra: complex [scenes, rows, columns / 2 + 1], the low-passed scenes.
        truth: their part on the sensor; ``width`` samples are round it on every side.
        prior: (f / 0.1)² at the frequencies.
        epsilons: [k].
        width: samples between the scene's edge and the sensor's.
    """

    along: tuple[torch.Tensor, torch.Tensor]
    lags: torch.Tensor
    spectra: torch.Tensor
    truth: torch.Tensor
    prior: torch.Tensor
    epsilons: torch.Tensor
    width: int

    def errors(self, table: torch.Tensor) -> torch.Tensor:
        """The mean squared error at every ε, [k]."""
        upper = table.flatten().index_select(0, self.lags.flatten()).view(self.lags.shape) / table[0, 0]
        near = torch.cat([upper[1:].flip(0, 1), upper])
        transfer = self.along[0] @ near @ self.along[1]
        w = self.width
        shape = (self.spectra.shape[1], 2 * (self.spectra.shape[2] - 1))
        record = torch.fft.irfft2(self.spectra * transfer, s=shape)[:, w:-w, w:-w]
        # The surrogate doubles the edge's samples; torch can only leave them single, so the order is written out.
        rows, columns = (
            torch.from_numpy(np.pad(np.arange(record.shape[k]), w, mode="symmetric")).to(record.device) for k in (1, 2)
        )
        seen = torch.fft.rfft2(record.index_select(1, rows).index_select(2, columns))
        errors = []
        for epsilon in self.epsilons:
            restored = torch.fft.irfft2(seen * wiener_tensor(transfer, epsilon * self.prior), s=shape)
            errors.append(((restored[:, w:-w, w:-w] - self.truth) ** 2).mean())
        return torch.stack(errors)


@dataclass(frozen=True, eq=False)
class ExpectedError(Objective):
    """Minus the expected restored PSNR in dB, mean over the levels.

    Attributes:
        lags: int64 [m], flat table indices of the sampled frequencies.
        pixel: [m], the pixel's sinc there.
        folded: [m], what sampling folds back from a grey panel of share 1.
        weight, signal, prior: [m], share of the frequency square, that share times P, (f / 0.1)².
        epsilons: [k].
        levels: dB, keys of :data:`maskfab.camera.sensor.ELECTRONS`.
        light: mean of the scenes, white is 1.
        leak: the boundary's part.
    """

    correlation: Autocorrelation
    stop: TiledStop
    lags: torch.Tensor
    pixel: torch.Tensor
    folded: torch.Tensor
    weight: torch.Tensor
    signal: torch.Tensor
    prior: torch.Tensor
    epsilons: torch.Tensor
    levels: tuple[int, ...]
    light: float
    leak: BoundaryLeak

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """Minus the expected PSNR in dB."""
        return 10 * torch.log10(self.errors(table)).mean()

    def errors(self, table: torch.Tensor) -> torch.Tensor:
        """The expected squared error at every level with its best ε, [levels]; white is 1."""
        share = self.stop.share(table)
        transfer = table.flatten().index_select(0, self.lags) / table[0, 0] * self.pixel + share * self.folded
        squared = 1 / (transfer**2 + self.epsilons[:, None] * self.prior) ** 2
        noise = squared @ (self.weight * transfer**2)
        held_back = self.epsilons**2 * (squared @ (self.signal * self.prior**2))
        held_back = held_back + self.leak.errors(table)
        errors = []
        for level in self.levels:
            white = ELECTRONS[level] * share / REFERENCE_TRANSMISSION
            errors.append(((self.light / white + (F1_SENSOR.read_noise / white) ** 2) * noise + held_back).min())
        return torch.stack(errors)


def expected_error(
    estimate: Surrogate,
    orientations: Labels,
    *,
    levels: tuple[int, ...] = LEVELS,
    precision: Precision = "float32",
    device: str = "cpu",
) -> ExpectedError:
    """The expected error of one layout, int8 [cells, cells] of the surrogate's lattice, elements of D4."""
    seen = estimate.lattice.camera
    # A window is no part of the transfer.
    camera = Camera(seen.focal_um, seen.stop, (seen.middle_nm,), seen.pixel_um, 256.0)
    dot_nm = round(estimate.lattice.dot_um * NM_PER_UM)
    stop = tiled_stop(estimate.dots, dot_nm, orientations, camera, precision=precision, device=device)
    size, reach = stop.correlation.size, stop.correlation.reach
    y, x = estimate.lags
    seen_lags = np.maximum(abs(y), abs(x)) <= reach
    nu = estimate.lags / stop.per_cycle(seen.middle_nm)
    constants = stop.here(np.asarray(FEW_EPSILONS, dtype=np.float64))
    return ExpectedError(
        stop.correlation,
        stop,
        stop.here(np.where(seen_lags, y * size + x % size, 0)),
        # Beyond the table the stop passes nothing.
        stop.here(np.sinc(nu[0]) * np.sinc(nu[1]) * seen_lags),
        stop.here(estimate.folded),
        stop.here(estimate.weight),
        stop.here(estimate.signal),
        stop.here(estimate.inverse_prior),
        constants,
        levels,
        estimate.noise.shot,
        _leak(estimate, stop, constants),
    )


def _leak(estimate: Surrogate, stop: TiledStop, epsilons: torch.Tensor) -> BoundaryLeak:
    reach, size = len(estimate.near) // 2, stop.correlation.size
    n = min(reach, stop.correlation.reach)
    lags = slice(reach - n, reach + n + 1)
    y, x = np.mgrid[0 : n + 1, -n : n + 1]
    complex_type = torch.complex64 if stop.dtype == torch.float32 else torch.complex128
    return BoundaryLeak(
        (stop.here(estimate.along[0][:, lags]), stop.here(estimate.along[1][:, lags].T)),
        stop.here(y * size + x % size),
        torch.from_numpy(estimate.low).to(stop.device, complex_type),
        stop.here(estimate.low_truth),
        stop.here(estimate.low_prior),
        epsilons,
        (estimate.low.shape[1] - estimate.low_truth.shape[1]) // 2,
    )


COLOURS = 3
LARGEST = 0.1  # share of the residuals that counts


@dataclass(frozen=True, eq=False)
class TopResidual(Objective):
    """The loss of a batch of crops.

    Attributes:
        transfer: H on the crops' frequencies, margins included.
        crops: [pictures, 3, rows, columns] with margins; 0 to 1.
        spectra: their ``rfft2``.
        margin: samples round the sensor on every side.
        dark: nothing lies beyond the sensor.
        nsr: noise-to-signal ratio of the filter.
        batch: pictures of a step; a pass over all of them in a new order follows the last.
    """

    correlation: Autocorrelation
    transfer: Transfer
    crops: torch.Tensor
    spectra: torch.Tensor
    margin: int
    dark: bool
    nsr: float
    batch: int
    seed: int
    chosen: tuple[int, ...]

    @property
    def batches(self) -> int:
        """Steps of one pass over all pictures."""
        return math.ceil(len(self.crops) / self.batch)

    def at(self, iteration: int, iterations: int) -> TopResidual:
        """The loss of that step's batch; of all pictures for the judgement."""
        if iteration < 0:
            return replace(self, chosen=tuple(range(len(self.crops))))
        epoch, place = divmod(iteration, self.batches)
        order = np.random.default_rng((self.seed, epoch)).permutation(len(self.crops))
        return replace(self, chosen=tuple(int(k) for k in order[place * self.batch : (place + 1) * self.batch]))

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        """The loss of the chosen pictures, white is 1."""
        m, shape = self.margin, (self.crops.shape[2], self.crops.shape[3])
        transfer = self.transfer(table)
        response = wiener_tensor(transfer, self.nsr)
        losses = []
        for k in self.chosen:
            record = torch.fft.irfft2(self.spectra[k] * transfer, s=shape)[:, m:-m, m:-m]
            around = (m, m, m, m)
            wide = torch.nn.functional.pad(record, around, mode="constant" if self.dark else "reflect")
            restored = torch.fft.irfft2(torch.fft.rfft2(wide) * response, s=shape)[:, m:-m, m:-m]
            residual = (restored - self.crops[k, :, m:-m, m:-m]).flatten() ** 2
            count = math.ceil(LARGEST * residual.numel())
            losses.append(torch.topk(residual, count, sorted=False).values.mean())
        return torch.stack(losses).mean() / 2


def top_residual(
    stop: TiledStop,
    scenes: Sequence[Photograph],
    *,
    side: int = 256,
    margin: int = 128,
    crops: int = 12,
    batch: int = 4,
    beyond: Literal["scene", "dark"] = "scene",
    nsr: float = 0.0037,
    seed: int = 0,
) -> TopResidual:
    """The loss over crops of photographs, from :func:`maskfab.camera.scenes.folder` or bundled ones.

    Args:
        stop: the layout; its camera has three wavelengths, those of red, green and blue.
        scenes: each large enough for a crop.
        margin: round it, pixels; less than the side.
        crops: how many, at random places, taken from the scenes in turn.
        nsr: noise-to-signal ratio of the filter, above 0: nothing restores a frequency that is nil.

    Raises:
        JobError: MF105 without scenes or with other than three wavelengths; MF104 for scenes smaller than a crop with
            its margins; MF121 for crops that are all the same grey everywhere.
    """
    if not scenes or len(stop.camera.wavelengths_nm) != COLOURS:
        what = (
            f"{len(scenes)} scenes and {len(stop.camera.wavelengths_nm)} wavelengths; the loss needs scenes and three"
        )
        cure = "Give photographs, and the wavelengths of red, green and blue"
        raise JobError("MF105", what, where="design.scenes", cure=cure)
    whole = side + 2 * margin
    smallest = min(min(scene.values.shape[1:]) for scene in scenes)
    if whole > smallest:
        what = f"crops with their margins have {whole} x {whole} pixels, and a scene only {smallest} along a side"
        cure = f"Give photographs of at least {whole} x {whole} pixels"
        raise JobError("MF104", what, where="design.scenes", cure=cure)
    draw = np.random.default_rng((seed, 1))
    cut = []
    for k in range(crops):
        values = scenes[k % len(scenes)].values
        top, left = (int(draw.integers(0, extent - whole + 1)) for extent in values.shape[1:])
        cut.append(values[:, top : top + whole, left : left + whole])
    pictures = np.stack(cut).astype(np.float64)
    if pictures.std(axis=(2, 3)).max() < LEAST_CONTRAST:
        what = (
            f"all {crops} crops are the same grey everywhere, within {LEAST_CONTRAST:g} of white; nothing in them can "
            "be restored better or worse"
        )
        cure = "Give photographs with contrast instead of uniform areas"
        raise JobError("MF121", what, where="design.scenes", cure=cure)
    if beyond == "dark":
        inner = np.zeros((whole, whole), dtype=np.bool_)
        inner[margin:-margin, margin:-margin] = True
        pictures *= inner
    crops_here = stop.here(pictures)
    return TopResidual(
        stop.correlation,
        stop.on_grid((whole, whole)),
        crops_here,
        torch.fft.rfft2(crops_here),
        margin,
        beyond == "dark",
        nsr,
        batch,
        seed,
        tuple(range(crops)),
    )
