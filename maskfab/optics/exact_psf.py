r"""The PSF of one line at any places, from the field itself: what its samples do not tell is exact to rounding.

**Energy** inside a circle is a sum over the Legendre series of the intensity in the square about it. Along an axis the
intensity, 0 <= I <= M, has no frequency above B, so on the ellipse about the square's side 2 r whose half axes add up
to ρ r it is below M exp(π B r (ρ - 1 / ρ)), and n Gauss nodes leave out no more than

    4 M exp(π B r (ρ - 1 / ρ)) ρ^-n / (ρ - 1)            (L. N. Trefethen, Approximation Theory, 2013, 8.2 and 8.3)

of it, for any ρ > 1; two axes 2 + sqrt(n) times that, 1 + sqrt(n) being a bound of the projection's norm. The disc is a
sum of chords, on which P_n has the integral (P_n+1 - P_n-1) / (2 n + 1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from numpy.polynomial.legendre import legvander

from maskfab.base.arrays import Floats
from maskfab.base.model import Psf, frozen
from maskfab.job.camera import Camera
from maskfab.optics.field.matrix import SampledField, direct_field, prepare
from maskfab.optics.field.methods import Prepared
from maskfab.optics.field.polygons import Boundary
from maskfab.optics.polynomials import gauss_legendre
from maskfab.optics.psf import Leak, cutoff, image_scale_um2, point_step_um, psf_norm_um6
from maskfab.optics.pupil import Pupil

# Error of a field over the one on the axis: rounding, of one from samples, and by polygons that stand for a stop.
_ROUNDING, _SAMPLED, _OF_POLYGONS = 2e-14, 1e-12, 1e-8
# PSF samples beyond the window to which a square about a lobe may reach.
_BEYOND = 4
# Gauss nodes beyond those that a cycle takes, and sums of half axes that are tried.
_SPARE, _SUMS = 32, np.linspace(1.5, 6.0, 46)


@dataclass(frozen=True, eq=False)
class ExactPsf:
    """The PSF of one line at any places.

    Attributes:
        samples: at points over the window.
        intensity: of a tensor grid of places x [n] and y [m] in micrometres, float64 [m, n].
        most: bound of the intensity anywhere.
        highest: no frequency of it is higher along an axis, cycles per micrometre.
        rounding: error of the field over that on the axis.
        even: whether it is alike on opposite sides.
    """

    samples: Psf
    intensity: Callable[[Floats, Floats], Floats]
    most: float
    highest: float
    rounding: float
    even: bool

    @classmethod
    def of(
        cls,
        samples: Psf,
        openings: Pupil | Boundary,
        camera: Camera,
        leak: Leak | None,
        sampled: SampledField | None = None,
    ) -> ExactPsf:
        """Of openings that the stop has cut, and of the film round them.

        Args:
            sampled: their field, as of :func:`sampled_field`; if None, polygons get one, and dots are summed directly.
        """
        if isinstance(openings, Boundary):
            clear, rounding = openings.area_um2, _OF_POLYGONS
            at = (sampled or sampled_field(openings, camera)).at
        else:
            clear, rounding = openings.energy_um2, _SAMPLED if sampled else _ROUNDING
            at = sampled.at if sampled else partial(direct_field, openings)
        scale = image_scale_um2(camera, samples.wavelength_nm)
        norm = psf_norm_um6(scale, clear if leak is None else leak.energy_um2(clear))

        def intensity(x_um: Floats, y_um: Floats) -> Floats:
            u, v = x_um / scale, y_um / scale
            field = at(u, v)
            if leak is not None:
                field = leak.field(field, u, v)
            return np.asarray((field.real**2 + field.imag**2) / norm)

        most = (clear if leak is None else camera.stop.area_um2) / scale**2
        highest = cutoff(camera, samples.wavelength_nm)
        return cls(samples, intensity, most, highest, rounding, leak is None)

    def in_circle(self, radius_um: float) -> tuple[float, float]:
        """Share of all energy within a circle about the axis, and the bound of its error."""
        turns = 2 * math.pi * radius_um * self.highest
        count = math.ceil(1.2 * turns) + _SPARE
        nodes, series, weights = _circle_sums(count)
        values = self.intensity(radius_um * nodes, radius_um * nodes)
        energy = radius_um**2 * float(np.sum((series.T @ values @ series) * weights))
        left = turns / 2 * (_SUMS - 1 / _SUMS) - count * np.log(_SUMS) + np.log(4 / (_SUMS - 1))
        error = math.exp(float(left.min())) * (2 + math.sqrt(count)) * self.most * math.pi * radius_um**2
        # Twice that of the field, and what the sums round.
        return energy, error + 10 * self.rounding


@lru_cache(maxsize=8)
def _circle_sums(count: int) -> tuple[Floats, Floats, Floats]:
    """Gauss nodes [n] of the square about the unit circle, what makes a Legendre series [n, n] of values there, and the
    integrals [n, n] of its terms over the circle."""
    nodes, weights = gauss_legendre(count)
    series = weights[:, None] * legvander(nodes, count - 1) * (np.arange(count) + 0.5)
    # Chords at the cosine of an angle: polynomials on a disc are even trigonometric ones.
    angle = math.pi * (np.arange(count + 1) + 0.5) / (count + 1)
    chords = legvander(np.sin(angle), count)
    lengths = np.empty((angle.size, count))
    lengths[:, 0] = 2 * np.sin(angle)
    order = np.arange(1, count)
    lengths[:, 1:] = (chords[:, 2:] - chords[:, :-2]) * (1 + (-1.0) ** order) / (2 * order + 1)
    across = legvander(np.cos(angle), count - 1) * (np.sin(angle) * math.pi / angle.size)[:, None]
    return nodes, frozen(series), frozen(lengths.T @ across)


def sampled_field(openings: Pupil | Boundary, camera: Camera, ready: Prepared | None = None) -> SampledField:
    """A field at so few frequencies that they give it anywhere in the window, at all lines of a camera.

    Args:
        ready: that field, made ready for the PSF; taken where it reaches as far.
    """
    reach_um = camera.window_um / 2 + _BEYOND * point_step_um(camera)
    highest = reach_um / min(image_scale_um2(camera, line) for line in camera.wavelengths_nm)
    if isinstance(ready, SampledField) and min(ready.nodes_u.highest, ready.nodes_v.highest) >= highest:
        return ready
    if isinstance(openings, Boundary):
        width, height = camera.stop.sides_um
        return SampledField.of(openings.parity, (width / 2, height / 2), (highest, highest))
    return SampledField.of(prepare(openings, highest, highest).field, openings.reach_um, (highest, highest))
