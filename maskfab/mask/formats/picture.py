"""Pictures of masks, PNG and TIFF: written of a die, read back against it, and read as layouts whoever made them.

Written are pixels for people and for machines that write them, at a stated number of dots per micrometre. A pixel of
the PNG of 8 bits is the share of it that is clear, to the nearest of 256 levels and up from the middle of two; one of
the TIFF of 1 bit is white where that share is half or more. Read back, every pixel is held against the exact share of
it that is clear: one wrong pixel fails, however coarse the picture.

Read as a layout, white pixels are clear, and the middle of the picture is the origin. A picture says how large its
pixels are only by its resolution, and nothing about where it lies.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import gcd
from pathlib import Path

import numpy as np
import scipy
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError, OutputError, SourceError
from maskfab.base.files import partial
from maskfab.base.model import CLEAR, Box, Die, Plate, Quantity
from maskfab.base.pictures import is_whole
from maskfab.base.units import NM_PER_UM, UM_PER_INCH, UM_PER_UNIT
from maskfab.job.values import MOST_DOTS_PER_UM, FileFormat
from maskfab.mask.dots import die_edges_nm, die_raster, pixel_overlaps, smallest_runs
from maskfab.mask.formats.content import note_rounding
from maskfab.mask.formats.format import Drawn, Format, Source
from maskfab.mask.formats.tiff import said_by, shown_alike
from maskfab.mask.layout import DBU_UM, LeftOut, check_file_size, clear_shapes, drawn_region, layer_info, note_left_out
from maskfab.mask.raster import coverage
from maskfab.mask.sandbox import damaged, missing

MOST_PIXELS = 400_000_000
MOST_RUNS = 20_000_000

TIFF_SUFFIXES = (".tif", ".tiff")
IMAGE_SUFFIXES = (".png", *TIFF_SUFFIXES)
_WHITE, _HALF = 255, 128
_MAGIC = {".png": (b"\x89PNG\r\n\x1a\n",), **dict.fromkeys(TIFF_SUFFIXES, (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"))}
_PNG_AROUND = 12
_UM_PER_UNIT = {**{unit: UM_PER_UNIT[unit] for unit in ("in", "cm", "m", "mm")}, "inch": UM_PER_INCH}


def read_picture(path: Path, dots_per_um: float | None = None) -> db.Layout:
    """An image as boxes on the layer CLEAR of one cell, the middle of the image the origin.

    Args:
        dots_per_um: pixels in a micrometre; what the file's resolution tags say if None.

    Raises:
        SourceError: MF301 missing, MF302 empty, MF303 damaged, MF304 not what its suffix says, MF308 turned, of several
            pages or transparent, MF313 too large, MF314 its resolution is not known or not the same along x and y,
            MF318 it does not say what is white.
    """
    values, stated = read_levels(path)
    pixel_nm = NM_PER_UM / (dots_per_um or stated or _unknown(path))
    white = values >= _HALF
    rows, columns = white.shape
    x, x_off = _edges_nm(columns, pixel_nm)
    y, y_off = _edges_nm(rows, pixel_nm)
    layout = db.Layout()
    layout.dbu = DBU_UM
    shapes = layout.create_cell("PICTURE").shapes(layout.layer(layer_info(CLEAR)))
    for box in _boxes(white[::-1], path):
        shapes.insert(db.Box(x[box[0]], y[box[1]], x[box[2]], y[box[3]]))
    note_rounding(layout, max(x_off, y_off))
    note_left_out(layout, LeftOut(grey_pixels=int(np.count_nonzero((values > 0) & (values < _WHITE)))))
    return layout


def read_levels(path: Path) -> tuple[NDArray[np.float64] | NDArray[np.uint8], float | None]:
    """Mean brightness of every pixel, 0 to 255, the top row first; pixels in a micrometre, if the file states them."""
    if not os.path.isfile(path):
        raise missing(path)
    if path.stat().st_size == 0:
        raise SourceError("MF302", f"{path.name} holds 0 bytes", where=str(path), cure="Save or copy the picture again")
    with path.open("rb") as file:
        start = file.read(8)
    if not any(start.startswith(magic) for magic in _MAGIC[path.suffix.lower()]):
        what = f"the content of {path.name} does not match its suffix"
        raise SourceError("MF304", what, where=str(path), cure="Give it its true suffix")
    if path.suffix.lower() == ".png" and not _ends(path):
        raise _damaged(path, "it ends without IEND")
    if path.suffix.lower() in TIFF_SUFFIXES:
        with shown_alike(path) as shown:
            values, stated = _pixels(path, shown.path)
            return shown.positive(values, _WHITE), stated
    return _pixels(path, path)


def _ends(path: Path) -> bool:
    """Whether a PNG is there to its last chunk: its length and name in eight bytes, its data, and a sum of four.

    A reader is content once it has all pixels.
    """
    start, size = len(_MAGIC[".png"][0]), path.stat().st_size
    with path.open("rb") as file:
        while start + _PNG_AROUND <= size:
            file.seek(start)
            length, name = int.from_bytes(file.read(4), "big"), file.read(4)
            start += _PNG_AROUND + length
            if name == b"IEND":
                return start <= size
    return False


def _unknown(path: Path) -> float:
    what = f"{path.name} does not state the size of its pixels"
    raise SourceError("MF314", what, where=str(path), cure="State the scale, such as --dots-per-um 0.25")


def _pixels(path: Path, shown: Path) -> tuple[NDArray[np.float64] | NDArray[np.uint8], float | None]:
    """Mean brightness of every pixel, 0 to 255, the top row first; pixels in a micrometre that the file states."""
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    where = str(path)
    image = oiio.ImageInput.open(str(shown))
    if image is None:
        raise _damaged(path, said_by(oiio))
    try:
        spec = image.spec()
        if spec.width * spec.height * spec.nchannels > MOST_PIXELS:
            what = (
                f"{path.name} has {spec.width} x {spec.height} pixels in {spec.nchannels} channels; the limit of all "
                f"is {MOST_PIXELS:.0e}"
            )
            raise SourceError("MF313", what, where=where, cure="Write fewer dots per micrometre, or one die at a time")
        further = image.seek_subimage(1, 0)
        said_by(image)  # there being none is no error
        if spec.getattribute("Orientation") not in {None, 1} or further:
            what = f"{path.name} is turned by its tags, or has several pages"
            raise SourceError("MF308", what, where=where, cure="Save one picture as it is seen")
        image.seek_subimage(0, 0)
        stated = _stated(spec, path)
        pixels = image.read_image(oiio.UINT8)
        problem = said_by(image) or said_by(oiio)
    finally:
        image.close()
    if pixels is None or problem:
        raise _damaged(path, problem)
    colours = [c for c in range(spec.nchannels) if c not in (spec.alpha_channel, spec.z_channel)]
    if not colours:
        raise _damaged(path, "it has no colour channel")
    channels = np.asarray(pixels).reshape(spec.height, spec.width, -1)
    if spec.alpha_channel >= 0 and channels[:, :, spec.alpha_channel].min() < _WHITE:
        what = f"{path.name} is transparent in part, which shows as whatever lies behind it"
        cure = "Save it without transparency, black where the mask is opaque and white where it is clear"
        raise SourceError("MF308", what, where=where, cure=cure)
    values = channels[:, :, colours]
    return values[:, :, 0] if len(colours) == 1 else values.mean(axis=2), stated


def _stated(spec: object, path: Path) -> float | None:
    along = [float(spec.get_float_attribute(name, 0.0)) for name in ("XResolution", "YResolution")]  # type: ignore[attr-defined]
    unit = str(spec.get_string_attribute("ResolutionUnit", ""))  # type: ignore[attr-defined]
    if unit not in _UM_PER_UNIT or not all(0 < value < 1e9 for value in along):
        return None
    if abs(along[0] / along[1] - 1) > 1e-6:
        what = f"{path.name} has {along[0]:g} pixels per {unit} along x and {along[1]:g} along y"
        raise SourceError("MF314", what, where=str(path), cure="Write square pixels, or state --dots-per-um")
    return along[0] / _UM_PER_UNIT[unit]


def _edges_nm(count: int, pixel_nm: float) -> tuple[list[int], float]:
    """Borders of the pixels on the nanometre grid, and the largest rounding; the middle is 0."""
    exact = (np.arange(count + 1) - count / 2) * pixel_nm
    # Half a nanometre is rounded the same way everywhere, so that equal pixels stay equal.
    nearest = np.floor(exact + 0.5)
    if np.abs(nearest).max() > 2**31 - 1:
        what = f"{count} pixels of {pixel_nm:g} nm are wider than 2.1 m"
        raise SourceError("MF313", what, cure="Give the true number of pixels per micrometre as --dots-per-um")
    shifts = exact - nearest
    spread = float(np.ptp(shifts))
    edges: list[int] = nearest.astype(np.int64).tolist()
    return edges, spread if spread > 1e-6 else 0.0


def _boxes(white: NDArray[np.bool_], path: Path) -> list[tuple[int, int, int, int]]:
    """Disjoint boxes of the white pixels, from the runs of every row; rows that are alike share them."""
    changes = np.flatnonzero((white[1:] != white[:-1]).any(axis=1)) + 1
    starts = np.concatenate([[0], changes])
    stops = np.concatenate([changes, [white.shape[0]]])
    boxes: list[tuple[int, int, int, int]] = []
    for low, high in zip(starts.tolist(), stops.tolist(), strict=True):
        steps = np.diff(np.pad(white[low].astype(np.int8), 1))
        left, right = np.flatnonzero(steps == 1).tolist(), np.flatnonzero(steps == -1).tolist()
        boxes += [(x0, low, x1, high) for x0, x1 in zip(left, right, strict=True)]
        if len(boxes) > MOST_RUNS:
            what = f"{path.name} has over {MOST_RUNS} runs of white pixels"
            raise SourceError("MF313", what, where=str(path), cure="Write one die at a time")
    return boxes


def _damaged(path: Path, what: str) -> SourceError:
    said = what.strip().splitlines()
    return damaged(path, said[0] if said else "it is damaged")


LARGEST_BYTES = 500_000_000

_DATE = "1980:01:01 00:00:00"
"""As members of our packages have it, which is no date of anything."""
_BAND_PIXELS = 4_000_000
_ROUNDING = 1e-9
"""A pixel covered to this much less or more than wholly is whole, and one covered by half to this is at a half."""
_UM_PER_CM = 10_000.0


@dataclass(frozen=True)
class Bitmap:
    """Facts of a written bitmap; ``partly`` pixels are neither clear nor opaque all over: with none it is the mask."""

    width: int
    height: int
    dots_per_um: float
    partly: int


def write_picture(
    plate: Plate,
    path: Path,
    dots_per_um: float,
    comments: Sequence[str] = (),
    *,
    die: str | None = None,
    limit_bytes: int = LARGEST_BYTES,
) -> Bitmap:
    """Write a plate, or one of its dies alone: as PNG in 8 bits, linear, white is clear; or as TIFF in one, 1 is clear.

    Args:
        dots_per_um: pixels per micrometre, also in the file's resolution; the lower left corner of the blank or of the
            panel is that of a pixel.

    Raises:
        OutputError: MF401 if the file cannot be written, MF413 if ``dots_per_um`` is not positive and finite, MF415 if
            the file would be too large.
    """
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    bits = 1 if path.suffix in TIFF_SUFFIXES else 8
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
    header.attribute("DateTime", _DATE if bits == 1 else "")
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
            what = f"{path} cannot be written: {output.geterror()}"
            raise OutputError("MF401", what, cure="Give --out a writable folder with room to spare")
    return Bitmap(width, height, dots_per_um, partly)


def bitmap_size(plate: Plate, dots_per_um: float, die: str | None = None) -> tuple[int, int]:
    """Pixels along x and y. Raises OutputError MF413 if ``dots_per_um`` is not positive and finite."""
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
    boxes = {laid.name: laid.box_nm for laid in plate.dies}
    if die not in boxes:
        raise KeyError(f"no die {die!r} on the plate {plate.name!r}")
    return boxes[die]


def _bands(plate: Plate, box: Box, width: int, height: int, dots_per_um: float) -> Iterator[Floats]:
    """Share of every pixel that is clear, float64 [rows, width], row 0 lowest; the highest band first."""
    x, y = _borders(box[0], width, dots_per_um), _borders(box[1], height, dots_per_um)
    dies = [_Laid.on(die, x) for die in plate.dies]
    marks = drawn_region(polygon for mark in plate.marks if mark.layer.written for polygon in mark.polygons)
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


@dataclass(frozen=True, eq=False)
class _Laid:
    """A die over the columns of an image.

    Attributes:
        clear: float64 [y, x] on the die's own grid.
        columns: the image's columns that the die reaches.
        across: share of each of these in each column of the grid.
    """

    clear: Floats
    y_edges: Floats
    columns: slice
    across: scipy.sparse.csr_array

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
    first = int(np.searchsorted(pixels, edges[0], side="right")) - 1
    last = int(np.searchsorted(pixels, edges[-1], side="left"))
    return slice(max(0, first), min(pixels.size - 1, last))


_LEVEL = 1e-6
_MOST_SHIFT = 0.1
"""Part of a pixel by which the resolution that a file states, which is rounded, may displace its last one."""


def check_pixels(dies: Sequence[Die], dots_per_um: float, where: str) -> None:
    """Refuse pixels that are larger than the smallest feature of a die: no picture of them carries the design.

    Raises:
        JobError: MF104.
    """
    if not dies:
        return
    pixel = NM_PER_UM / dots_per_um
    smallest, die = min(((smallest_nm(die, pixel), die) for die in dies), key=lambda pair: pair[0])
    if pixel <= smallest * (1 + _ROUNDING):
        return
    coarsest, even = NM_PER_UM / smallest, NM_PER_UM / gcd(*(length for die in dies for length in _lengths_nm(die)))
    cure = f"Set it to at least {_rounded_up(coarsest)}"
    if coarsest > MOST_DOTS_PER_UM:
        cure = (
            f"Leave png and tiff out of export.formats: it would take {_rounded_up(coarsest)}, more than any may have"
        )
    elif coarsest * (1 + _ROUNDING) < even <= MOST_DOTS_PER_UM:
        cure += f"; from {_rounded_up(even)} on pixels can follow every dot"
    what = (
        f"{dots_per_um:g} dots per um are pixels of {pixel / NM_PER_UM:g} um, larger than the smallest feature of the "
        f"die {die.name}, {smallest / NM_PER_UM:g} um: such a picture cannot carry the design"
    )
    raise JobError("MF104", what, where=f"{where}: export.dots_per_um", cure=cure)


def check_bitmap(die: Die, design: db.Layout, path: Path, dots_per_um: float) -> tuple[Quantity, ...]:
    """Read a die's PNG or TIFF back and compare it with the plate.

    Args:
        dots_per_um: pixels per micrometre that it should have; its own resolution tags are what it is read by.

    Returns:
        ``bitmap_wrong_pixels``, whose limit is 0: pixels that are not what the exact share of them that is clear makes
        them, all of them if size or resolution are others; and ``bitmap_xor_area`` in um²: what only one of picture and
        die covers, each pixel clear or not. Its limit is 0 where pixels follow the dots; elsewhere it is not judged,
        for it tells what pixels so large cannot show.
    """
    x0, y0, x1, y1 = die.box_nm
    pixel = NM_PER_UM / dots_per_um
    width, height = (int(np.ceil(round(side / pixel, 6))) for side in (x1 - x0, y1 - y0))
    x, y = (start + pixel * np.arange(count + 1, dtype=np.float64) for start, count in ((x0, width), (y0, height)))
    clear = coverage(clear_shapes(design, die.box_nm), x, y)
    partly = int(np.count_nonzero((clear > _ROUNDING) & (clear < 1 - _ROUNDING)))
    wrong, differing, why = _compared(path, clear, dots_per_um)
    area_um2 = differing / dots_per_um**2
    return (
        Quantity("bitmap_wrong_pixels", wrong, why, limit=0, passed=wrong == 0, die=die.name),
        Quantity(
            "bitmap_xor_area",
            area_um2,
            f"{path.name}, each pixel clear or not, against the exact share of it that is clear; "
            + (f"{partly} pixels are partly clear" if partly else "its pixels follow the dots"),
            limit=None if partly else 0.0,
            passed=None if partly else area_um2 == 0,
            die=die.name,
        ),
    )


def _compared(path: Path, clear: Floats, dots_per_um: float) -> tuple[int, float, str]:
    """Pixels of a file that are wrong; what only it or the design makes clear, in pixels; and how that was told."""
    levels, stated = read_levels(path)
    rows, columns = clear.shape
    if stated is None:
        what = f"{path.name} does not state the size of its pixels"
        raise SourceError("MF314", what, where=str(path), cure="Run the job again to rewrite it")
    if levels.shape != clear.shape or abs(stated / dots_per_um - 1) * max(rows, columns) > _MOST_SHIFT:
        high, wide = levels.shape
        every = max(levels.size, clear.size)
        return (
            every,
            every,
            (
                f"{path.name} is {wide} x {high} pixels, {stated:g} to the um; the design has {columns} x {rows}, "
                f"{dots_per_um:g} to the um"
            ),
        )
    grey, wrong, differing = path.suffix == ".png", 0, 0.0
    band = max(1, _BAND_PIXELS // columns)
    for low in range(0, rows, band):
        read, share = levels[::-1][low : low + band].astype(np.float64), clear[low : low + band]
        off = abs(read - _WHITE * share) > 0.5 + _LEVEL if grey else read != _WHITE * (share >= 0.5 - _ROUNDING)
        wrong += int(np.count_nonzero(off))
        apart = np.where(read >= _WHITE / 2, 1 - share, share)
        differing += float(apart[apart > _ROUNDING].sum())
    rule = (
        "level against the exact share of each pixel that is clear, to the nearest of 256"
        if grey
        else "white against the exact share of each pixel that is clear: half of it or more"
    )
    return wrong, differing, f"{path.name}, {rule}"


def smallest_nm(die: Die, enough_nm: float) -> float:
    """Shortest clear or opaque run of a die along x or y; lengths of which dots and gutters are at least are enough."""
    least = min(length for length in (die.panel.dot_nm, die.panel.gutter_nm) if length)
    if least >= enough_nm:
        return float(least)
    runs = smallest_runs(die_raster(die), *die_edges_nm(die))
    return min(runs.clear, runs.opaque)


def _lengths_nm(die: Die) -> tuple[int, int]:
    """Lengths that pixels have to divide to follow every dot: a dot, and the way from the border to the first."""
    return die.panel.dot_nm, die.panel.gutter_nm // 2


def _rounded_up(value: float) -> str:
    text = f"{value:.6g}"
    digits = 5 - int(np.floor(np.log10(value)))
    return text if float(text) >= value else f"{np.ceil(value * 10.0**digits) / 10.0**digits:.6g}"


def _format(name: FileFormat, title: str, tail: str) -> Format:
    def write(of: Source, die: Die, to: Path) -> Bitmap:
        return write_picture(of.plate, to, of.settings.dots_per_um, of.comments, die=die.name)

    def compare(made: Drawn, die: Die, path: Path) -> tuple[Quantity, ...]:
        return check_bitmap(die, made.design, path, made.settings.dots_per_um)

    return Format(name, title, tail, write_die=write, compare_die=compare)


FORMATS = (_format("png", "PNG", ".png"), _format("tiff", "TIFF, 1 bit", ".tif"))
