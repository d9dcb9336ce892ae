r"""Chrome that light leaks through: amplitude τ = 10^(-OD / 2) exp(2πi φ) where the openings have 1.

With o the openings and s the clear stop, the amplitude is a = o + τ (s - o), and so is its field: that of s is known in
closed form, so a leak costs one PSF nothing but a sum. Of a binary mask of open ratio η the mean amplitude is
η + τ (1 - η) and the mean intensity η + |τ|² (1 - η); they fix peak Strehl and volume under the MTF as η alone does
without a leak. The autocorrelation is that of the real part plus that of the imaginary part.

Notes:
    The part of the autocorrelation that is imaginary, o's with s less s's with o, is left out of the MTF: it comes from
    where the openings on one side of the stop differ from those on the other, and enters the modulus squared. Strips
    between cells are no dots; what leaks through them is missing from the autocorrelation. Both are in its uncertainty.
"""

from __future__ import annotations

import cmath
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from maskfab.base.arrays import Complexes, Floats
from maskfab.model import MaskBlank, Stop
from maskfab.optics.field.clear_stop import clear_field
from maskfab.optics.image.lag_table import LagTable
from maskfab.optics.pupil.aperture import Aperture
from maskfab.optics.pupil.pupil import Pupil, cut
from maskfab.optics.pupil.stop_shape import inside

# Shares of the reach, and directions.
_LAGS = [(share, x, y) for share in (0.25, 0.5, 1.0) for x, y in ((1.0, 0.0), (0.0, 1.0), (0.7, 0.7), (-0.7, 0.7))]


@dataclass(frozen=True)
class Leak:
    """The film's amplitude behind a stop.

    Attributes:
        amplitude: τ.
        stop: the lens stop.
    """

    amplitude: complex
    stop: Stop

    @classmethod
    def of(cls, blank: MaskBlank, stop: Stop) -> Leak | None:
        """The leak that a job states; None unless it states both density and phase."""
        if blank.optical_density is None or blank.film_phase_waves is None:
            return None
        return cls(10 ** (-blank.optical_density / 2) * cmath.exp(2j * cmath.pi * blank.film_phase_waves), stop)

    def field(self, openings: Complexes, axis: Floats) -> Complexes:
        """The field of openings and film from that of the openings alone, on a square grid of frequencies [n, n]."""
        clear = clear_field(self.stop, axis, axis[:, None])
        return np.asarray((1 - self.amplitude) * openings + self.amplitude * clear)

    def energy_um2(self, clear_um2: float) -> float:
        """Integral of the intensity behind a mask that is clear over that area."""
        return clear_um2 + abs(self.amplitude) ** 2 * (self.stop.area_um2 - clear_um2)

    def field_integral_um2(self, clear_um2: float) -> complex:
        """Integral of the amplitude: the field on the axis."""
        return clear_um2 + self.amplitude * (self.stop.area_um2 - clear_um2)

    def volume_um2(self, clear_um2: float, energy_um2: float) -> float:
        """Volume under the MTF of a mask with that clear area, as far as its dots pass that energy."""
        strips = self._strips_um2(clear_um2, energy_um2)
        return abs(self.field_integral_um2(clear_um2) - self.amplitude * strips) ** 2 / energy_um2

    def _strips_um2(self, clear_um2: float, energy_um2: float) -> float:
        """Area of film that is in no dot, from the energy that it lacks; rounding aside."""
        lacking = self.energy_um2(clear_um2) - energy_um2
        return lacking / abs(self.amplitude) ** 2 if lacking > 1e-9 * energy_um2 else 0.0

    def pupils(self, aperture: Aperture) -> Iterator[Pupil]:
        """Real and imaginary part of the amplitude of dots inside the stop; the latter only if there is one.

        Strips between cells stay dark, for lags are those of dots. One part at a time is made: of a fine grid each
        takes hundreds of megabytes.
        """
        x, y, t = aperture.x, aperture.y, aperture.transmission
        step, turned = self.amplitude.real, self.amplitude.imag
        film = 1 - t
        for rows, dots in ((film, y.dot_index()), (film.T, x.dot_index())):
            rows[np.setdiff1d(np.arange(len(rows)), dots)] = 0.0
        yield cut(Aperture(x, y, t + step * film, (1 - step) ** 2 * aperture.variance), self.stop)
        if abs(turned) > 1e-15:
            film *= turned
            yield cut(Aperture(x, y, film, turned**2 * aperture.variance), self.stop)

    def lag_table(self, openings: Pupil, tables: Sequence[LagTable], reach_um: float) -> LagTable:
        """The table of lags of all that passes light, as of :func:`maskfab.optics.image.lag_table.lag_table`.

        Args:
            openings: inside the stop, without the leak.
            tables: of every one of :meth:`pupils`.
            reach_um: the largest lag along either axis that will be asked for.
        """
        energy = sum(table.energy_um2 for table in tables)
        total = reduce(np.add, [table.values for table in tables])
        total.flags.writeable = False
        shares = [table.energy_um2 / energy for table in tables]
        strips = abs(self.amplitude) ** 2 * self._strips_um2(openings.energy_um2, float(energy))
        # Cauchy and Schwarz: what is missing, against all, and against itself.
        missing = 2 * np.sqrt(strips / energy) + strips / energy
        lost = missing + self._imaginary_um2(openings, min(reach_um, self.stop.diameter_um)) / energy
        near, beyond = (
            float(np.dot(shares, each) + lost) for each in zip(*(table.errors for table in tables), strict=True)
        )
        return replace(
            tables[0],
            values=total,
            energy_um2=float(energy),
            errors=(near, beyond),
            rims=tuple(rim for table in tables for rim in table.rims),
            spread_um2=sum(table.spread_um2 for table in tables),
        )

    def _imaginary_um2(self, openings: Pupil, reach_um: float) -> float:
        """Twice the largest imaginary part of the autocorrelation at some lags, for it is smooth."""
        if self.amplitude.imag == 0:
            return 0.0
        x, y = ((edges[1:] + edges[:-1]) / 2 for edges in (openings.x.edges_um(), openings.y.edges_um()))
        clear = openings.mean_transmission * np.diff(openings.x.edges_um()) * np.diff(openings.y.edges_um())[:, None]
        worst = 0.0
        for share, across, up in _LAGS:
            dx, dy = share * reach_um * across, share * reach_um * up
            ahead, behind = (inside(self.stop, x + k * dx, y[:, None] + k * dy) for k in (1, -1))
            worst = max(worst, abs(float(clear[ahead].sum() - clear[behind].sum())))
        return 2 * abs(self.amplitude.imag) * worst
