"""Pixels for people and for machines that write them: 8-bit PNG, 1-bit TIFF, at a stated number of dots per micrometre.

A pixel of the PNG is the share of it that is clear, to the nearest of 256 levels and up from the middle of two; one of
the TIFF is white where that share is half or more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from klayout import db
from scipy import sparse

from maskfab.base.arrays import Floats
from maskfab.errors import OutputError
from maskfab.export.size import check_file_size
from maskfab.files.atomic import partial
from maskfab.files.image import is_whole
from maskfab.geometry.die_grid import die_edges_nm, die_raster, pixel_overlaps
from maskfab.geometry.plate_layout import coverage, simple_polygon
from maskfab.model import Box, Die, Furniture, Plate
from maskfab.units import NM_PER_UM

LARGEST_BYTES = 500_000_000

_DATE = "1980:01:01 00:00:00"
"""As members of our packages have it, which is no date of anything."""
_BAND_PIXELS = 4_000_000
_ROUNDING = 1e-9
_UM_PER_CM = 10_000.0


@dataclass(frozen=True)
class Bitmap:
    """Facts of a written bitmap.

    Attributes:
        width: pixels along x.
        height: pixels along y.
        dots_per_um: pixels per micrometre.
        partly: pixels that are neither clear nor opaque all over; where there are none, the pixels are the mask.
    """

    width: int
    height: int
    dots_per_um: float
    partly: int


def write_preview(
    plate: Plate,
    path: Path,
    dots_per_um: float,
    comments: Sequence[str] = (),
    *,
    die: str | None = None,
    limit_bytes: int = LARGEST_BYTES,
) -> Bitmap:
    """Write a plate, or one of its dies alone, as 8-bit grey PNG: linear, white is clear.

    Args:
        plate: what to draw.
        path: the file to write, ``.png``.
        dots_per_um: pixels per micrometre, also in the file's resolution; the lower left corner of the blank or of the
            panel is that of a pixel.
        comments: provenance, put into the file's description.
        die: the only die to show, by its name.
        limit_bytes: raw size beyond which nothing is written.

    Raises:
        OutputError: MF401 if the file cannot be written, MF413 if ``dots_per_um`` is not positive and finite, MF415 if
            the file would be too large.
        KeyError: for a die that the plate does not have.
    """
    return _write(plate, path, dots_per_um, comments, die, limit_bytes, bits=8)


def write_bilevel(
    plate: Plate,
    path: Path,
    dots_per_um: float,
    comments: Sequence[str] = (),
    *,
    die: str | None = None,
    limit_bytes: int = LARGEST_BYTES,
) -> Bitmap:
    """Write as TIFF with one bit for each pixel, deflated; 1 (white) is clear. All else as :func:`write_preview`."""
    return _write(plate, path, dots_per_um, comments, die, limit_bytes, bits=1)


def bitmap_size(plate: Plate, dots_per_um: float, die: str | None = None) -> tuple[int, int]:
    """Pixels along x and y.

    Raises:
        OutputError: MF413 if ``dots_per_um`` is not positive and finite.
    """
    if not (math.isfinite(dots_per_um) and dots_per_um > 0):
        raise OutputError("MF413", f"{dots_per_um} dots per um are not positive", cure="Give a number such as 1.0")
    box = _box(plate, die)
    # A length that is whole in pixels stays so whatever the rounding of the product.
    width, height = (math.ceil(round(side * dots_per_um / NM_PER_UM, 6)) for side in (box[2] - box[0], box[3] - box[1]))
    return max(1, width), max(1, height)


def _box(plate: Plate, die: str | None) -> Box:
    if die is None:
        half = plate.blank_nm // 2
        return -half, -half, half, half
    boxes = {each.name: each.box_nm for each in plate.dies}
    if die not in boxes:
        raise KeyError(f"no die {die!r} on the plate {plate.name!r}")
    return boxes[die]


def _write(
    plate: Plate,
    path: Path,
    dots_per_um: float,
    comments: Sequence[str],
    die: str | None,
    limit_bytes: int,
    bits: int,
) -> Bitmap:
    width, height = bitmap_size(plate, dots_per_um, die)
    check_file_size(math.ceil(width * bits / 8) * height, limit_bytes, path, "Choose fewer dots per um, or one die")
    header = oiio.ImageSpec(width, height, 1, "uint8")
    if bits == 1:
        header.attribute("oiio:BitsPerSample", 1)
        header.attribute("compression", "zip")
    header.attribute("XResolution", dots_per_um * _UM_PER_CM)
    header.attribute("YResolution", dots_per_um * _UM_PER_CM)
    header.attribute("ResolutionUnit", "cm")
    header.attribute("oiio:ColorSpace", "lin_rec709_scene")
    header.attribute("Software", "maskfab")
    # Or OpenImageIO writes the time, and equal masks make unequal files. TIFF knows no empty one.
    header.attribute("DateTime", _DATE if path.suffix in {".tif", ".tiff"} else "")
    said = (*comments, f"{dots_per_um:g} dots per um; white is clear in the chrome")
    header.attribute("ImageDescription", "; ".join(" ".join(line.split()) for line in said))
    partly = 0
    with partial(path) as aside:
        output = oiio.ImageOutput.create(str(aside))
        if output is None or not output.open(str(aside), header):
            raise OutputError("MF401", f"{path} cannot be written", cure="Choose another --out and a known suffix")
        written, top = True, 0
        for shares in _bands(plate, _box(plate, die), width, height, dots_per_um):
            partly += int(np.count_nonzero((shares > _ROUNDING) & (shares < 1 - _ROUNDING)))
            # Rounding must not choose between halves.
            levels = (
                (shares >= 0.5 - _ROUNDING) * np.uint8(255)
                if bits == 1
                else np.floor(shares * 255.0 + 0.5 + 255 * _ROUNDING).astype(np.uint8)
            )
            pixels = np.ascontiguousarray(levels[::-1, :, None])
            written = written and output.write_scanlines(top, top + len(pixels), 0, pixels)
            top += len(pixels)
        if not (output.close() and written and is_whole(aside)):
            raise OutputError(
                "MF401",
                f"{path} cannot be written: {output.geterror()}",
                cure="Give --out a writable folder with room to spare",
            )
    return Bitmap(width, height, dots_per_um, partly)


def _bands(plate: Plate, box: Box, width: int, height: int, dots_per_um: float) -> Iterator[Floats]:
    """Share of every pixel that is clear, float64 [rows, width], row 0 lowest; the highest band first."""
    x, y = _borders(box[0], width, dots_per_um), _borders(box[1], height, dots_per_um)
    dies = [_Laid.on(die, x) for die in plate.dies]
    marks = db.Region([db.Polygon(simple_polygon(p)) for mark in _written(plate) for p in mark.polygons])
    rows = max(1, _BAND_PIXELS // width)
    for stop in range(height, 0, -rows):
        edges = y[max(0, stop - rows) : stop + 1]
        shares = np.zeros((edges.size - 1, width))
        for die in dies:
            die.add_to(shares, edges)
        window = db.Region(db.Box(math.floor(x[0]), math.floor(edges[0]), math.ceil(x[-1]), math.ceil(edges[-1])))
        near = marks & window
        if not near.is_empty():
            shares += coverage(near, x, edges)
        yield np.minimum(shares, 1.0)


def _borders(start_nm: int, pixels: int, dots_per_um: float) -> Floats:
    return np.asarray(start_nm + np.arange(pixels + 1) * (NM_PER_UM / dots_per_um), dtype=np.float64)


def _written(plate: Plate) -> Iterator[Furniture]:
    return (mark for mark in plate.furniture if mark.layer.written)


@dataclass(frozen=True, eq=False)
class _Laid:
    """A die over the columns of an image.

    Attributes:
        clear: float64 [y, x] on the die's own grid.
        y_edges: of that grid.
        columns: the image's columns that the die reaches.
        across: share of each of these in each column of the grid.
    """

    clear: Floats
    y_edges: Floats
    columns: slice
    across: sparse.csr_array

    @classmethod
    def on(cls, die: Die, x: Floats) -> _Laid:
        x_edges, y_edges = die_edges_nm(die)
        columns = _reached(x_edges, x)
        across = pixel_overlaps(x_edges, x[columns.start : columns.stop + 1])
        return cls(die_raster(die).astype(np.float64), y_edges, columns, across)

    def add_to(self, shares: Floats, y: Floats) -> None:
        rows = _reached(self.y_edges, y)
        if rows.start >= rows.stop or self.columns.start >= self.columns.stop:
            return
        along = pixel_overlaps(self.y_edges, y[rows.start : rows.stop + 1])
        low, high = along.indices.min(), along.indices.max() + 1
        mixed = along[:, low:high] @ self.clear[low:high]
        shares[rows, self.columns] += (self.across @ mixed.T).T


def _reached(edges: Floats, pixels: Floats) -> slice:
    """The pixels that an interval reaches into."""
    first = int(np.searchsorted(pixels, edges[0], side="right")) - 1
    last = int(np.searchsorted(pixels, edges[-1], side="left"))
    return slice(max(0, first), min(pixels.size - 1, last))
