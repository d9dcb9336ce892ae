r"""Lens aberrations: a wavefront in Zernike terms, and the PSF it leaves.

A wavefront is Σ c_j Z_j in waves, Z_j the Zernike polynomials in Noll's order (R. J. Noll, J. Opt. Soc. Am. 66, 207,
1976), orthonormal on the round stop: the mean of Z_j Z_k over it is 1 if j = k, else 0, so that the rms of the
wavefront is the root of the sum of squares of its coefficients (piston aside). The pupil is multiplied by
exp(+2πi W): a wavefront that rises towards +x moves the image towards +x.

Notes:
    On a square stop the polynomials belong to the circle inscribed in it: they go beyond 1 in the corners, where high
    degrees grow fast, and are no longer orthonormal.
    Noll's order counts cosine terms as even numbers and sine terms as odd ones, which is neither the OSA/ANSI nor the
    fringe order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.model import Stop
from maskfab.optics.pupil.stop_shape import Waves
from maskfab.optics.wavefront.mean_over_tilings import MeanPsf, phase_error

HIGHEST_TERM = 66
"""Noll's number of the last term of radial degree 10."""

NOLL: Mapping[str, int] = MappingProxyType(
    {
        "tilt_x": 2,
        "tilt_y": 3,
        "defocus": 4,
        "astigmatism_oblique": 5,
        "astigmatism": 6,
        "coma_y": 7,
        "coma_x": 8,
        "trefoil_y": 9,
        "trefoil_x": 10,
        "spherical": 11,
    }
)
"""Noll's numbers of the terms that have names."""


@dataclass(frozen=True)
class Wavefront:
    """A lens's wavefront error.

    Attributes:
        terms: pairs of Noll's number and its coefficient in waves.
        reference_nm: the wavelength whose waves these are; at others the same path counts in proportion.

    Raises:
        JobError: MF104 for a term outside 1 to 66, or a coefficient that is not finite.
    """

    terms: tuple[tuple[int, float], ...]
    reference_nm: float

    def __post_init__(self) -> None:
        for term, coefficient in self.terms:
            if not 1 <= term <= HIGHEST_TERM:
                raise JobError(
                    "MF104",
                    f"Zernike term {term} is outside 1 to {HIGHEST_TERM}",
                    cure="Give Noll's numbers; defocus is 4, spherical aberration 11",
                )
            if not math.isfinite(coefficient):
                raise JobError(
                    "MF104",
                    f"the coefficient of Zernike term {term} is {coefficient}",
                    cure="Give a finite number of waves, such as 0.05",
                )
        if not (math.isfinite(self.reference_nm) and self.reference_nm > 0):
            raise JobError(
                "MF104",
                f"the wavefront's reference wavelength is {self.reference_nm:g} nm",
                cure="Give the wavelength at which it was measured, such as 633 nm",
            )

    def rms_waves(self, wavelength_nm: float) -> float:
        """Root mean square over the clear round stop, piston left out, in waves at that wavelength."""
        squares: dict[int, float] = {}
        for term, coefficient in self.terms:
            squares[term] = squares.get(term, 0.0) + coefficient
        total = sum(value**2 for term, value in squares.items() if term > 1)
        return math.sqrt(total) * self.reference_nm / wavelength_nm

    def waves(self, stop: Stop, wavelength_nm: float) -> Waves:
        """The wavefront as a function of x and y in micrometres."""
        radius, scale = stop.diameter_um / 2, self.reference_nm / wavelength_nm

        def path(x_um: Floats, y_um: Floats) -> Floats:
            total = np.zeros(np.broadcast(x_um, y_um).shape)
            for term, coefficient in self.terms:
                total += coefficient * scale * zernike(term, x_um / radius, y_um / radius)
            return total

        return path


def noll_degrees(term: int) -> tuple[int, int]:
    """Radial degree n and azimuthal frequency m of a term; m > 0 for a cosine, m < 0 for a sine."""
    n = 0
    while (n + 1) * (n + 2) // 2 < term:
        n += 1
    place = term - n * (n + 1) // 2
    m = 2 * (place // 2) if n % 2 == 0 else 2 * ((place - 1) // 2) + 1
    return n, m if term % 2 == 0 else -m


def zernike(term: int, x: Floats, y: Floats) -> Floats:
    """Zernike polynomial of Noll's number ``term`` at x, y in units of the stop's radius; any shapes that broadcast.

    The radial polynomial (Born and Wolf, 9.2.1) without its factor ρ^|m|, which goes to the angle's cosine or sine, is
    a polynomial in ρ²; together they are a polynomial in x and y, with no angle undefined at the middle.
    """
    n, signed = noll_degrees(term)
    m = abs(signed)
    squared = x**2 + y**2
    radial = np.zeros_like(squared)
    for k in range((n - m) // 2 + 1):
        factor = math.factorial(n - k) // (
            math.factorial(k) * math.factorial((n + m) // 2 - k) * math.factorial((n - m) // 2 - k)
        )
        radial += (-1) ** k * factor * squared ** ((n - m) // 2 - k)
    if m == 0:
        return np.asarray(math.sqrt(n + 1) * radial)
    power = (x + 1j * y) ** m
    return np.asarray(math.sqrt(2 * (n + 1)) * radial * (power.real if signed > 0 else power.imag))


def marechal_strehl(rms_waves: float) -> float:
    """exp(-(2πσ)²), the Strehl ratio of a weak wavefront of any shape (V. N. Mahajan, J. Opt. Soc. Am. 73, 860, 1983).

    Notes:
        Good to 1e-3 for the usual shapes at σ = 1/14 wave; at σ = 0.2 it is a guess.
    """
    return math.exp(-((2 * math.pi * rms_waves) ** 2))


def aberration_error(wavefront: Wavefront, wavelength_nm: float, mean: MeanPsf | None = None) -> float:
    """Estimated relative L2 error of the PSF if the wavefront is left out (:func:`ensemble.phase_error`).

    Args:
        wavefront: weak, up to about a tenth of a wave rms.
        wavelength_nm: the line.
        mean: of the tiling; without it the answer is the most that any tiling shows.
    """
    parts = [
        marechal_strehl(Wavefront(chosen, wavefront.reference_nm).rms_waves(wavelength_nm))
        for chosen in (
            tuple(term for term in wavefront.terms if noll_degrees(term[0])[0] % 2 == parity) for parity in (0, 1)
        )
    ]
    return phase_error(mean, parts[0], parts[1])
