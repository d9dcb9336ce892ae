"""Merged captures as OpenEXR: light and standard deviation, laid out as the sensor is, with their provenance."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from maskfab.base import __version__
from maskfab.capture.frames import PLANE_COLOURS
from maskfab.capture.merge import Merged
from maskfab.export.images.exr import Fact, write_channels

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
