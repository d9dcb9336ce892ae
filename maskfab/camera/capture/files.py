"""Frames from files: RAW by LibRaw (extra ``raw``), linear TIFF and PNG of 16 bits, and EXR.

Merged captures as OpenEXR: light and standard deviation, laid out as the sensor is, with their provenance.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from maskfab.base import __version__
from maskfab.base.errors import SourceError
from maskfab.base.provenance import sha256_of_file
from maskfab.camera.capture.frame_process import PICTURES
from maskfab.camera.capture.frames import PLANE_COLOURS, Colour, Frame, Pattern, same_sensor
from maskfab.camera.capture.merge import Merged
from maskfab.mask.formats.exr import Fact, write_channels
from maskfab.mask.sandbox import PATIENCE_S, read_apart

_CODED = (".jpg", ".jpeg", ".heic", ".heif", ".avif", ".webp", ".gif", ".bmp", ".hdr", ".jxl")
_MOSAICS: dict[str, Pattern] = {
    "rggb": (("R", "G"), ("G", "B")),
    "bggr": (("B", "G"), ("G", "R")),
    "grbg": (("G", "R"), ("B", "G")),
    "gbrg": (("G", "B"), ("R", "G")),
}


def read_frame(
    path: Path,
    *,
    exposure_s: float | None = None,
    black: float | None = None,
    white: float | None = None,
    mosaic: str | None = None,
) -> Frame:
    """One frame, in a process of its own.

    Args:
        path: ``.tif .tiff .png .exr``; anything else is taken for RAW.
        exposure_s: in seconds; what the file states if None.
        black: counts of no light in every colour; what the file states, or 0, if None.
        white: counts of a full pixel; what the file states, 65535 of 16 bits or infinite if None.
        mosaic: ``rggb bggr grbg gbrg`` of a picture that holds a mosaic in grey.

    Raises:
        SourceError: MF301 missing, MF302 empty, MF303 damaged, MF308 of a kind that is not read, MF313 too large, MF316
            far slower to read than frames are, MF318 a TIFF that does not say what is white, MF330 not linear, MF333
            black not below white or an exposure that is not above 0, MF431 RAW without rawpy.
    """
    path = Path(path)
    where = str(path)
    if not os.path.isfile(path):
        raise SourceError("MF301", f"there is no file {path.name}", where=where, cure="Give the path of a frame")
    if path.stat().st_size == 0:
        raise SourceError("MF302", f"{path.name} holds 0 bytes", where=where, cure="Copy it from the camera again")
    suffix = path.suffix.lower()
    if suffix in _CODED:
        raise SourceError(
            "MF330",
            f"{path.name} is a {suffix[1:].upper()} picture, of 8 bits or compressed with loss, not linear counts",
            where=where,
            cure="Give the camera's RAW file, or linear TIFF or PNG of 16 bits, or EXR",
        )
    if suffix not in PICTURES and find_spec("rawpy") is None:
        raise SourceError(
            "MF431",
            f"{path.name} is read by rawpy, which is not installed",
            where=where,
            cure="Run pip install 'maskfab[raw]', or save the frame as linear TIFF of 16 bits",
        )
    found: Frame = read_apart(path, Path(__file__).with_name("frame_process.py"), kind=Frame, seconds=PATIENCE_S)
    found = replace(found, sha256=sha256_of_file(path), pattern=_stated_mosaic(found, mosaic, where))
    levels, count = found.black if black is None else (black,), len(found.lattices)
    found = replace(
        found,
        exposure_s=found.exposure_s if exposure_s is None else exposure_s,
        black=levels if len(levels) == count else levels[:1] * count,
        white=found.white if white is None else white,
    )
    _check_levels(found, where)
    return found


def read_frames(
    paths: Sequence[Path],
    *,
    times_s: Sequence[float] | None = None,
    black: float | None = None,
    white: float | None = None,
    mosaic: str | None = None,
) -> tuple[Frame, ...]:
    """Frames of one sensor.

    Args:
        paths: of one or more files.
        times_s: an exposure for each file, in their order; what the files state if None.
        black: as :func:`read_frame`.
        white: as :func:`read_frame`.
        mosaic: as :func:`read_frame`.

    Raises:
        SourceError: as :func:`read_frame`; MF331 if they are not of one sensor, MF332 if there are not as many times as
            files.
    """
    if times_s is not None and len(times_s) != len(paths):
        raise SourceError(
            "MF332",
            f"{len(times_s)} exposure times are given for {len(paths)} files",
            cure="Give one time for each file, in the same order",
        )
    given: Sequence[float | None] = [None] * len(paths) if times_s is None else times_s
    frames = tuple(
        read_frame(path, exposure_s=time, black=black, white=white, mosaic=mosaic)
        for path, time in zip(paths, given, strict=True)
    )
    same_sensor(frames)
    return frames


def _stated_mosaic(frame: Frame, mosaic: str | None, where: str) -> Pattern | None:
    if mosaic is None:
        return frame.pattern
    known = _MOSAICS.get(mosaic.lower())
    if known is None or frame.counts.ndim != 2:
        what = f"{mosaic!r} is no mosaic" if known is None else f"{frame.name} has three planes, which are no mosaic"
        raise SourceError("MF331", what, where=where, cure=f"State one of {', '.join(_MOSAICS)}, of grey pictures only")
    if frame.pattern is not None and frame.pattern != known:
        raise SourceError(
            "MF331",
            f"{frame.name} says that its mosaic is {_letters(frame.pattern)}, not {mosaic.lower()}",
            where=where,
            cure="Leave the mosaic out",
        )
    return known


def _letters(pattern: Pattern) -> str:
    places: list[Colour] = [colour for row in pattern for colour in row]
    return "".join(places).lower()


def _check_levels(frame: Frame, where: str) -> None:
    if not (max(frame.black) < frame.white and all(math.isfinite(each) for each in frame.black)):
        raise SourceError(
            "MF333",
            f"black of {max(frame.black):g} counts is not below white of {frame.white:g}",
            where=where,
            cure="State black and white in the counts of the file",
        )
    if frame.exposure_s is not None and not (math.isfinite(frame.exposure_s) and frame.exposure_s > 0):
        raise SourceError(
            "MF332",
            f"an exposure of {frame.exposure_s:g} s is not above 0",
            where=where,
            cure="Give a positive time for each file",
        )


Singles = np.ndarray[tuple[int, ...], np.dtype[np.float32]]


def write_merged(merged: Merged, light: Path, sigma: Path) -> None:
    """Write two files of float32, [rows, columns] of the frames: one channel ``Y`` (a mosaic stays one), or R, G and B.

    Pixels that are not valid have light 0 and an infinite standard deviation.

    Args:
        merged: what to write.
        light: the file of the light, electrons a second.
        sigma: the file of its standard deviation.

    Raises:
        OutputError: MF401 if a file cannot be written; nothing is left under its name.
    """
    facts = merged_facts(merged)
    for path, name in ((light, "electrons_per_s"), (sigma, "sigma")):
        pixels = _laid_out(merged, name)
        channels = PLANE_COLOURS if pixels.shape[2] == 3 else ("Y",)
        write_channels(pixels, channels, path, {**facts, "holds": name}, f"maskfab {__version__}")


def merged_facts(merged: Merged) -> dict[str, Fact]:
    """Header entries that tell what a merged capture is and was made from."""
    timed = all(each.exposure_s is not None for each in merged.used)
    pattern = merged.pattern or ()
    return {
        "maskfab_version": __version__,
        "unit": "electrons/s" if timed else "electrons",
        "axes": "the first row of pixels is the uppermost of the sensor, as the files of the camera hold it",
        "mosaic": "".join(colour for row in pattern for colour in row) or "none",
        "corner": f"row {merged.corner[0]}, column {merged.corner[1]} of the files",
        "electrons_per_count": merged.electrons_per_count,
        "read_noise_e": merged.read_noise_e,
        "frames": ", ".join(each.name for each in merged.used),
        "frames_sha256": ", ".join(each.sha256 or "none" for each in merged.used),
        "exposures_s": ", ".join(
            "unknown" if each.exposure_s is None else repr(each.exposure_s) for each in merged.used
        ),
        "drifts": ", ".join(f"{each.drift.taken_out:.9g}" for each in merged.used),
        "hot_pixels": float(len(merged.hot)),
        "disagreeing_pixels": float(len(merged.disagreeing)),
        "full_pixels": float(len(merged.full)),
        "dusty_pixels": float(len(merged.dust)),
        "lonely_pixels": float(len(merged.alone)),
    }


def _laid_out(merged: Merged, name: str) -> Singles:
    """[rows, columns, channels] of the planes."""
    if all(plane.step == 1 for plane in merged.planes):
        return np.stack([getattr(plane, name) for plane in merged.planes], axis=2).astype(np.float32)
    found = np.empty((*merged.shape, 1), dtype=np.float32)
    for plane in merged.planes:
        found[plane.first[0] :: plane.step, plane.first[1] :: plane.step, 0] = getattr(plane, name)
    return found
