"""A picture of a mask, PNG or TIFF, as a layout: white pixels are clear, and its middle is the origin.

A picture says how large its pixels are only by its resolution, and nothing about where it lies.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.errors import SourceError
from maskfab.geometry.plate_layout import DBU_UM, layer_info
from maskfab.geometry.shape_limits import ROUNDING_KEY, LeftOut, note_left_out
from maskfab.model import CLEAR
from maskfab.readers.image_errors import said_by
from maskfab.readers.tiff_tone import shown_alike
from maskfab.units import NM_PER_UM, UM_PER_INCH, UM_PER_UNIT

MOST_PIXELS = 400_000_000
MOST_RUNS = 20_000_000

TIFF_SUFFIXES = (".tif", ".tiff")
IMAGE_SUFFIXES = (".png", *TIFF_SUFFIXES)
_WHITE, _HALF = 255, 128
_MAGIC = {
    ".png": (b"\x89PNG\r\n\x1a\n",),
    **dict.fromkeys(TIFF_SUFFIXES, (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")),
}
_PNG_AROUND = 12
_UM_PER_UNIT = {**{unit: UM_PER_UNIT[unit] for unit in ("in", "cm", "m", "mm")}, "inch": UM_PER_INCH}


def read_picture(path: Path, dots_per_um: float | None = None) -> db.Layout:
    """An image as boxes on the layer CLEAR of one cell, the middle of the image the origin.

    Args:
        path: ``.png .tif .tiff``.
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
    told = "largest rounding to the nanometre grid"
    layout.add_meta_info(db.LayoutMetaInfo(ROUNDING_KEY, max(x_off, y_off), told))
    note_left_out(layout, LeftOut(grey_pixels=int(np.count_nonzero((values > 0) & (values < _WHITE)))))
    return layout


def read_levels(path: Path) -> tuple[NDArray[np.float64] | NDArray[np.uint8], float | None]:
    """Mean brightness of every pixel, 0 to 255, the top row first; pixels in a micrometre that the file states, if any.

    Raises:
        SourceError: MF301 missing, MF302 empty, MF303 damaged, MF304 not what its suffix says, MF308 turned, of several
            pages or transparent, MF313 too large, MF314 its resolution is not the same along x and y, MF318 it does not
            say what is white.
    """
    if not os.path.isfile(path):
        raise SourceError(
            "MF301", f"there is no file {path.name}", where=str(path), cure="Give the path of an existing file"
        )
    if path.stat().st_size == 0:
        raise SourceError("MF302", f"{path.name} holds 0 bytes", where=str(path), cure="Save or copy the picture again")
    with path.open("rb") as file:
        start = file.read(8)
    if not any(start.startswith(magic) for magic in _MAGIC[path.suffix.lower()]):
        raise SourceError(
            "MF304",
            f"the content of {path.name} does not match its suffix",
            where=str(path),
            cure="Give it its true suffix",
        )
    if path.suffix.lower() == ".png" and not _ends(path):
        raise _damaged(path, "it ends without IEND")
    if path.suffix.lower() in TIFF_SUFFIXES:
        with shown_alike(path) as shown:
            return _pixels(path, shown)
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
    raise SourceError(
        "MF314",
        f"{path.name} does not state the size of its pixels",
        where=str(path),
        cure="State the scale, such as --dots-per-um 0.25",
    )


def _pixels(path: Path, shown: Path) -> tuple[NDArray[np.float64] | NDArray[np.uint8], float | None]:
    """Mean brightness of every pixel, 0 to 255, the top row first; pixels in a micrometre that the file states.

    Args:
        path: the file, as it is told.
        shown: the same, or what is read in its place.
    """
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    where = str(path)
    image = oiio.ImageInput.open(str(shown))
    if image is None:
        raise _damaged(path, said_by(oiio))
    try:
        spec = image.spec()
        if spec.width * spec.height * spec.nchannels > MOST_PIXELS:
            raise SourceError(
                "MF313",
                f"{path.name} has {spec.width} x {spec.height} pixels in {spec.nchannels} channels; the limit of all "
                f"is {MOST_PIXELS:.0e}",
                where=where,
                cure="Write fewer dots per micrometre, or one die at a time",
            )
        further = image.seek_subimage(1, 0)
        said_by(image)  # there being none is no error
        if spec.getattribute("Orientation") not in {None, 1} or further:
            raise SourceError(
                "MF308",
                f"{path.name} is turned by its tags, or has several pages",
                where=where,
                cure="Save one picture as it is seen",
            )
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
        raise SourceError(
            "MF308",
            f"{path.name} is transparent in part, which shows as whatever lies behind it",
            where=where,
            cure="Save it without transparency, black where the mask is opaque and white where it is clear",
        )
    values = channels[:, :, colours]
    return values[:, :, 0] if len(colours) == 1 else values.mean(axis=2), stated


def _stated(spec: object, path: Path) -> float | None:
    along = [float(spec.get_float_attribute(name, 0.0)) for name in ("XResolution", "YResolution")]  # type: ignore[attr-defined]
    unit = str(spec.get_string_attribute("ResolutionUnit", ""))  # type: ignore[attr-defined]
    if unit not in _UM_PER_UNIT or not all(0 < value < 1e9 for value in along):
        return None
    if abs(along[0] / along[1] - 1) > 1e-6:
        raise SourceError(
            "MF314",
            f"{path.name} has {along[0]:g} pixels per {unit} along x and {along[1]:g} along y",
            where=str(path),
            cure="Write square pixels, or state --dots-per-um",
        )
    return along[0] / _UM_PER_UNIT[unit]


def _edges_nm(count: int, pixel_nm: float) -> tuple[list[int], float]:
    """Borders of the pixels on the nanometre grid, and the largest rounding; the middle is 0."""
    exact = (np.arange(count + 1) - count / 2) * pixel_nm
    # Half a nanometre is rounded the same way everywhere, so that equal pixels stay equal.
    nearest = np.floor(exact + 0.5)
    if np.abs(nearest).max() > 2**31 - 1:
        raise SourceError(
            "MF313",
            f"{count} pixels of {pixel_nm:g} nm are wider than 2.1 m",
            cure="Give the true number of pixels per micrometre as --dots-per-um",
        )
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
            raise SourceError(
                "MF313",
                f"{path.name} has over {MOST_RUNS} runs of white pixels",
                where=str(path),
                cure="Write one die at a time",
            )
    return boxes


def _damaged(path: Path, what: str) -> SourceError:
    said = what.strip().splitlines()
    return SourceError(
        "MF303", f"{path.name}: {said[0] if said else 'it is damaged'}", where=str(path), cure="Write or copy it again"
    )
