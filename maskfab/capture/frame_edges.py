"""The slanted edges of one frame, colour by colour on the places of its own pixels, nothing interpolated."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.capture.edge import WHOLE, Grid
from maskfab.capture.edge_regions import Region
from maskfab.capture.frames import PIXELS_OF, Colour, Frame
from maskfab.capture.measured_edges import EdgeDesign, MeasuredEdge, MeasuredEdges, measured_edges
from maskfab.errors import SourceError


def frame_edges(
    frame: Frame,
    pixel_um: float | None,
    *,
    region: Region | None = None,
    window_px: float = math.inf,
    designs: Mapping[Colour, EdgeDesign] | None = None,
) -> MeasuredEdges:
    """Every edge of a frame, in each of its colours.

    Args:
        frame: linear counts.
        pixel_um: side of a sensor pixel, or None.
        region: box of sensor pixels to look in; the whole frame if None.
        window_px: largest reach to either side of an edge.
        designs: for each colour of the frame, all of one die; None to hold nothing beside.

    Raises:
        SourceError: as :func:`maskfab.capture.measured_edges.measured_edges`, if no colour has an edge that can be
            measured.
    """
    edges: list[MeasuredEdge] = []
    left_out: list[str] = []
    refused: list[SourceError] = []
    die = None
    for colour in dict.fromkeys(each.colour for each in frame.lattices):
        values, grid, clipped_at = _light(frame, colour)
        try:
            found = measured_edges(
                values,
                pixel_um,
                colour=colour,
                grid=grid,
                region=region,
                window_px=window_px,
                clipped_at=clipped_at,
                design=None if designs is None else designs[colour],
                where=frame.name,
            )
        except SourceError as error:
            refused.append(error)
            left_out.append(f"{PIXELS_OF[colour]}: {error}")
            continue
        edges += found.edges
        left_out += [f"{PIXELS_OF[colour]}: {each}" for each in found.left_out]
        die = found.die
    if not edges:
        raise refused[0]
    return MeasuredEdges(tuple(edges), tuple(left_out), die)


def _light(frame: Frame, colour: Colour) -> tuple[Floats, Grid, float]:
    """Counts above black of one colour, where they lie, and from where on they are clipped."""
    own = [(each, black) for each, black in zip(frame.lattices, frame.black, strict=True) if each.colour == colour]
    clipped_at = frame.white - max(black for _, black in own)
    (first, black), *others = own
    if not others:
        return first.of(frame.counts).astype(np.float64) - black, Grid(first.first, first.step), clipped_at
    # The two greens of a mosaic together have twice the places across an edge that either has.
    values = np.full(frame.shape, np.nan)
    for lattice, level in own:
        lattice.of(values)[...] = lattice.of(frame.counts).astype(np.float64) - level
    return values, WHOLE, clipped_at
