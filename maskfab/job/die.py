"""One die as a job states it, and what it and a camera must be for each other."""

from __future__ import annotations

import math
from collections import Counter
from typing import Annotated

from pydantic import Field

from maskfab.base import units
from maskfab.base.errors import JobError
from maskfab.base.model import Tiling
from maskfab.base.units import UM_PER_NM
from maskfab.job.camera import Camera
from maskfab.job.values import DrawingUnit, DrawnText, Length, LengthOrZero, Name, Pitch, PlateLength, Section

_MOST_DOTS_ACROSS_STOP = 6000
_MOST_SAMPLES = 4096


class DieSection(Section):
    """[[die]]: one opening laid out as one panel."""

    name: Name
    """Name of the die in files and reports."""
    label: DrawnText = Field(min_length=1, max_length=40)
    """Text under the die, ASCII."""
    opening: str
    """A key of [openings], or the path of a file relative to the job: TOML, text, PNG, TIFF, EXR, NumPy, GDSII, OASIS
    or DXF.
    """
    opening_layer: str | None = None
    """Layer that holds the opening, in a layout file."""
    opening_cell: str | None = None
    """Cell that holds the opening, in a layout file."""
    opening_unit: DrawingUnit | None = None
    """One unit of a DXF; default: what it states itself, else um."""
    others: Annotated[tuple[str, ...], Field(min_length=1, max_length=14, strict=False)] | None = None
    """Further openings; every cell draws one of all."""
    dot: Length
    """Side of one dot."""
    pitch: Pitch | None = None
    """Pitch of the pixels, as a length or in DPI; checked against dots x dot + gutter."""
    gutter: LengthOrZero = 0.0
    """Opaque space between neighbouring cells, half of it on each side."""
    tiling: Annotated[Tiling, Field(strict=False)]
    """Order of orientations over the panel."""
    map: str | None = None
    """With tiling = "map": a key of [maps], or the path of a file relative to the job."""
    seed: int | None = Field(default=None, ge=0)
    """Seed of a tiling that is drawn at random."""
    size: PlateLength | None = None
    """Side of the square that the panel fills with whole pixels; default: plate.die_size."""


def check_die(die: DieSection, where: str) -> None:
    """A tiling with the map that it needs (MF122), and a dot and a gutter on the grid of 1 nm (MF107)."""
    check_tiling(die, where)
    units.to_nm(die.dot, where=f"{where}.dot", name="dot")
    even_nm(die.gutter, where=f"{where}.gutter", name="gutter")


def check_tiling(die: DieSection, where: str) -> None:
    """A tiling with the map, the openings and the gutter that go with it. Raises JobError MF122."""
    if (die.tiling is Tiling.MAP) != (die.map is not None):
        without = die.map is None
        what = f"die {die.name!r} is tiled {die.tiling} and has {'no' if without else 'a'} map"
        cure = 'Add map = "maps/x.toml"' if without else 'Use tiling = "map", or remove the key'
        raise JobError("MF122", what, where=f"{where}.map", cure=cure)
    if die.tiling is Tiling.HEXAGONAL and (die.others or die.gutter):
        what = f"die {die.name!r} is tiled hexagonal, which takes one opening and no gutter"
        cure = "Remove that key, or use another tiling"
        raise JobError("MF122", what, where=f"{where}.{'others' if die.others else 'gutter'}", cure=cure)


def check_seed(die: DieSection, where: str) -> None:
    """A seed where chance is asked for. Raises JobError MF111."""
    if (die.tiling.seeded or die.others) and die.seed is None:
        what = f"is tiled {die.tiling}" if die.tiling.seeded else f"chooses among {1 + len(die.others or ())} openings"
        cure = "Add seed = 1"
        raise JobError("MF111", f"die {die.name!r} {what} without a seed", where=f"{where}.seed", cure=cure)


def even_nm(value_um: float, *, where: str, name: str) -> int:
    """Integer nanometres of a length of which either half must lie on the database grid (MF107 otherwise)."""
    value_nm = units.to_nm(value_um, where=where, name=name)
    if value_nm % 2:
        what = f"{name} {value_um:g} um is an odd number of nanometres, half of which is off the 1 nm grid"
        raise JobError("MF107", what, where=where, cure=f"Use {value_um + UM_PER_NM:g} um")
    return value_nm


def check_lens(camera: Camera, *, where: str) -> None:
    """Refuse a stop through which no lens of its focal length can bring light to a focus, and a pinhole.

    By the sine condition the numerical aperture is D / 2f, the sine of an angle. A stop narrower than a wavelength is
    no aperture of scalar diffraction.

    Raises:
        JobError: MF131 if D / 2f exceeds 1; MF104 if D is less than the longest wavelength.
    """
    width, widest = camera.stop.diameter_um, 2 * camera.focal_um
    line = max(camera.wavelengths_nm) * UM_PER_NM
    if width < line:
        what = f"a stop of {width:g} um is narrower than the wavelength of {line:g} um"
        raise JobError("MF104", what, where=where, cure='Give the diameter of the lens, such as "4 mm"')
    if width > widest:
        what = (
            f"a stop of {width:g} um before a focal length of {camera.focal_um:g} um has the numerical aperture "
            f"{width / widest:.3g}; in air the limit is 1"
        )
        cure = f"Use a stop of at most {widest:g} um, or a longer focal length"
        raise JobError("MF131", what, where=where, cure=cure)


def check_lines(camera: Camera, *, where: str) -> None:
    """Refuse a wavelength that is there twice. Raises JobError MF105."""
    twice = [line for line, count in Counter(camera.wavelengths_nm).items() if count > 1]
    if twice:
        what = f"the wavelength {twice[0]:g} nm is given more than once"
        raise JobError("MF105", what, where=where, cure="List each wavelength once")


def check_optics(camera: Camera, dot_um: float, *, where: str) -> None:
    """Refuse what :func:`check_pupil` and :func:`check_window` refuse."""
    check_pupil(camera, dot_um, where=where)
    check_window(camera, dot_um, where=where)


def check_pupil(camera: Camera, dot_um: float, *, where: str) -> None:
    """Refuse an aperture too fine to hold, and what :func:`check_lines` refuses.

    Raises:
        JobError: MF105 if a wavelength is there twice; MF115 if the stop is more than 6000 dots across.
    """
    check_lines(camera, where=f"{where}: camera.wavelengths")
    check_across(camera, dot_um, where)


def check_across(camera: Camera, dot_um: float, where: str) -> None:
    """Refuse a stop that is more than 6000 dots across (MF115)."""
    across = camera.stop.diameter_um / dot_um
    if across > _MOST_DOTS_ACROSS_STOP:
        what = (
            f"a stop of {camera.stop.diameter_um:g} um is {across:.0f} dots of {dot_um:g} um across; the limit is "
            f"{_MOST_DOTS_ACROSS_STOP}"
        )
        raise JobError("MF115", what, where=where, cure="Use a smaller stop or a coarser dot")


def check_window(camera: Camera, dot_um: float, *, where: str) -> None:
    """Refuse a window with replicas of the PSF in it, and one that is too fine to hold.

    Raises:
        JobError: MF104 for a window smaller than a pixel; MF113 if it is wider than λf/dot at the shortest wavelength;
            MF115 if it is more than 4096 samples wide.
    """
    shortest = min(camera.wavelengths_nm)
    limit = shortest * UM_PER_NM * camera.focal_um / dot_um
    if camera.window_um > limit:
        what = (
            f"window {camera.window_um:g} um is wider than λf/dot = {limit:.1f} um at {shortest:g} nm for a dot of "
            f"{dot_um:g} um"
        )
        cure = f"Use a window of at most {math.floor(limit * 10) / 10:g} um"
        raise JobError("MF113", what, where=f"{where}: camera.window", cure=cure)
    if camera.window_um < camera.pixel_um:
        what = f"window {camera.window_um:g} um is smaller than one sensor pixel of {camera.pixel_um:g} um"
        raise JobError("MF104", what, where=f"{where}: camera.window", cure="Use a window of many pixels")
    finest = min(camera.pixel_um, shortest * UM_PER_NM * camera.focal_um / camera.stop.diameter_um) / 2
    samples = camera.window_um / finest
    if samples > _MOST_SAMPLES:
        what = (
            f"a window of {camera.window_um:g} um is {samples:.0f} samples of {finest:g} um wide; the limit is "
            f"{_MOST_SAMPLES}"
        )
        cure = f"Use a window of at most {math.floor(_MOST_SAMPLES * finest * 10) / 10:g} um, or a larger pixel"
        raise JobError("MF115", what, where=f"{where}: camera.window", cure=cure)
