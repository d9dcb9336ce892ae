"""A plate as in a mirror: x to -x about its centre, everything with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from maskfab.model import ORIENTATIONS, Die, Furniture, Gauge, Panel, Plate, Polygon, Track

_TURNS = ORIENTATIONS // 2


def mirrored(plate: Plate) -> Plate:
    """The plate seen from its other side; twice it is the plate itself.

    Names and titles stay: they are those of the same things.
    """
    return replace(
        plate,
        dies=tuple(_die(die) for die in plate.dies),
        furniture=tuple(_mark(mark) for mark in plate.furniture),
        gauges=tuple(_gauge(gauge) for gauge in plate.gauges),
        notes=tuple(replace(note, position_nm=(-note.position_nm[0], note.position_nm[1])) for note in plate.notes),
    )


def mirrored_panel(panel: Panel) -> Panel:
    """A panel whose columns run the other way, each cell mirrored; emitters and wires that turn go with their cell."""
    return replace(
        panel,
        orientations=_elements(panel.orientations)[:, ::-1],
        tracks=tuple(track if track.turns else _track(track, panel.pitch_nm) for track in panel.tracks),
    )


def _elements(cells: NDArray[np.int8]) -> NDArray[np.int8]:
    """Every cell's element of D4 followed by a mirror: k = r + 4 f turns by r quarters after f mirrors."""
    opening, element = np.divmod(cells, ORIENTATIONS)
    mirror, turn = np.divmod(element, _TURNS)
    return np.asarray(ORIENTATIONS * opening + _TURNS * (1 - mirror) + (-turn) % _TURNS, dtype=np.int8)


def _die(die: Die) -> Die:
    # Of an odd width the middle lies half a nanometre beside the panel's.
    width = die.panel.size_nm[0]
    return replace(die, panel=mirrored_panel(die.panel), centre_nm=(width // 2 - die.box_nm[2], die.centre_nm[1]))


def _mark(mark: Furniture) -> Furniture:
    return replace(mark, polygons=tuple(_polygon(each) for each in mark.polygons))


def _track(track: Track, pitch_nm: int) -> Track:
    polygons = (((pitch_nm + x, y) for x, y in _polygon(each)) for each in track.polygons)
    return replace(track, polygons=tuple(map(tuple, polygons)))


def _polygon(polygon: Polygon) -> Polygon:
    """Backwards, so that it runs round what it bounds in the sense that it did."""
    return tuple((-x, y) for x, y in reversed(polygon))


def _gauge(gauge: Gauge) -> Gauge:
    return replace(gauge, centre_nm=(-gauge.centre_nm[0], gauge.centre_nm[1]))
