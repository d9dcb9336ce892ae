"""Pictures on the pixels of a display, linear light: photographs, and targets that show its faults.

Targets have one value per pixel, [rows, columns, 3], row 0 the lowest.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Singles
from maskfab.base.errors import JobError, SourceError
from maskfab.base.files import no_file
from maskfab.base.model import frozen
from maskfab.mask.formats.tiff import said_by, shown_alike
from maskfab.optics.colour import light_of_code

LARGEST = 60_000_000
"""Pixels of the largest picture that is read: three quarters of a gigabyte once it is floating point."""

MOST_CHANNELS = 16
"""Read before those without colour are left out; a few bytes can state thousands."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture as a file holds it.

    Attributes:
        values: float32 [rows, columns, 1 to 4], row 0 on top; grey or red, green, blue, then alpha if there is one.
        coded: whether the colours are sRGB code values (integers of any depth) rather than linear light (floats).
        associated: whether the colours are already multiplied by alpha.
        sensitivity: ISO speed of its EXIF; None where it has none.
        orientation: tag by which its values are still to be turned to be seen.
    """

    values: Singles
    coded: bool
    associated: bool
    where: str
    sensitivity: float | None = None
    orientation: int = 1


def read_picture(path: str | Path, *, upright: bool = True) -> Picture:
    """Read a picture of any kind that OpenImageIO knows; palettes are looked up.

    Args:
        upright: turn it as its tag says that it is seen; else it stays as the sensor lay.

    Raises:
        SourceError: MF301 missing, MF302 empty, MF303 damaged, MF308 not a picture, MF318 a TIFF that does not say what
            is white.
        JobError: MF121 no colour channels, or too large.
    """
    path = Path(path)
    where = str(path)
    image = _found(path, where)
    orientation = image.spec().get_int_attribute("Orientation", 1)
    if image.format_name() != "tiff":
        picture = _of_image(image, where)
    else:
        image.close()
        with shown_alike(path) as shown:
            picture = _of_image(_opened(shown.path, where), where)
            picture = replace(picture, values=shown.positive(picture.values, 1.0))
    if not upright:
        return replace(picture, orientation=orientation)
    return replace(picture, values=turned(picture.values, orientation))


def picture_shape(path: Path) -> tuple[int, int]:
    """Rows and columns of a picture as it is seen, by its header; errors as :func:`read_picture`, if it tells."""
    image = _found(path, str(path))
    spec = image.spec()
    image.close()
    _readable(spec, str(path))
    shape = spec.height, spec.width
    return shape[::-1] if spec.get_int_attribute("Orientation", 1) in _LYING else shape


_KEPT = ("Make", "Model", "DateTime", "ExposureTime", "FNumber")


def exif_of(path: Path) -> dict[str, Any]:
    """Camera, lens, date and exposure that a picture's file tells, by OpenImageIO's names; none where it tells none."""
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    image = oiio.ImageInput.open(str(path)) if path.is_file() else None
    if image is None:
        oiio.geterror()  # or it is told at the end of the process
        return {}
    told = {each.name: each.value for each in image.spec().extra_attribs}
    image.close()
    return {name: value for name, value in told.items() if name in _KEPT or name.startswith("Exif:")}


_LYING = (5, 6, 7, 8)


def turned(values: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Pixels [rows, columns, ...] as they are seen, of the tag Orientation of TIFF 6.0 and EXIF."""
    if orientation in _LYING:
        values = values.swapaxes(0, 1)
    down, across = orientation in (3, 4, 7, 8), orientation in (2, 3, 6, 7)
    return np.ascontiguousarray(values[:: -1 if down else 1, :: -1 if across else 1])


def _found(path: Path, where: str) -> Any:
    if not os.path.isfile(path):
        raise SourceError("MF301", no_file(path, where), cure="Give the path of a picture")
    if path.stat().st_size == 0:
        raise SourceError("MF302", f"{where} is empty", cure="Save or copy the picture again")
    return _opened(path, where)


def _opened(path: Path, where: str) -> Any:
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    # Otherwise integers come multiplied by alpha, in code values, which loses what a display would be sent.
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    image = oiio.ImageInput.open(str(path), config)
    if image is None:
        what = f"{where} is not a picture: {_first_line(said_by(oiio))}"
        raise SourceError("MF308", what, cure="Save the picture as PNG, TIFF or JPEG")
    return image


def _of_image(image: Any, where: str) -> Picture:
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    try:
        spec = image.spec()
        channels = _readable(spec, where)
        pixels = image.read_image(oiio.FLOAT)
        problem = said_by(image)
    finally:
        image.close()
    if pixels is None or problem:
        raise SourceError("MF303", f"{where} is damaged: {_first_line(problem)}", cure="Save or copy the picture again")
    values = np.asarray(pixels, dtype=np.float32).reshape(spec.height, spec.width, spec.nchannels)
    associated = not spec.get_int_attribute("oiio:UnassociatedAlpha")
    iso = float(spec.get_int_attribute("Exif:PhotographicSensitivity")) or None
    return Picture(values[:, :, channels], str(spec.format) not in _FLOATS, associated, where, iso)


def _readable(spec: Any, where: str) -> list[int]:
    """The channels of a picture that are read, if its header promises one."""
    if spec.width < 1 or spec.height < 1:
        raise JobError("MF121", "the picture is empty", where=where, cure="Give a picture with pixels")
    if spec.depth > 1:
        raise JobError("MF121", "the picture is a volume", where=where, cure="Give one slice of it")
    if spec.nchannels > MOST_CHANNELS:
        what = f"the picture has {spec.nchannels} channels, more than {MOST_CHANNELS}"
        raise JobError("MF121", what, where=where, cure="Save it as grey or as red, green and blue")
    if spec.width * spec.height > LARGEST:
        what = f"the picture has {spec.width} x {spec.height} pixels, more than {LARGEST // 1_000_000} million"
        raise JobError("MF121", what, where=where, cure="Scale the picture down")
    return _channels(spec, where)


_FLOATS = ("half", "float", "double")


def on_pixels(picture: Picture, rows: int, columns: int) -> Floats:
    """Linear light of every pixel of a display, [rows, columns, 3] within 0 to 1, row 0 the lowest.

    The middle of the picture, cut to the display's shape, is averaged over each pixel's own area, fractions of picture
    elements included. What is transparent is black.
    """
    height, width = picture.values.shape[:2]
    scale = min(height / rows, width / columns)
    across = _shares(width, columns, scale)
    down = _shares(height, rows, scale)
    strips = np.empty((height, columns, 3))
    step = max(1, 4_000_000 // width)
    for top in range(0, height, step):
        light = _linear(picture, picture.values[top : top + step])
        strips[top : top + step] = np.tensordot(light, across, axes=(1, 1)).transpose(0, 2, 1)
    mean = np.tensordot(down, strips, axes=1)
    return np.ascontiguousarray(np.clip(mean, 0.0, 1.0)[::-1])  # the mean of ones may be 1 + 1e-16


def _linear(picture: Picture, values: Singles) -> Floats:
    """Linear light [y, x, 3] of some lines of a picture."""
    with np.errstate(invalid="ignore"):  # what is not finite is refused next
        numbers = values.astype(np.float64)
    if not np.isfinite(numbers).all():
        cure = "Replace infinite and NaN values by numbers from 0 to 1"
        raise JobError("MF121", "the picture has values that are not finite", where=picture.where, cure=cure)
    low, high = float(numbers.min()), float(numbers.max())
    if low < 0 or high > 1:
        what = f"the picture's values reach from {low:.4g} to {high:.4g}; a display shows 0 to 1"
        raise JobError("MF121", what, where=picture.where, cure="Scale the picture to 0 to 1")
    count = numbers.shape[2]
    colours = numbers[:, :, : 3 if count >= 3 else 1]
    alpha = numbers[:, :, -1:] if count in (2, 4) else None
    if picture.coded and alpha is not None and picture.associated:
        colours = np.divide(colours, alpha, out=np.zeros_like(colours), where=alpha > 0).clip(max=1.0)
    light = light_of_code(colours) if picture.coded else colours
    if alpha is not None and (picture.coded or not picture.associated):
        light = light * alpha
    return np.broadcast_to(light, (*light.shape[:2], 3))


def _shares(size: int, count: int, scale: float) -> Floats:
    """[count, size] the share of each pixel that each picture element makes up; ``scale`` elements make a pixel."""
    start = (size - count * scale) / 2
    bounds = start + scale * np.arange(count + 1)
    edges = np.arange(size + 1.0)
    shared = np.minimum(bounds[1:, None], edges[1:]) - np.maximum(bounds[:-1, None], edges[:-1])
    share = np.maximum(shared, 0.0)
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def _channels(spec: Any, where: str) -> list[int]:
    try:
        names = [str(name).upper() for name in spec.channelnames]
    except UnicodeDecodeError as error:
        what = f"{where} is damaged: the name of a channel is not text"
        raise SourceError("MF303", what, cure="Save the picture again, as PNG or in grey or RGB") from error
    colours = [names.index(name) for name in ("R", "G", "B") if name in names]
    if len(colours) < 3:
        rest = [c for c in range(spec.nchannels) if c not in (spec.alpha_channel, spec.z_channel)]
        if len(rest) not in (1, 3):
            what = f"the picture has the channels {', '.join(names)}"
            raise JobError("MF121", what, where=where, cure="Save it as grey or as red, green and blue")
        colours = rest
    return colours + ([spec.alpha_channel] if spec.alpha_channel >= 0 else [])


def _first_line(text: object) -> str:
    return (str(text).strip() or "it cannot be read").splitlines()[0]


# Strokes of a few letters on a grid of 5 x 7, the top row first.
_LETTERS = (
    ("#...#", "##.##", "#.#.#", "#.#.#", "#...#", "#...#", "#...#"),
    (".###.", "#...#", "#...#", "#####", "#...#", "#...#", "#...#"),
    (".####", "#....", "#....", ".###.", "....#", "....#", "####."),
    ("#...#", "#..#.", "#.#..", "##...", "#.#..", "#..#.", "#...#"),
)


def flat(pixels: int, level: float = 0.5) -> Floats:
    """An even grey of that linear light."""
    return np.full((pixels, pixels, 3), level)


def edge(pixels: int) -> Floats:
    """Black on the left, white on the right; where the picture repeats there is the opposite edge."""
    return _grey(np.broadcast_to(np.where(np.arange(pixels) < pixels // 2, 0.0, 1.0), (pixels, pixels)))


def zone_plate(pixels: int) -> Floats:
    """Rings whose frequency grows with the radius, to half a cycle per pixel at the middle of the sides."""
    axis = np.arange(pixels) - (pixels - 1) / 2
    squared = axis[:, None] ** 2 + axis**2
    return _grey(0.5 + 0.5 * np.cos(np.pi * squared / pixels))


def text(pixels: int) -> Floats:
    """Black letters five pixels wide on white, and bars of one, two and three pixels under them."""
    page = np.ones((pixels, pixels))
    for line, top in enumerate(range(2, pixels - 8, 10)):
        if line % 3 == 2:
            _bars(page[top : top + 7], pixels)
        else:
            _letters(page[top : top + 7], pixels, line)
    return _grey(page[::-1])


@lru_cache(maxsize=4)
def leaves(pixels: int, seed: int = 1) -> Floats:
    """Discs of all sizes and muted colours that hide one another, whose statistics are those of photographs.

    Lee, Mumford and Huang, "Occlusion models for natural images" (2001): as many discs of radius r as 1 / r^3.
    """
    draw = np.random.default_rng(seed)
    scale = 4  # samples along a pixel
    side = pixels * scale
    smallest, largest = 1.0 * scale, 0.3 * side
    picture = np.zeros((side, side, 3))
    bare = np.ones((side, side), dtype=np.bool_)
    left = side * side
    for _ in range(6000):
        part = draw.random()
        radius = (smallest**-2 - part * (smallest**-2 - largest**-2)) ** -0.5
        x, y = draw.uniform(0, side, size=2)
        grey = draw.uniform(0.02, 0.85)
        colour = np.clip(grey * (1 + 0.45 * draw.uniform(-1, 1, size=3)), 0.0, 1.0)
        box = tuple(slice(max(0, int(at - radius)), math.ceil(at + radius)) for at in (y, x))
        rows, columns = np.ogrid[: bare[box].shape[0], : bare[box].shape[1]]
        disc = (columns + box[1].start - x) ** 2 + (rows + box[0].start - y) ** 2 < radius**2
        new = bare[box] & disc
        picture[box][new] = colour
        bare[box] &= ~new
        left -= int(new.sum())
        if not left:
            break
    picture[bare] = 0.18
    return frozen(picture.reshape(pixels, scale, pixels, scale, 3).mean(axis=(1, 3)))


def _letters(strip: Floats, pixels: int, line: int) -> None:
    for place, left in enumerate(range(2, pixels - 6, 6)):
        letter = _LETTERS[(place + line) % len(_LETTERS)]
        strip[:, left : left + 5] = [[0.0 if stroke == "#" else 1.0 for stroke in row] for row in letter]


def _bars(strip: Floats, pixels: int) -> None:
    left = 2
    for width in (1, 2, 3):
        if left + 9 * width > pixels - 2:
            return
        for _ in range(5):
            strip[:, left : left + width] = 0.0
            left += 2 * width
        left += 2


def _grey(level: Floats) -> Floats:
    return np.repeat(np.asarray(level, dtype=np.float64)[:, :, None], 3, axis=2)
