"""The picture of a point light that a camera takes through a die, and how it changes with all that is not known of it.

A lens without errors makes one picture of all colours, in frequencies; its errors, told as a path, change that smoothly
with the wavelength, so that three lines of it stand for all others between them.

On a grid of dots with transmission t the field is T = Σ t exp(2πi W) w² sinc(uw) sinc(vw) exp(-2πi (ux + vy)), the
phase W taken at the middle of each dot. Clear features that are wider by β, half of it on each side, hold strips along
all their edges. A strip's transform is that of its middle; that of all edges, those to the right less those to the
left, is -2πiu T. So along each axis a wider T is exactly

    cos(πuβ) T + β/2 sinc(uβ) E,

E the field of the edges between clear and closed; both axes together add β²/4 times that of the corners.
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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import TypeVar

import numpy as np
import scipy

from maskfab.base.arrays import Complexes, Floats, Mask
from maskfab.base.model import Panel
from maskfab.base.units import UM_PER_NM
from maskfab.camera.inspection.bench import (
    AXIAL,
    AXIAL_BEND,
    FULL,
    LATERAL,
    OF_PUPIL,
    PER_NM,
    STEPS,
    in_band,
    light_transfer,
    opened,
    within,
)
from maskfab.job.camera import Camera, Stop
from maskfab.optics.phase import zernike
from maskfab.optics.polynomials import gauss_legendre, spherical_bessel
from maskfab.optics.pupil import Pupil
from maskfab.optics.spectrum import Spectrum

OVERSAMPLING = 1.3
"""Samples on a grid for each that the picture's limit asks for."""
MARGIN = 24
"""Samples that a grid must hold beyond the outermost pixel."""
_K = TypeVar("_K")
_V = TypeVar("_V")
_WIDTH = math.sqrt(MARGIN / (math.pi * (1 - 1 / OVERSAMPLING)))
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
    # One sine serves all samples about a place: from one to the next it changes its sign.
    near = np.where(off_px == 0, 1e-300, off_px)
    sines = np.sin(np.pi * off_px[..., :1]) * (1 - 2 * (offsets % 2)) / np.pi
    values = np.where(off_px == 0, 1.0, sines / near) * np.exp(-(off_px**2) / (2 * _WIDTH**2)) * (weights[:, None] / 2)
    columns = first[..., None] + offsets + samples // 2
    rows = np.broadcast_to(np.arange(centres.size)[:, None, None], columns.shape)
    held = (columns >= 0) & (columns < samples)
    parts = (values[held], (rows[held], columns[held]))
    return scipy.sparse.coo_array(parts, shape=(centres.size, samples)).toarray()  # type: ignore[no-any-return]


def smoothed(picture: Floats, per_um: float, transfer: Callable[[Floats], Floats]) -> Floats:
    """A picture [n, n] of so many samples a micrometre in a light of some transfer, dark beyond its ends."""
    size = scipy.fft.next_fast_len(picture.shape[0] + 2 * MARGIN, real=True)
    up, across = per_um * np.fft.fftfreq(size)[:, None], per_um * np.fft.rfftfreq(size)
    spectrum = scipy.fft.rfft2(picture, (size, size)) * transfer(np.hypot(up, across))
    return scipy.fft.irfft2(spectrum, (size, size))[: picture.shape[0], : picture.shape[1]]  # type: ignore[no-any-return]


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
    _clear: Mask
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
    def of(cls, pupil: Pupil, stop: Stop, frequencies: Floats, clear: Mask | None = None) -> DieField:
        """The field of a pupil at these frequencies.

        Args:
            stop: in whose radii errors of the lens are told.
            clear: dots that are open whether the stop hides them or not; those of the pupil where nothing is said.
        """
        dots = np.array(pupil.mean_transmission)
        edges_x, edges_y = pupil.x.edges_um(), pupil.y.edges_um()
        x, y = (edges_x[1:] + edges_x[:-1]) / 2, (edges_y[1:] + edges_y[:-1]) / 2
        wide_x, wide_y = pupil.x.dot_um, pupil.y.dot_um
        rim, radius = _rim(pupil, x, y, frequencies), stop.diameter_um / 2
        # Of a die off the axis most cells may lie beyond the stop.
        lit = [np.flatnonzero((dots > 0).any(axis=axis)) for axis in (1, 0)]
        (low, high), (left, right) = ((held[0], held[-1] + 1) if held.size else (0, 1) for held in lit)
        box, up, across = np.s_[low:high, left:right], slice(low, high + 1), slice(left, right + 1)
        clear = np.asarray(dots > 0 if clear is None else clear)[box]
        dots, x, y, edges_x, edges_y = dots[box], x[left:right], y[low:high], edges_x[across], edges_y[up]
        waves = _waves(x, frequencies, wide_x), _waves(y, frequencies, wide_y)
        lines = _waves(edges_x, frequencies), _waves(edges_y, frequencies)
        return cls(pupil.energy_um2, frequencies, dots, clear, rim, x, y, edges_x, edges_y, radius, *waves, *lines)

    @cached_property
    def _outline(self) -> tuple[Floats, Floats, Floats]:
        """Weights of upright edges, level ones, and corners."""
        dots, clear = self._dots, self._clear.astype(np.float64)
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

    def widened(self, bias_um: float) -> tuple[Floats, Floats]:
        """Factors of waves, [2 n], along an axis: of dots, and of the lines along which they grow by half a bias."""
        phase = np.tile(self.frequencies, 2) * bias_um
        return np.asarray(np.cos(np.pi * phase)), np.asarray(np.sinc(phase))

    def field(
        self, rows: Complexes | Floats, lines: Complexes | Floats | None = None, bias_um: float = 0.0
    ) -> Complexes:
        """Field [2 n - 1, 2 n - 1] of waves along x of every row of dots, and of every line between two rows."""
        if lines is None:
            return _crossed(self._along_y, rows)
        dots, edges = self.widened(bias_um)
        waves = np.concatenate([self._along_y * dots, self._lines_y * edges])
        return _crossed(waves, np.concatenate([rows, lines]))


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
        half, (dots, edges) = bias_um / 2, self.die.widened(bias_um)
        rows, lines = self._dots * dots + half * upright * edges, half * level * dots + half**2 * corners * edges
        return self.die.field(rows, lines, bias_um) + self._rim

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
_KEPT, _KEPT_MEANS = 3, 24
"""Fields that are kept: a slope goes to either side of one."""
_NODES_BETWEEN = 3
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
        bench: pairs of a name of :mod:`maskfab.camera.inspection.bench` and a value, of all that is sought of it.
    """

    x_um: float = 0.0
    y_um: float = 0.0
    turn_rad: float = 0.0
    scale: float = 0.0
    bias_um: float = 0.0
    terms: tuple[tuple[int, float], ...] = ()
    lamp: Lamp | None = None
    bench: tuple[tuple[str, float], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all that is not known, in the order of :attr:`values`."""
        sought = *(LAMP if self.lamp else ()), *(name for name, _ in self.bench)
        return (*GEOMETRY, BIAS, *sought, *(f"z{term}" for term, _ in self.terms))

    @property
    def values(self) -> Floats:
        lamp = () if self.lamp is None else (self.lamp.x_um, self.lamp.y_um, self.lamp.share)
        stand = self.x_um, self.y_um, self.turn_rad, self.scale, self.bias_um
        return np.array([*stand, *lamp, *(value for _, value in self.bench), *(waves for _, waves in self.terms)])

    def at(self, values: Floats) -> Setting:
        """This setting with other values, those of the bench as near as they can be."""
        rest = list(map(float, values))
        stand = {name: rest.pop(0) for name in (*GEOMETRY, BIAS)}
        lamp = self.lamp and Lamp(*(rest.pop(0) for _ in LAMP))
        bench = tuple((name, within(name, rest.pop(0))) for name, _ in self.bench)
        return Setting(
            **stand, terms=tuple(zip((term for term, _ in self.terms), rest, strict=True)), lamp=lamp, bench=bench
        )

    def beside(self, bench: Mapping[str, float]) -> Setting:
        """This setting with values of the bench, added or in place of those that it has, as near as they can be."""
        values = {**dict(self.bench), **bench}
        return replace(self, bench=tuple((name, within(name, value)) for name, value in values.items()))

    @property
    def of_a_point(self) -> Setting:
        """This setting in the light of one point, whose lines are as stated: as it stands before other scenes."""
        bench = tuple((name, value) for name, value in self.bench if name not in FULL)
        return replace(self, lamp=None, bench=bench)

    @property
    def told(self) -> Setting:
        """This setting without what is 0 anyway."""
        terms = tuple(pair for pair in self.terms if pair[1])
        return replace(self, terms=terms, bench=tuple(pair for pair in self.bench if pair[1]))


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
    """

    panel: Panel
    way_round: int
    camera: Camera
    light: Mapping[str, Spectrum]
    pixels: tuple[Pixels, ...]
    _frequencies: Floats
    _half_um: float
    _few: Mapping[str, Spectrum]
    _dies: dict[tuple[float, ...], DieField] = field(default_factory=dict, repr=False)
    _lens: dict[tuple[object, ...], list[LensField]] = field(default_factory=dict, repr=False)
    _amplitude: dict[tuple[object, ...], list[Complexes]] = field(default_factory=dict, repr=False)
    _last: dict[tuple[object, ...], list[Floats]] = field(default_factory=dict, repr=False)
    _along: dict[tuple[float, ...], Floats] = field(default_factory=dict, repr=False)
    _sloping: dict[Setting, dict[str, list[Floats]]] = field(default_factory=dict, repr=False)

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
        """The image of a die; another lamp may lie ``off_um`` from the lamps' origin along an axis."""
        step = 1 / (2 * camera.stop.diameter_um * OVERSAMPLING)
        shortest = min(float(lines.wavelengths_nm.min()) for lines in light.values()) * UM_PER_NM
        half = off_um + _SPARE_PX * camera.pixel_um
        half += max(abs(axis).max() for pixel in pixels for axis in (pixel.x_um, pixel.y_um))
        count = math.ceil(half / (shortest * camera.focal_um) / step) + MARGIN
        few = {colour: gathered(lines, camera, half) for colour, lines in light.items()}
        frequencies = step * np.arange(count + 1, dtype=np.float64)
        return cls(panel, way_round, camera, dict(light), tuple(pixels), frequencies, half, few)

    @property
    def transmission(self) -> float:
        """Share of the stop's light that passes the die as drawn."""
        return self._die(Setting()).energy_um2 / self.camera.stop.area_um2

    @property
    def _step(self) -> float:
        return float(self._frequencies[1])

    def _die(self, setting: Setting) -> DieField:
        bench = dict(setting.bench)
        key = tuple(bench.get(name, 0.0) for name in OF_PUPIL)

        def made() -> DieField:
            before = opened(self.panel, self.way_round, self.camera.stop, bench, _RIM_DEGREE + 1)
            return DieField.of(before.pupil, self.camera.stop, self._frequencies, before.clear)

        return _kept(self._dies, key, made)

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
        key = setting.told
        if key not in self._sloping:
            self._sloping.clear()
            self._sloping[key] = self._stand_slopes(setting)
        known = self._sloping[key]
        known.update((name, self._by_bench(setting, name)) for name, _ in setting.bench if name not in known)
        asked = [term for term, _ in setting.terms if f"z{term}" not in known]
        if asked:
            waves, behind = [self._waves(float(line)) for line in self._nodes(setting)], self._behind(setting)
            by_terms = [self._changed(setting, [node.by_term(term) for node in behind], waves) for term in asked]
            named = (f"z{term}" for term in asked)
            known.update(zip(named, self._taken(setting, by_terms, self._few), strict=True))
        return [known[name] for name in setting.names]

    def _by_bench(self, setting: Setting, name: str) -> list[Floats]:
        value = dict(setting.bench).get(name, 0.0)
        there = within(name, value + STEPS[name])
        step = there - value if there > value else -STEPS[name]
        ahead, here = (
            self._taken(at, [self._intensities(at)], self._few)[0]
            for at in (setting.beside({name: value + step}), setting)
        )
        return [(a - b) / step for a, b in zip(ahead, here, strict=True)]

    def _stand_slopes(self, setting: Setting) -> dict[str, list[Floats]]:
        """Changes with place, turn, scale, bias, and with another lamp."""
        energy = self._die(setting).energy_um2
        here, flat = self._intensities(setting), [_intensity(field, energy) for field in self._fields(setting)]
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
        if np.unique(every).size <= _NODES_BETWEEN:
            return np.unique(every)
        return 1 / np.array([ends[0], ends.mean(), ends[1]])

    def _nodes(self, setting: Setting) -> Floats:
        return self._three if setting.terms or any(self._focus(setting)) else self._three[:1]

    def _focus(self, setting: Setting) -> tuple[float, float]:
        """Waves of defocus at the camera's first line for each nanometre from it, and for each square of it."""
        bench = dict(setting.bench)
        return (bench.get(AXIAL, 0.0) * PER_NM, bench.get(AXIAL_BEND, 0.0) * PER_NM**2)

    def _waves(self, wavelength_nm: float) -> float:
        """Waves at a line for each at the camera's first."""
        return self.camera.wavelengths_nm[0] / wavelength_nm

    def _behind(self, setting: Setting) -> list[LensField]:
        # A picture of another bias, or of a term that is still 0, is seen through the same lens.
        nodes, die, focus = self._nodes(setting), self._die(setting), self._focus(setting)
        terms = setting.told.terms
        return _kept(
            self._lens,
            (nodes.size, die, terms, focus),
            lambda: [die.behind(self._seen_at(float(line), dict(terms), focus)) for line in nodes],
        )

    def _seen_at(self, line_nm: float, terms: dict[int, float], focus: tuple[float, float]) -> list[tuple[int, float]]:
        off = line_nm - self.camera.wavelengths_nm[0]
        shifted = focus[0] * off + focus[1] * off**2
        if shifted:
            terms = {**terms, DEFOCUS: terms.get(DEFOCUS, 0.0) + shifted}
        return [(term, value * self._waves(line_nm)) for term, value in terms.items()]

    def _fields(self, setting: Setting) -> list[Complexes]:
        behind = self._behind(setting)
        key = setting.bias_um, tuple(behind)
        return _kept(self._amplitude, key, lambda: [node.field(setting.bias_um) for node in behind])

    def _intensities(self, setting: Setting) -> list[Floats]:
        # A picture that is only moved or stretched is of the same light.
        key, energy = (setting.turn_rad, setting.bias_um, tuple(self._behind(setting))), self._die(setting).energy_um2
        return _kept(
            self._last,
            key,
            lambda: [turned(_intensity(field, energy), setting.turn_rad) for field in self._fields(setting)],
        )

    def _changed(
        self, setting: Setting, by: Sequence[Complexes], factors: Sequence[float] | None = None
    ) -> list[Floats]:
        """Change of the intensity at each node with that of the field, times a factor of the node."""
        factors = factors or [1.0] * len(by)
        flat = (
            2 * factor / self._die(setting).energy_um2 * (here.real * change.real + here.imag * change.imag)
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
        bench, first = dict(setting.bench), self.camera.wavelengths_nm[0]
        transfer = light_transfer(bench)
        for colour, stated in light.items():
            mine = [k for k, each in enumerate(self.pixels) if each.colour == colour]
            apart = _apart_nm(stated, self.camera, self._half_um) / _SPECKLES_APART
            lines = in_band(stated, bench, apart)
            for line, weight in zip(lines.wavelengths_nm, lines.weights, strict=True):
                at_line = [_between(nodes, intensities, float(line)) for intensities in given]
                stretch = (1 + setting.scale) / (line * UM_PER_NM * self.camera.focal_um)
                width = self.camera.pixel_um * stretch / self._step
                if transfer is not None:
                    at_line = [smoothed(intensity, stretch / self._step, transfer) for intensity in at_line]
                off_x, off_y = (bench.get(name, 0.0) * PER_NM * (line - first) for name in LATERAL)
                for k, (right_um, up_um, share) in product(mine, lights):
                    x_um = self.pixels[k].x_um - setting.x_um - right_um - off_x
                    y_um = self.pixels[k].y_um - setting.y_um - up_um - off_y
                    across, up = (self._means(samples, um, stretch / self._step, width) for um in (x_um, y_um))
                    factor = share * weight * (self.camera.pixel_um * stretch) ** 2
                    for total, intensity in zip(taken, at_line, strict=True):
                        total[k] += factor * (up @ intensity @ across.T)
        return taken

    def _means(self, samples: int, centres_um: Floats, stretch: float, width: float) -> Floats:
        """Matrix of means over pixels; of a picture that is moved along one axis the other axis has the same."""
        key = samples, float(centres_um[0]), float(centres_um[-1]), centres_um.size, stretch
        return _kept(self._along, key, lambda: pixel_means(samples, centres_um * stretch, width), _KEPT_MEANS)


def _intensity(field: Complexes, energy_um2: float) -> Floats:
    return np.asarray((field.real**2 + field.imag**2) / max(energy_um2, 1e-300))


def _kept(kept: dict[_K, _V], key: _K, made: Callable[[], _V], most: int = _KEPT) -> _V:
    """The value under a key, made where it is not; beside it are kept those that were asked for last."""
    value = kept.pop(key) if key in kept else made()
    while len(kept) >= most:
        kept.pop(next(iter(kept)))
    kept[key] = value
    return value


def _apart_nm(lines: Spectrum, camera: Camera, reach_um: float) -> float:
    shortest = float(lines.wavelengths_nm.min())
    apart_nm = _SPECKLES_APART * shortest**2 * UM_PER_NM * camera.focal_um
    return apart_nm / (camera.stop.diameter_um * reach_um)


def gathered(lines: Spectrum, camera: Camera, reach_um: float) -> Spectrum:
    """Lines of a spectrum brought together where they part a picture by less than a speckle within a reach."""
    order = np.argsort(lines.wavelengths_nm)
    wavelengths, weights = lines.wavelengths_nm[order], lines.weights[order]
    group = np.floor((wavelengths - wavelengths[0]) / _apart_nm(lines, camera, reach_um)).astype(np.intp)
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
