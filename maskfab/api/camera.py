"""The camera behind the panel, and what it makes of one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from maskfab.api.lengths import Length, Wavelength, is_one, length_text, wavelength_text, wavelengths_nm
from maskfab.base import model
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.model import Panel as Tiled
from maskfab.base.units import NM_PER_UM
from maskfab.base.work import one_thread
from maskfab.job.camera import Camera as Lens
from maskfab.job.die import check_lens, check_pupil, check_window
from maskfab.job.faults import parse_section

if TYPE_CHECKING:
    from pandas import DataFrame

    from maskfab.api.lengths import Wavelengths  # at run time refused here, line by line
    from maskfab.optics.lags import LagTable
    from maskfab.optics.psf import ReadyPupil
    from maskfab.optics.pupil import Pupil
    from maskfab.report.figures.sheet import Drawing

    class HasPanel(Protocol):
        """A result that lays out an opening, such as a design with its map."""

        @property
        def panel(self) -> Tiled: ...

    # At run time refused here, with all that may be given.
    LaidOut: TypeAlias = Tiled | model.Opening | HasPanel


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
        wavelengths: Wavelength | Wavelengths = ("610 nm", "530 nm", "470 nm"),
        window: Length = "256 um",
    ) -> None:
        """A camera.

        Args:
            focal: focal length.
            stop: diameter of a round stop, or its f-number as ``"f/1.8"``, or any stop as a job file writes it, such as
                ``{"shape": "annulus", "diameter": "4 mm", "inner": "1 mm"}``.
            pixel: side of a sensor pixel.
            wavelengths: one or several, that verbs take the camera for; three are red, green and blue. PSF and MTF are
                had at any other, too.
            window: side of the PSF's window on the sensor.
        """
        lines = [wavelengths] if is_one(wavelengths) else wavelengths
        if not isinstance(lines, list):
            lines = [*wavelengths_nm(lines, "Camera: wavelengths")]
        stated = {
            "focal": length_text(focal, "focal", "Camera: focal"),
            "stop": _stop(stop),
            "pixel": length_text(pixel, "pixel", "Camera: pixel"),
            "wavelengths": [wavelength_text(line, "Camera: wavelengths") for line in lines],
            "window": length_text(window, "window", "Camera: window"),
        }
        object.__setattr__(self, "section", parse_section(Lens, stated, where="Camera"))
        check_lens(self.model, where="Camera: stop")
        _require_directions(self.model)

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

    @property
    def wavelengths(self) -> tuple[float, ...]:
        """Those that it was made with, in nanometres."""
        return self.section.wavelengths_nm

    @overload
    def psf(  # type: ignore[overload-overlap]  # text is a sequence, too
        self, panel: LaidOut, wavelength: Wavelength | None = ..., *, pixels: bool = ...
    ) -> Psf: ...
    @overload
    def psf(self, panel: LaidOut, wavelength: Wavelengths, *, pixels: bool = ...) -> tuple[Psf, ...]: ...
    @checked_arguments
    @one_thread
    def psf(
        self, panel: LaidOut, wavelength: Wavelength | Wavelengths | None = None, *, pixels: bool = False
    ) -> Psf | tuple[Psf, ...]:
        """Point spread function of the panel as designed, at one wavelength or several.

        Samples lie as close as the shortest wavelength of the camera needs, or of the call if that is shorter. Several
        wavelengths share their samples and the pupil, which is made ready once.

        Examples:
            >>> import maskfab as mf
            >>> panel = mf.Panel.tile(mf.Opening.bar(dots=7, size=(5, 3), pitch="56 um"), size="560 um")
            >>> camera = mf.Camera("5 mm", stop="400 um", pixel="2 um", window="64 um")
            >>> [round(psf.energy_in_window, 2) for psf in camera.psf(panel, ["555 nm", 850])]
            [0.29, 0.28]

        Args:
            panel: what the camera looks through; its middle is on the axis. An opening alone is laid out periodically
                over the stop.
            wavelength: any, such as ``"555 nm"`` or 555; of a list or an array of them a tuple is returned. May be left
                out if the camera has only one.
            pixels: means over sensor pixels instead of intensity at points.

        Raises:
            JobError: MF103, MF104, MF105, MF112 or MF156 for what is no wavelength, MF105 for none of several, and for
                what is no panel, MF113 for a window that is too wide, MF114 for a panel smaller than the stop.
            SourceError: MF309 if nothing is clear in front of the stop.
        """
        from maskfab.optics.psf import pixel_margin, pixel_psf

        lines = self.asked_nm(wavelength)
        laid, note = self._laid_out(panel, "Camera.psf: panel")
        # Samples as close as those of the camera's own wavelengths, so that all can be laid on each other.
        camera = self._of({*lines, *self.wavelengths})
        check_window(self._of(lines), laid.dot_nm / NM_PER_UM, where="Camera")
        margin = pixel_margin(camera) if pixels else 0
        found = {}
        # Kept made ready for the next call unless it is large.
        ready = _kept if _is_kept(laid, camera) else _kept.__wrapped__
        for psf in ready(laid, camera, margin, tuple(dict.fromkeys(lines))).psfs():
            seen = pixel_psf(psf, camera) if pixels else psf
            found[seen.wavelength_nm] = Psf(seen.values, seen.step_um, seen.wavelength_nm, seen.kind, note=note)
        return found[lines[0]] if wavelength is None or is_one(wavelength) else tuple(found[line] for line in lines)

    @overload
    def mtf(  # type: ignore[overload-overlap]
        self, panel: LaidOut, wavelength: Wavelength | None = ...
    ) -> Mtf: ...
    @overload
    def mtf(self, panel: LaidOut, wavelength: Wavelengths) -> tuple[Mtf, ...]: ...
    @checked_arguments
    @one_thread
    def mtf(self, panel: LaidOut, wavelength: Wavelength | Wavelengths | None = None) -> Mtf | tuple[Mtf, ...]:
        """Presampled modulation transfer function of the panel as designed; arguments and errors as for :meth:`psf`,
        but for the window, which it does not use."""
        from maskfab.optics.mtf import presampled_mtf

        lines = self.asked_nm(wavelength)
        camera = self._of(lines)
        laid, note = self._laid_out(panel, "Camera.mtf: panel")
        table = (_kept_lags if _is_kept(laid, camera) else _kept_lags.__wrapped__)(laid, camera)
        found = {
            line: Mtf(**vars(presampled_mtf(table, camera, line)), camera=camera, table=table, note=note)
            for line in dict.fromkeys(lines)
        }
        return found[lines[0]] if wavelength is None or is_one(wavelength) else tuple(found[line] for line in lines)

    def _laid_out(self, stated: object, where: str) -> tuple[Tiled, str]:
        """The panel that is meant, and a note on what was assumed of it."""
        from maskfab.mask.panels import lacks_pitch, laid_over, periodic_note

        if isinstance(stated, model.Opening):
            laid = laid_over(stated, self.model.stop)
            return laid, periodic_note(stated.name, min(laid.size_nm) / NM_PER_UM)
        if isinstance(stated, np.ndarray):
            raise lacks_pitch(stated, where)
        panel = stated if isinstance(stated, Tiled) else getattr(stated, "panel", None)
        if not isinstance(panel, Tiled):
            cure = 'Give a Panel, such as Panel.tile(opening, size="4.4 mm"), an Opening, or a design with its map'
            raise JobError("MF105", f"{stated!r:.60} is not a Panel", where=where, cure=cure)
        return panel, ""

    def _of(self, lines: Iterable[float]) -> Lens:
        return replace(self.model, wavelengths_nm=tuple(dict.fromkeys(lines)))

    def asked_nm(self, wavelength: object) -> tuple[float, ...]:
        """Nanometres of the wavelengths that are asked for."""
        if wavelength is not None:
            return wavelengths_nm(wavelength, "wavelength")
        if len(self.wavelengths) > 1:
            listed = ", ".join(f"{line:g}" for line in self.wavelengths)
            what = f"no wavelength is given, and the camera has {listed} nm"
            cure = f'Give one, such as "{self.wavelengths[0]:g} nm", or all: camera.wavelengths'
            raise JobError("MF105", what, where="wavelength", cure=cure)
        return self.wavelengths

    def __repr__(self) -> str:
        from maskfab.camera.stop_cells import camera_line

        return f"<Camera: {camera_line(self.model)}>"


_KEPT, _MOST_KEPT = 4, 1_000_000
"""Pupils that are kept made ready, and intervals of the largest of them, which takes 30 MB."""


@lru_cache(maxsize=_KEPT)
def _kept(panel: Tiled, camera: Lens, margin: int, lines: tuple[float, ...]) -> ReadyPupil:
    from maskfab.optics.psf import ReadyPupil

    return ReadyPupil.of(_pupil(panel, camera), camera, margin, lines)


@lru_cache(maxsize=_KEPT)
def _kept_lags(panel: Tiled, camera: Lens) -> LagTable:
    """The lags of a panel behind the stop that an MTF at any line of the camera asks for."""
    from maskfab.optics.lags import lag_table
    from maskfab.optics.mtf import longest_lag_um

    return lag_table(_pupil(panel, camera), longest_lag_um(camera))


def _is_kept(panel: Tiled, camera: Lens) -> bool:
    intervals = min(camera.stop.diameter_um / (panel.dot_nm / NM_PER_UM), max(panel.size_nm) / panel.dot_nm) ** 2
    return intervals <= _MOST_KEPT


def _pupil(panel: Tiled, camera: Lens) -> Pupil:
    from maskfab.mask.panels import check_cover
    from maskfab.optics.pupil import cut, panel_aperture

    check_lens(camera, where="Camera: stop")
    check_pupil(camera, panel.dot_nm / NM_PER_UM, where="Camera")
    check_cover(panel, camera.stop, "the panel", where="Camera: stop")
    return cut(panel_aperture(panel, camera.stop.diameter_um / 2, as_bytes=True), camera.stop)


def _stop(stated: Length | Mapping[str, object]) -> object:
    if isinstance(stated, str) and stated.strip().lower().startswith("f/"):
        return stated
    if not isinstance(stated, Mapping):
        return {"diameter": length_text(stated, "stop", "Camera: stop")}
    sizes = ("diameter", "inner", "width", "height")
    return {
        key: length_text(value, "stop", f"Camera: stop.{key}") if key in sizes else length_text(value)
        for key, value in stated.items()
    }


def _require_directions(camera: Lens) -> None:
    """Refuse a lens with no light at its window's rim: angle a lands at f sin a (Goodman, Fourier Optics, 5.2)."""
    if camera.window_um / 2 <= camera.focal_um:
        return
    what = f"behind a focal length of {camera.focal_um:g} um no light reaches the rim of a window of "
    what += f"{camera.window_um:g} um; did you mean '{camera.focal_um:g} mm'?"
    cure = f'Give the focal length of the lens, such as "5.6 mm", or a window of at most {2 * camera.focal_um:g} um'
    raise JobError("MF156", what, where="Camera: focal", cure=cure)


@cache
def protocol_f1() -> Camera:
    """The camera of protocol F1, for plates of which no camera is stated."""
    return Camera("10 mm", stop="4 mm", pixel="2 um", wavelengths=["610 nm", "530 nm", "470 nm"])


@dataclass(frozen=True, eq=False, repr=False)
class Psf(model.Psf):
    """A point spread function: intensity per square micrometre of sensor; the whole plane holds 1.

    ``samples[i, j]`` lies at ``y_um[i]``, ``x_um[j]``; the optical axis is in the middle.

    Attributes:
        note: what was assumed of the panel; empty for nothing.
    """

    note: str = ""

    @property
    def samples(self) -> NDArray[np.float64]:
        """float64 [n, n], per square micrometre."""
        return self.values

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.values, dtype=dtype, copy=copy)

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

    def to_dataframe(self) -> DataFrame:
        """The samples as a table: a row for each ``y_um``, a column for each ``x_um``, per square micrometre."""
        from maskfab.report.text import dataframe

        table = dataframe(dict(zip(self.x_um.tolist(), self.values.T, strict=True)))
        table.index = self.y_um.tolist()
        return table.rename_axis(index="y_um", columns="x_um")

    def plot(self) -> Drawing:
        """log10 over six decades below the peak."""
        from maskfab.report.figures import die as die_figures

        return die_figures.psf((self,))

    def _repr_svg_(self) -> str:
        return self.plot().svg()

    def __repr__(self) -> str:
        count = len(self.values)
        note = self.note and f"; {self.note}"
        return f"<Psf at {self.wavelength_nm:g} nm: {count} x {count} {self.kind}s {self.step_um:.4g} um apart{note}>"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Mtf(model.Mtf):
    """A presampled modulation transfer function, optics and sensor pixel, up to half a cycle per pixel.

    ``cuts["radial_mean"]`` and the others stand at ``frequency_cy_per_mm``.

    Attributes:
        camera: whose it is.
        table: autocorrelation of the pupil, from which it is taken.
        note: what was assumed of the panel; empty for nothing.
    """

    camera: Lens
    table: LagTable
    note: str = ""

    @property
    def auc(self) -> model.Quantity:
        """Mean of the radial minimum over its frequencies, with its error."""
        from maskfab.optics.metrics import auc_radial_min

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
        from maskfab.optics.metrics import falls_to
        from maskfab.optics.mtf import LEVELS, presampled_mtf

        percent = 100 * float(level)
        if percent in LEVELS:
            return falls_to(self, percent, None)
        return falls_to(presampled_mtf(self.table, self.camera, self.wavelength_nm, (percent,)), percent, None)

    def to_dataframe(self) -> DataFrame:
        """The curves as a table: a row for each frequency, ``frequency_cy_per_mm`` and every cut, ``wavelength_nm``."""
        from maskfab.report.text import dataframe

        curves = {"frequency_cy_per_mm": self.frequency_cy_per_mm, **self.cuts}
        return dataframe({**curves, "wavelength_nm": np.full(len(self.frequency_cy_per_mm), self.wavelength_nm)})

    def plot(self) -> Drawing:
        """The band from radial minimum to maximum, the radial mean, and straight cuts."""
        from maskfab.report.figures import die as die_figures

        return die_figures.mtf((self,))

    def _repr_svg_(self) -> str:
        return self.plot().svg()

    def __repr__(self) -> str:
        note = self.note and f"; {self.note}"
        return f"<Mtf at {self.wavelength_nm:g} nm: 0 to {self.frequency_cy_per_mm[-1]:g} cy/mm, AUC {self.auc}{note}>"
