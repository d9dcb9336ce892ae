"""A stack: frames of one light by one sensor that differ in their exposure time, judged before they are merged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maskfab.capture.frames import Frame, same_sensor
from maskfab.errors import SourceError

_PILED_UP = 8
_WELL_ABOVE_BLACK = 100
_SHORTEST, _LONGEST = 1e-7, 1e5


def check_stack(frames: Sequence[Frame]) -> None:
    """Refuse frames that cannot be merged.

    One frame needs no time; several need times that differ.

    Raises:
        SourceError: MF331 of unlike sensors, MF332 times missing, all equal or of no camera, MF333 pixels that are full
            below the white level, MF334 without frames.
    """
    if not frames:
        raise SourceError("MF334", "there are no frames", cure="Give one or more")
    same_sensor(frames)
    if len(frames) > 1:
        _check_times(frames)
    _check_white(frames)


def _check_times(frames: Sequence[Frame]) -> None:
    missing = [frame.name for frame in frames if frame.exposure_s is None]
    if missing:
        raise SourceError(
            "MF332",
            f"{len(missing)} of {len(frames)} frames state no exposure time, the first of them {missing[0]}",
            where=missing[0],
            cure="Give all times, such as --times '1 ms' --times '4 ms', in the order of the files",
        )
    times = [frame.exposure_s for frame in frames if frame.exposure_s is not None]
    if len(set(times)) == 1:
        raise SourceError(
            "MF332",
            f"all {len(frames)} frames have an exposure of {times[0]:g} s; a stack needs times that differ",
            where=frames[0].name,
            cure="Give the true times, or a single frame; two equal frames tell the gain",
        )
    if not all(_SHORTEST <= time <= _LONGEST for time in times):
        raise SourceError(
            "MF332",
            f"times from {min(times):g} s to {max(times):g} s; the limits are {_SHORTEST:g} s and {_LONGEST:g} s",
            where=frames[0].name,
            cure="Give times with their unit",
        )


def _check_white(frames: Sequence[Frame]) -> None:
    """Two exposures that end at one count, below white, are full there: of light they would end at two."""
    seen: dict[float, str] = {}
    for frame in frames:
        top = float(frame.counts.max())
        piled = np.count_nonzero(frame.counts == np.float32(top)) >= _PILED_UP
        if not (max(frame.black) + _WELL_ABOVE_BLACK < top < frame.white and piled):
            continue
        if top in seen:
            raise SourceError(
                "MF333",
                f"{seen[top]} and {frame.name} both end at {top:g} counts, which many pixels have, below the white "
                f"level of {frame.white:g}",
                where=frame.name,
                cure=f"State the true white level, such as --white {top:g}",
            )
        seen[top] = frame.name
