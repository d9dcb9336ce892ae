"""Scenes: photographs, or drawn ones, as code values and as the light that they stand for.

A scene is the middle of a picture, at most 1024 x 1536 (1536 x 1024 of an upright one), or all of it, its sides cut to
multiples of 64 so that transforms are fast; pictures are never scaled. A grey one has three equal channels. Integers
are sRGB code values, whose light follows by the sRGB curve. Floats (EXR, HDR) are light, and have code values by the
same curve; above white they are refused unless the light that is white is stated, as nobody can know it.

Who has no photographs takes dead leaves, whose spectrum falls as a power of f, as nature's does. Discs of random
colours fall on each other; a radius r is drawn with density r^-3 between two limits, which makes the picture look the
same at every scale (Lee, Mumford, Huang, Int. J. Comput. Vision 41, 35, 2001). Every scene follows from its seed. From
0.02 to 0.4 cycles per pixel its power falls as f^-2.9, as that of a sharp photograph in daylight. Photographs taken
indoors are dimmer and softer, and what restores them best differs: of three at hand, one has a mean of 0.40 of white
and a power of f^-2.7, the others 0.10 and 0.11, and f^-3.5 and f^-3.7. So every second scene is dim and soft too: 0.10
and f^-3.5. For highlights, lamps hang in front of them: discs of 2 to 100 times white.

The blur is circular, so beyond its edges a scene repeats. Of the 256 pixels that others have round the sensor, a small
one has 128; how much of a point's light falls farther is told. If half of it does, the scene is smaller than the point
spread, and what is photographed would be its repetition.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import overload

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Indices, Singles
from maskfab.base.errors import JobError, SourceError
from maskfab.camera.imaging import MARGIN, Blur, Design, Margin, RestoredBy, upright
from maskfab.display.pictures import Picture, read_picture
from maskfab.optics.colour import code_of_light, light_of_code

SHORT, LONG = 1024, 1536
NARROW, WIDE = 128, 832
"""Pixels of scene round the sensor where a side of a picture has fewer than the second of them."""
SMALLEST = 512
"""Pixels along a side: 128 round the sensor, 64 more that the inner frame leaves out, and 128 of that frame."""
MOST_WHOLE = 60_000_000
"""Pixels of whole pictures together: they take four gigabytes until they are scored."""
_STEP = 64
_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".exr", ".hdr")


@dataclass(frozen=True, eq=False)
class Photograph:
    """A scene for a protocol.

    Attributes:
        values: float32 [3, rows, columns], code values within 0 to 1.
        measured: its light in units of white where a file holds that rather than code values, else None; highlights
            are above 1.
        around: pixels of it on every side of the sensor.
    """

    name: str
    number: int
    values: Singles
    measured: Singles | None = field(default=None)
    around: int = MARGIN

    @property
    def margin(self) -> Margin:
        """Where the sensor lies in it."""
        rows, columns = self.values.shape[1:]
        return Margin((rows, columns), self.around)

    @property
    def middle(self) -> Photograph:
        """At most 1024 x 1536 of it, as a scene has where nobody asks for whole ones."""
        part = _middle(self.values.shape[1:])
        return replace(
            self, values=self.values[:, *part], measured=None if self.measured is None else self.measured[:, *part]
        )

    @property
    def true(self) -> Singles:
        """Code values of what lies on the sensor, in its middle."""
        return self.margin.sensor(self.values)

    @property
    def dark(self) -> Photograph:
        """The scene with no light from outside the sensor."""
        return replace(self, values=self.margin.dark(self.true), measured=None)

    @property
    def light(self) -> Singles:
        """Linear light, float32 [3, rows, columns], white is 1."""
        return light_of_code(self.values) if self.measured is None else self.measured


@dataclass(frozen=True, eq=False)
class Folder:
    """Photographs of a folder, and files beside them.

    Attributes:
        skipped: names of files that are no pictures by their suffix; hidden ones are not counted.
    """

    photographs: Sequence[Photograph]
    skipped: tuple[str, ...]


@lru_cache(maxsize=4)
def spectrum_of(scene: Photograph, *, linear: bool) -> NDArray[np.complex64]:
    """``rfft2`` of a scene's linear light, or of its code values, [3, rows, half]; read-only.

    Kept of the last four scenes: as many as are drawn, and all dies of a process look at these.
    """
    values = scene.light if linear else scene.values
    made = scipy.fft.rfft2(values, axes=(1, 2), workers=1)
    spectrum = upright(made.shape, np.complex64)
    spectrum[:] = made
    spectrum.flags.writeable = False
    return spectrum


def scene(
    name: str,
    values: Singles,
    number: int | None = None,
    *,
    coded: bool = True,
    white: float | None = None,
    whole: bool = False,
) -> Photograph:
    """Cut a picture [rows, columns] or [rows, columns, 1 or 3] to a scene.

    Args:
        name: in tables; its digits, if it has no other characters, are the number.
        number: seeds the noise; None takes it from the name.
        white: light that is white, more of which is a highlight; None where nobody states it, and 1 is white.

    Raises:
        JobError: MF121 if it is too small, not within 0 to 1, or negative, not finite, or unstated
            light above white.
    """
    picture = np.asarray(values, dtype=np.float32)
    picture = picture[:, :, None] if picture.ndim == 2 else picture
    rows, columns = picture.shape[:2]
    if min(rows, columns) < SMALLEST:
        what = (
            f"the picture has {columns} x {rows} pixels, fewer than {SMALLEST} along a side: at each edge {NARROW} lie "
            "outside the sensor, which their light reaches, and 64 outside the inner frame that is scored"
        )
        cure = f"Give a photograph of {LONG} x {SHORT} or more, or at least {SMALLEST} along each side"
        raise JobError("MF121", what, where=name, cure=cure)
    _require_light(name, picture, coded=coded, white=white)
    middle = picture[_middle((rows, columns), whole=whole)]
    colours = middle[:, :, :3] if picture.shape[2] >= 3 else np.repeat(middle[:, :, :1], 3, axis=2)
    if number is None:
        number = int(name) if name.isdecimal() else zlib.crc32(name.encode()) % 1_000_000
    planes = np.ascontiguousarray(colours.transpose(2, 0, 1))
    around = MARGIN if min(rows, columns) >= WIDE else NARROW
    if coded:
        return Photograph(name, number, planes, around=around)
    planes = planes if white is None else planes / np.float32(white)
    return Photograph(name, number, code_of_light(planes), planes, around)


def _middle(shape: tuple[int, ...], *, whole: bool = False) -> tuple[slice, slice]:
    rows, columns = shape
    most = shape if whole else (SHORT, LONG) if columns >= rows else (LONG, SHORT)
    sides = [min(have, limit) // _STEP * _STEP for have, limit in zip(shape, most, strict=True)]
    top, left = ((have - side) // 2 for have, side in zip(shape, sides, strict=True))
    return slice(top, top + sides[0]), slice(left, left + sides[1])


def _require_light(name: str, picture: Singles, *, coded: bool, white: float | None) -> None:
    if white is not None and not (np.isfinite(white) and white > 0):
        raise JobError("MF121", f"light of {white:g} is not white", where=name, cure="Give a number above 0")
    low, high = (float(picture.min()), float(picture.max())) if np.isfinite(picture).all() else (np.nan, np.nan)
    if coded and not (low >= 0 and high <= 1):
        what = "the picture's values are not within 0 to 1"
        raise JobError("MF121", what, where=name, cure="Scale the picture to 0 to 1")
    if not (low >= 0 and np.isfinite(high)):
        cure = "Replace NaN, infinite and negative values by light of 0 or more"
        raise JobError("MF121", "the picture's light is negative or not finite in places", where=name, cure=cure)
    if high > 1 and white is None and not coded:
        cure = (
            f"State the light that is white with --white: {high:.4g} if nothing is brighter than white; less, if "
            "there are highlights, which brackets need"
        )
        raise JobError("MF121", f"the picture holds light up to {high:.4g}, above white", where=name, cure=cure)


def folder(path: str | Path, white: float | None = None, *, whole: bool = False) -> Folder:
    """Every photograph of a folder, by name.

    Raises:
        SourceError: MF301 if there is no folder or no photograph in it; as
            :func:`maskfab.display.pictures.read_picture`.
        JobError: MF121 as :func:`scene`, and for a picture that is transparent in places; MF142 for whole pictures of
            more than 60 million pixels together.
    """
    where = Path(path)
    files, skipped = picture_files(where)
    photographs: list[Photograph] = []
    pixels = 0
    for file in files:
        picture = read_picture(file)
        colours = opaque(picture.values, file)
        photographs.append(scene(file.stem, colours, coded=picture.coded, white=white, whole=whole))
        pixels += photographs[-1].values[0].size
        if whole and pixels > MOST_WHOLE:
            what = (
                f"whole pictures up to {file.name} have {pixels / 1e6:.3g} million pixels; the limit is "
                f"{MOST_WHOLE / 1e6:g} million together"
            )
            cure = "Give fewer photographs at a time, or photograph their middle"
            raise JobError("MF142", what, where=str(where), cure=cure)
    return Folder(tuple(photographs), skipped)


def picture_files(folder: Path) -> tuple[list[Path], tuple[str, ...]]:
    """Photographs of a folder by their suffix, and names of what else there is; MF301 if there are none."""
    shown = sorted(file for file in folder.iterdir() if file.name[0] != ".") if os.path.isdir(folder) else []
    files = [file for file in shown if file.suffix.lower() in _SUFFIXES]
    if not files:
        kinds = ", ".join(suffix[1:].upper() for suffix in _SUFFIXES)
        raise SourceError("MF301", f"there are no photographs in {folder}", cure=f"Give a folder of {kinds} files")
    return files, tuple(file.name for file in shown if file not in files)


def checked_pixels(file: Path, picture: Picture, white: float | None) -> Singles:
    """Colours of a photograph, [rows, columns, 1 or 3]; errors as :func:`scene`, but for its size."""
    colours = opaque(picture.values, file)
    _require_light(str(file), colours, coded=picture.coded, white=white)
    return colours


def opaque(values: Singles, file: Path) -> Singles:
    """The colours of a picture [rows, columns, channels], without its opacity."""
    if values.shape[2] not in (2, 4):
        return values
    if values[:, :, -1].min() < 1:
        what = "the picture is transparent in places, and what lies behind it is not known"
        raise JobError("MF121", what, where=str(file), cure="Save it without transparency")
    return values[:, :, :-1]


_SMALLEST, _LARGEST = 3.0, 300.0
_DISCS = 6000
_LEAST_ALONE = 50
"""Pixels along a disc's side from which on it is laid out alone, smaller ones with all of their size."""
_DIM, _SOFTER, _SOFT_FROM = 0.3, 0.3, 0.01
_LAMPS, _LAMP_RADII, _LAMP_LIGHT = 24, (1.5, 9.0), (2.0, 100.0)


def dead_leaves(seed: int, rows: int = SHORT, columns: int = LONG) -> Photograph:
    """One scene of 6000 discs of radius 3 to 300 pixels, the last on top, edges one pixel soft."""
    draw = np.random.default_rng(seed)
    share = draw.random(_DISCS)
    radii = 1 / np.sqrt(share / _LARGEST**2 + (1 - share) / _SMALLEST**2)
    # Few large leaves fall; the ground is laid first with them so that no place stays bare.
    radii[: _DISCS // 50] = np.maximum(radii[: _DISCS // 50], draw.uniform(80, _LARGEST, _DISCS // 50))
    middles = draw.random((_DISCS, 2)) * (rows, columns)
    brightness = draw.random(_DISCS) ** 2
    colours = np.clip(brightness[:, None] * draw.uniform(0.6, 1.4, (_DISCS, 3)), 0.01, 1).astype(np.float32)
    values = np.full((3, rows, columns), 0.2, dtype=np.float32)
    corners, sides = np.maximum(0, (middles - radii[:, None]).astype(int) - 1), 2 * np.ceil(radii).astype(int) + 4
    covers: dict[int, Singles] = {}
    for side in range(sides.min(), _LEAST_ALONE):
        alike = np.flatnonzero(sides == side)
        covers |= zip(alike.tolist(), _covers(middles[alike], radii[alike], corners[alike], side), strict=True)
    for k, ((top, left), side, colour) in enumerate(zip(corners, sides, colours, strict=True)):
        part = values[:, top : top + side, left : left + side]
        one = slice(k, k + 1)
        cover = covers[k] if k in covers else _covers(middles[one], radii[one], corners[one], side)[0]
        change = colour[:, None, None] - part
        change *= cover[: part.shape[1], : part.shape[2]]
        part += change
    return Photograph(f"leaves{seed}", seed, np.clip(values, 0, 1))


def _covers(middles: Floats, radii: Floats, corners: Indices, side: int) -> Singles:
    """Shares of pixels that discs cover, [discs, side, side] from each disc's own corner on."""
    places = (corners[:, :, None] + np.arange(side)).astype(np.float32) - middles[:, :, None].astype(np.float32)
    squares = np.square(places.astype(np.float64))
    # In double precision the root of the squares is hypot's, to the last bit, in a quarter of the time.
    cover: Singles = np.sqrt(squares[:, 0, :, None] + squares[:, 1, None]).astype(np.float32)
    np.subtract((radii + 0.5).astype(np.float32)[:, None, None], cover, out=cover)
    np.clip(cover, 0, 1, out=cover)
    return cover


def indoors(scene: Photograph) -> Photograph:
    """The scene at 0.3 of its light, softened: amplitudes fall by another f^-0.3 beyond 0.01 cycles per pixel."""
    rows, columns = scene.values.shape[1:]
    frequency = np.hypot(np.arange(rows)[:, None] / (2 * rows), np.arange(columns) / (2 * columns))
    softened = (1 + (frequency / _SOFT_FROM) ** 2) ** (-_SOFTER / 2)
    values = scipy.fft.idctn(scipy.fft.dctn(scene.values, axes=(1, 2)) * softened, axes=(1, 2))
    return replace(scene, name=f"{scene.name}_dim", values=np.clip(_DIM * values, 0, 1).astype(np.float32))


def lit(scene: Photograph) -> Photograph:
    """The scene with 24 lamps, 1.5 to 9 pixels in radius and of 2 to 100 times white; edges one pixel soft."""
    rows, columns = scene.values.shape[1:]
    draw = np.random.default_rng(scene.number)
    light = scene.light.copy()
    y, x = np.arange(rows, dtype=np.float32)[:, None], np.arange(columns, dtype=np.float32)
    for _ in range(_LAMPS):
        top, left = draw.uniform(0, rows), draw.uniform(0, columns)
        radius = draw.uniform(*_LAMP_RADII)
        bright = np.exp(draw.uniform(*np.log(_LAMP_LIGHT)))
        cover = np.clip(np.float32(radius + 0.5) - np.hypot(y - np.float32(top), x - np.float32(left)), 0, 1)
        light += cover * (np.float32(bright) - light)
    return Photograph(f"{scene.name}_lit", scene.number, code_of_light(light), light)


class Bundled(Sequence[Photograph]):
    """The scenes used where no photographs are given: dead leaves of seeds 1 to ``count``, every second one indoors.

    Each is drawn when it is first asked for.
    """

    def __init__(self, count: int) -> None:
        self._drawn: list[Photograph | None] = [None] * count

    def __len__(self) -> int:
        return len(self._drawn)

    @overload
    def __getitem__(self, place: int) -> Photograph: ...

    @overload
    def __getitem__(self, place: slice) -> tuple[Photograph, ...]: ...

    def __getitem__(self, place: int | slice) -> Photograph | tuple[Photograph, ...]:
        if isinstance(place, slice):
            return tuple(self[k] for k in range(len(self))[place])
        number = range(1, len(self) + 1)[place]
        drawn = self._drawn[place]
        if drawn is None:
            leaves = dead_leaves(number)
            drawn = self._drawn[place] = leaves if number % 2 else indoors(leaves)
        return drawn


def bundled(count: int = 4) -> Bundled:
    """So many scenes for those who have no photographs."""
    return Bundled(count)


def drawn(count: int = 4, *, highlights: bool) -> tuple[Photograph, ...]:
    """Bundled scenes, with lamps in them where ``highlights`` are wanted."""
    return tuple(map(lit, bundled(count)) if highlights else bundled(count))


PORTRAIT = "Grace Hopper by the U.S. Navy, in the public domain, as matplotlib brings it along"


def portrait() -> Photograph | None:
    """A photograph that anybody can judge, to be looked at beside drawn scenes: :data:`PORTRAIT`; None where matplotlib
    was installed without its sample data."""
    import matplotlib

    file = Path(matplotlib.get_data_path(), "sample_data", "grace_hopper.jpg")
    return scene(file.stem, read_picture(file).values) if file.is_file() else None


MOST_BEYOND = 0.5
"""Of a point's light, farther than the scene goes on round the sensor."""


def beyond(blur: Blur, margin: Margin) -> float:
    """Share of a point's light that falls farther than the margin is wide along an axis, of the worst colour."""
    shape = margin.shape[0] + 2 * (MARGIN - margin.width), margin.shape[1] + 2 * (MARGIN - margin.width)
    near = np.ix_(*(abs(scipy.fft.fftfreq(side, 1 / side)) <= margin.width for side in shape))
    spreads = (scipy.fft.irfft2(transfer, s=shape, workers=1) for transfer in blur.on(shape))
    return max(1 - float(spread[near].sum(dtype=np.float64) / spread.sum(dtype=np.float64)) for spread in spreads)


def messages(design: Design, scenes: Sequence[Photograph]) -> tuple[str, ...]:
    """Sentences on scenes with less than 256 pixels round the sensor, behind a design.

    Raises:
        JobError: MF121 for one that is smaller than the design's point spread.
    """
    blur = design.seen if isinstance(design, RestoredBy) else design
    sentences = []
    for scene in scenes:
        margin = scene.margin
        if margin.width >= MARGIN:
            continue
        rows, columns = margin.shape
        share, size = beyond(blur, margin), f"{columns} x {rows} pixels, {margin.width} of them round the sensor"
        if share > MOST_BEYOND:
            what = (
                f"the picture has {size}, and {share:.1%} of a point's light falls farther behind {design.name}; the "
                f"limit is {MOST_BEYOND:.0%}, beyond which it is smaller than the point spread"
            )
            cure = f"Give a photograph of {WIDE} x {WIDE} or more, which has {MARGIN} round the sensor"
            raise JobError("MF121", what, where=scene.name, cure=cure)
        sentences.append(
            f"the scene {scene.name} has {size} rather than {MARGIN}: {share:.1%} of a point's light falls farther, "
            "and what comes from beyond the edges is taken from the scene repeated"
        )
    return tuple(sentences)
