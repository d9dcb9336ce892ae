"""Change of a PSF by a gap between panel and stop, estimated from the mean PSF over layouts."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.model import Camera, Psf, Stop
from maskfab.optics.pupil.aperture import Aperture
from maskfab.optics.pupil.pupil import Pupil
from maskfab.optics.pupil.stop_shape import edge_points, perimeter_um, widest_um
from maskfab.optics.wavefront.mean_over_tilings import MeanPsf, decorrelation_error
from maskfab.optics.wavefront.panel_gap import Place, shift_um
from maskfab.units import UM_PER_NM

_RIM_POINTS = 2048
_STRIP_LAYERS = 8
_DIRECTIONS = 24


def common_share(stop: Stop, distance_um: Floats | float, gap_um: float = 0.0, wavelength_nm: float = 0.0) -> Floats:
    r"""Correlation of the clear stop with itself, moved by a distance and seen across a gap.

    For short distances a round stop of diameter D has 1 - 4 s / (πD) in common with itself. Across a gap s is averaged
    with Fresnel's kernel, a Gaussian of complex width σ² = iλg/2π, which gives the mean of Rice's distribution,

        ⟨s⟩ = sqrt(λg)/2 e^{iπ/4} e^{iη} [(1 - 2iη) J0(η) - 2η J1(η)],   η = π s² / (2λg).

    Other stops, whose overlap is direction-dependent, are treated as the round one of the same perimeter-to-area ratio;
    for a square that is the one of the same D.
    """
    moved = np.asarray(distance_um, dtype=np.float64)
    span = wavelength_nm * UM_PER_NM * gap_um
    if span > 0:
        eta = np.pi * moved**2 / (2 * span)
        rice = np.exp(1j * eta) * ((1 - 2j * eta) * scipy.special.j0(eta) - 2 * eta * scipy.special.j1(eta))
        mean: NDArray[np.complex128] = np.sqrt(span) / 2 * np.exp(0.25j * np.pi) * rice
    else:
        mean = moved.astype(np.complex128)
    return np.asarray(np.clip(abs(1 - mean * (perimeter_um(stop) / (np.pi * stop.area_um2))), 0, 1))


def rim_crowding(openings: Aperture, inside: Pupil, distance_um: float) -> float:
    """Ratio of the clear area that a stop trades when it moves by a distance to that of even openings, at least 1.

    The clear area of the strips along the rim that the stop loses on one side and gains on the other, over their whole
    area times the open share of the stop; the worst of many directions. Cells that are few or sparse stand on the rim
    as it happens: a strip then holds several times its share of the light, or none.

    Args:
        openings: as far as the stop reaches, and that distance beyond.
        inside: what the stop leaves of them.
        distance_um: positive.
    """
    stop, clear_um2 = inside.stop, inside.field_integral_um2
    if not clear_um2:
        return 1.0
    place, outward, length = edge_points(stop, _RIM_POINTS)
    angle = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    across = outward @ np.stack([np.cos(angle), np.sin(angle)])
    layer = distance_um / _STRIP_LAYERS
    traded = np.zeros(_DIRECTIONS)
    for k in range(_STRIP_LAYERS):
        # The strip is as deep as the move along the rim's normal: of its last layer it holds a part.
        held = layer * np.clip(_STRIP_LAYERS * abs(across) - k, 0, 1)
        for side in (1, -1):
            clear = _seen(openings, place + side * (k + 0.5) * layer * outward)
            traded += (clear * length) @ (held * (side * across > 0))
    even = clear_um2 / stop.area_um2 * distance_um * (length @ abs(across))
    return max(1.0, float((traded / even).max()))


def _seen(openings: Aperture, place: Floats) -> Floats:
    """Transmission at points [..., 2]; 0 beyond the openings."""
    index = []
    inside = np.ones(place.shape[:-1], dtype=np.bool_)
    for axis, lattice in enumerate((openings.x, openings.y)):
        edges = lattice.edges_um()
        found = np.searchsorted(edges, place[..., axis], side="right") - 1
        inside &= (found >= 0) & (found < edges.size - 1)
        index.append(np.clip(found, 0, edges.size - 2))
    return np.where(inside, openings.transmission[index[1], index[0]], 0.0)


def shift_error(mean: MeanPsf, camera: Camera, gap_um: float, image_um: Place) -> float:
    """Estimated relative L2 error of the PSF if the openings' shift is left out, over the mean's window.

    For random tilings: the cells that the stop no longer shares are new. It saturates where no cell is shared. For an
    opening that looks alike in all orientations the variance, hence this, is 0.

    Notes:
        Measured at stops of 300 to 600 um, gaps up to 1 mm: the truth is 0.15 to 2.2 times the estimate. It is less
        where the shift is much shorter than the pitch, because the strip that is new is then not independent of the
        cell it belongs to; it is more for dense openings, because the repeating part changes too. Where a factor of
        three decides, compute :func:`maskfab.optics.wavefront.panel_gap.shifted_psf`: it costs one PSF.
    """
    moved = math.hypot(*shift_um(camera, gap_um, image_um))
    if camera.stop.shape == "circle":
        s = min(moved / camera.stop.diameter_um, 1.0)
        share = 2 / math.pi * (math.acos(s) - s * math.sqrt(1 - s**2))
    elif camera.stop.shape in ("square", "rectangle"):
        width, height = camera.stop.sides_um
        across, up = shift_um(camera, gap_um, image_um)
        share = max(0.0, 1 - abs(across) / width) * max(0.0, 1 - abs(up) / height)
    else:
        share = max(0.0, 1 - moved * widest_um(camera.stop) / camera.stop.area_um2)
    return decorrelation_error(mean.variance, mean.psf.values, share)


def share_across_gap(psf: Psf, camera: Camera, gap_um: float) -> Floats:
    """:func:`common_share` of the stop with where the light of each of a PSF's samples leaves the openings, [n, n]."""
    count = psf.values.shape[0]
    across = gap_um / camera.focal_um * psf.step_um * np.arange(count // 2 + 1, dtype=np.float64)
    quadrant = common_share(camera.stop, np.hypot(across[:, None], across), gap_um, psf.wavelength_nm)
    place = abs(np.arange(count) - count // 2)
    return quadrant[np.ix_(place, place)]


def gap_error(mean: MeanPsf, share: Floats) -> float:
    """Estimated relative L2 error of the PSF if diffraction over the gap is left out, over the mean's window.

    Light of spatial frequency q crosses the gap at the slope λq and so meets a stop that is moved by λ g q, blurred by
    sqrt(λg); the share of openings that enter or leave is new speckle. The notes of
    :func:`shift_error` hold here too, and the truth may be down to 0.05 of the estimate for openings that are large
    against sqrt(λg): a bound to rule the gap out with, not a measure of it.

    Args:
        mean: of the tiling.
        share: what :func:`share_across_gap` says of its samples.
    """
    return decorrelation_error(mean.variance, mean.psf.values, share)
