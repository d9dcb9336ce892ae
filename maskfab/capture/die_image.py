"""The picture of a point light that a camera takes through a die, and how it changes with all that is not known of it.

A lens without errors makes one picture of all colours, in frequencies; its errors, told as a path, change that smoothly
with the wavelength, so that three lines of it stand for all others between them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.capture.die_field import DieField, LensField
from maskfab.capture.resampling import MARGIN, OVERSAMPLING, gaussian_nodes, pixel_means, turned
from maskfab.model import Camera, Panel, orient
from maskfab.optics.image.spectrum import Spectrum
from maskfab.optics.pupil.aperture import Aperture, panel_aperture
from maskfab.optics.pupil.pupil import cut
from maskfab.units import UM_PER_NM

_SPECKLES_APART = 0.8
"""Speckles at the window's edge by which lines that stand for all of a band may move its slopes."""
GEOMETRY = ("x_um", "y_um", "turn_rad", "scale")
BIAS = "bias_um"
_SHIFT_PX, _TURN, _SCALE = 0.02, 1e-3, 1e-4
"""Steps by which the picture is moved, turned and stretched for its slopes."""
_SPARE_PX = 4
"""Pixels by which a light may be found off the middle of the window, and the window stretched."""


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

    @property
    def names(self) -> tuple[str, ...]:
        """Of all that is not known, in the order of :attr:`values`."""
        return (*GEOMETRY, BIAS, *(f"z{term}" for term, _ in self.terms))

    @property
    def values(self) -> Floats:
        return np.array([self.x_um, self.y_um, self.turn_rad, self.scale, self.bias_um, *(w for _, w in self.terms)])

    def at(self, values: Floats) -> Setting:
        """This setting with other values."""
        known = dict(zip((*GEOMETRY, BIAS), map(float, values), strict=False))
        terms = zip((term for term, _ in self.terms), map(float, values[len(known) :]), strict=True)
        return Setting(**known, terms=tuple(terms))


@dataclass(frozen=True, eq=False)
class Pixels:
    """Pixels of one colour of a sensor, on a grid of their own.

    Attributes:
        colour: of their filter.
        x_um, y_um: their middles, y upwards; [columns] and [rows], each in the order of the picture.
    """

    colour: str
    x_um: Floats
    y_um: Floats


@dataclass(frozen=True, eq=False)
class DieImage:
    """A die, one way round, before a camera.

    Attributes:
        panel: of the die.
        way_round: element of D4 that takes it to how it stands.
        camera: its lens and its pixel.
        light: what each colour of pixels sees of a point light.
        pixels: for which pictures are made.
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
    _last: dict[tuple[object, ...], list[Floats]] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls, panel: Panel, way_round: int, camera: Camera, light: Mapping[str, Spectrum], pixels: Sequence[Pixels]
    ) -> DieImage:
        """The image of a die.

        Args:
            panel: of the die, its middle on the axis.
            way_round: element of D4 that takes the die as drawn to how it stands, as of :func:`maskfab.model.orient`.
            camera: its lens and its pixel.
            light: what each colour of pixels sees of a point light.
            pixels: for which pictures are made.
        """
        openings = panel_aperture(panel, camera.stop.diameter_um / 2)
        x, y = (openings.x, openings.y) if way_round % 2 == 0 else (openings.y, openings.x)
        held = Aperture(x, y, orient(openings.transmission, way_round), orient(openings.variance, way_round))
        step = 1 / (2 * camera.stop.diameter_um * OVERSAMPLING)
        shortest = min(float(lines.wavelengths_nm.min()) for lines in light.values()) * UM_PER_NM
        half = max(abs(axis).max() for each in pixels for axis in (each.x_um, each.y_um)) + _SPARE_PX * camera.pixel_um
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
        (pictures,) = self._taken(setting, [self._intensities(setting)], self.light)
        return pictures

    def slopes(self, setting: Setting) -> list[list[Floats]]:
        """Changes of pictures with everything that a setting names, in its order; of as few lines as show them."""
        behind = self._behind(setting)
        here = [each.field(setting.bias_um) for each in behind]
        flat = [self._intensity(each) for each in here]
        seen = [turned(each, setting.turn_rad) for each in flat]
        left, right = ([turned(each, setting.turn_rad + sign * _TURN) for each in flat] for sign in (1, -1))
        changes = [[(a - b) / (2 * _TURN) for a, b in zip(left, right, strict=True)]]
        changes.append(self._changed(setting, here, [each.by_bias(setting.bias_um) for each in behind]))
        for term, _ in setting.terms:
            by_term = [
                self._waves(float(line)) * each.by_term(term)
                for line, each in zip(self._nodes(setting), behind, strict=True)
            ]
            changes.append(self._changed(setting, here, by_term))
        turn, bias, *terms = self._taken(setting, changes, self._few)
        across, up, scale = (self._moved(setting, seen, key, step) for key, step in self._steps.items())
        return [across, up, turn, scale, bias, *terms]

    @cached_property
    def _steps(self) -> dict[str, float]:
        step = _SHIFT_PX * self.camera.pixel_um
        return {"x_um": step, "y_um": step, "scale": _SCALE}

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
        key = nodes.size, tuple(each for each in setting.terms if each[1])
        if key not in self._lens:
            self._lens.clear()
            self._lens[key] = [
                self._field.behind([(term, value * self._waves(float(line))) for term, value in key[1]])
                for line in nodes
            ]
        return self._lens[key]

    def _intensities(self, setting: Setting) -> list[Floats]:
        # A picture that is only moved or stretched is of the same light.
        key = setting.turn_rad, setting.bias_um, setting.terms
        if key not in self._last:
            self._last.clear()
            self._last[key] = [
                turned(self._intensity(each.field(setting.bias_um)), setting.turn_rad) for each in self._behind(setting)
            ]
        return self._last[key]

    def _intensity(self, field: NDArray[np.complex128]) -> Floats:
        return np.asarray((field.real**2 + field.imag**2) / self._field.energy_um2)

    def _changed(
        self, setting: Setting, here: Sequence[NDArray[np.complex128]], by: Sequence[NDArray[np.complex128]]
    ) -> list[Floats]:
        """Change of the intensity at each line with that of the field."""
        flat = (2 * (a.real * b.real + a.imag * b.imag) / self._field.energy_um2 for a, b in zip(here, by, strict=True))
        return [turned(each, setting.turn_rad) for each in flat]

    def _moved(self, setting: Setting, seen: list[Floats], key: str, step: float) -> list[Floats]:
        ahead, behind = (
            self._taken(replace(setting, **{key: getattr(setting, key) + sign * step}), [seen], self._few)[0]
            for sign in (1, -1)
        )
        return [(a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True)]

    def _taken(
        self, setting: Setting, given: Sequence[list[Floats]], light: Mapping[str, Spectrum]
    ) -> list[list[Floats]]:
        """Pixels of several intensities, each told at the nodes; [given][grid of pixels]."""
        nodes = self._nodes(setting)
        found = [[np.zeros((each.y_um.size, each.x_um.size)) for each in self.pixels] for _ in given]
        samples = given[0][0].shape[0]
        for colour, lines in light.items():
            mine = [k for k, each in enumerate(self.pixels) if each.colour == colour]
            for line, weight in zip(lines.wavelengths_nm, lines.weights, strict=True):
                at_line = [_between(nodes, intensities, float(line)) for intensities in given]
                stretch = (1 + setting.scale) / (line * UM_PER_NM * self.camera.focal_um)
                width = self.camera.pixel_um * stretch / self._step
                for k in mine:
                    each = self.pixels[k]
                    across = self._means(samples, each.x_um - setting.x_um, stretch / self._step, width)
                    up = self._means(samples, each.y_um - setting.y_um, stretch / self._step, width)
                    factor = weight * (self.camera.pixel_um * stretch) ** 2
                    for total, intensity in zip(found, at_line, strict=True):
                        total[k] += factor * (up @ intensity @ across.T)
        return found

    def _means(self, samples: int, centres_um: Floats, stretch: float, width: float) -> Floats:
        """Matrix of means over pixels, of light from all over the source; ``stretch`` in samples a micrometre."""
        offsets, weights = gaussian_nodes(self.light_um * stretch)
        parts = (
            weight * pixel_means(samples, centres_um * stretch + offset, width)
            for offset, weight in zip(offsets, weights, strict=True)
        )
        return np.asarray(sum(parts))


def gathered(lines: Spectrum, camera: Camera, reach_um: float) -> Spectrum:
    """Lines of a spectrum brought together where they part a picture by less than a speckle within a reach.

    Args:
        lines: of the light.
        camera: behind whose stop a speckle is as wide as wavelength x focal length / diameter.
        reach_um: distance from the middle of the picture.
    """
    order = np.argsort(lines.wavelengths_nm)
    wavelengths, weights = lines.wavelengths_nm[order], lines.weights[order]
    apart_nm = _SPECKLES_APART * float(wavelengths.min()) ** 2 * UM_PER_NM * camera.focal_um
    apart_nm /= camera.stop.diameter_um * reach_um
    group = np.floor((wavelengths - wavelengths[0]) / apart_nm).astype(np.intp)
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    total = np.add.reduceat(weights, starts)
    kept = total > 0
    middle = np.add.reduceat(weights * wavelengths, starts)[kept] / total[kept]
    return Spectrum(middle, total[kept] / total[kept].sum(), lines.name)


def _between(nodes: Floats, values: Sequence[Floats], wavelength_nm: float) -> Floats:
    """A polynomial in the inverse wavelength through values at its nodes."""
    if len(values) == 1:
        return values[0]
    place, at = 1 / nodes, 1 / wavelength_nm
    shares = [
        math.prod((at - place[j]) / (place[k] - place[j]) for j in range(place.size) if j != k)
        for k in range(place.size)
    ]
    return np.asarray(sum(share * each for share, each in zip(shares, values, strict=True)))
