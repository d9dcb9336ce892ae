"""Light that leaves a display: every pixel's red, green and blue from where its emitters really are.

The eye's optics and nerves take it as a Fourier series up to what they pass, from where the display is looked at.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from maskfab.base.arrays import Complexes, Floats, Indices, Labels
from maskfab.base.errors import JobError
from maskfab.base.model import COLOURS, ORIENTATIONS, Emitters, Frozen, Opening, Panel, orient, refined
from maskfab.base.units import UM_PER_MM
from maskfab.optics.colour import LUMINANCE

TELEPHONE_UM = 300_000.0
"""From the eye to a telephone that is held as usual."""
_NEAREST_UM, _FARTHEST_UM = 1e4, 1e8


@dataclass(frozen=True)
class Viewing:
    """A display's pixels and an eye in front of them.

    Attributes:
        distance_um: from the eye to the display, 10 mm to 100 m.

    Raises:
        JobError: MF121 if nothing can be seen from there, MF104 if the pitch is not finite and positive.
    """

    pitch_um: float
    distance_um: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.pitch_um) and self.pitch_um > 0):
            raise JobError("MF104", f"the pitch is {self.pitch_um:g} um", cure="Give a finite, positive pitch")
        if not _NEAREST_UM <= self.distance_um <= _FARTHEST_UM:
            what = (
                f"a viewing distance of {self.distance_um / UM_PER_MM:g} mm is outside {_NEAREST_UM / UM_PER_MM:g} mm "
                f"to {_FARTHEST_UM / 1e6:g} m"
            )
            cure = f"A telephone is held at about {TELEPHONE_UM / UM_PER_MM:g} mm"
            raise JobError("MF121", what, where="distance", cure=cure)

    @property
    def pixels_per_degree(self) -> float:
        """Pixels per degree on the axis, where one degree is the distance times pi / 180."""
        return math.radians(self.distance_um) / self.pitch_um


_ROUNDING = 1e-12
"""Parts of a pixel that floating point makes of nothing."""
MOST_SAMPLES = 1 << 24
"""Samples of one picture; three colours of them and their transforms stay under 1.5 GB."""


@dataclass(frozen=True, eq=False)
class EmittedLight(Frozen):
    """Emitted light on square samples, each the exact mean over its own area.

    Attributes:
        rgb: float64 [3, y, x], row 0 the lowest; linear-light red, green and blue with the primaries of sRGB. The mean
            over a pixel is what the picture asks of it, so a white picture has the mean 1.
    """

    rgb: Floats
    samples: int
    pitch_um: float

    @property
    def pixels(self) -> tuple[int, int]:
        """Rows and columns of pixels."""
        return self.rgb.shape[1] // self.samples, self.rgb.shape[2] // self.samples


def show(panel: Panel, image: Floats, samples: int) -> EmittedLight:
    """The image on the pixels in the middle of a panel.

    Every emitter is driven so that the pixel sends out the colour asked for, whatever the emitters' areas (a small one
    is brighter). Openings and gutters are dark.

    Args:
        image: [rows, columns, 3] linear light 0 to 1, one value per pixel, row 0 the lowest.

    Raises:
        JobError: MF121 if the panel has no emitters or too few pixels; MF119 if an emitter lies
            over an opening or off the grid of dots; MF115 if there would be too many samples.
    """
    return Tiled.of(panel, *image.shape[:2]).light(image, samples)


def ideal(image: Floats, samples: int, pitch_um: float) -> EmittedLight:
    """The image on a display whose pixels shine evenly over all of their area in every colour: the reference."""
    rows, columns = image.shape[:2]
    _check_samples(rows, columns, samples)
    even = np.repeat(np.repeat(np.moveaxis(image, -1, 0), samples, axis=1), samples, axis=2)
    return EmittedLight(_still(even), samples, pitch_um)


@dataclass(frozen=True, eq=False)
class Tile:
    """One pixel's red, green and blue, on cells between lines that need not be evenly apart.

    Attributes:
        labels: int8 [n, n]; 0 is none, 1 to 3 are red, green and blue; row 0 the lowest.
        lines: float64 [n + 1], sides of rows and of columns alike, from the pixel's lower left corner, in pixels.
    """

    labels: Labels
    lines: Floats

    def samples(self, count: int) -> Floats:
        """Light on [3, count, count] squares of the pixel, of mean 1 per colour.

        A sample that an emitter covers in part takes its share of the area, so the means are exact on any grid.
        """
        bounds = np.linspace(0.0, 1.0, count + 1)
        shared = np.minimum(bounds[1:, None], self.lines[1:]) - np.maximum(bounds[:-1, None], self.lines[:-1])
        share = np.where(shared > _ROUNDING, shared, 0.0) * count
        covered = np.stack([share @ lit @ share.T for lit in self._lit])
        return np.asarray(covered / covered.mean(axis=(1, 2), keepdims=True))

    def transform(self, y: Floats, x: Floats) -> Complexes:
        """[3, y, x] of frequencies in cycles per pixel, from the lower left corner; 1 at 0. Exact."""
        waves = [self._waves(f) for f in (y, x)]
        return np.stack([waves[0] @ lit @ waves[1].T / area for lit, area in zip(self._lit, self.shares, strict=True)])

    @property
    def shares(self) -> tuple[float, float, float]:
        """Share of the pixel that red, green and blue cover."""
        red, green, blue = (float(np.diff(self.lines) @ lit @ np.diff(self.lines)) for lit in self._lit)
        return red, green, blue

    @property
    def centroid(self) -> tuple[float, float]:
        """(x, y) of the luminance from the pixel's centre, in pixels."""
        sizes, middles = np.diff(self.lines), (self.lines[1:] + self.lines[:-1]) / 2 - 0.5
        places = np.array(
            [
                (sizes @ lit @ (sizes * middles), (sizes * middles) @ lit @ sizes) / (sizes @ lit @ sizes)
                for lit in self._lit
            ]
        )
        x, y = LUMINANCE @ places
        return float(x), float(y)

    def turned(self, orientation: int) -> Tile:
        """The pixel under an element of D4; its lines must be alike from either side."""
        return replace(self, labels=orient(self.labels, orientation))

    @property
    def _lit(self) -> list[Floats]:
        return [(self.labels == colour).astype(np.float64) for colour in range(1, 1 + len(COLOURS))]

    def _waves(self, f: Floats) -> Complexes:
        """[f, n] integrals of exp(-2 pi i f r) between neighbouring lines."""
        sizes, middles = np.diff(self.lines), (self.lines[1:] + self.lines[:-1]) / 2
        return np.asarray(np.exp(-2j * np.pi * np.outer(f, middles)) * (np.sinc(np.outer(f, sizes)) * sizes))


@dataclass(frozen=True, eq=False)
class Tiled:
    """Pixels of a few kinds, int [rows, columns], row 0 the lowest, on which pictures are shown; the field repeats."""

    tiles: tuple[Tile, ...]
    held: Indices
    pitch_um: float

    @classmethod
    def of(cls, panel: Panel, rows: int, columns: int) -> Tiled:
        """So many pixels in the middle of a panel.

        Raises:
            JobError: MF121 if it has fewer, or no emitters; MF119 for emitters that cannot be shown.
        """
        high, wide = panel.orientations.shape
        if rows > high or columns > wide:
            what = f"the picture has {columns} x {rows} pixels and the panel {wide} x {high}"
            cure = f"Show at most {min(high, wide)} x {min(high, wide)} pixels, or make the panel larger"
            raise JobError("MF121", what, where="pixels", cure=cure)
        bottom, left = (high - rows) // 2, (wide - columns) // 2
        held = panel.orientations[bottom : bottom + rows, left : left + columns]
        return cls(tiles_of(panel), held.astype(np.intp), panel.cell_size.pitch_um)

    @property
    def centroid(self) -> tuple[float, float]:
        """Mean (x, y) of the luminance from the pixels' centres, in pixels: how far pictures are displaced."""
        x, y = self._mean([tile.centroid for tile in self.tiles])
        return float(x), float(y)

    @property
    def shares(self) -> tuple[float, float, float]:
        """Share of a pixel that red, green and blue cover, in the mean."""
        red, green, blue = self._mean([tile.shares for tile in self.tiles])
        return float(red), float(green), float(blue)

    def _mean(self, of_tiles: Sequence[tuple[float, ...]]) -> Floats:
        used = np.bincount(self.held.ravel(), minlength=len(self.tiles))
        return np.asarray(used @ np.array(of_tiles) / used.sum())

    def light(self, image: Floats, samples: int) -> EmittedLight:
        """The image [rows, columns, 3] on the pixels, ``samples`` along each."""
        rows, columns = image.shape[:2]
        _check_samples(rows, columns, samples)
        tiles = np.stack([tile.samples(samples) for tile in self.tiles])
        rgb = np.empty((3, rows, samples, columns, samples))
        for colour in range(3):
            # One row of pixels at a time keeps the gathered tiles small.
            for row in range(rows):
                lit = tiles[self.held[row], colour] * image[row, :, colour, None, None]
                rgb[colour, row] = lit.transpose(1, 0, 2)
        return EmittedLight(_still(rgb.reshape(3, rows * samples, columns * samples)), samples, self.pitch_um)

    def series(self, image: Floats, viewing: Viewing, highest_cpd: float) -> Series:
        """Fourier series of the image [rows, columns, 3] on the pixels, exact up to a frequency along x and along y.

        Pixels of one kind emit alike, so that their light is what each is asked for, on the lattice, convolved with the
        kind's own. Its coefficients are the discrete transform of the picture on those pixels, times the transform of
        the kind's emitters, which are rectangles; summed over kinds. No samples along a pixel are needed.
        """
        rows, columns = image.shape[:2]
        frame = _frame((rows, columns), self.pitch_um, viewing, highest_cpd)
        y, x = _orders(frame)
        for kind in np.unique(self.held):
            own = scipy.fft.fft2(np.where((self.held == kind)[..., None], image, 0.0), axes=(0, 1)) / (rows * columns)
            sent = self.tiles[kind].transform(y / rows, x / columns)
            frame.coefficients[...] += np.moveaxis(own[np.ix_(y % rows, x % columns)], -1, 0) * sent
        return frame


def _frame(pixels: tuple[int, int], pitch_um: float, viewing: Viewing, highest_cpd: float) -> Series:
    """A series of nothing, up to a frequency. Raises JobError MF115 for too many coefficients."""
    high, wide = (count / viewing.pixels_per_degree for count in pixels)
    most_y, most_x = (math.floor(highest_cpd * side) for side in (high, wide))
    _refuse_too_many(2 * most_y + 1, 2 * most_x + 1)
    y, x = np.arange(-most_y, most_y + 1), np.arange(most_x + 1)
    empty = np.zeros((3, len(y), len(x)), dtype=np.complex128)
    return Series(empty, y / high, x / wide, pixels, pitch_um, 1.0 / viewing.pixels_per_degree)


def _orders(frame: Series) -> tuple[Indices, Indices]:
    """Numbers of the coefficients, along y from -K to K and along x from 0 to K."""
    most_y, most_x = len(frame.y_cpd) // 2, len(frame.x_cpd) - 1
    return np.arange(-most_y, most_y + 1), np.arange(most_x + 1)


def tiles_of(panel: Panel) -> tuple[Tile, ...]:
    """Contents that a cell of a panel can have: 8 u + k is opening u under element k of D4."""
    tiles = []
    for emitters in emitters_of(panel):
        # Half a gutter, the cells, half a gutter.
        edges = panel.gutter_nm / 2 + emitters.cell_nm * np.arange(len(emitters.labels) + 1.0)
        own = Tile(emitters.labels, edges / panel.pitch_nm)
        tiles += [own.turned(turn) for turn in range(ORIENTATIONS)]
    return tuple(tiles)


def has_emitters(panel: Panel) -> bool:
    """Whether anything is said of where the panel emits."""
    return panel.emitters is not None or all(opening.emitters is not None for opening in panel.openings)


def emitters_of(panel: Panel) -> tuple[Emitters, ...]:
    """The emitters behind each opening of a panel, if they can be shown: the panel's, or else the opening's own.

    Raises:
        JobError: MF121 if there are no emitters, or none of one colour; MF119 if an emitter lies over an opening or off
            the grid of dots.
    """
    return tuple(_checked_emitters(panel, opening) for opening in panel.openings)


def _checked_emitters(panel: Panel, opening: Opening) -> Emitters:
    where = f"opening {opening.name}"
    emitters = panel.emitters
    if emitters is None and opening.emitters is not None:
        emitters = Emitters(opening.emitters, panel.cell_size.dots_nm // len(opening.emitters))
    if emitters is None:
        what = "the panel has no emitters"
        raise JobError("MF121", what, where=where, cure="Say in the job where red, green and blue emit")
    labels = emitters.labels
    side = panel.cell_size.dots_nm
    if labels.ndim != 2 or labels.shape[0] != labels.shape[1] or labels.shape[0] * emitters.cell_nm != side:
        what = f"{labels.shape} cells of {emitters.cell_nm} nm are not the pixel's {side} nm"
        cure = "Divide the pixel less its gutter into square cells of whole nanometres"
        raise JobError("MF119", what, where=where, cure=cure)
    if panel.dot_nm % emitters.cell_nm:
        what = f"cells of {emitters.cell_nm} nm do not divide a dot of {panel.dot_nm} nm"
        raise JobError("MF119", what, where=where, cure="Use cells that divide a dot")
    per_dot = panel.dot_nm // emitters.cell_nm
    over = int((refined(opening.mask, per_dot) & (labels > 0)).sum())
    if over:
        what = f"{over} cells of the emitters lie over an opening"
        raise JobError("MF119", what, where=where, cure="Move the emitters behind the closed area")
    for number, colour in enumerate(COLOURS, start=1):
        if not (labels == number).any():
            raise JobError("MF121", f"no part of a pixel emits {colour}", where=where, cure=f"Give {colour} an emitter")
    return emitters


def _check_samples(rows: int, columns: int, samples: int) -> None:
    if samples < 1:
        raise JobError("MF121", f"{samples} samples per pixel", where="samples", cure="Use 1 or more; 21 is usual")
    if rows * columns * samples**2 > MOST_SAMPLES:
        what = f"{columns} x {rows} pixels of {samples} x {samples} samples are more than {MOST_SAMPLES}"
        cure = f"Show fewer pixels, or use {max(1, int((MOST_SAMPLES / (rows * columns)) ** 0.5))} samples"
        raise JobError("MF115", what, where="pixels, samples", cure=cure)


def _still(array: Floats) -> Floats:
    array.flags.writeable = False  # or Light would copy it
    return array


MOST_SEEN = 1 << 20
"""Samples of a picture as the eye takes it in."""


@dataclass(frozen=True, eq=False)
class Series:
    """Coefficients c(k) of L(r) = sum over k of c(k) exp(2 pi i k r), for light that repeats beyond its edges.

    Attributes:
        coefficients: complex128 [3, y, x]; y runs from -K to K, x from 0 to K (the rest is their conjugate).
        pixel_deg: the same as an angle.
    """

    coefficients: Complexes
    y_cpd: Floats
    x_cpd: Floats
    pixels: tuple[int, int]
    pitch_um: float
    pixel_deg: float

    @property
    def radius_cpd(self) -> Floats:
        """[y, x] length of the frequency vector."""
        radius: Floats = np.hypot(self.y_cpd[:, None], self.x_cpd)
        return radius

    def filtered(self, gain: Callable[[Floats], Floats], mix: Floats | None = None) -> Series:
        """The light after ``mix`` [n, 3] of its colours and a gain [n, y, x] (or [y, x]) of the frequency."""
        mixed = self.coefficients if mix is None else np.tensordot(mix, self.coefficients, axes=1)
        return replace(self, coefficients=mixed * gain(self.radius_cpd))

    def displaced(self, x_px: float, y_px: float) -> Series:
        """The light displaced right and up by a distance in pixels."""
        degrees_y, degrees_x = (self.pixel_deg * shift for shift in (y_px, x_px))
        turn = np.exp(-2j * np.pi * degrees_y * self.y_cpd)[:, None] * np.exp(-2j * np.pi * degrees_x * self.x_cpd)
        return replace(self, coefficients=self.coefficients * turn)

    def up_to(self, highest_cpd: float) -> Series:
        """The part of the series up to a frequency along x and along y."""
        most_y, most_x = len(self.y_cpd) // 2, len(self.x_cpd) - 1
        less_y, less_x = (
            min(most, math.floor(highest_cpd * count * self.pixel_deg))
            for most, count in zip((most_y, most_x), self.pixels, strict=True)
        )
        rows, columns = slice(most_y - less_y, most_y + less_y + 1), slice(less_x + 1)
        kept = self.coefficients[:, rows, columns]
        return replace(self, coefficients=kept, y_cpd=self.y_cpd[rows], x_cpd=self.x_cpd[columns])

    def values(self, samples: int) -> Floats:
        """[3, y, x] the series at the middles of ``samples`` squares along each pixel, which must carry its band.

        Raises:
            JobError: MF115 if that is too many samples: an eye near the display resolves too much of it.
        """
        rows, columns = (count * samples for count in self.pixels)
        _refuse_too_many(rows, columns)
        most_y, most_x = len(self.y_cpd) // 2, len(self.x_cpd) - 1
        if 2 * most_y >= rows or 2 * most_x >= columns:
            raise ValueError(f"{samples} samples per pixel cannot carry {most_x} cycles on {columns} samples")
        spectrum = np.zeros((len(self.coefficients), rows, columns // 2 + 1), dtype=np.complex128)
        y, x = np.arange(-most_y, most_y + 1), np.arange(most_x + 1)
        phase = np.exp(1j * np.pi * y / rows)[:, None] * np.exp(1j * np.pi * x / columns)
        spectrum[:, y % rows, : most_x + 1] = self.coefficients * phase
        light: Floats = scipy.fft.irfft2(spectrum, s=(rows, columns), overwrite_x=True) * (rows * columns)
        return light


def series(light: EmittedLight, viewing: Viewing, highest_cpd: float) -> Series:
    """The Fourier series of light up to ``highest_cpd`` along x and along y.

    Notes:
        The samples are squares of constant light, so their series is their discrete transform, which repeats, times
        the sinc of a square: exact at every frequency, also above the grid's own Nyquist frequency.
    """
    rows, columns = light.rgb.shape[1:]
    frame = _frame(light.pixels, light.pitch_um, viewing, highest_cpd)
    y, x = _orders(frame)
    # exp(-i pi k / n) moves the origin from the middle of sample 0 to its corner.
    weight_y = np.sinc(y / rows) * np.exp(-1j * np.pi * y / rows) / rows
    weight_x = np.sinc(x / columns) * np.exp(-1j * np.pi * x / columns) / columns
    coefficients = frame.coefficients
    for colour in range(3):
        if 2 * x[-1] <= columns:
            lines = scipy.fft.rfft(light.rgb[colour], axis=1)[:, : len(x)]
        else:
            lines = scipy.fft.fft(light.rgb[colour], axis=1)[:, x % columns]
        coefficients[colour] = scipy.fft.fft(lines, axis=0)[y % rows]
    coefficients *= weight_y[:, None] * weight_x
    return frame


def _refuse_too_many(rows: int, columns: int) -> None:
    if rows * columns > MOST_SEEN:
        what = f"from this distance the eye resolves {columns} x {rows} samples of the picture, more than {MOST_SEEN}"
        raise JobError("MF115", what, where="distance, pixels", cure="Look from farther away, or show fewer pixels")
