"""The designed die's presampled MTF across an edge, as it is and as the edge's window shows it.

A window of finite reach blurs the transfer function along the frequency by its own transform. A display's is a comb
(its orders lie beside each other on the sensor), so a measured and a designed curve can only be held against each other
through one window.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.capture.edge_window import window
from maskfab.model import Camera, Panel, frozen
from maskfab.optics.image.lag_table import LagTable, lag_table
from maskfab.optics.image.psf import cutoff, image_scale_um2
from maskfab.optics.image.spectrum import Band, Spectrum, line_spectrum, pixel_transfer, quadrature, reach_um
from maskfab.optics.pupil.aperture import panel_aperture
from maskfab.optics.pupil.pupil import cut

Light = Band | float
"""A colour of the camera, response times illuminant, or a line's wavelength in nanometres."""

_BAND_TOLERANCE = 1e-3
# Of the line spread: its period in reaches of the window, and samples per pixel.
_PERIOD, _PER_PX = 16, 8


@dataclass(frozen=True, eq=False)
class DesignedMtf:
    """The designed presampled MTF along an edge's normal, at the frequencies of the measured one.

    Attributes:
        light: the band's name, or the line.
        wavelength_nm: the line; None of a band.
        pixel_um: side of the camera's pixel.
        frequency_cy_per_px: float64 [n].
        mtf: float64 [n].
        seen: float64 [n], through the window of the measurement, 1 at 0: what a perfect measurement shows; ``mtf``
            itself where nothing is known of a window.
        uncertainty: bound of the error of the transfer function.
        method: in words.
    """

    light: str
    wavelength_nm: float | None
    pixel_um: float
    frequency_cy_per_px: Floats
    mtf: Floats
    seen: Floats
    uncertainty: float
    method: str

    def __post_init__(self) -> None:
        for name in ("frequency_cy_per_px", "mtf", "seen"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def designed_mtf(
    panel: Panel,
    camera: Camera,
    light: Light,
    frequency_cy_per_px: Floats,
    normal_deg: float,
    *,
    half_px: float | None = None,
    orientation: int = 0,
) -> DesignedMtf:
    """The MTF of a panel in focus, along one direction.

    Args:
        panel: as designed.
        camera: what looked through it.
        light: of the colour that was measured.
        frequency_cy_per_px: float64 [n], 0 first.
        normal_deg: direction of the waves in the picture, from right towards up: an edge's normal.
        half_px: reach of the measurement's window to either side of the edge; None if nothing is known of one.
        orientation: how the panel stood before the camera, as :func:`maskfab.model.orient` counts.

    Raises:
        JobError: MF112 for a line outside 200 to 2000 nm; MF115 for a band that takes too many lines.
    """
    frequency = frequency_cy_per_px
    longest = light.range_nm[1] if isinstance(light, Band) else light
    shortest = light.range_nm[0] if isinstance(light, Band) else light
    ends = max(math.sqrt(2) * cutoff(camera, shortest), float(frequency[-1]) / camera.pixel_um)
    pupil = cut(panel_aperture(panel, camera.stop.diameter_um / 2), camera.stop)
    table = lag_table(pupil, reach_um(camera, np.array([longest]), ends))
    along = math.radians(normal_in_die(normal_deg, orientation))
    direction = math.cos(along), math.sin(along)
    spectrum = _lines(light, table, camera, direction, ends)
    mtf, error = _transfer(table, camera, spectrum, direction, frequency)
    return DesignedMtf(
        light.name if isinstance(light, Band) else f"{light:g} nm",
        None if isinstance(light, Band) else light,
        camera.pixel_um,
        frequency,
        abs(mtf),
        abs(mtf if half_px is None else _seen(table, camera, spectrum, direction, frequency, half_px, ends)),
        error,
        f"autocorrelation of the designed pupil in focus at {_count(spectrum.wavelengths_nm.size)}, times the pixel's "
        "transfer",
    )


def _count(lines: int) -> str:
    return "1 wavelength" if lines == 1 else f"{lines} wavelengths"


def normal_in_die(normal_deg: float, orientation: int) -> float:
    """The direction in the die's own axes of a wave that has another one in the picture's."""
    turned = normal_deg - 90 * (orientation % 4)
    return 180 - turned if orientation >= 4 else turned


def _lines(light: Light, table: LagTable, camera: Camera, direction: tuple[float, float], highest: float) -> Spectrum:
    if not isinstance(light, Band):
        return line_spectrum([light])
    nu = np.linspace(0, highest, 257)
    return quadrature(light, table, camera, _BAND_TOLERANCE, nu * direction[0], nu * direction[1]).spectrum


def _transfer(
    table: LagTable, camera: Camera, spectrum: Spectrum, direction: tuple[float, float], cycles_per_px: Floats
) -> tuple[Floats, float]:
    """Optics times pixel along a direction, signed, and a bound of its error."""
    nu_x, nu_y = (cycles_per_px / camera.pixel_um * part for part in direction)
    total, error = np.zeros(cycles_per_px.size), 0.0
    for wavelength, weight in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True):
        scale = image_scale_um2(camera, float(wavelength))
        otf, off = table.bounded_otf(scale * nu_x, scale * nu_y)
        total += weight * otf
        error += float(weight * off.max(initial=0.0))
    return total * pixel_transfer(camera, nu_x, nu_y), error


def _seen(
    table: LagTable,
    camera: Camera,
    spectrum: Spectrum,
    direction: tuple[float, float],
    frequency: Floats,
    half_px: float,
    highest: float,
) -> Floats:
    """The transfer function of the line spread within the window."""
    side = round(_PERIOD * half_px) * _PER_PX // 2
    step = _PER_PX / 2 / side
    cycles = step * np.arange(side + 1, dtype=np.float64)
    passes = cycles <= highest * camera.pixel_um
    transfer = np.zeros(side + 1)
    transfer[passes] = _transfer(table, camera, spectrum, direction, cycles[passes])[0]
    line = np.fft.fftshift(np.fft.irfft(transfer))
    place = (np.arange(line.size, dtype=np.float64) - side) / _PER_PX
    inside = abs(place) < half_px
    cut_off = line[inside] * window(place[inside], half_px)
    found = np.cos(2 * np.pi * frequency[:, None] * place[inside]) @ cut_off
    return np.asarray(found / found[0])
