"""Captures of a point light, and records of scenes, through a die: a simulator that shares no optics with the package.

The field behind the stop is summed by matrices over the die's dots, each with its exact transform, and over strips of
those that a round stop cuts; its square is integrated over every pixel by Gauss and Legendre's nodes. What a camera
adds comes after that: dust, drift, banding, noise, blooming, codes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import factorial

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from scipy import signal, special

from maskfab.base.model import Panel
from maskfab.camera.frames.frame import Frame, Pattern

Floats = NDArray[np.float64]
_STRIP_UM, _NODES = 0.5, 5


@dataclass(frozen=True, eq=False)
class Dots:
    """Transmission [ny, nx] between edges along x and y (ascending, um), the optical axis at 0."""

    x_um: Floats
    y_um: Floats
    clear: Floats

    @classmethod
    def of(cls, panel: Panel) -> Dots:
        """Dots of a panel without tracks."""
        side, dots, gutter = panel.dot_nm / 1e3, panel.opening.dots, panel.gutter_nm / 1e3
        cells = np.stack([[panel.pattern(cell) for cell in row] for row in panel.orientations])
        held = np.pad(cells, ((0, 0), (0, 0), (0, gutter > 0), (0, gutter > 0)))
        rows, columns, high, wide = held.shape
        edges = [
            (np.arange(count)[:, None] - count / 2) * (dots * side + gutter) + gutter / 2 + side * np.arange(dots + 1)
            for count in (columns, rows)
        ]
        x, y = (axis.ravel() if gutter else np.append(axis[:, :-1], axis[-1, -1]) for axis in edges)
        clear = held.transpose(0, 2, 1, 3).reshape(rows * high, columns * wide).astype(np.float64)
        return cls(x, y, clear[: y.size - 1, : x.size - 1])

    def within(self, half_um: float) -> Dots:
        """Dots nearer to the axis than so."""
        kept = [np.flatnonzero((axis[1:] > -half_um) & (axis[:-1] < half_um)) for axis in (self.x_um, self.y_um)]
        (left, right), (low, high) = ((held[0], held[-1] + 1) for held in kept)
        return Dots(self.x_um[left : right + 1], self.y_um[low : high + 1], self.clear[low:high, left:right])

    def moved(self, x_um: float, y_um: float) -> Dots:
        """The die off the axis."""
        return Dots(self.x_um + x_um, self.y_um + y_um, self.clear)

    def grown(self, bias_um: float) -> Dots:
        """Clear features wider by so much, half of it at each edge: every edge becomes a strip of its own."""
        if not bias_um:
            return self
        clear = self.clear
        for axis in (0, 1):
            moved = clear if axis == 0 else clear.T
            beside = np.pad(moved, ((1, 1), (0, 0)))
            strips = np.maximum(beside[:-1], beside[1:]) if bias_um > 0 else np.minimum(beside[:-1], beside[1:])
            wide = np.empty((2 * len(moved) + 1, moved.shape[1]))
            wide[::2], wide[1::2] = strips, moved
            clear = wide if axis == 0 else wide.T
        half = abs(bias_um) / 2
        x, y = (np.stack([axis - half, axis + half], axis=1).ravel() for axis in (self.x_um, self.y_um))
        return Dots(x, y, clear)


@dataclass(frozen=True)
class Optics:
    """Lens and pixels, in um and nm: weights of lines, and waves at the first of them by Noll's numbers.

    ``barrel``, if there is one, is a second circle before the stop: x, y and radius.
    """

    diameter_um: float
    focal_um: float
    pixel_um: float
    pixels: int
    lines: dict[float, float]
    terms: dict[int, float] = field(default_factory=dict)
    barrel: tuple[float, float, float] | None = None


def zernike(number: int, x: Floats, y: Floats) -> Floats:
    """Noll's term at places in radii."""
    degree = 0
    while (degree + 1) * (degree + 2) // 2 < number:
        degree += 1
    place = number - degree * (degree + 1) // 2 - 1
    order = sorted(abs(m) for m in range(-degree, degree + 1, 2))[place]
    rho, angle = np.hypot(x, y), np.arctan2(y, x)
    radial = sum(
        (-1) ** k
        * factorial(degree - k)
        / (factorial(k) * factorial((degree + order) // 2 - k) * factorial((degree - order) // 2 - k))
        * rho ** (degree - 2 * k)
        for k in range((degree - order) // 2 + 1)
    )
    turn = 1.0 if order == 0 else np.sqrt(2) * (np.cos if number % 2 == 0 else np.sin)(order * angle)
    return np.asarray(np.sqrt(degree + 1) * radial * turn)


def _waves(low: Floats, high: Floats, frequencies: Floats) -> NDArray[np.complex128]:
    """Transforms of intervals, [intervals, frequencies]."""
    width, middle = (high - low)[:, None], (high + low)[:, None] / 2
    return width * np.sinc(frequencies * width) * np.exp(-2j * np.pi * frequencies * middle)


def picture(dots: Dots, optics: Optics, at_um: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """Share of the die's light in every pixel [rows, columns], row 0 the top, of a point imaged at ``at_um``."""
    radius, first = optics.diameter_um / 2, next(iter(optics.lines))
    dots = dots.within(radius)
    x, y = dots.x_um, dots.y_um
    circles = [(0.0, 0.0, radius), *([optics.barrel] if optics.barrel else [])]
    held, met = np.ones(dots.clear.shape, dtype=bool), np.ones(dots.clear.shape, dtype=bool)
    for at_x, at_y, limit in circles:
        far, near = _distances(x - at_x, y - at_y)
        held, met = held & (far <= limit), met & (near < limit)
    whole = np.where(held, dots.clear, 0.0)
    rim = _rim(dots, ~held & met & (dots.clear > 0), circles)
    energy = (np.diff(y) @ whole**2 @ np.diff(x)) + ((rim[1] - rim[0]) * (rim[3] - rim[2]) * rim[4] ** 2).sum()
    nodes, weights = leggauss(_NODES)
    places = optics.pixel_um * (np.arange(optics.pixels)[:, None] - (optics.pixels - 1) / 2 + nodes / 2).ravel()
    total = np.zeros((optics.pixels, optics.pixels))
    for line, weight in optics.lines.items():
        scale = line * 1e-3 * optics.focal_um
        waves = {term: value * first / line for term, value in optics.terms.items()}

        def phase(across: Floats, up: Floats, waves: dict[int, float] = waves) -> NDArray[np.complex128]:
            path = sum((w * zernike(t, across / radius, up / radius) for t, w in waves.items()), np.zeros(()))
            return np.exp(2j * np.pi * path)

        u, v = (places - at_um[0]) / scale, (places[::-1] - at_um[1]) / scale
        middle_x, middle_y = (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2
        inner = whole * phase(middle_x, middle_y[:, None])
        amplitude = _waves(y[:-1], y[1:], v).T @ inner @ _waves(x[:-1], x[1:], u)
        cut = rim[4] * phase((rim[0] + rim[1]) / 2, (rim[2] + rim[3]) / 2)
        amplitude += (_waves(rim[2], rim[3], v) * cut[:, None]).T @ _waves(rim[0], rim[1], u)
        intensity = abs(amplitude) ** 2 * (optics.pixel_um / scale) ** 2 / energy
        side = optics.pixels, _NODES
        total += weight * np.einsum("ikjl,k,l->ij", intensity.reshape(*side, *side), weights / 2, weights / 2)
    return total / sum(optics.lines.values())


def _distances(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Of the farthest and of the nearest point of every dot from the origin."""
    ends = [np.stack([abs(axis[:-1]), abs(axis[1:])]) for axis in (x, y)]
    across = [(axis[:-1] < 0) & (axis[1:] > 0) for axis in (x, y)]
    near = [np.where(over, 0.0, each.min(axis=0)) for each, over in zip(ends, across, strict=True)]
    far = [each.max(axis=0) for each in ends]
    return np.hypot(far[0], far[1][:, None]), np.hypot(near[0], near[1][:, None])


def _rim(dots: Dots, cut: NDArray[np.bool_], circles: Sequence[tuple[float, float, float]]) -> Floats:
    """Strips of the dots that circles cut: low and high along x, along y, and transmission, [5, strips]."""
    strips = []
    for row, column in np.argwhere(cut):
        low, high = dots.y_um[row : row + 2]
        edges = np.linspace(low, high, max(1, round((high - low) / _STRIP_UM)) + 1)
        for one, other in pairwise(edges):
            left, right = dots.x_um[column], dots.x_um[column + 1]
            for at_x, at_y, radius in circles:
                chord = np.sqrt(max(0.0, radius**2 - ((one + other) / 2 - at_y) ** 2))
                left, right = max(left, at_x - chord), min(right, at_x + chord)
            if left < right:
                strips.append((left, right, one, other, dots.clear[row, column]))
    return np.array(strips).reshape(-1, 5).T


_SPARE = 16


def lamp_picture(
    dots: Dots, optics: Optics, width_um: float, at_um: tuple[float, float] = (0.0, 0.0), *, disc: bool = True
) -> Floats:
    """The picture of a lamp that is no point: a disc of so much width on the sensor, or a bell's at half its height.

    Pixels are taken finer than the picture's limit, and beyond the window, so that its transform is exact.
    """
    shortest = min(optics.lines) * 1e-3
    times = int(np.ceil(2.2 * optics.pixel_um * optics.diameter_um / (shortest * optics.focal_um)))
    side = optics.pixels + 2 * _SPARE
    step = optics.pixel_um / times
    fine = picture(dots, replace(optics, pixel_um=step, pixels=side * times), at_um)
    wave = np.hypot(np.fft.fftfreq(side * times, step)[:, None], np.fft.rfftfreq(side * times, step))
    if disc:
        left = np.pi * width_um * np.where(wave > 0, wave, 1.0)
        share = np.where(wave > 0, 2 * special.j1(left) / left, 1.0)
    else:
        share = np.exp(-((np.pi * width_um * wave) ** 2) / (4 * np.log(2)))
    wide = np.fft.irfft2(np.fft.rfft2(fine) * share, fine.shape)
    return wide.reshape(side, times, side, times).sum(axis=(1, 3))[_SPARE:-_SPARE, _SPARE:-_SPARE]


def flat_band(middle_nm: float, width_nm: float, count: int = 41) -> dict[float, float]:
    """Lines of equal weight that fill a band, the middle one first: it is that of the lens's waves."""
    lines = middle_nm + width_nm * ((np.arange(count) + 0.5) / count - 0.5)
    return dict.fromkeys(sorted(lines.tolist(), key=lambda line: abs(line - middle_nm)), 1 / count)


MOSAIC: Pattern = (("R", "G"), ("G", "B"))


def mosaic(colours: Mapping[str, Floats]) -> Floats:
    """What a colour sensor sees of pictures in red, green and blue."""
    seen = np.empty_like(colours["G"])
    for row, column in np.ndindex(2, 2):
        seen[row::2, column::2] = colours[MOSAIC[row][column]][row::2, column::2]
    return seen


@dataclass(frozen=True)
class Sensor:
    """Electrons and counts; ``banding_e`` is the deviation of a row's offset, ``blooms`` the passes of its spilling."""

    read_noise_e: float = 4.87
    electrons_per_count: float = 1.3
    black: float = 512.0
    white: float = 65535.0
    full_well_e: float = np.inf
    banding_e: float = 0.0
    blooms: int = 40

    def counts(self, light_e: Floats, random: np.random.Generator) -> NDArray[np.float32]:
        """One exposure of so many electrons a pixel, in mean."""
        charge = random.poisson(np.clip(light_e, 0, None)).astype(np.float64)
        for _ in range(self.blooms if np.isfinite(self.full_well_e) else 0):
            over = np.maximum(charge - self.full_well_e, 0.0)
            if not over.any():
                break
            charge -= over
            charge[1:] += over[:-1] / 2
            charge[:-1] += over[1:] / 2
        charge = np.minimum(charge, self.full_well_e)
        rows = random.normal(0, self.banding_e, (len(charge), 1)) if self.banding_e else 0.0
        charge = charge + rows + random.normal(0, self.read_noise_e, charge.shape)
        whole = np.rint(charge / self.electrons_per_count + self.black)
        return np.clip(whole, 0, self.white).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Stack:
    """Exposures: ``light`` [pixels, pixels], or one for each; ``dust`` and ``drift`` are factors."""

    light: Floats | Sequence[Floats]
    times: tuple[float, ...] = (1.0, 4.0, 16.0, 64.0)
    peak_e: float = 1e4
    beneath_e: float = 1.0
    dust: Floats | None = None
    drift: tuple[float, ...] | None = None
    sensor: Sensor = Sensor()
    pattern: Pattern | None = None

    def frames(self, seed: int) -> list[Frame]:
        """Frames as a camera would hand them over, the first with ``peak_e`` electrons at its peak for time 1."""
        random, sensor = np.random.default_rng(seed), self.sensor
        lights = [self.light] * len(self.times) if isinstance(self.light, np.ndarray) else self.light
        black = (sensor.black,) * (1 if self.pattern is None else 4)
        unit, frames = self.peak_e / lights[0].max(), []
        for light, time, drift in zip(lights, self.times, self.drift or (1.0,) * len(self.times), strict=True):
            shaded = light * (1.0 if self.dust is None else self.dust)
            counts = sensor.counts((unit * drift * shaded + self.beneath_e) * time, random)
            frames.append(Frame(f"{time:g}.tif", counts, black, sensor.white, self.pattern, 1e-3 * time))
        return frames


def record(scene: Floats, psf: Floats, white_e: float, seed: int, sensor: Sensor | None = None) -> Floats:
    """A photograph of a linear scene [rows, columns], dark beyond its ends, as shares of white with noise."""
    sensor = sensor or Sensor(full_well_e=white_e)
    light_e = white_e * signal.fftconvolve(scene, psf, mode="same")
    counts = replace(sensor, electrons_per_count=1.0).counts(light_e, np.random.default_rng(seed))
    return (counts.astype(np.float64) - sensor.black) / white_e


def srgb8(shares: Floats) -> NDArray[np.uint8]:
    """Codes of 8 bits for shares of white, by sRGB's curve."""
    light = np.clip(shares, 0.0, 1.0)
    return np.rint(255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)).astype(
        np.uint8
    )
