"""Run as a process of its own: reads one frame, RAW by LibRaw or a picture by OpenImageIO, and writes it to stdout.

Frames come from cameras and programs of any maker, and both libraries are written in C: a damaged file may end, hang or
fill the process that reads it, which is this one.

    python -P -W error frame_process.py FILE
"""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from maskfab.base.arrays import Singles
from maskfab.base.errors import SourceError
from maskfab.camera.frames.dng import as_told, told
from maskfab.camera.frames.frame import (
    LEVELS_OF_BYTES,
    MOST_PIXELS,
    OF_BYTES,
    PICTURES,
    PLANE_COLOURS,
    Colour,
    Frame,
    Pattern,
    white_of_16_bits,
)
from maskfab.mask.formats.tiff import TURN, said_by, shown_alike
from maskfab.mask.process_limits import limit_share
from maskfab.mask.sandbox import answer_message, error_message

_MEMORY, _MEMORY_PER_BYTE = 4 << 30, 8
_SECONDS, _BYTES_PER_SECOND = 30, 2_000_000
_LOSSY = {"jpeg", "jpg", "webp", "b44", "b44a", "dwaa", "dwab", "pxr24"}
_CODED_CHUNKS = {b"sRGB": "sRGB code values", b"iCCP": "a colour profile", b"cICP": "code values of a display"}
_ORIENTATIONS = {3: 3, 5: 8, 6: 6}
"""Tags of LibRaw's flips."""
_LINEAR_GAMMA = 100_000
_CURE = "Save the frame as the camera's RAW, or as linear TIFF or PNG of 16 bits or EXR without loss"


def raw_frame(path: Path) -> Frame:
    """A RAW file by LibRaw: what the sensor counted inside its visible edge, not turned, nothing interpolated."""
    import rawpy

    stated = told(path)
    try:
        with rawpy.imread(str(path)) as raw:
            sizes = raw.sizes
            _check_size(path, sizes.raw_width, sizes.raw_height)
            counts, pattern, places = _of_sensor(path, raw)
            each_black, whites = raw.black_level_per_channel, raw.camera_white_level_per_channel
            balance = [float(gain) for gain in raw.camera_whitebalance[:3]]
            matrix = np.asarray(raw.color_matrix, dtype=np.float64)[:, :3]
            frame = Frame(
                name=path.name,
                counts=counts,
                black=tuple(float(each_black[place]) for place in places),
                white=float(min((level for level in whites or () if level > 0), default=raw.white_level)),
                pattern=pattern,
                exposure_s=_decimal(raw.other.shutter_speed),
                balance=(balance[0], balance[1], balance[2]) if min(balance) > 0 else None,
                colour_matrix=matrix if matrix.any() and np.isfinite(matrix).all() else None,
                orientation=_ORIENTATIONS.get(sizes.flip, 1),
                **_maker(path, raw.other.iso_speed),
            )
            return (
                frame
                if stated is None
                else as_told(frame, raw.raw_image, (sizes.top_margin, sizes.left_margin), stated, path)
            )
    except (rawpy.LibRawFileUnsupportedError, rawpy.NotSupportedError) as error:
        what = f"{path.name} is no RAW file that LibRaw knows ({_text(error)})"
        cure = "Convert it to uncompressed DNG, or save it as linear TIFF of 16 bits"
        raise SourceError("MF308", what, where=str(path), cure=cure) from error
    except rawpy.LibRawError as error:
        raise _damaged(path, _text(error)) from error


def picture_frame(path: Path) -> Frame:
    """A picture whose values are linear in the light: unsigned of 16 bits, or floating point."""
    if path.suffix.lower() not in (".tif", ".tiff"):
        return _of_picture(path, path)
    with shown_alike(path) as shown:
        frame = _of_picture(path, shown.path)
        if shown.turned and not math.isfinite(frame.white):
            what = f"{path.name} says that 0 is white of floating-point values, of which none is said to be black"
            raise SourceError("MF318", what, where=str(path), cure=TURN)
        if not shown.turned:
            return frame
        # Of levels that were shifted the last bits count from white.
        most = float(np.iinfo(np.uint16).max)
        return replace(frame, counts=shown.positive(frame.counts, most), white=most)


def _of_sensor(path: Path, raw: Any) -> tuple[Singles, Pattern | None, tuple[int, ...]]:
    """Singles, their mosaic, and for each of its places which of LibRaw's colours it is."""
    seen = raw.raw_image_visible
    names: list[Colour] = [letter if letter in PLANE_COLOURS else "-" for letter in raw.color_desc.decode()]
    if seen.ndim == 3:
        return np.ascontiguousarray(seen[:, :, :3].transpose(2, 0, 1).astype(np.float32)), None, (0, 1, 2)
    if raw.num_colors == 1:
        return seen.astype(np.float32), None, (0,)
    colours = raw.raw_colors_visible
    tile = colours[:2, :2]
    repeated = all((colours[y::2, x::2] == tile[y, x]).all() for y in (0, 1) for x in (0, 1))
    pattern = tuple(tuple(names[place] for place in row) for row in tile.tolist()) if repeated else ()
    if sorted(colour for row in pattern for colour in row) != ["B", "G", "G", "R"]:
        what = f"{path.name} has no mosaic of 2 x 2 pixels in red, green, green and blue"
        cure = "Take the captures with a camera of such a mosaic, or with one that records no colours"
        raise SourceError("MF308", what, where=str(path), cure=cure)
    (one, two), (three, four) = pattern
    return seen.astype(np.float32), ((one, two), (three, four)), tuple(tile.ravel().tolist())


def _maker(path: Path, iso_speed: float) -> dict[str, Any]:
    """Camera and sensitivity, which LibRaw's Python interface tells in part: most RAW files are TIFF at their start."""
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    camera, sensitivity = "", iso_speed or None
    image = oiio.ImageInput.open(str(path))
    if image is not None:
        spec = image.spec()
        with suppress(UnicodeDecodeError):
            camera = " ".join(spec.get_string_attribute(name) for name in ("Make", "Model")).strip()
        sensitivity = sensitivity or spec.get_int_attribute("Exif:PhotographicSensitivity") or None
        image.close()
    else:
        oiio.geterror()  # or it is told at the end of the process
    return {"camera": camera, "sensitivity": sensitivity}


def _of_picture(path: Path, shown: Path) -> Frame:
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    image = oiio.ImageInput.open(str(shown))
    if image is None:
        raise _damaged(path, said_by(oiio))
    spec = image.spec()
    _check_size(path, spec.width, spec.height)
    _check_kind(path, spec, pages=2 if image.seek_subimage(1, 0) else 1)
    said_by(image)  # there being no second page is no error
    image.seek_subimage(0, 0)
    whole = str(spec.format) == "uint16"
    pixels = image.read_image("uint16" if whole else "float")
    problem = said_by(image) or said_by(oiio)
    image.close()
    if pixels is None or problem:
        raise _damaged(path, problem)
    values = np.asarray(pixels).reshape(spec.height, spec.width, spec.nchannels)
    if (
        whole
        and not (values % OF_BYTES).any()
        and len(np.unique(values[:: max(1, len(values) // 64)])) > LEVELS_OF_BYTES
    ):
        raise _coded(path, f"holds 8 bits as 16: all its values are multiples of {OF_BYTES}")
    if not np.isfinite(values).all():
        raise _damaged(path, "it has values that are not finite")
    planes = values.transpose(2, 0, 1).astype(np.float32)
    return Frame(
        name=path.name,
        counts=np.ascontiguousarray(planes[0] if len(planes) == 1 else planes),
        black=(0.0,) * len(planes),
        white=white_of_16_bits(values) if whole else float("inf"),
        exposure_s=_decimal(spec.get_float_attribute("ExposureTime", 0.0)),
        camera=" ".join(spec.get_string_attribute(name) for name in ("Make", "Model")).strip(),
        sensitivity=float(spec.get_int_attribute("Exif:PhotographicSensitivity")) or None,
        orientation=spec.get_int_attribute("Orientation", 1),
    )


def _check_kind(path: Path, spec: Any, pages: int) -> None:
    kind, bits = str(spec.format), spec.get_int_attribute("oiio:BitsPerSample")
    packing = str(spec.get_string_attribute("compression", "")).partition(":")[0].lower()
    if kind not in ("uint16", "half", "float") or (kind == "uint16" and bits not in (0, 16)):
        raise _coded(path, f"has values of the type {kind}{f' of {bits} bits' if bits else ''}")
    if packing in _LOSSY:
        raise _coded(path, f"is compressed with loss ({packing})")
    profile = str(spec.get_string_attribute("ICCProfile:profile_description", ""))
    if profile and "linear" not in profile.lower():
        raise _coded(path, f"has the colour profile {profile!r}, which is not linear")
    if path.suffix.lower() == ".png":
        for name, content in _chunks(path):
            if name in _CODED_CHUNKS and not profile:
                raise _coded(path, f"says that it holds {_CODED_CHUNKS[name]}")
            if name == b"gAMA" and len(content) == 4 and struct.unpack(">I", content)[0] != _LINEAR_GAMMA:
                raise _coded(path, f"states a gamma of {struct.unpack('>I', content)[0] / _LINEAR_GAMMA:g}, not 1")
    names = tuple(str(name).upper() for name in spec.channelnames)
    if pages > 1 or not (names == PLANE_COLOURS or (len(names) == 1 and spec.alpha_channel < 0)):
        fault = "several pages" if pages > 1 else f"the channels {', '.join(names)}"
        what = f"{path.name} has {fault}; a frame is one picture in grey or in red, green and blue"
        cure = "Save one picture a file, without transparency"
        raise SourceError("MF308", what, where=str(path), cure=cure)


def _chunks(path: Path) -> Iterator[tuple[bytes, bytes]]:
    """Names and contents of a PNG's chunks before its pixels."""
    with path.open("rb") as file:
        file.seek(8)
        while len(head := file.read(8)) == 8 and head[4:] != b"IDAT":
            length = int.from_bytes(head[:4], "big")
            yield head[4:], file.read(min(length, 16))
            file.seek(max(0, length - 16) + 4, 1)


def _decimal(stated: float) -> float | None:
    """The plainest fraction that a single rounds to, as cameras write times; None for no time."""
    if not (np.isfinite(stated) and stated > 0):
        return None
    for most in (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000):
        plain = Fraction(stated).limit_denominator(most)
        if np.float32(float(plain)) == np.float32(stated):
            return float(plain)
    return float(stated)


def _check_size(path: Path, width: int, height: int) -> None:
    if width < 2 or height < 2 or width * height > MOST_PIXELS:
        what = (
            f"{path.name} has {width} x {height} pixels; a frame has at least 2 x 2 and at most "
            f"{MOST_PIXELS // 1_000_000} million"
        )
        raise SourceError("MF313", what, where=str(path), cure="Crop it about the light")


def _coded(path: Path, what: str) -> SourceError:
    return SourceError("MF330", f"{path.name} {what}", where=str(path), cure=_CURE)


def _damaged(path: Path, what: str) -> SourceError:
    said = what.strip().splitlines()
    cure = "Copy or save it again"
    return SourceError("MF303", f"{path.name}: {said[0] if said else 'it is damaged'}", where=str(path), cure=cure)


def _text(error: Exception) -> str:
    reason = error.args[0] if error.args else ""
    return reason.decode(errors="replace") if isinstance(reason, bytes) else str(reason)


if __name__ == "__main__":
    file = Path(sys.argv[1])
    limit_share(file, _MEMORY, _MEMORY_PER_BYTE, _SECONDS, _BYTES_PER_SECOND)
    try:
        message = answer_message(picture_frame(file) if file.suffix.lower() in PICTURES else raw_frame(file), Frame)
    except SourceError as error:
        message = error_message(error)
    sys.stdout.buffer.write(message)
