"""The camera behind the panel, and what it makes of one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maskfab.api.lengths import Length, Wavelength, length_text, wavelength_text
from maskfab.base import model
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.model import Panel as Tiled
from maskfab.base.units import NM_PER_UM, parse_wavelength_nm
from maskfab.base.work import one_thread
from maskfab.camera.lens import camera_line
from maskfab.job.camera import Camera as Lens
from maskfab.job.read import check_lens, check_pupil, check_window, parse_section
from maskfab.mask.panels import check_cover
from maskfab.optics.lags import LagTable, lag_table
from maskfab.optics.metrics import auc_radial_min, falls_to
from maskfab.optics.mtf import LEVELS, longest_lag_um, presampled_mtf
from maskfab.optics.psf import pixel_margin, pixel_psf, point_psf
from maskfab.optics.pupil import Pupil, cut, panel_aperture

if TYPE_CHECKING:
    from maskfab.report.figures.sheet import Drawing


@dataclass(frozen=True, init=False, repr=False)
class Camera:
    """A lens and a sensor.

    Examples:
        >>> import maskfab as mf
        >>> camera = mf.Camera("10 mm", stop="4 mm", pixel="2 um", wavelengths=["610 nm", "530 nm", "470 nm"])
        >>> camera.model.focal_um, camera.model.wavelengths_nm
        (10000.0, (610.0, 530.0, 470.0))

    Attributes:
        section: the camera as [camera] of a job file states it.
    """

    section: Lens

    @checked_arguments
    def __init__(
        self,
        focal: Length,
        *,
        stop: Length | Mapping[str, object],
        pixel: Length,
        wavelengths: Wavelength | Sequence[Wavelength],
        window: Length = "256 um",
    ) -> None:
        """A camera.

        Args:
            focal: focal length.
            stop: diameter of a round stop, or any stop as a job file writes it, such as
                ``{"shape": "annulus", "diameter": "4 mm", "inner": "1 mm"}``.
            pixel: side of a sensor pixel.
            wavelengths: one or several; three are red, green and blue.
            window: side of the PSF's window on the sensor.

        Raises:
            JobError: MF103, MF104, MF105 or MF112 for a value, MF131 or MF132 for the stop.
        """
        lines = [wavelengths] if isinstance(wavelengths, str | float | int) else list(wavelengths)
        shape = {key: length_text(value) for key, value in stop.items()} if isinstance(stop, Mapping) else {}
        stated = {
            "focal": length_text(focal),
            "stop": shape or {"diameter": length_text(stop)},
            "pixel": length_text(pixel),
            "wavelengths": [wavelength_text(line) for line in lines],
            "window": length_text(window),
        }
        object.__setattr__(self, "section", parse_section(Lens, stated, where="Camera"))
        check_lens(self.model, where="Camera: stop")

    @classmethod
    def of_section(cls, section: Lens) -> Camera:
        """The camera of a job file's section."""
        made = cls.__new__(cls)
        object.__setattr__(made, "section", section)
        return made

    @property
    def model(self) -> Lens:
        """The camera that the optics take, in micrometres and nanometres."""
        return self.section

    @checked_arguments
    @one_thread
    def psf(self, panel: Tiled, wavelength: Wavelength | None = None, *, pixels: bool = False) -> Psf:
        """Point spread function of the panel as designed.

        Args:
            panel: what the camera looks through; its middle is on the axis.
            wavelength: one of the camera's; may be left out if it has only one.
            pixels: means over sensor pixels instead of intensity at points.

        Raises:
            JobError: MF105 for a wavelength that the camera does not have, MF113 for a window that is too wide, MF114
                for a panel smaller than the stop.
            SourceError: MF309 if nothing is clear in front of the stop.
        """
        line, camera = self._line(wavelength), self.model
        check_window(camera, panel.dot_nm / NM_PER_UM, where="Camera")
        pupil = self._pupil(panel)
        psf = point_psf(pupil, camera, line, pixel_margin(camera) if pixels else 0)
        psf = pixel_psf(psf, camera) if pixels else psf
        return Psf(psf.values, psf.step_um, psf.wavelength_nm, psf.kind)

    @checked_arguments
    @one_thread
    def mtf(self, panel: Tiled, wavelength: Wavelength | None = None) -> Mtf:
        """Presampled modulation transfer function of the panel as designed; arguments and errors as for :meth:`psf`,
        but for the window, which it does not use."""
        line, camera = self._line(wavelength), self.model
        table = lag_table(self._pupil(panel), longest_lag_um(camera))
        mtf = presampled_mtf(table, camera, line)
        return Mtf(**vars(mtf), camera=camera, table=table)

    def _pupil(self, panel: Tiled) -> Pupil:
        camera = self.model
        check_pupil(camera, panel.dot_nm / NM_PER_UM, where="Camera")
        check_cover(panel, camera.stop, "the panel", where="Camera: stop")
        return cut(panel_aperture(panel, camera.stop.diameter_um / 2), camera.stop)

    def _line(self, wavelength: Wavelength | None) -> float:
        """Nanometres of one of the camera's wavelengths."""
        lines = self.section.wavelengths_nm
        if wavelength is None and len(lines) == 1:
            return lines[0]
        asked = None if wavelength is None else parse_wavelength_nm(wavelength_text(wavelength), where="wavelength")
        if asked not in lines:
            what = "no wavelength is given" if asked is None else f"the camera has no wavelength {asked:g} nm"
            cure = f"Use one of {', '.join(f'{line:g} nm' for line in lines)}"
            raise JobError("MF105", what, where="wavelength", cure=cure)
        return asked

    def __repr__(self) -> str:
        return f"<Camera: {camera_line(self.model)}>"


F1 = Camera("10 mm", stop="4 mm", pixel="2 um", wavelengths=["610 nm", "530 nm", "470 nm"])
"""The camera of protocol F1, for plates of which no camera is stated."""


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

    camera: Lens
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
