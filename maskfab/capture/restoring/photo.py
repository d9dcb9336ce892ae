"""A photograph as a camera took it: a record in units of white, and what makes colours of it once it is restored.

Of a RAW file or linear counts the black is taken off, and white is 1 in every colour, so that the noise is one function
of the light. A mosaic is interpolated linearly in balanced colours and brought back. Codes of sRGB are linearised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.mosaic import interpolated
from maskfab.camera.photographs import opaque
from maskfab.camera.record import Noise, Record
from maskfab.capture.frames import Frame
from maskfab.capture.reading import read_frame
from maskfab.capture.restoring.binned import of_cells
from maskfab.capture.restoring.noise_estimate import estimated_noise
from maskfab.errors import JobError, SourceError
from maskfab.eye.picture import Picture, read_picture
from maskfab.optics.numbers.colour import light_of_code
from maskfab.provenance import sha256_of_file

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
        electrons_per_count: gain.
        read_noise_e: in electrons; goes with the gain.
    """

    black: float | None = None
    white: float | None = None
    mosaic: str | None = None
    electrons_per_count: float | None = None
    read_noise_e: float | None = None

    def __post_init__(self) -> None:
        if (self.electrons_per_count is None) != (self.read_noise_e is None):
            missing = "gain" if self.electrons_per_count is None else "read_noise"
            raise JobError(
                "MF105",
                "gain and read noise are the noise together, and one of them is not stated",
                where=missing,
                cure="State both, or neither for an estimate by the photograph itself",
            )
        gain, read = self.electrons_per_count, self.read_noise_e
        if gain is not None and read is not None and not (0 < gain < np.inf and 0 <= read < np.inf):
            raise SourceError(
                "MF335",
                f"a gain of {gain:g} electrons per count with a read noise of {read:g} electrons",
                where="gain",
                cure="Give a gain above 0 and a read noise of 0 or more",
            )


@dataclass(frozen=True, eq=False)
class Photo:
    """A photograph that can be restored.

    Attributes:
        name: of its file, without suffix.
        sha256: of its file.
        record: of three colours, each in units of its own white.
        balance: by which they are multiplied for a neutral white, the least of them 1.
        matrix: [3, 3] from balanced colours to linear sRGB.
        told: sentences on how it was read.
    """

    name: str
    sha256: str
    record: Record
    balance: tuple[float, float, float]
    matrix: Floats
    told: tuple[str, ...]


def read_photo(path: Path, stated: Stated, *, cells: bool = False) -> Photo:
    """Read a file: RAW, TIFF and PNG of 16 bits and EXR as linear counts, any other picture as code values of sRGB.

    Args:
        path: of it.
        stated: what its file may lack.
        cells: take the cells of a mosaic for pixels, and interpolate nothing.

    Raises:
        SourceError: as :func:`maskfab.capture.reading.read_frame` but for MF330, and as
            :func:`maskfab.eye.picture.read_picture`; MF334 if all is full or dark, MF335 if the noise cannot be
            estimated, MF353 for a picture without colours, or of cells without a mosaic.
        JobError: MF121 for fewer than 128 pixels along a side, or a picture that is transparent; MF105 for facts that
            are stated of code values, which have none.
    """
    try:
        frame = read_frame(path, black=stated.black, white=stated.white, mosaic=stated.mosaic)
    except SourceError as refusal:
        if refusal.code != "MF330":
            raise
        if cells:
            raise _no_mosaic(path) from refusal
        return _of_picture(path, stated, refusal.what)
    return _of_frame(frame, stated, path, cells=cells)


def _of_frame(frame: Frame, stated: Stated, path: Path, *, cells: bool) -> Photo:
    if frame.counts.ndim == 2 and frame.pattern is None:
        raise _no_colours(path, "If it is a mosaic, state its colours, such as --mosaic rggb")
    if cells and frame.pattern is None:
        raise _no_mosaic(path)
    _check_size(frame.shape, str(path))
    white = frame.white if np.isfinite(frame.white) else float(frame.counts.max())
    told = [] if np.isfinite(frame.white) else [f"no white is stated: the brightest value, {white:g}, is white"]
    counts, pattern = frame.counts, frame.pattern
    units = np.empty(counts.shape, dtype=np.float32)
    lattices = frame.lattices
    for black, lattice in zip(frame.black, lattices, strict=True):
        above = lattice.of(counts).astype(np.float32) - np.float32(black)
        lattice.of(units)[...] = above / np.float32(max(white - black, 1e-30))
    ceiling = 1.0 if np.isfinite(frame.white) else np.inf
    _check_light(units, ceiling, str(path))
    planes = [lattice.of(units).astype(np.float32) for lattice in lattices]
    noise, how = _noise(stated, planes, ceiling, white - float(np.mean(frame.black)))
    balance, more = _balance(frame)
    if pattern is not None and cells:
        letters = "".join(colour for row in pattern for colour in row)
        rows, columns = (side // 2 * 2 for side in frame.shape)
        full = frame.full[:rows, :columns].reshape(rows // 2, 2, columns // 2, 2).any(axis=(1, 3))
        seen = of_cells(np.stack([plane[: rows // 2, : columns // 2] for plane in planes]), letters)
        values = np.where(full, np.float32(ceiling), seen)
        told.append(f"cells of the mosaic {letters} taken for pixels, nothing interpolated")
    elif pattern is not None:
        red = next((y, x) for y in (0, 1) for x in (0, 1) if pattern[y][x] == "R")
        for lattice, plane in zip(lattices, planes, strict=True):
            lattice.of(units)[...] = plane * np.float32(balance["RGB".index(lattice.colour)])
        rows, columns = (side // _WHOLE * _WHOLE for side in frame.shape)
        values = interpolated(units[:rows, :columns], red) / np.array(balance, dtype=np.float32)[:, None, None]
        full = frame.full[:rows, :columns]
        values = np.where(full, np.float32(ceiling), np.minimum(values, np.nextafter(np.float32(1), np.float32(0))))
        told.append(f"mosaic {''.join(c for row in pattern for c in row)} interpolated by linear filters of 5 x 5")
    else:
        values = units
    values, cut = _cut(values)
    record = Record(np.ascontiguousarray(values, dtype=np.float32), noise, ceiling, pattern is not None and not cells)
    matrix = np.eye(3) if frame.colour_matrix is None else frame.colour_matrix
    more += [] if frame.colour_matrix is not None else ["the file has no colour matrix: its colours are taken for sRGB"]
    return Photo(path.stem, frame.sha256, record, balance, matrix, (*told, *how, *more, *cut))


def _balance(frame: Frame) -> tuple[tuple[float, float, float], list[str]]:
    if frame.balance is None:
        return _ALIKE, ["the file has no balance: its colours stay as they are"]
    least = min(frame.balance)
    red, green, blue = (each / least for each in frame.balance)
    return (red, green, blue), []


def _of_picture(path: Path, stated: Stated, why: str) -> Photo:
    given = {"black": stated.black, "white": stated.white, "mosaic": stated.mosaic, "gain": stated.electrons_per_count}
    for key, value in given.items():
        if value is not None:
            raise JobError(
                "MF105",
                f"{why}, so it has no counts of which {key} could be stated",
                where=key,
                cure="Give the camera's RAW file, or linear TIFF or PNG of 16 bits, or state nothing",
            )
    picture = read_picture(path)
    _check_size(picture.values.shape[:2], str(path))
    light = _light(picture, path)
    # Some coders end a code below the last one; what reads so is taken for full.
    ceiling = float(light_of_code(np.array([_LAST_CODE], dtype=np.float32))[0])
    _check_light(light, ceiling, str(path))
    noise = estimated_noise(list(light), ceiling)
    told = [
        f"{why}; taken for code values of sRGB, and linearised: the camera's tone curve is not undone",
        _estimated(noise),
    ]
    values, cut = _cut(light)
    return Photo(
        path.stem,
        sha256_of_file(path),
        Record(np.ascontiguousarray(values), noise, ceiling),
        _ALIKE,
        np.eye(3),
        (*told, *cut),
    )


def _light(picture: Picture, path: Path) -> Singles:
    values = opaque(picture.values, path)
    if values.shape[2] != 3:
        raise _no_colours(path, "Give a photograph in red, green and blue")
    planes = np.ascontiguousarray(values.transpose(2, 0, 1))
    return light_of_code(planes) if picture.coded else planes / np.float32(max(float(planes.max()), 1e-30))


def _noise(stated: Stated, planes: Sequence[Singles], ceiling: float, counts: float) -> tuple[Noise, list[str]]:
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
        raise JobError(
            "MF121",
            f"the photograph has {columns} x {rows} pixels, fewer than {SMALLEST} along a side",
            where=where,
            cure=f"Give a photograph of at least {SMALLEST} pixels along each side",
        )


def _check_light(units: Singles, ceiling: float, where: str) -> None:
    clipped = float((units >= np.float32(ceiling)).mean())
    if clipped > _MOST_CLIPPED or not float(units.mean()) > 0:
        what = f"{100 * clipped:.0f} % of the pixels are full" if clipped > _MOST_CLIPPED else "no pixel is above black"
        raise SourceError(
            "MF334", what, where=where, cure="Give a photograph that is exposed rightly, or state black and white"
        )


def _no_mosaic(path: Path) -> SourceError:
    return SourceError(
        "MF353",
        f"{path.name} has no mosaic, and the PSF was captured with one",
        where=str(path),
        cure="Give photographs of the same camera, or state their --mosaic",
    )


def _no_colours(path: Path, cure: str) -> SourceError:
    return SourceError("MF353", f"{path.name} has one colour, and photographs have three", where=str(path), cure=cure)
