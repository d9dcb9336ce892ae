r"""The paper's data-driven loss: the largest tenth of what a Wiener filter leaves wrong in real pictures.

Pictures x are blurred by the transfer H, recorded on the sensor, and restored by

    G = H / (H² + nsr),        loss = ½ mean of the largest 10 % of |x - restored|²    of every picture,

Yang & Sankaranarayanan 2021, L_data ("top-10 L2"; Shrivastava et al., CVPR 2016, for mining the hard samples). Flat
parts are easy, so that the mean over everything would be theirs.

Notes:
    Good for what is to be photographed; it costs twenty times as much as a loss of the OTF alone.
    As published, light from outside the sensor does not exist (``beyond="dark"``), no noise is added, and what is left
    is the error of the picture's edge, far above anything a design changes within. With ``beyond="scene"`` the crop's
    surroundings are blurred in, and the record is mirrored; with a ``level`` shot and read noise are added for the
    light that the unit lets through.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch

from maskfab.camera.exposure import ELECTRONS, F1_SENSOR, REFERENCE_TRANSMISSION
from maskfab.camera.photographs import Photograph
from maskfab.errors import JobError
from maskfab.optimiser.model.layout_error import wiener_tensor
from maskfab.optimiser.model.scene_statistics import LEAST_CONTRAST
from maskfab.optimiser.relax.autocorrelation import Autocorrelation
from maskfab.optimiser.relax.objective import Objective
from maskfab.optimiser.relax.tiled_stop import GridTransfer, TiledStop

COLOURS = 3


@dataclass(frozen=True, eq=False)
class TopResidual(Objective):
    """The loss of a batch of crops.

    Attributes:
        correlation: of the pupil.
        stop: the layout.
        transfer: H on the crops' frequencies, margins included.
        crops: [pictures, 3, rows, columns] with margins; 0 to 1.
        spectra: their ``rfft2``.
        noise: [2, pictures, 3, sensor rows, sensor columns], standard normal: of shots, of reading; None without noise.
        margin: samples round the sensor on every side.
        dark: nothing lies beyond the sensor.
        nsr: noise-to-signal ratio of the filter.
        level: dB, key of :data:`maskfab.camera.exposure.ELECTRONS`; None is noiseless.
        share: of the residuals that counts, the largest.
        batch: pictures of a step; a pass over all of them in a new order follows the last.
        seed: of the orders.
        chosen: numbers of the pictures of this step.
    """

    correlation: Autocorrelation
    stop: TiledStop
    transfer: GridTransfer
    crops: torch.Tensor
    spectra: torch.Tensor
    noise: torch.Tensor | None
    margin: int
    dark: bool
    nsr: float
    level: int | None
    share: float
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
        share = self.stop.share(table)
        losses = []
        for k in self.chosen:
            record = torch.fft.irfft2(self.spectra[k] * transfer, s=shape)[:, m:-m, m:-m]
            if self.noise is not None and self.level is not None:
                electrons = ELECTRONS[self.level] * share / REFERENCE_TRANSMISSION
                shots, reading = self.noise[:, k]
                deviation = torch.sqrt(record.detach().clamp_min(0) / electrons)
                record = record + deviation * shots + F1_SENSOR.read_noise / electrons * reading
            around = (m, m, m, m)
            wide = torch.nn.functional.pad(record, around, mode="constant" if self.dark else "reflect")
            restored = torch.fft.irfft2(torch.fft.rfft2(wide) * response, s=shape)[:, m:-m, m:-m]
            residual = (restored - self.crops[k, :, m:-m, m:-m]).flatten() ** 2
            count = math.ceil(self.share * residual.numel())
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
    level: int | None = None,
    share: float = 0.1,
    seed: int = 0,
) -> TopResidual:
    """The loss over crops of photographs, from :func:`maskfab.camera.photographs.folder` or bundled ones.

    Args:
        stop: the layout; its camera has three wavelengths, those of red, green and blue.
        scenes: each large enough for a crop.
        side: of the sensor, pixels.
        margin: round it, pixels; less than the side.
        crops: how many, at random places, taken from the scenes in turn.
        batch: crops of one step.
        beyond: what lies outside the sensor.
        nsr: noise-to-signal ratio of the filter, above 0: nothing restores a frequency that is nil.
        level: dB of noise; None is none.
        share: of the residuals that counts.
        seed: of the places, the noise and the order.

    Raises:
        JobError: MF105 without scenes or with other than three wavelengths; MF104 for numbers out of range, or
            scenes smaller than a crop; MF121 for crops that are all the same grey everywhere.
    """
    if not scenes or len(stop.camera.wavelengths_nm) != COLOURS:
        raise JobError(
            "MF105",
            f"{len(scenes)} scenes and {len(stop.camera.wavelengths_nm)} wavelengths; the loss needs scenes and three",
            where="design.scenes",
            cure="Give photographs, and the wavelengths of red, green and blue",
        )
    whole = side + 2 * margin
    smallest = min(min(scene.values.shape[1:]) for scene in scenes)
    fine = 0 < margin < side and whole <= smallest and 0 < nsr < math.inf and 0 < share <= 1 and crops >= batch >= 1
    if not (fine and (level is None or level in ELECTRONS)):
        raise JobError(
            "MF104",
            f"side {side}, margin {margin}, nsr {nsr:g}, share {share:g}, {batch} of {crops} crops, level {level}: a "
            f"crop with margins may have {smallest} pixels, margins are smaller than the side, nsr is above 0, shares "
            "within 0 to 1",
            where="design.top_residual",
            cure="Take the defaults: 256, 128, 0.0037, 0.1, 4 of 12, none",
        )
    draw = np.random.default_rng((seed, 1))
    cut = []
    for k in range(crops):
        values = scenes[k % len(scenes)].values
        top, left = (int(draw.integers(0, extent - whole + 1)) for extent in values.shape[1:])
        cut.append(values[:, top : top + whole, left : left + whole])
    pictures = np.stack(cut).astype(np.float64)
    if pictures.std(axis=(2, 3)).max() < LEAST_CONTRAST:
        raise JobError(
            "MF121",
            f"all {crops} crops are the same grey everywhere, within {LEAST_CONTRAST:g} of white; nothing in them can "
            "be restored better or worse",
            where="design.scenes",
            cure="Give photographs with contrast instead of uniform areas",
        )
    if beyond == "dark":
        inner = np.zeros((whole, whole), dtype=np.bool_)
        inner[margin:-margin, margin:-margin] = True
        pictures *= inner
    crops_here = stop.here(pictures)
    return TopResidual(
        stop.correlation,
        stop,
        stop.on_grid((whole, whole)),
        crops_here,
        torch.fft.rfft2(crops_here),
        None if level is None else stop.here(draw.standard_normal((2, crops, COLOURS, side, side))),
        margin,
        beyond == "dark",
        nsr,
        level,
        share,
        batch,
        seed,
        tuple(range(crops)),
    )
