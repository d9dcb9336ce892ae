r"""The field that a die leaves behind a lens, and how it changes with the width of features and with the lens's errors.

On a grid of dots with transmission t the field is Σ t exp(2πi W) w² sinc(uw) sinc(vw) exp(-2πi (ux + vy)), the phase W
taken at the middle of each dot. Clear features that are wider by β, half of it on each side, add β/2 times the field of
the edges between clear and closed, and β²/4 that of their corners, which is exact but for (πuβ)² / 24 of itself.

Dots that the stop cuts hold the moments of what is left of them, of second degree and below.

Notes:
    A phase that is alike over a dot leaves out its slope there: of a tenth of a wave of defocus a few thousandths of a
    wave per dot, which is worth some 1e-5 of a PSF.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from maskfab.base.arrays import Complexes, Floats
from maskfab.model import Stop
from maskfab.optics.functions.bessel import spherical_bessel
from maskfab.optics.pupil.pupil import Pupil
from maskfab.optics.wavefront.aberration import zernike

_Terms = tuple[tuple[int, float], ...]

DEFOCUS = 4
_RIM_DEGREE = 2


@dataclass(frozen=True, eq=False)
class _Waves:
    """Cosines and sines of one axis, [places, frequencies] each, for frequencies from 0 up."""

    cosine: Floats
    sine: Floats

    @classmethod
    def of(cls, places_um: Floats, frequencies: Floats, width_um: float) -> _Waves:
        """Those of places as wide as they are told, in cycles per micrometre; 0 for lines."""
        phase = 2 * np.pi * places_um[:, None] * frequencies
        weight = width_um * np.sinc(frequencies * width_um) if width_um else 1.0
        return cls(np.cos(phase) * weight, np.sin(phase) * weight)


@dataclass(frozen=True, eq=False)
class _Rim:
    """Parts that the mean over cut dots leaves out of their field: sums of products of an order along y and along x.

    Attributes:
        x, y: middles of the dots, [k].
        along_x: of every order, [orders, k, 2 n - 1]: its wave on the symmetric grid of frequencies.
        along_y: for every order along x, those along y with their moments, [orders, k, 2 n - 1].
    """

    x: Floats
    y: Floats
    along_x: Complexes
    along_y: Complexes

    @classmethod
    def of(cls, pupil: Pupil, x: Floats, y: Floats, frequencies: Floats) -> _Rim:
        """Those of a pupil whose dots have these middles."""
        both = np.concatenate([-frequencies[:0:-1], frequencies])
        orders = np.arange(_RIM_DEGREE + 1)

        def waves(places: Floats, width: float) -> Complexes:
            bessel = spherical_bessel(np.asarray(np.pi * abs(both) * width, dtype=np.float64), orders.size)
            signs = np.sign(both) ** orders[:, None]
            kernels = (2 * orders + 1)[:, None] * (-1j) ** orders[:, None] * width * signs * bessel
            return kernels[:, None, :] * np.exp(-2j * np.pi * places[:, None] * both)  # type: ignore[no-any-return]

        moments = np.array(pupil.rim_moments[:, : orders.size, : orders.size])
        moments[:, np.add.outer(orders, orders) > _RIM_DEGREE] = 0
        moments[:, 0, 0] = 0
        across, up = x[pupil.rim_column], y[pupil.rim_row]
        along_y = np.einsum("kqp,qkv->pkv", moments, waves(up, pupil.y.dot_um))
        return cls(across, up, waves(across, pupil.x.dot_um), along_y)

    def field(self, phasor: Complexes | Floats) -> Complexes:
        """The field of the cut dots, each with its phase, [2 n - 1, 2 n - 1]."""
        found: Complexes = np.einsum("pkv,pku->vu", self.along_y * phasor[:, None], self.along_x, optimize=True)
        return found


@dataclass(frozen=True, eq=False)
class DieField:
    """A die behind its stop, ready for any lens.

    Attributes:
        energy_um2: transmitted, of the die as designed.
        frequencies: from 0 up, cycles per micrometre, alike along both axes, [n].
    """

    energy_um2: float
    frequencies: Floats
    _dots: Floats
    _rim: _Rim
    _x: Floats
    _y: Floats
    _edges_x: Floats
    _edges_y: Floats
    _radius_um: float
    _waves: tuple[_Waves, _Waves, _Waves, _Waves]

    @classmethod
    def of(cls, pupil: Pupil, stop: Stop, frequencies: Floats) -> DieField:
        """The field of a pupil at these frequencies."""
        dots = np.array(pupil.mean_transmission)
        edges_x, edges_y = pupil.x.edges_um(), pupil.y.edges_um()
        x, y = (edges_x[1:] + edges_x[:-1]) / 2, (edges_y[1:] + edges_y[:-1]) / 2
        wide_x, wide_y = pupil.x.dot_um, pupil.y.dot_um
        waves = (
            _Waves.of(x, frequencies, wide_x),
            _Waves.of(y, frequencies, wide_y),
            _Waves.of(edges_x, frequencies, 0.0),
            _Waves.of(edges_y, frequencies, 0.0),
        )
        rim, radius = _Rim.of(pupil, x, y, frequencies), stop.diameter_um / 2
        return cls(pupil.energy_um2, frequencies, dots, rim, x, y, edges_x, edges_y, radius, waves)

    @cached_property
    def _outline(self) -> tuple[Floats, Floats, Floats]:
        """Weights of upright edges, level ones, and corners."""
        dots = self._dots
        clear = (dots > 0).astype(np.float64)
        # Of an edge that the stop cuts, as much as of the dot that it bounds.
        upright = abs(np.diff(dots, axis=1, prepend=0, append=0)) * (np.diff(clear, axis=1, prepend=0, append=0) != 0)
        level = abs(np.diff(dots, axis=0, prepend=0, append=0)) * (np.diff(clear, axis=0, prepend=0, append=0) != 0)
        around = np.pad(clear, 1)
        count = around[1:, 1:] + around[:-1, 1:] + around[1:, :-1] + around[:-1, :-1]
        return upright, level, np.select([count == 1, count == 3], [1.0, -1.0])

    def behind(self, terms: Sequence[tuple[int, float]]) -> LensField:
        """The field behind a lens of pairs of Noll's number and waves."""
        return LensField(self, tuple(terms))

    def _phasor(self, x: Floats, y: Floats, terms: _Terms) -> Complexes | Floats:
        return self._phasor_at(x, y[:, None], terms)

    def _phasor_at(self, x: Floats, y: Floats, terms: _Terms) -> Complexes | Floats:
        if not any(waves for _, waves in terms):
            return np.ones(np.broadcast(x, y).shape)
        across, up = x / self._radius_um, y / self._radius_um
        path = sum(waves * zernike(term, across, up) for term, waves in terms if waves)
        return np.asarray(np.exp(2j * np.pi * path))

    def of_dots(self, terms: _Terms) -> Complexes:
        """Of clear features as they are drawn, [2 n - 1, 2 n - 1]."""
        found = self._sum(self._phasor(self._x, self._y, terms))
        found += self._rim.field(self._phasor_at(self._rim.x, self._rim.y, terms))
        return found

    def of_slope(self, term: int, terms: _Terms) -> Complexes:
        """Change of what dots make with one of the lens's errors, per wave; that of cut dots' rest is left out."""
        slope = zernike(term, self._x / self._radius_um, self._y[:, None] / self._radius_um)
        return self._sum(2j * np.pi * slope * self._phasor(self._x, self._y, terms))

    def _sum(self, phasor: Complexes | Floats) -> Complexes:
        along_x, along_y, _, _ = self._waves
        return _transform(self._dots * phasor, along_x, along_y)

    def of_edges(self, terms: _Terms) -> Complexes:
        """Of lines along the edges between clear and closed, [2 n - 1, 2 n - 1]."""
        along_x, along_y, lines_x, lines_y = self._waves
        upright, level, _ = self._outline
        found = _transform(upright * self._phasor(self._edges_x, self._y, terms), lines_x, along_y)
        found += _transform(level * self._phasor(self._x, self._edges_y, terms), along_x, lines_y)
        return found

    def of_corners(self, terms: _Terms) -> Complexes:
        """Of points at the corners, [2 n - 1, 2 n - 1]."""
        _, _, lines_x, lines_y = self._waves
        _, _, corners = self._outline
        return _transform(corners * self._phasor(self._edges_x, self._edges_y, terms), lines_x, lines_y)


@dataclass(frozen=True, eq=False)
class LensField:
    """The field of a die behind one lens, whatever the bias: its parts are made once.

    Attributes:
        die: behind its stop.
        terms: the lens's errors, pairs of Noll's number and waves.
    """

    die: DieField
    terms: _Terms

    @cached_property
    def _dots(self) -> Complexes:
        return self.die.of_dots(self.terms)

    @cached_property
    def _edges(self) -> Complexes:
        return self.die.of_edges(self.terms)

    @cached_property
    def _corners(self) -> Complexes:
        return self.die.of_corners(self.terms)

    def field(self, bias_um: float) -> Complexes:
        """[2 n - 1, 2 n - 1] for clear features so much wider than drawn."""
        if not bias_um:
            return self._dots
        return self._dots + bias_um / 2 * self._edges + bias_um**2 / 4 * self._corners

    def by_bias(self, bias_um: float) -> Complexes:
        """Change of the field with the width of clear features, per micrometre."""
        return self._edges / 2 + bias_um / 2 * self._corners

    def by_term(self, term: int) -> Complexes:
        """Change of the field with one of the lens's errors, per wave; that of edges' own is left out."""
        return self.die.of_slope(term, self.terms)


def _transform(values: Complexes | Floats, along_x: _Waves, along_y: _Waves) -> Complexes:
    """Σ values exp(-2πi (ux + vy)) on the symmetric grid of frequencies."""
    found = _real_transform(np.asarray(values.real), along_x, along_y)
    if np.iscomplexobj(values):
        found += 1j * _real_transform(np.asarray(values.imag), along_x, along_y)
    return found


def _real_transform(values: Floats, along_x: _Waves, along_y: _Waves) -> Complexes:
    even, odd = values @ along_x.cosine, values @ along_x.sine
    cosine, sine = along_y.cosine.T, along_y.sine.T
    return _assembled(cosine @ even, cosine @ odd, sine @ even, sine @ odd)


def _assembled(even_even: Floats, even_odd: Floats, odd_even: Floats, odd_odd: Floats) -> Complexes:
    """The field of all signs from sums with cosines (even) and sines (odd) along y, then x."""
    quarters = {
        (sign_y, sign_x): even_even - sign_x * sign_y * odd_odd - 1j * (sign_x * even_odd + sign_y * odd_even)
        for sign_y in (1, -1)
        for sign_x in (1, -1)
    }
    rows = [np.concatenate([quarters[sign, -1][:, :0:-1], quarters[sign, 1]], axis=1) for sign in (-1, 1)]
    return np.concatenate([rows[0][:0:-1], rows[1]])
