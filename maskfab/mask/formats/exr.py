"""OpenEXR: PSFs, emitted light and other numbers with what they mean in the header; equal content makes equal bytes.

PSFs are float32, linear, of the finest sampling that a report shows: intensity at points, from the polygons read back.
The header says what a reader needs to use them, and to make them again. Written ones are held against those that were
measured: every sample, and every entry of the header, read by OpenImageIO. Light for people comes as 8-bit PNG, too.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.arrays import Floats, Singles
from maskfab.base.errors import SourceError
from maskfab.base.files import no_file
from maskfab.base.model import Die, DieOptics, Plate, Psf, Quantity
from maskfab.base.pictures import write_image
from maskfab.base.units import NM_PER_UM
from maskfab.job.camera import Camera, Stop
from maskfab.mask.formats.format import Format
from maskfab.mask.formats.tiff import said_by
from maskfab.optics.colour import code_of_light

if TYPE_CHECKING:
    from maskfab.mask.job import Job


@dataclass(frozen=True, eq=False)
class Channels:
    """An EXR.

    Attributes:
        values: float64 [channels, rows, columns], row 0 the uppermost.
        stored: type of the values in the file, ``half`` or ``float``.
        facts: entries of the header whose name begins with a prefix, without it.
    """

    values: Floats
    names: tuple[str, ...]
    stored: str
    facts: dict[str, Any]


def read_channels(path: Path, prefix: str, cure: str) -> Channels:
    """Read a file. Raises SourceError MF301 if there is no such file, MF303 if it cannot be read."""
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    if not os.path.isfile(path):
        raise SourceError("MF301", no_file(path, path.name), where=str(path), cure=cure)
    image = oiio.ImageInput.open(str(path))
    if image is None:
        raise damaged(path, said_by(oiio), cure)
    spec = image.spec()
    pixels = image.read_image("float")
    problem = said_by(image) or said_by(oiio)
    image.close()
    if pixels is None or problem:
        raise damaged(path, problem, cure)
    try:
        entries = {entry.name: entry.value for entry in spec.extra_attribs}
        names = tuple(str(name) for name in spec.channelnames)
    except UnicodeDecodeError as error:
        raise damaged(path, "an entry of its header is no text", cure) from error
    facts = {name.removeprefix(prefix): value for name, value in entries.items() if name.startswith(prefix)}
    planes = np.asarray(pixels, dtype=np.float64).reshape(spec.height, spec.width, spec.nchannels).transpose(2, 0, 1)
    return Channels(planes, names, str(spec.format), facts)


def damaged(path: Path, why: str, cure: str) -> SourceError:
    """MF303 with the first line of a reason."""
    said = why.strip().splitlines()
    what = f"{path.name} cannot be read: {said[0] if said else 'damaged'}"
    return SourceError("MF303", what, where=str(path), cure=cure)


Fact: TypeAlias = str | float
Facts: TypeAlias = Mapping[str, Fact]

PREFIX = "maskfab:"
"""Prefix of the names of our entries in a header."""


def write_channels(
    pixels: NDArray[np.float16] | NDArray[np.float32],
    channels: Sequence[str],
    path: Path,
    facts: Facts,
    software: str = "maskfab",
) -> None:
    """Write linear values, half or float by their type, compressed by scanlines without loss.

    Args:
        pixels: [y, x, channels], the top row first.
        facts: go into the header, each under :data:`PREFIX` and its name; numbers as float32.
    """
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    height, width, count = pixels.shape
    header = oiio.ImageSpec(width, height, count, "half" if pixels.dtype == np.float16 else "float")
    header.channelnames = tuple(channels)
    header.attribute("compression", "zip")
    header.attribute("oiio:ColorSpace", "lin_rec709_scene" if count > 1 else "data")
    header.attribute("Software", software)
    header.attribute("DateTime", "")  # or OpenImageIO writes the time, and equal values make unequal files
    for name, value in facts.items():
        header.attribute(PREFIX + name, value)
    write_image(np.ascontiguousarray(pixels), header, path)


_STEPS = 65535
_ROWS = 64
"""Coded at a time."""


def write_exr(light: Floats | Singles, path: Path, facts: Facts) -> None:
    """Write linear light as half floats; row 0 of the file is the top.

    Args:
        light: [3, y, x] or [y, x, 3], row 0 the lowest; linear, primaries of sRGB.
        facts: go into the header, each under ``maskfab:`` and its name.
    """
    write_channels(_upright(light).astype(np.float16), ("R", "G", "B"), path, facts)


def write_png(
    light: Floats | Singles, path: Path, white: float = 1.0, exif: Mapping[str, Any] = MappingProxyType({})
) -> None:
    """Write linear light as 8-bit sRGB (IEC 61966-2-1); ``white`` is what becomes 255, more is cut off.

    Args:
        light: [3, y, x] or [y, x, 3], row 0 the lowest.
        exif: of a photograph, by OpenImageIO's names.
    """
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    # A table of 16 bits is off by at most a twentieth of a code, and saves a power for every value.
    table = (code_of_light(np.linspace(0.0, 1.0, _STEPS + 1)) * 255).round().astype(np.uint8)
    upright = _upright(light)
    pixels: NDArray[np.uint8] = np.empty(upright.shape, dtype=np.uint8)
    for first in range(0, len(upright), _ROWS):
        steps = np.clip(upright[first : first + _ROWS] * (_STEPS / white), 0.0, _STEPS).round().astype(np.uint16)
        pixels[first : first + _ROWS] = table[steps]
    height, width, channels = pixels.shape
    header = oiio.ImageSpec(width, height, channels, "uint8")
    header.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    # Half of the time for a twentieth more bytes: one filter for all rows, each less its left neighbours.
    header.attribute("png:compressionLevel", 3)
    header.attribute("png:filter", 16)
    for name, value in exif.items():
        header.attribute(name, value)
    write_image(pixels, header, path)


def _upright(light: NDArray[Any]) -> NDArray[Any]:
    """[y, x, 3] with the top row first."""
    last = light if light.shape[-1] == 3 else np.moveaxis(light, 0, -1)
    return last[::-1]


AXES = (
    "x to the right and y upwards, as the plate's files draw them; the first row of pixels is the uppermost; "
    "the optical axis is the middle pixel"
)


@dataclass(frozen=True, eq=False)
class PsfFile:
    """One PSF of a die, as a file."""

    name: str
    die: Die
    psf: Psf
    facts: Facts

    def write(self, path: Path) -> None:
        """Write it; raises as :func:`write_psf`."""
        write_psf(self.psf, path, self.facts, f"maskfab {self.facts['maskfab_version']}")


def psf_files(
    job: Job, plate: Plate, optics: Sequence[DieOptics], source: str, version: str = __version__
) -> tuple[PsfFile, ...]:
    """One file for each die and wavelength."""
    common = {"plate": plate.name, "source": source, "job_sha256": job.digest, "maskfab_version": version}
    return tuple(
        PsfFile(
            f"{plate.name}_{item.die.name}_psf_{psf.wavelength_nm:.12g}nm.exr",
            item.die,
            psf,
            {**psf_facts(psf), **camera_header(job.camera), **dict(_of_die(job, item.die)), **common},
        )
        for item in optics
        for psf in item.psfs
        if psf.kind == "point"
    )


def psf_facts(psf: Psf) -> dict[str, Fact]:
    """Meaning of the values of a PSF, as header entries."""
    return {
        "wavelength_nm": psf.wavelength_nm,
        "step_um": psf.step_um,
        "kind": psf.kind,
        "unit": "1/um^2",
        "axes": AXES,
    }


def camera_header(camera: Camera) -> dict[str, Fact]:
    """The camera that a PSF holds for."""
    return {
        "focal_um": camera.focal_um,
        "stop": camera.stop.shape,
        "stop_um": camera.stop.diameter_um,
        **stop_facts(camera.stop),
        "sensor_pixel_um": camera.pixel_um,
    }


def stop_facts(stop: Stop) -> dict[str, Fact]:
    """Facts of a stop beyond shape and diameter: its sides, its dark middle, its corners."""
    facts: dict[str, Fact] = {}
    if stop.size_um is not None:
        facts |= {"stop_width_um": stop.size_um[0], "stop_height_um": stop.size_um[1]}
    if stop.inner_share:
        facts["stop_inner_um"] = stop.inner_share * stop.diameter_um
    if stop.outline_um:
        facts["stop_corners_um"] = "; ".join(f"{x:.12g} {y:.12g}" for x, y in stop.outline_um)
    return facts


def write_psf(psf: Psf, path: Path, facts: Facts, software: str) -> None:
    """Write a PSF as one float32 channel, intensity per square micrometre of sensor; row 0 of the file is the top.

    Args:
        facts: of the header; those of :func:`psf_facts` at least.
    """
    # Of an array without the axis of channels OpenImageIO takes the first axis for x.
    write_channels(psf.values[::-1, :, None].astype(np.float32), ("Y",), path, facts, software)


def _of_die(job: Job, die: Die) -> Iterator[tuple[str, Fact]]:
    """Numbers of the panel, and its openings by name and by the hash of their text in the resolved job."""
    panel = die.panel
    section = next(stated for stated in job.spec.die if stated.name == die.name)
    named = (section.opening, *(section.others or ()))
    yield "die", die.name
    yield "pitch_um", panel.cell_size.pitch_um
    yield "dot_um", panel.dot_nm / NM_PER_UM
    yield "gutter_um", panel.gutter_nm / NM_PER_UM
    yield "tiling", panel.tiling.value
    yield "seed", "none" if panel.seed is None else str(panel.seed)
    yield "opening", ", ".join(named)
    yield "opening_sha256", ", ".join(hashlib.sha256(job.spec.openings[name].encode()).hexdigest() for name in named)


_CURE = "Run the job again to rewrite it"
_OF_ITSELF, _OF_PEAK = 1e-6, 1e-9
"""Float32 rounds to 6e-8 of a value; another machine's sums differ by some 1e-12 of the peak."""


def check_psf_file(made: PsfFile, folder: Path) -> tuple[Quantity, Quantity]:
    """Read a PSF back and compare it with the one that was measured.

    Returns:
        ``psf_file_wrong_samples``, samples that differ by more than a millionth of themselves, all of them if their
        number is another; and ``psf_file_wrong_facts``, entries of the header that are missing, differ or were not
        written. The limit of both is 0.
    """
    values, facts = read_psf_file(folder / made.name)
    expected = made.psf.values
    if values.shape != expected.shape:
        wrong = max(values.size, expected.size)
    else:
        allowed = _OF_ITSELF * abs(expected) + _OF_PEAK * expected.max()
        wrong = int(np.count_nonzero(~(abs(values - expected) <= allowed)))
    differing = tuple(_differing(made.facts, facts))

    def judged(name: str, count: int, method: str) -> Quantity:
        where = {"die": made.die.name, "wavelength_nm": made.psf.wavelength_nm}
        return Quantity(name, count, method, limit=0, passed=count == 0, **where)  # type: ignore[arg-type]

    listed = f": {', '.join(differing)}" if differing else ""
    return (
        judged("psf_file_wrong_samples", wrong, f"{made.name}, every sample against the PSF that was measured"),
        judged("psf_file_wrong_facts", len(differing), f"{made.name}, every entry of its header{listed}"),
    )


def read_psf_file(path: Path) -> tuple[Floats, dict[str, Any]]:
    """Samples [y, x], row 0 the lowest, and the entries of the header that are ours, by name.

    Raises:
        SourceError: MF301 if there is no such file, MF303 if it cannot be read or has not one float32 channel.
    """
    channels = read_channels(path, PREFIX, _CURE)
    if len(channels.names) != 1 or channels.stored != "float":
        raise damaged(path, f"{len(channels.names)} channels of {channels.stored} are not one of float", _CURE)
    return channels.values[0, ::-1], channels.facts


def _differing(expected: Facts, read: dict[str, Any]) -> Iterator[str]:
    for name in dict.fromkeys((*expected, *read)):
        one, other = expected.get(name), read.get(name)
        if isinstance(one, float) and isinstance(other, float):
            same = np.float32(one) == np.float32(other)
        else:
            same = one == other
        if not same:
            yield f"{name} is {other!r}, not {one!r}"


FORMATS = (Format("exr", "OpenEXR, PSF", ".exr"),)
"""Written by :class:`PsfFile`, for PSFs are of what is measured in the other files."""
