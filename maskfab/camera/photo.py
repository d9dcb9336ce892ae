"""A photograph as a camera took it: a record in units of white, restored, and what makes colours of it then.

Of a RAW file or linear counts the black is taken off, and white is 1 in every colour, so that the noise is one function
of the light. A mosaic is interpolated linearly in balanced colours and brought back. Codes of sRGB are linearised.
Restored light becomes a picture by balance, colour matrix, and as bright as asked; codes follow by sRGB's curve.

Where nobody states the sensor's gain, the photograph tells its noise. Second differences along both axes,
[1 -2 1] x [1 -2 1] / 6, keep the variance of white noise and nothing of light that is even or slopes (J. Immerkær,
Comput. Vis. Image Underst. 64, 300, 1996). In classes of equal brightness, their median in the smoothest blocks tells
the variance there, and the classes tell

    var = light / electrons of white + floor        (A. Foi et al., IEEE Trans. Image Process. 17, 1737, 2008).

Notes:
    Behind a panel the finest detail is blurred away, so what is left there is noise. A picture that a camera or a coder
    has smoothed looks less noisy than it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize

from maskfab.base.arrays import Floats, Singles
from maskfab.base.errors import JobError, SourceError
from maskfab.base.provenance import sha256_of_file
from maskfab.camera.blur import MeasuredBlur
from maskfab.camera.chart import ChartMatrix
from maskfab.camera.explained import EXPLAINED, FOREIGN, Explained, explain
from maskfab.camera.frames.frame import PICTURES, Frame, Source, letters, read_frame
from maskfab.camera.frames.stack import require_gain
from maskfab.camera.imaging import LARGE, Blur
from maskfab.camera.noise_spectrum import ENOUGH, WhitenedBlur, noise_of, squares, whitened
from maskfab.camera.record import BinnedBlur, Noise, Record, Restorer, binned, interpolated, of_cells
from maskfab.camera.restorers.choice import Chosen, restored
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scenes import opaque
from maskfab.camera.sensor import counted, gain_of_file
from maskfab.display.pictures import exif_of, read_picture, turned
from maskfab.job.camera import Sensor
from maskfab.mask.formats.exr import Fact
from maskfab.optics.colour import light_of_code

_BLOCK, _STRIP = 8, 130
_CLASSES = 24
_SMOOTH = 0.3
"""Share of a class's blocks that are looked at: those whose means over 3 x 3 pixels differ least."""
_FEWEST = 8
_OF_MEDIAN = 0.6745
"""Median of the modulus of a standard normal number."""
_LEAST = 1e-7
"""Variance in units of white below which none is told: a well of 10 million electrons."""


def estimated_noise(planes: Sequence[Singles], ceiling: float = np.inf) -> Noise:
    """Noise in units of white, of white noise that is the same function of light in every colour.

    Args:
        planes: [rows, columns] of each colour, as the pixels recorded it, black is 0 and white 1: interpolated pixels
            are not noisy enough.
        ceiling: light at which pixels are full; blocks that hold one do not count.
    """
    parts = [_blocks(strip, ceiling, edge) for plane in planes for strip, edge in _strips(plane)]
    light, rough, fine = (np.concatenate([part[k] for part in parts]) for k in range(3))
    order = np.argsort(light)
    means, variances = [], []
    for group in np.array_split(order, _CLASSES):
        smooth = group[np.argsort(rough[group])[: max(_FEWEST, int(_SMOOTH * group.size))]]
        if smooth.size >= _FEWEST:
            means.append(float(light[smooth].mean()))
            variances.append(max(float(np.median(fine[smooth])) / _OF_MEDIAN, 0.0) ** 2)
    if len(means) < _CLASSES:
        what = f"{light.size} blocks of {_BLOCK} x {_BLOCK} pixels that are not full are too few to tell the noise by"
        cure = "State the gain and the read noise, or give a larger photograph"
        raise SourceError("MF335", what, where="gain", cure=cure)
    slope, floor = _line(np.array(means), np.array(variances))
    return Noise(1 / slope, floor**0.5 / slope)


def _strips(plane: Singles) -> list[tuple[Singles, int]]:
    """Strips of rows, evenly apart, as many as tell its noise, and rows of edge; all of a small plane."""
    if plane.size < 2 * ENOUGH:
        return [(plane, 0)]
    apart = _STRIP * (plane.size // ENOUGH)
    return [(plane[first : first + _STRIP], 1) for first in range(0, len(plane) - _STRIP // 2, apart)]


def _blocks(plane: Singles, ceiling: float, edge: int) -> tuple[Floats, Floats, Floats]:
    """Blocks without full pixels: mean light, its unevenness, and the median modulus of second differences [n]."""
    second = np.array([1.0, -2.0, 1.0], dtype=np.float32)
    fine = ndimage.correlate1d(ndimage.correlate1d(plane, second, axis=0), second, axis=1) / 6
    every = (ndimage.uniform_filter(plane, 3), plane, abs(fine))
    means, held, rough = (squares(values[edge : len(values) - edge], _BLOCK) for values in every)
    each, clear = (1, 2), held.max(axis=(1, 2)) < ceiling
    return means.mean(axis=each)[clear], means.std(axis=each)[clear], np.median(rough, axis=each)[clear]


def _line(light: Floats, variance: Floats) -> tuple[float, float]:
    """Slope and floor, none below 0, by least squares of relative errors, which are alike in all classes."""
    expected = np.maximum(variance, _LEAST)
    for _ in range(4):
        both = np.stack([np.maximum(light, 0), np.ones_like(light)], axis=1) / expected[:, None]
        (slope, floor), _ = optimize.nnls(both, variance / expected)
        expected = np.maximum(slope * np.maximum(light, 0) + floor, _LEAST)
    return max(float(slope), _LEAST), float(floor)


SMALLEST = 128
"""Pixels along a side."""
_WHOLE = 16
"""Sides are cut to multiples of it: transforms are fast, and restorers begin on coarser pixels."""
_MOST_CLIPPED = 0.9
_ALIKE = (1.0, 1.0, 1.0)
_LAST_CODE = 0.999


@dataclass(frozen=True)
class Stated:
    """Facts of a photograph that its file may lack; None for those that nobody states.

    Attributes:
        black, white: counts of no light, and of a full pixel.
        mosaic: ``rggb bggr grbg gbrg`` of a picture that holds a mosaic in grey.
        sensor: of the job; where it has a converter, and its gain is known, it tells both.
    """

    black: float | None = None
    white: float | None = None
    mosaic: str | None = None
    electrons_per_count: float | None = None
    read_noise_e: float | None = None
    sensor: Sensor | None = None

    def __post_init__(self) -> None:
        if (self.electrons_per_count is None) != (self.read_noise_e is None):
            missing = "gain" if self.electrons_per_count is None else "read_noise"
            what = "gain and read noise are the noise together, and one of them is not stated"
            cure = "State both, or neither for an estimate by the photograph itself"
            raise JobError("MF105", what, where=missing, cure=cure)
        if self.electrons_per_count is not None and self.read_noise_e is not None:
            require_gain(self.electrons_per_count, self.read_noise_e, where="gain")


@dataclass(frozen=True, eq=False)
class Photo:
    """A photograph that can be restored.

    Attributes:
        balance: by which they are multiplied for a neutral white, the least of them 1.
        matrix: [3, 3] from balanced colours to linear sRGB.
        orientation: tag by which it is still to be turned to be seen.
        exif: of its file.
        coded: whether it holds code values, and not counts.
    """

    name: str
    sha256: str
    record: Record
    balance: tuple[float, float, float]
    matrix: Floats
    told: tuple[str, ...]
    noise_stated: bool = False
    orientation: int = 1
    exif: Mapping[str, Any] = field(default_factory=dict)
    coded: bool = False


def read_photo(path: Source, stated: Stated, *, cells: bool = False) -> Photo:
    """Read a file: RAW, TIFF and PNG of 16 bits and EXR as linear counts, any other picture as code values of sRGB.

    Args:
        cells: take the cells of a mosaic for pixels, and interpolate nothing.

    Raises:
        SourceError: as :func:`maskfab.camera.frames.frame.read_frame` but for MF330, and as
            :func:`maskfab.display.pictures.read_picture`; MF334 if all is full or dark, MF335 if the noise cannot be
            estimated, MF353 for a picture without colours, or of cells without a mosaic.
        JobError: MF121 for fewer than 128 pixels along a side, or a picture that is transparent; MF105 for facts that
            are stated of code values, which have none.
    """
    try:
        frame = read_frame(path, black=stated.black, white=stated.white, mosaic=stated.mosaic)
    except SourceError as refusal:
        if refusal.code != "MF330" or isinstance(path, Frame):
            raise
        if cells:
            raise _no_mosaic(path) from refusal
        return _of_picture(path, stated, refusal.what)
    return _of_frame(frame, stated, Path(path.name) if isinstance(path, Frame) else path, cells=cells)


def _of_frame(frame: Frame, stated: Stated, path: Path, *, cells: bool) -> Photo:
    if frame.counts.ndim == 2 and frame.pattern is None:
        raise _no_colours(path, "If it is a mosaic, state its colours, such as --mosaic rggb")
    if cells and frame.pattern is None:
        raise _no_mosaic(path)
    _check_size(frame.shape, str(path))
    white = frame.white if np.isfinite(frame.white) else float(frame.counts.max())
    sentences = [] if np.isfinite(frame.white) else [f"no white is stated: the brightest value, {white:g}, is white"]
    counts, pattern = frame.counts, frame.pattern
    units = np.empty(counts.shape, dtype=np.float32)
    lattices = frame.lattices
    for black, lattice in zip(frame.black, lattices, strict=True):
        above = lattice.of(counts).astype(np.float32) - np.float32(black)
        lattice.of(units)[...] = above / np.float32(max(white - black, 1e-30))
    ceiling = 1.0 if np.isfinite(frame.white) else np.inf
    _check_light(units, ceiling, str(path))
    planes = [lattice.of(units) for lattice in lattices]
    noise, how = _noise(stated, frame, planes, ceiling, white - float(np.mean(frame.black)))
    factors = frame.balance or _ALIKE
    red_factor, green_factor, blue_factor = (factor / min(factors) for factor in factors)
    balance = red_factor, green_factor, blue_factor
    if pattern is not None and cells:
        rows, columns = (side // 2 * 2 for side in frame.shape)
        full = frame.full[:rows, :columns].reshape(rows // 2, 2, columns // 2, 2).any(axis=(1, 3))
        seen = of_cells(np.stack([plane[: rows // 2, : columns // 2] for plane in planes]), letters(pattern))
        values = np.where(full, np.float32(ceiling), seen)
        sentences.append(f"cells of the mosaic {letters(pattern)} taken for pixels, nothing interpolated")
    elif pattern is not None:
        red = next((y, x) for y in (0, 1) for x in (0, 1) if pattern[y][x] == "R")
        for lattice, plane in zip(lattices, planes, strict=True):
            lattice.of(units)[...] = plane * np.float32(balance["RGB".index(lattice.colour)])
        rows, columns = (side // _WHOLE * _WHOLE for side in frame.shape)
        values = interpolated(units[:rows, :columns], red) / np.array(balance, dtype=np.float32)[:, None, None]
        full = frame.full[:rows, :columns]
        values = np.where(full, np.float32(ceiling), np.minimum(values, np.nextafter(np.float32(1), np.float32(0))))
        sentences.append(f"mosaic {letters(pattern)} interpolated by linear filters of 5 x 5")
    else:
        values = units
    values, cut = _cut(values)
    record = Record(np.ascontiguousarray(values, dtype=np.float32), noise, ceiling, pattern is not None and not cells)
    matrix = np.eye(3) if frame.colour_matrix is None else frame.colour_matrix
    if frame.balance is None:
        how.append("the file has no balance: its colours stay as they are")
    if frame.colour_matrix is None:
        how.append("the file has no colour matrix: its colours are taken for sRGB")
    known = stated.electrons_per_count is not None
    if path.suffix.lower() in PICTURES[:-1]:
        sentences.append(
            "taken for counts that grow as the light does, for its file says nothing else: " + _TO_BE_CODED
        )
    told = (*sentences, *how, *cut)
    # By the process that read it: RAW files come from anywhere.
    stated_by_file = {"Model": frame.camera, "ExposureTime": frame.exposure_s}
    exif = {name: value for name, value in stated_by_file.items() if value}
    return Photo(path.stem, frame.sha256, record, balance, matrix, told, known, frame.orientation, exif)


def _of_picture(path: Path, stated: Stated, why: str) -> Photo:
    given = {"black": stated.black, "white": stated.white, "mosaic": stated.mosaic, "gain": stated.electrons_per_count}
    for key, value in given.items():
        if value is not None:
            cure = "Give the camera's RAW file, or linear TIFF or PNG of 16 bits, or state nothing"
            raise JobError("MF105", f"{why}, so it has no counts of which {key} could be stated", where=key, cure=cure)
    picture = read_picture(path, upright=False)  # the display lies as the sensor does
    if stated.sensor is not None:
        gain_of_file(stated.sensor, path.name, picture.sensitivity)
    _check_size(picture.values.shape[:2], str(path))
    colours = opaque(picture.values, path)
    if colours.shape[2] != 3:
        raise _no_colours(path, "Give a photograph in red, green and blue")
    planes = np.ascontiguousarray(colours.transpose(2, 0, 1))
    light = light_of_code(planes) if picture.coded else planes / np.float32(max(float(planes.max()), 1e-30))
    # Some coders end a code below the last one; what reads so is taken for full.
    ceiling = float(light_of_code(np.array([_LAST_CODE], dtype=np.float32))[0])
    _check_light(light, ceiling, str(path))
    noise = estimated_noise(list(light), ceiling)
    sentences = [
        f"{why}; taken for code values of sRGB, and linearised: the camera's tone curve is not undone, and structure "
        "that is missing speaks against no display",
        _estimated(noise),
    ]
    values, cut = _cut(light)
    record = Record(np.ascontiguousarray(values), noise, ceiling)
    told, turn = (*sentences, *cut), picture.orientation
    photo = Photo(path.stem, sha256_of_file(path), record, _ALIKE, np.eye(3), told, coded=True)
    return replace(photo, orientation=turn, exif=exif_of(path))


def _noise(
    stated: Stated, frame: Frame, planes: Sequence[Singles], ceiling: float, counts: float
) -> tuple[Noise, list[str]]:
    by_sensor = counted(stated.sensor, frame)
    if by_sensor is not None and stated.electrons_per_count is None:
        gain, read = by_sensor
        noise = Noise(gain * counts, read, gain)
        return noise, [f"noise by [sensor]: {noise.electrons:.3g} electrons of white, read noise of {read:.2g}"]
    if stated.electrons_per_count is None or stated.read_noise_e is None:
        noise = estimated_noise(planes, ceiling)
        return noise, [_estimated(noise)]
    return Noise(stated.electrons_per_count * counts, stated.read_noise_e, stated.electrons_per_count), []


def _estimated(noise: Noise) -> str:
    return (
        f"noise estimated from the photograph: {noise.electrons:.3g} electrons of white, read noise of "
        f"{noise.read_noise:.2g}"
    )


def _cut(values: Singles) -> tuple[Singles, list[str]]:
    rows, columns = (side // _WHOLE * _WHOLE for side in values.shape[1:])
    cut = values[:, :rows, :columns]
    return cut, [] if cut.shape == values.shape else [f"cut to {columns} x {rows} pixels, multiples of {_WHOLE}"]


def _check_size(shape: tuple[int, ...], where: str) -> None:
    rows, columns = shape
    if min(rows, columns) < SMALLEST:
        what = f"the photograph has {columns} x {rows} pixels, fewer than {SMALLEST} along a side"
        cure = f"Give a photograph of at least {SMALLEST} pixels along each side"
        raise JobError("MF121", what, where=where, cure=cure)


def _check_light(units: Singles, ceiling: float, where: str) -> None:
    clipped = float((units >= np.float32(ceiling)).mean())
    if clipped > _MOST_CLIPPED or not float(units.mean()) > 0:
        what = f"{100 * clipped:.0f} % of the pixels are full" if clipped > _MOST_CLIPPED else "no pixel is above black"
        cure = "Give a photograph that is exposed rightly, or state black and white"
        raise SourceError("MF334", what, where=where, cure=cure)


def _no_mosaic(path: Path) -> SourceError:
    what = f"{path.name} has no mosaic, and the PSF was captured with one"
    cure = "Give photographs of the same camera, or state their --mosaic"
    return SourceError("MF353", what, where=str(path), cure=cure)


def _no_colours(path: Path, cure: str) -> SourceError:
    return SourceError("MF353", f"{path.name} has one colour, and photographs have three", where=str(path), cure=cure)


_TO_BE_CODED = "a picture that was developed is to say so by its profile"
MOST_STOPS = 16.0
_ROWS = 64
"""Developed at a time."""


def developed(photo: Photo, light: Singles, stops: float = 0.0) -> Singles:
    """Linear sRGB within 0 to 1 of light [3, rows, columns] in units of each colour's own white."""
    matrix = (photo.matrix * 2.0**stops).astype(np.float32)
    colours = np.moveaxis(np.empty((*light.shape[1:], 3), dtype=np.float32), -1, 0)
    for first in range(0, light.shape[1], _ROWS):
        rows = slice(first, first + _ROWS)
        np.clip(np.tensordot(matrix, balanced(photo, light[:, rows]), axes=1), 0, 1, out=colours[:, rows])
    return colours


PAGE_PX = 720
"""Pixels along a picture's longer side on a page, at most."""


def shrunk(picture: Singles) -> Singles:
    """Means [3, rows, columns] over as many pixels as a page has no room for."""
    step = math.ceil(max(picture.shape[1:]) / PAGE_PX)
    rows, columns = (side // step for side in picture.shape[1:])
    parts = (picture[:, y : y + rows * step : step, x : x + columns * step : step] for y, x in np.ndindex(step, step))
    return np.asarray(sum(parts) / np.float32(step**2))


def balanced(photo: Photo, light: Singles) -> Singles:
    """Light in colours of which equal ones are neutral, 1 at most."""
    # Where one colour is full the others could be above it: white there is that of the least, or it would be tinted.
    return np.asarray(np.minimum(light * np.array(photo.balance, dtype=np.float32)[:, None, None], 1))


def require_stops(stops: float) -> None:
    """Refuse a brightness that no picture has (MF104)."""
    if not (math.isfinite(stops) and abs(stops) <= MOST_STOPS):
        what = f"{stops:g} stops are beyond {MOST_STOPS:g}"
        raise JobError("MF104", what, where="stops", cure="Give a number of stops such as 1.5")


def restored_light(
    photo: Photo,
    blur: Blur,
    restorers: Sequence[Restorer],
    *,
    chosen: bool,
    epsilon: float | None,
    bin: bool,
    trust: bool = False,
    rivals: Mapping[str, Blur] = MappingProxyType({}),
) -> tuple[Record, Chosen, Explained, tuple[str, ...]]:
    """The record of a photograph, what the chosen restorer made of it, whether the blur explains it, and sentences.

    Where the record speaks against the blur it stays as it is; trusted, the blur is undone as it is said to be.

    Args:
        chosen: whether the best is asked for, so that Wiener alone restores a large photograph.
        epsilon: strength of the prior, with which the blur is trusted; None for what each record speaks for.
        rivals: other blurs by name, of which one may explain the photograph better; looked at unless trusted.
    """
    record, seen, sentences = photo.record, blur, photo.told
    if isinstance(blur, MeasuredBlur):
        seen, lost = blur.within(*record.values.shape[1:])
        sentences = (*sentences, *lost)
    if bin:
        record, seen, sentences = binned(record), BinnedBlur(seen), (*sentences, "means over 2 x 2 pixels")
        rivals = {name: BinnedBlur(rival) for name, rival in rivals.items()}
    if record.values[0].size > LARGE:
        if not chosen and [restorer.name for restorer in restorers] != [Wiener().name]:
            what = (
                f"{restorers[-1].name} keeps too much of {record.values[0].size / 1e6:.3g} million pixels; the limit "
                f"is {LARGE / 1e6:g} million"
            )
            cure = "Restore it by wiener, or add --bin for a quarter of the pixels"
            raise JobError("MF142", what, where=photo.name, cure=cure)
        restorers = (Wiener(),)
        sentences = (*sentences, f"of more than {LARGE / 1e6:g} million pixels, so restored by wiener")
    noise, processed = noise_of(record, stated=photo.noise_stated)
    trust = trust or epsilon is not None
    found = explain(record, seen, noise, {} if trust else rivals, coded=photo.coded)
    sentences = (*sentences, *processed)
    if trust:
        return record, restored(record, seen, restorers, epsilon), replace(found, trusted=True), sentences
    if found.verdict == FOREIGN:
        return record, Chosen("none", 0.0, np.clip(record.values, 0, 1), {}, {}), found, sentences
    known = found.verdict == EXPLAINED
    told = found.noise if known else noise
    even, blurred = whitened(record, told), WhitenedBlur(found.blur, told)
    return record, restored(even, blurred, restorers, least=found.strength, known=known), found, sentences


@dataclass(frozen=True, eq=False, repr=False)
class RestoredPhoto:
    """One photograph, restored.

    Attributes:
        picture: float32 [3, rows, columns] linear sRGB within 0 to 1, row 0 on top.
        full: bool [rows, columns], where a colour of the photograph was full.
        before: the photograph itself, as large as a page shows it.
    """

    name: str
    sha256: str
    picture: Singles
    full: NDArray[np.bool_]
    blur: tuple[str, ...]
    restorer: str
    epsilon: float
    electrons: float
    read_noise: float
    clipped: float
    told: tuple[str, ...]
    before: Singles
    explained: Explained
    exif: Mapping[str, Any]

    @classmethod
    def of(
        cls,
        photo: Photo,
        record: Record,
        won: Chosen,
        explained: Explained,
        blur: tuple[str, ...],
        colours: ChartMatrix | None,
        stops: float,
    ) -> RestoredPhoto:
        """The picture that restored light becomes: ``won`` by the chosen restorer, in units of each colour's white."""
        sentences = photo.told
        if colours is not None:
            photo = replace(photo, matrix=colours.matrix)
            sentences = (*(text for text in sentences if "colour matrix" not in text), "colours by the chart")
        noise, dark = record.noise, np.zeros(1, dtype=np.float32)

        def upright(light: Singles) -> Singles:
            return np.moveaxis(turned(np.moveaxis(developed(photo, light, stops), 0, -1), photo.orientation), -1, 0)

        before, picture = shrunk(upright(record.values)), upright(won.picture)
        full = turned(np.asarray(record.clipped.any(axis=0)), photo.orientation)
        for plane in picture:
            full |= plane >= 1
        return cls(
            photo.name,
            photo.sha256,
            picture,
            full,
            blur,
            won.makers,
            won.epsilon,
            noise.electrons,
            float(noise.variance(dark)[0]) ** 0.5 * noise.electrons,
            float(photo.record.clipped.mean()),
            sentences if photo.orientation == 1 else (*sentences, "turned as its tag says that it is seen"),
            before,
            explained,
            photo.exif,
        )

    def to_dict(self) -> dict[str, Any]:
        """Numbers and words, without the picture."""
        _, rows, columns = self.picture.shape
        return {
            "name": self.name,
            "sha256": self.sha256,
            "rows": rows,
            "columns": columns,
            "blur": list(self.blur),
            "restorer": self.restorer,
            "epsilon": self.epsilon,
            "electrons_of_white": self.electrons,
            "read_noise_e": self.read_noise,
            "clipped": self.clipped,
            "explained": self.explained.to_dict(),
            "told": list(self.told),
        }

    @property
    def facts(self) -> dict[str, Fact]:
        """Entries for the header of a picture."""
        return {
            "restorer": self.restorer,
            "epsilon": self.epsilon,
            "photo_sha256": self.sha256,
            "blur": "; ".join(self.blur),
        }
