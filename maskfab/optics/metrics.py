"""The optical numbers of a report, each with its unit, method and error."""

from __future__ import annotations

import numpy as np

from maskfab.model import Camera, Mtf, Psf, Quantity
from maskfab.optics.mtf import area_under_radial_min, frequency_at
from maskfab.optics.otf import LagTable
from maskfab.optics.psf import image_scale_um2

_MTF_LEVELS = (10, 30, 50)


AREA_ERROR = 1e-8
"""Relative error of an area inside the stop; the polygon that stands for a round stop has 4096 sides."""


def stop_open_ratio(clear_um2: float, camera: Camera, die: str | None, method: str) -> Quantity:
    """Share of the stop that is clear."""
    ratio = clear_um2 / camera.stop.area_um2
    return Quantity("stop_open_ratio", "η", ratio, "1", method, uncertainty=AREA_ERROR * ratio, die=die)


def mtf_quantities(mtf: Mtf, die: str | None) -> list[Quantity]:
    """AUC of the radial minimum, and the frequencies at which the radial mean falls to 50, 30 and 10 %."""
    line = mtf.wavelength_nm
    found = [
        Quantity(
            "auc_radial_min",
            "AUC",
            area_under_radial_min(mtf),
            "1",
            "mean of the radial minimum of the presampled MTF from 0 to half a cycle per pixel, from the lag table",
            uncertainty=mtf.uncertainty,
            die=die,
            wavelength_nm=line,
        )
    ]
    for level in reversed(_MTF_LEVELS):
        frequency = frequency_at(mtf, "radial_mean", level / 100)
        found.append(
            Quantity(
                f"mtf{level}",
                f"ν{level}",
                frequency,
                "cy/mm",
                f"first frequency at which the radial mean of the presampled MTF falls to {level} %; none: not before "
                f"{mtf.frequency_cy_per_mm[-1]:g} cy/mm",
                uncertainty=None if frequency is None else _frequency_error(mtf, frequency),
                die=die,
                wavelength_nm=line,
            )
        )
    return found


def energy_in_window(psf: Psf, uncertainty: float, die: str | None) -> Quantity:
    """Share of all transmitted energy inside the PSF's window."""
    width = psf.step_um * psf.values.shape[0]
    return Quantity(
        "psf_energy_in_window",
        "E",
        psf.energy_in_window,
        "1",
        f"sum of the pixel-integrated PSF over {width:g} um x {width:g} um; the rest lies outside",
        uncertainty=uncertainty,
        die=die,
        wavelength_nm=psf.wavelength_nm,
    )


def strehl_quantities(
    psf: Psf, camera: Camera, energy_um2: float, area_um2: float, die: str | None, limit: float
) -> list[Quantity]:
    """Peak intensity against the clear stop's, and its distance from the square of the open ratio, which fixes it.

    Args:
        psf: sampled at points, its middle on the axis.
        camera: for its focal length and stop.
        energy_um2: what the PSF was normalised by.
        area_um2: clear area inside the stop from another source than the PSF.
        die: whose numbers these are.
        limit: largest admissible relative error.
    """
    scale = image_scale_um2(camera, psf.wavelength_nm)
    stop = camera.stop
    middle = psf.values.shape[0] // 2
    strehl = float(psf.values[middle, middle]) * scale**2 * energy_um2 / stop.area_um2**2
    error = abs(strehl / (area_um2 / stop.area_um2) ** 2 - 1)
    return [
        Quantity(
            "peak_strehl",
            "S",
            strehl,
            "1",
            "peak of the PSF over that of the open stop; the open ratio alone fixes it, so it ranks no design",
            uncertainty=AREA_ERROR,
            die=die,
            wavelength_nm=psf.wavelength_nm,
        ),
        Quantity(
            "strehl_invariant_error",
            "|S/η² - 1|",
            error,
            "1",
            "peak Strehl of the matrix path against the square of the open ratio from the polygons' area",
            uncertainty=AREA_ERROR,
            limit=limit,
            passed=error <= limit,
            die=die,
            wavelength_nm=psf.wavelength_nm,
        ),
    ]


def mtf_volume(table: LagTable, area_um2: float, die: str | None, limit: float) -> Quantity:
    """Volume under the two-dimensional MTF over that of the open stop, which the open ratio fixes.

    The integral of the normalised autocorrelation of a binary pupil is its clear area, for the open stop the stop's,
    and their ratio is the open ratio.
    """
    error = abs(table.volume_um2 / area_um2 - 1)
    return Quantity(
        "mtf_volume_invariant_error",
        "|V/η - 1|",
        error,
        "1",
        "volume under the 2-D MTF from the lag table against the open ratio from the polygons' area",
        uncertainty=max(AREA_ERROR, table.uncertainty),
        limit=limit,
        passed=error <= limit,
        die=die,
    )


def relative_difference(measured: Psf, reference: Psf) -> float:
    """Relative L2 distance of two PSFs on one grid."""
    return float(np.linalg.norm(measured.values - reference.values) / np.linalg.norm(reference.values))


def _frequency_error(mtf: Mtf, frequency: float) -> float:
    """The MTF's error divided by its slope there, plus half a ring, over which the mean is taken."""
    k = int(np.searchsorted(mtf.frequency_cy_per_mm, frequency))
    step = float(mtf.frequency_cy_per_mm[1])
    slope = float(mtf.cuts["radial_mean"][k - 1] - mtf.cuts["radial_mean"][k]) / step
    return step / 2 + mtf.uncertainty / slope
