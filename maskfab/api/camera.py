"""The camera behind the panel, and what it makes of one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from maskfab.api.curves import Mtf, Psf
from maskfab.api.lengths import Length, Wavelength, length_text, wavelength_text
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.model import Camera as Lens
from maskfab.base.model import Panel as Tiled
from maskfab.base.units import NM_PER_UM, parse_wavelength_nm
from maskfab.base.work import one_thread
from maskfab.camera.lens import camera_line
from maskfab.job.read import check_lens, check_pupil, check_window, parse_section
from maskfab.job.sections import CameraSection
from maskfab.mask.panels import check_cover
from maskfab.optics.lags import lag_table
from maskfab.optics.mtf import longest_lag_um, presampled_mtf
from maskfab.optics.psf import pixel_margin, pixel_psf, point_psf
from maskfab.optics.pupil import Pupil, cut, panel_aperture


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

    section: CameraSection

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
        object.__setattr__(self, "section", parse_section(CameraSection, stated, where="Camera"))
        check_lens(self.model, where="Camera: stop")

    @classmethod
    def of_section(cls, section: CameraSection) -> Camera:
        """The camera of a job file's section."""
        made = cls.__new__(cls)
        object.__setattr__(made, "section", section)
        return made

    @property
    def model(self) -> Lens:
        """The camera that the optics take, in micrometres and nanometres."""
        return self.section.camera()

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
        found = point_psf(pupil, camera, line, pixel_margin(camera) if pixels else 0)
        found = pixel_psf(found, camera) if pixels else found
        return Psf(found.values, found.step_um, found.wavelength_nm, found.kind)

    @checked_arguments
    @one_thread
    def mtf(self, panel: Tiled, wavelength: Wavelength | None = None) -> Mtf:
        """Presampled modulation transfer function of the panel as designed; arguments and errors as for :meth:`psf`,
        but for the window, which it does not use."""
        line, camera = self._line(wavelength), self.model
        table = lag_table(self._pupil(panel), longest_lag_um(camera))
        found = presampled_mtf(table, camera, line)
        return Mtf(**vars(found), camera=camera, table=table)

    def _pupil(self, panel: Tiled) -> Pupil:
        camera = self.model
        check_pupil(camera, panel.dot_nm / NM_PER_UM, where="Camera")
        check_cover(panel, camera.stop, "the panel", where="Camera: stop")
        return cut(panel_aperture(panel, camera.stop.diameter_um / 2), camera.stop)

    def _line(self, wavelength: Wavelength | None) -> float:
        """Nanometres of one of the camera's wavelengths."""
        lines = self.section.wavelengths
        if wavelength is None and len(lines) == 1:
            return lines[0]
        asked = None if wavelength is None else parse_wavelength_nm(wavelength_text(wavelength), where="wavelength")
        if asked not in lines:
            raise JobError(
                "MF105",
                "no wavelength is given" if asked is None else f"the camera has no wavelength {asked:g} nm",
                where="wavelength",
                cure=f"Use one of {', '.join(f'{line:g} nm' for line in lines)}",
            )
        return asked

    def __repr__(self) -> str:
        return f"<Camera: {camera_line(self.model)}>"


F1 = Camera("10 mm", stop="4 mm", pixel="2 um", wavelengths=["610 nm", "530 nm", "470 nm"])
"""The camera of protocol F1, for plates of which no camera is stated."""
