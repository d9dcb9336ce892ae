"""Frames from files: RAW by LibRaw (extra ``raw``), linear TIFF and PNG of 16 bits, and EXR."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from maskfab.capture.frame_process import PICTURES
from maskfab.capture.frames import Colour, Frame, Pattern, same_sensor
from maskfab.errors import SourceError
from maskfab.provenance import sha256_of_file
from maskfab.readers.sandbox.child_process import PATIENCE_S, read_apart

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
