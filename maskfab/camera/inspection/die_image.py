"""The picture of a point light that a camera takes through a die, and how it changes with all that is not known of it.

A lens without errors makes one picture of all colours, in frequencies; its errors, told as a path, change that smoothly
with the wavelength, so that three lines of it stand for all others between them.

On a grid of dots with transmission t the field is Σ t exp(2πi W) w² sinc(uw) sinc(vw) exp(-2πi (ux + vy)), the phase W
taken at the middle of each dot. Clear features that are wider by β, half of it on each side, add β/2 times the field of
the edges between clear and closed, and β²/4 that of their corners, which is exact but for (πuβ)² / 24 of itself.
Dots that the stop cuts hold the moments of what is left of them, of second degree and below.

The picture is band-limited, on a grid, and taken by pixels that lie anywhere, are of any size, and turned against it.
Samples closer than the picture's limit asks for say all about it: between them it is the sum of a sinc under a Gaussian
(L. Qian, Proc. Am. Math. Soc. 131, 1169, 2003), whose error falls with exp(-π N (1 - 1/q) / 2) for N samples to each
side and q times as many as needed. A turn is three shears (M. Unser et al., IEEE Trans. Image Process. 4, 1371, 1995).

Notes:
    A phase that is alike over a dot leaves out its slope there: of a tenth of a wave of defocus a few thousandths of a
    wave per dot, which is worth some 1e-5 of a PSF.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np
import scipy

from maskfab.base.arrays import Complexes, Floats
from maskfab.base.model import Panel, orient
from maskfab.base.units import UM_PER_NM
from maskfab.job.camera import Camera, Stop
from maskfab.optics.phase import zernike
from maskfab.optics.polynomials import gauss_legendre, spherical_bessel
from maskfab.optics.pupil import Aperture, Pupil, cut, panel_aperture
from maskfab.optics.spectrum import Spectrum

OVERSAMPLING = 1.3
"""Samples on a grid for each that the picture's limit asks for."""
MARGIN = 24
"""Samples that a grid must hold beyond the outermost pixel."""
_WIDTH = math.sqrt(MARGIN / (math.pi * (1 - 1 / OVERSAMPLING)))
_ALIASED, _REACH = 0.77, 4.5
_NODES = 8
"""Of the mean over a pixel, which holds a few samples across."""


def pixel_means(samples: int, centres: Floats, width: float) -> Floats:
    """Matrix [pixels, samples] that turns samples along an axis into means over pixels.

    Args:
        samples: odd; the middle one lies at 0, neighbours are 1 apart.
        centres: of the pixels, in samples, [pixels].
        width: of a pixel, in samples.
    """
    nodes, weights = gauss_legendre(_NODES)
    places = centres[:, None] + width / 2 * nodes
    first = np.floor(places).astype(np.intp) - MARGIN + 1
    offsets = np.arange(2 * MARGIN)
    off_px = places[..., None] - (first[..., None] + offsets)
    values = np.sinc(off_px) * np.exp(-(off_px**2) / (2 * _WIDTH**2)) * (weights[:, None] / 2)
    columns = first[..., None] + offsets + samples // 2
    rows = np.broadcast_to(np.arange(centres.size)[:, None, None], columns.shape)
    held = (columns >= 0) & (columns < samples)
    parts = (values[held], (rows[held], columns[held]))
    return scipy.sparse.coo_array(parts, shape=(centres.size, samples)).toarray()  # type: ignore[no-any-return]


def gaussian_nodes(sigma: float) -> tuple[Floats, Floats]:
    """Places and weights that stand for a Gaussian under which such a picture is smoothed, by the trapezoid rule.

    Its repetitions along the frequency fall on the picture's band with less than 1e-5 of themselves.
    """
    if not sigma:
        return np.zeros(1), np.ones(1)
    apart = 1 / (1 / (2 * OVERSAMPLING) + _ALIASED / sigma)
    count = math.ceil(_REACH * sigma / apart)
    places = np.asarray(apart * np.arange(-count, count + 1), dtype=np.float64)
    weights = np.exp(-((places / sigma) ** 2) / 2)
    return places, np.asarray(weights / weights.sum())


def turned(picture: Floats, angle_rad: float) -> Floats:
    """The picture [n, n] turned counter-clockwise about its middle sample, rows upwards, by less than a radian."""
    if angle_rad == 0:
        return picture
    across, up = -math.tan(angle_rad / 2), math.sin(angle_rad)
    return _sheared(_sheared(_sheared(picture, across), up, rows=False), across)


def _sheared(picture: Floats, slope: float, *, rows: bool = True) -> Floats:
    """Rows moved by slope times their height; or columns by slope times their place."""
    values = picture if rows else picture.T
    count = values.shape[1]
    size = scipy.fft.next_fast_len(count + 2 * MARGIN, real=True)
    height, by = values.shape[0], math.isqrt(values.shape[0]) + 1
    step = -2j * np.pi * slope * np.fft.rfftfreq(size)
    # Exponentials of every by-th row times those of the rows between: of each they would take most of the time.
    far = np.exp(np.arange(0, height, by)[:, None] * step - height // 2 * step)
    phase = (far[:, None] * np.exp(np.arange(by)[:, None] * step)).reshape(-1, step.size)[:height]
    moved = scipy.fft.irfft(scipy.fft.rfft(values, size, axis=1) * phase, size, axis=1)[:, :count]
    return moved if rows else moved.T  # type: ignore[no-any-return]


_Terms = tuple[tuple[int, float], ...]

DEFOCUS = 4
_RIM_DEGREE = 2


def _waves(places_um: Floats, frequencies: Floats, width_um: float = 0.0) -> Floats:
    """Cosines of places for frequencies from 0 up, then sines: [places, 2 frequencies], of a width or of lines (0)."""
    phase = 2 * np.pi * places_um[:, None] * frequencies
    weight = width_um * np.sinc(frequencies * width_um) if width_um else 1.0
    return np.concatenate([np.cos(phase) * weight, np.sin(phase) * weight], axis=1)


_Rim = tuple[Floats, Floats, Complexes, Complexes]
"""Parts that the mean over cut dots leaves out of their field, sums of products of an order along y and one along x.

Middles of the dots along x and y [k], waves of every order along x on the symmetric grid of frequencies
[orders, k, 2 n - 1], and for every order along x those along y with their moments, [orders, k, 2 n - 1].
"""


def _rim(pupil: Pupil, x: Floats, y: Floats, frequencies: Floats) -> _Rim:
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
    return across, up, waves(across, pupil.x.dot_um), along_y


@dataclass(frozen=True, eq=False)
class DieField:
    """A die behind its stop, ready for any lens."""

    energy_um2: float
    frequencies: Floats
    _dots: Floats
    _rim: _Rim
    _x: Floats
    _y: Floats
    _edges_x: Floats
    _edges_y: Floats
    _radius_um: float
    _along_x: Floats
    _along_y: Floats
    _lines_x: Floats
    _lines_y: Floats

    @classmethod
    def of(cls, pupil: Pupil, stop: Stop, frequencies: Floats) -> DieField:
        """The field of a pupil at these frequencies."""
        dots = np.array(pupil.mean_transmission)
        edges_x, edges_y = pupil.x.edges_um(), pupil.y.edges_um()
        x, y = (edges_x[1:] + edges_x[:-1]) / 2, (edges_y[1:] + edges_y[:-1]) / 2
        wide_x, wide_y = pupil.x.dot_um, pupil.y.dot_um
        waves = _waves(x, frequencies, wide_x), _waves(y, frequencies, wide_y)
        lines = _waves(edges_x, frequencies), _waves(edges_y, frequencies)
        rim, radius = _rim(pupil, x, y, frequencies), stop.diameter_um / 2
        return cls(pupil.energy_um2, frequencies, dots, rim, x, y, edges_x, edges_y, radius, *waves, *lines)

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
        if not any(waves for _, waves in terms):
            return np.ones(np.broadcast(x, y).shape)
        across, up = x / self._radius_um, y / self._radius_um
        path = sum(waves * zernike(term, across, up) for term, waves in terms if waves)
        return np.asarray(np.exp(2j * np.pi * path))

    def rim(self, terms: _Terms) -> Complexes:
        """Field of what the mean over cut dots leaves out, [2 n - 1, 2 n - 1]."""
        x, y, along_x, along_y = self._rim
        cut = along_y * self._phasor(x, y, terms)[:, None]
        size = along_x.shape[2]
        return np.asarray(cut.reshape(-1, size).T @ along_x.reshape(-1, size), dtype=np.complex128)

    def rows_of_dots(self, terms: _Terms, of: int | None = None) -> Complexes | Floats:
        """Waves along x of every row of clear features as drawn, [rows, 2 n]; or their change with an error, a wave."""
        values = self._dots * self._phasor(self._x, self._y[:, None], terms)
        if of is not None:
            values = 2j * np.pi * zernike(of, self._x / self._radius_um, self._y[:, None] / self._radius_um) * values
        return _along(values, self._along_x)

    def rows_of_outlines(self, terms: _Terms) -> tuple[Complexes | Floats, Complexes | Floats, Complexes | Floats]:
        """Waves along x of upright edges, of level ones, and of corners, each as high as nothing."""
        (upright, level, corners), x, y = self._outline, self._x, self._y[:, None]
        edges_x, edges_y = self._edges_x, self._edges_y[:, None]
        return (
            _along(upright * self._phasor(edges_x, y, terms), self._lines_x),
            _along(level * self._phasor(x, edges_y, terms), self._along_x),
            _along(corners * self._phasor(edges_x, edges_y, terms), self._lines_x),
        )

    def field(self, rows: Complexes | Floats, lines: Complexes | Floats | None = None) -> Complexes:
        """Field [2 n - 1, 2 n - 1] of waves along x of every row of dots, and of every line between two rows."""
        if lines is None:
            return _crossed(self._along_y, rows)
        return _crossed(np.concatenate([self._along_y, self._lines_y]), np.concatenate([rows, lines]))


@dataclass(frozen=True, eq=False)
class LensField:
    """The field of a die behind one lens, whatever the bias: its parts are made once."""

    die: DieField
    terms: _Terms

    @cached_property
    def _rim(self) -> Complexes:
        return self.die.rim(self.terms)

    @cached_property
    def _dots(self) -> Complexes | Floats:
        return self.die.rows_of_dots(self.terms)

    @cached_property
    def _outlines(self) -> tuple[Complexes | Floats, Complexes | Floats, Complexes | Floats]:
        return self.die.rows_of_outlines(self.terms)

    def field(self, bias_um: float) -> Complexes:
        """[2 n - 1, 2 n - 1] for clear features so much wider than drawn."""
        if not bias_um:
            return self.die.field(self._dots) + self._rim
        upright, level, corners = self._outlines
        half = bias_um / 2
        return self.die.field(self._dots + half * upright, half * level + half**2 * corners) + self._rim

    def by_bias(self, bias_um: float) -> Complexes:
        """Change of the field with the width of clear features, per micrometre."""
        upright, level, corners = self._outlines
        return self.die.field(upright / 2, level / 2 + bias_um / 2 * corners)

    def by_term(self, term: int) -> Complexes:
        """Change of the field with one of the lens's errors, per wave; that of edges and of cut dots' rest left out."""
        return self.die.field(self.die.rows_of_dots(self.terms, term))


def _along(values: Complexes | Floats, waves: Floats) -> Complexes | Floats:
    """Products of values, real or complex, with waves along their second axis."""
    if np.iscomplexobj(values):
        return np.asarray(values.real @ waves + 1j * (values.imag @ waves), dtype=np.complex128)
    return np.asarray(values @ waves, dtype=np.float64)


def _crossed(waves: Floats, rows: Complexes | Floats) -> Complexes:
    """Σ values exp(-2πi (ux + vy)) on the symmetric grid, of waves along y and of values that are waves along x."""
    count = waves.shape[1] // 2
    both = _along(rows.T, waves).T
    (even_even, even_odd), (odd_even, odd_odd) = (np.split(half, 2, axis=1) for half in np.split(both, 2))
    field = np.empty((2 * count - 1, 2 * count - 1), dtype=np.complex128)
    up, down = slice(count - 1, None), slice(count - 1, None, -1)
    # Sums with cosines (even) and sines (odd) along y, then x, tell the field of all signs.
    alike, odd = even_even - odd_odd, 1j * (even_odd + odd_even)
    field[up, up], field[down, down] = alike - odd, alike + odd
    alike, odd = even_even + odd_odd, 1j * (even_odd - odd_even)
    field[up, down], field[down, up] = alike + odd, alike - odd
    return field


_SPECKLES_APART = 0.8
"""Speckles at the window's edge by which lines that stand for all of a band may move its slopes."""
GEOMETRY = ("x_um", "y_um", "turn_rad", "scale")
BIAS = "bias_um"
_SHIFT_PX, _TURN, _SCALE = 0.02, 1e-3, 1e-4
"""Steps by which the picture is moved, turned and stretched for its slopes."""
_SPARE_PX = 4
"""Pixels by which a light may be found off the middle of the window, and the window stretched."""


LAMP = ("lamp_x_um", "lamp_y_um", "lamp_share")


@dataclass(frozen=True)
class Lamp:
    """Another light behind the same die: its place on the sensor from the first one's, y upwards, and share of it."""

    x_um: float
    y_um: float
    share: float


@dataclass(frozen=True)
class Setting:
    """A die's stand before a camera, and what its writer did to it.

    Attributes:
        x_um, y_um: place of the light on the sensor, y upwards.
        turn_rad: of the die, counter-clockwise as it is seen on the sensor.
        scale: by how much the picture is larger than that of the stated pitch, pixel, focal length and wavelength,
            less 1.
        bias_um: by which clear features are wider than drawn.
        terms: the lens's errors, pairs of Noll's number and waves at the camera's first line.
    """

    x_um: float = 0.0
    y_um: float = 0.0
    turn_rad: float = 0.0
    scale: float = 0.0
    bias_um: float = 0.0
    terms: tuple[tuple[int, float], ...] = ()
    lamp: Lamp | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all that is not known, in the order of :attr:`values`."""
        return (*GEOMETRY, BIAS, *(LAMP if self.lamp else ()), *(f"z{term}" for term, _ in self.terms))

    @property
    def values(self) -> Floats:
        lamp = () if self.lamp is None else (self.lamp.x_um, self.lamp.y_um, self.lamp.share)
        stand = self.x_um, self.y_um, self.turn_rad, self.scale, self.bias_um
        return np.array([*stand, *lamp, *(waves for _, waves in self.terms)])

    def at(self, values: Floats) -> Setting:
        """This setting with other values."""
        rest = list(map(float, values))
        stand = {name: rest.pop(0) for name in (*GEOMETRY, BIAS)}
        lamp = self.lamp and Lamp(*(rest.pop(0) for _ in LAMP))
        return Setting(**stand, terms=tuple(zip((term for term, _ in self.terms), rest, strict=True)), lamp=lamp)


@dataclass(frozen=True, eq=False)
class Pixels:
    """Pixels of one colour of a sensor, on a grid of their own.

    Attributes:
        x_um, y_um: their middles, y upwards; [columns] and [rows], each in the order of the picture.
    """

    colour: str
    x_um: Floats
    y_um: Floats


@dataclass(frozen=True, eq=False)
class DieImage:
    """A die, one way round, before a camera.

    Attributes:
        way_round: element of D4 that takes it to how it stands.
        light: what each colour of pixels sees of a point light.
        light_um: standard deviation along each axis of a light that is a Gaussian on the sensor, 0 of a point.
    """

    panel: Panel
    way_round: int
    camera: Camera
    light: Mapping[str, Spectrum]
    pixels: tuple[Pixels, ...]
    _field: DieField
    _step: float
    _few: Mapping[str, Spectrum]
    light_um: float = 0.0
    _lens: dict[tuple[int, tuple[tuple[int, float], ...]], list[LensField]] = field(default_factory=dict, repr=False)
    _amplitude: dict[tuple[object, ...], list[Complexes]] = field(default_factory=dict, repr=False)
    _last: dict[tuple[object, ...], list[Floats]] = field(default_factory=dict, repr=False)
    _sloping: dict[tuple[float, Setting], dict[str, list[Floats]]] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        panel: Panel,
        way_round: int,
        camera: Camera,
        light: Mapping[str, Spectrum],
        pixels: Sequence[Pixels],
        off_um: float = 0.0,
    ) -> DieImage:
        """The image of a die.

        Args:
            off_um: how far from their origin along an axis another lamp may lie.
        """
        openings = panel_aperture(panel, camera.stop.diameter_um / 2)
        x, y = (openings.x, openings.y) if way_round % 2 == 0 else (openings.y, openings.x)
        held = Aperture(x, y, orient(openings.transmission, way_round), orient(openings.variance, way_round))
        step = 1 / (2 * camera.stop.diameter_um * OVERSAMPLING)
        shortest = min(float(lines.wavelengths_nm.min()) for lines in light.values()) * UM_PER_NM
        half = off_um + _SPARE_PX * camera.pixel_um
        half += max(abs(axis).max() for pixel in pixels for axis in (pixel.x_um, pixel.y_um))
        count = math.ceil(half / (shortest * camera.focal_um) / step) + MARGIN
        die = DieField.of(cut(held, camera.stop), camera.stop, step * np.arange(count + 1))
        few = {colour: gathered(lines, camera, half) for colour, lines in light.items()}
        return cls(panel, way_round, camera, dict(light), tuple(pixels), die, step, few)

    @property
    def transmission(self) -> float:
        """Share of the stop's light that passes the die as drawn."""
        return self._field.energy_um2 / self.camera.stop.area_um2

    def on(self, pixels: Sequence[Pixels]) -> DieImage:
        """The image of the same die on other pixels."""
        return DieImage.of(self.panel, self.way_round, self.camera, self.light, pixels)

    def pictures(self, setting: Setting) -> list[Floats]:
        """Share of the light that every pixel takes, [rows, columns] for each grid of pixels."""
        return self._taken(setting, [self._intensities(setting)], self.light)[0]

    def slopes(self, setting: Setting) -> list[list[Floats]]:
        """Changes of pictures with everything that a setting names, in its order; of as few lines as show them.

        What was asked last is kept for who asks for more terms at the same setting.
        """
        key = self.light_um, replace(setting, terms=tuple(term for term in setting.terms if term[1]))
        if key not in self._sloping:
            self._sloping.clear()
            self._sloping[key] = self._stand_slopes(setting)
        known = self._sloping[key]
        asked = [term for term, _ in setting.terms if f"z{term}" not in known]
        if asked:
            waves, behind = [self._waves(float(line)) for line in self._nodes(setting)], self._behind(setting)
            by_terms = [self._changed(setting, [node.by_term(term) for node in behind], waves) for term in asked]
            named = (f"z{term}" for term in asked)
            known.update(zip(named, self._taken(setting, by_terms, self._few), strict=True))
        return [known[name] for name in setting.names]

    def _stand_slopes(self, setting: Setting) -> dict[str, list[Floats]]:
        """Changes with place, turn, scale, bias, and with another lamp."""
        here, flat = self._intensities(setting), [self._intensity(field) for field in self._fields(setting)]
        left, right = ([turned(picture, setting.turn_rad + sign * _TURN) for picture in flat] for sign in (1, -1))
        by_turn = [(a - b) / (2 * _TURN) for a, b in zip(left, right, strict=True)]
        by_bias = self._changed(setting, [node.by_bias(setting.bias_um) for node in self._behind(setting)])
        turn, bias = self._taken(setting, [by_turn, by_bias], self._few)
        shift = _SHIFT_PX * self.camera.pixel_um
        steps = {"x_um": shift, "y_um": shift, "scale": _SCALE}
        slopes = {"turn_rad": turn, BIAS: bias}
        slopes |= {key: self._moved(setting, here, key, step) for key, step in steps.items()}
        if setting.lamp is not None:
            x_um, y_um, share = setting.lamp.x_um, setting.lamp.y_um, setting.lamp.share
            there = replace(setting, x_um=setting.x_um + x_um, y_um=setting.y_um + y_um, lamp=None)
            for key in ("x_um", "y_um"):
                slopes[f"lamp_{key}"] = [share * slope for slope in self._moved(there, here, key, shift)]
            slopes["lamp_share"] = self.pictures(there)
        return slopes

    @cached_property
    def _three(self) -> Floats:
        """Lines between which the lens's errors are told for all others, by their inverse wavelengths."""
        every = np.concatenate([lines.wavelengths_nm for lines in self.light.values()])
        ends = 1 / np.array([every.max(), every.min()])
        if ends[1] - ends[0] < 1e-9 * ends[0]:
            return every[:1]
        return 1 / np.array([ends[0], ends.mean(), ends[1]])

    def _nodes(self, setting: Setting) -> Floats:
        return self._three if setting.terms else self._three[:1]

    def _waves(self, wavelength_nm: float) -> float:
        """Waves at a line for each at the camera's first."""
        return self.camera.wavelengths_nm[0] / wavelength_nm

    def _behind(self, setting: Setting) -> list[LensField]:
        # A picture of another bias, or of a term that is still 0, is seen through the same lens.
        nodes = self._nodes(setting)
        key = nodes.size, tuple(term for term in setting.terms if term[1])
        if key not in self._lens:
            self._lens.clear()
            self._lens[key] = [
                self._field.behind([(term, value * self._waves(float(line))) for term, value in key[1]])
                for line in nodes
            ]
        return self._lens[key]

    def _fields(self, setting: Setting) -> list[Complexes]:
        key = setting.bias_um, setting.terms
        if key not in self._amplitude:
            self._amplitude.clear()
            self._amplitude[key] = [node.field(setting.bias_um) for node in self._behind(setting)]
        return self._amplitude[key]

    def _intensities(self, setting: Setting) -> list[Floats]:
        # A picture that is only moved or stretched is of the same light.
        key = setting.turn_rad, setting.bias_um, setting.terms
        if key not in self._last:
            self._last.clear()
            self._last[key] = [turned(self._intensity(field), setting.turn_rad) for field in self._fields(setting)]
        return self._last[key]

    def _intensity(self, field: Complexes) -> Floats:
        return np.asarray((field.real**2 + field.imag**2) / self._field.energy_um2)

    def _changed(
        self, setting: Setting, by: Sequence[Complexes], factors: Sequence[float] | None = None
    ) -> list[Floats]:
        """Change of the intensity at each node with that of the field, times a factor of the node."""
        factors = factors or [1.0] * len(by)
        flat = (
            2 * factor / self._field.energy_um2 * (here.real * change.real + here.imag * change.imag)
            for here, change, factor in zip(self._fields(setting), by, factors, strict=True)
        )
        return [turned(picture, setting.turn_rad) for picture in flat]

    def _moved(self, setting: Setting, seen: list[Floats], key: str, step: float) -> list[Floats]:
        ahead, behind = (
            self._taken(replace(setting, **{key: getattr(setting, key) + sign * step}), [seen], self._few)[0]
            for sign in (1, -1)
        )
        return [(a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True)]

    def _taken(
        self, setting: Setting, given: Sequence[list[Floats]], light: Mapping[str, Spectrum]
    ) -> list[list[Floats]]:
        """Pixels of several intensities, each told at the nodes, in the light of all lamps; [given][grid of pixels]."""
        nodes, lamp = self._nodes(setting), setting.lamp
        lights = [(0.0, 0.0, 1.0), *([(lamp.x_um, lamp.y_um, lamp.share)] if lamp else ())]
        taken = [[np.zeros((pixel.y_um.size, pixel.x_um.size)) for pixel in self.pixels] for _ in given]
        samples = given[0][0].shape[0]
        for colour, lines in light.items():
            mine = [k for k, each in enumerate(self.pixels) if each.colour == colour]
            for line, weight in zip(lines.wavelengths_nm, lines.weights, strict=True):
                at_line = [_between(nodes, intensities, float(line)) for intensities in given]
                stretch = (1 + setting.scale) / (line * UM_PER_NM * self.camera.focal_um)
                width = self.camera.pixel_um * stretch / self._step
                for k, (right_um, up_um, share) in product(mine, lights):
                    x_um = self.pixels[k].x_um - setting.x_um - right_um
                    y_um = self.pixels[k].y_um - setting.y_um - up_um
                    across, up = (self._means(samples, um, stretch / self._step, width) for um in (x_um, y_um))
                    factor = share * weight * (self.camera.pixel_um * stretch) ** 2
                    for total, intensity in zip(taken, at_line, strict=True):
                        total[k] += factor * (up @ intensity @ across.T)
        return taken

    def _means(self, samples: int, centres_um: Floats, stretch: float, width: float) -> Floats:
        """Matrix of means over pixels, of light from all over the source; ``stretch`` in samples a micrometre."""
        offsets, weights = gaussian_nodes(self.light_um * stretch)
        parts = (
            weight * pixel_means(samples, centres_um * stretch + offset, width)
            for offset, weight in zip(offsets, weights, strict=True)
        )
        return np.asarray(sum(parts))


def gathered(lines: Spectrum, camera: Camera, reach_um: float) -> Spectrum:
    """Lines of a spectrum brought together where they part a picture by less than a speckle within a reach."""
    order = np.argsort(lines.wavelengths_nm)
    wavelengths, weights = lines.wavelengths_nm[order], lines.weights[order]
    apart_nm = _SPECKLES_APART * float(wavelengths.min()) ** 2 * UM_PER_NM * camera.focal_um
    apart_nm /= camera.stop.diameter_um * reach_um
    group = np.floor((wavelengths - wavelengths[0]) / apart_nm).astype(np.intp)
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    total = np.add.reduceat(weights, starts)
    lit = total > 0
    middle = np.add.reduceat(weights * wavelengths, starts)[lit] / total[lit]
    return Spectrum(middle, total[lit] / total[lit].sum(), lines.name)


def _between(nodes: Floats, values: Sequence[Floats], wavelength_nm: float) -> Floats:
    if len(values) == 1:
        return values[0]
    place, at = 1 / nodes, 1 / wavelength_nm
    shares = [
        math.prod((at - place[j]) / (place[k] - place[j]) for j in range(place.size) if j != k)
        for k in range(place.size)
    ]
    return np.asarray(sum(share * value for share, value in zip(shares, values, strict=True)))
