"""Point spread and modulation transfer functions with their axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maskfab.base import model
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.optics.lags import LagTable
from maskfab.optics.metrics import auc_radial_min, falls_to
from maskfab.optics.mtf import LEVELS, presampled_mtf

if TYPE_CHECKING:
    from maskfab.report.figures.sheet import Drawing


class Psf(model.Psf):
    """A point spread function: intensity per square micrometre of sensor; the whole plane holds 1.

    ``samples[i, j]`` lies at ``y_um[i]``, ``x_um[j]``; the optical axis is in the middle.
    """

    @property
    def samples(self) -> NDArray[np.float64]:
        """float64 [n, n], per square micrometre."""
        return self.values

    @property
    def x_um(self) -> NDArray[np.float64]:
        """float64 [n], places of the columns on the sensor."""
        count = self.values.shape[1]
        axis: NDArray[np.float64] = self.step_um * (np.arange(count, dtype=np.float64) - count // 2)
        return axis

    @property
    def y_um(self) -> NDArray[np.float64]:
        """float64 [n], places of the rows, upwards."""
        return self.x_um

    def plot(self) -> Drawing:
        """log10 over six decades below the peak."""
        from maskfab.report.figures import die as die_figures

        return die_figures.psf((self,))

    def _repr_svg_(self) -> str:
        return self.plot().svg()

    def __repr__(self) -> str:
        count = len(self.values)
        return f"<Psf at {self.wavelength_nm:g} nm: {count} x {count} {self.kind}s {self.step_um:.4g} um apart>"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Mtf(model.Mtf):
    """A presampled modulation transfer function, optics and sensor pixel, up to half a cycle per pixel.

    ``cuts["radial_mean"]`` and the others stand at ``frequency_cy_per_mm``.

    Attributes:
        camera: whose it is.
        table: autocorrelation of the pupil, from which it is taken.
    """

    camera: model.Camera
    table: LagTable

    @property
    def auc(self) -> model.Quantity:
        """Mean of the radial minimum over its frequencies, with its error."""
        return auc_radial_min(self, None)

    @checked_arguments
    def frequency_at(self, level: float) -> model.Quantity:
        """First frequency, in cy/mm, at which the radial mean falls to a level, with its error; no value if it never
        does.

        Raises:
            JobError: MF104 for a level that is not between 0 and 1, MF105 for one that is no number.
        """
        if isinstance(level, bool) or not isinstance(level, int | float):
            raise JobError("MF105", f"level = {level!r} is not a number", where="level", cure="Write 0.5")
        if not 0 < level < 1:
            raise JobError("MF104", f"level = {level} must lie between 0 and 1", where="level", cure="Write 0.5")
        percent = 100 * float(level)
        if percent in LEVELS:
            return falls_to(self, percent, None)
        return falls_to(presampled_mtf(self.table, self.camera, self.wavelength_nm, (percent,)), percent, None)

    def plot(self) -> Drawing:
        """The band from radial minimum to maximum, the radial mean, and straight cuts."""
        from maskfab.report.figures import die as die_figures

        return die_figures.mtf((self,))

    def _repr_svg_(self) -> str:
        return self.plot().svg()

    def __repr__(self) -> str:
        return f"<Mtf at {self.wavelength_nm:g} nm: 0 to {self.frequency_cy_per_mm[-1]:g} cy/mm, AUC {self.auc}>"
