"""A file of biased data against its plate, twice: as it is, and as the writer will make it.

The data are held against the sized design, polygon by polygon, and against the openings without any polygons, on lines
half the bias beside those of the dots. Then what was read is sized back, and compared with the design as any file is:
a bias taken off twice, or not at all, fails there, whatever the sizing of the design does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from klayout import db

from maskfab.base.arrays import Floats, Mask
from maskfab.comparison.roundtrip import RoundTrip, compare_layout
from maskfab.export.cell_polygons import CUT
from maskfab.geometry.data_bias import biased_data, written_of
from maskfab.geometry.die_grid import die_edges_nm, die_raster
from maskfab.geometry.plate_layout import coverage, layer_info, region
from maskfab.model import CLEAR, Die, Plate, Quantity
from maskfab.units import NM_PER_UM


def compare_biased(
    plate: Plate,
    design: db.Layout,
    read: db.Layout,
    path: Path,
    bias_nm: int,
    *,
    dots: bool = True,
    drawn_polygons: int | None = None,
    layer_names: Mapping[str, str] | None = None,
) -> RoundTrip:
    """Comparison of a layout of biased data; arguments as of :func:`maskfab.comparison.roundtrip.compare_layout`.

    Returns:
        The comparison of the layout sized back, which is its ``layout``; polygons are counted in the data.
    """
    sized = biased_data(region(design, CLEAR), plate, bias_nm)
    raw = compare_layout(
        plate,
        _with_clear(design, sized),
        read,
        path,
        dots=False,
        drawn_polygons=drawn_polygons,
        layer_names=layer_names,
    )
    data = region(raw.layout, CLEAR) - region(raw.layout, CUT)
    back = compare_layout(
        plate,
        design,
        _with_clear(raw.layout, written_of(data, plate, bias_nm)),
        path,
        dots=dots,
        layer_names=layer_names,
    )
    return replace(
        back,
        polygons=raw.polygons,
        drawn_polygons=raw.drawn_polygons,
        rounding_nm=raw.rounding_nm,
        differences=back.differences or raw.differences,
        data=tuple(_rows(plate, raw, data, bias_nm, dots=dots)),
    )


def biased_raster(die: Die, bias_nm: int) -> tuple[Floats, Floats, Mask]:
    """A die in biased data, without polygons: lines along x and y, and which parts between them are clear.

    A line between two dots becomes two, half the bias to either side of it; what lies between them is clear if both
    dots are (positive bias: shapes shrink), or if one is (negative: they grow), and so along x and then along y.

    Returns:
        float64 [nx + 1] and [ny + 1] lines in plate nanometres, bool [ny, nx].
    """
    clear = np.pad(die_raster(die), 1)
    x, y = die_edges_nm(die)
    clear, x = _between(clear, x, bias_nm)
    turned, y = _between(clear.T, y, bias_nm)
    return x, y, turned.T


def _with_clear(layout: db.Layout, clear: db.Region) -> db.Layout:
    """A layout whose layer CLEAR holds these shapes instead, in its top cell."""
    found = layout.dup()
    for layer in (CLEAR, CUT):
        index = found.find_layer(layer_info(layer))
        if index is not None:
            found.delete_layer(index)
    found.top_cell().shapes(found.layer(layer_info(CLEAR))).insert(clear)
    return found


def _rows(plate: Plate, raw: RoundTrip, data: db.Region, bias_nm: int, *, dots: bool) -> Iterator[Quantity]:
    name, bias = raw.path.name, bias_nm / NM_PER_UM
    yield Quantity(
        "data_bias",
        -bias,
        f"of clear widths in the data of {name}, whose writer changes them by {bias:+g} um. What was read is sized "
        "back: all other numbers are of the plate as it comes out",
    )
    yield Quantity(
        "data_xor_area",
        raw.xor_area_um2,
        f"{name}, read independently, XOR with the design sized by {-bias:+g} um per width",
        limit=0.0,
        passed=raw.xor_area_um2 == 0,
    )
    widths = [each.read_nm - (each.gauge.target_nm - bias_nm) for each in raw.cds]
    if widths:
        worst = max(widths, key=abs)
        told = f"largest of all CD structures in {name}, against their targets less the bias"
        yield Quantity("data_width_error", worst, told, limit=0, passed=worst == 0)
    for die in plate.dies if dots else ():
        wrong = _wrong_parts(die, data, bias_nm)
        told = f"parts between the biased lines of the dots in {name}, clear otherwise than the opening says"
        yield Quantity("data_wrong_parts", wrong, told, limit=0, passed=wrong == 0, die=die.name)


def _wrong_parts(die: Die, data: db.Region, bias_nm: int) -> int:
    x, y, clear = biased_raster(die, bias_nm)
    reach = abs(bias_nm)
    inside = data & db.Region(db.Box(*die.box_nm).enlarged(reach, reach))
    if min(x.size, y.size) < 2:
        return 0 if inside.is_empty() else 1
    return int(np.count_nonzero(coverage(inside, x, y) != clear))


def _between(clear: Mask, lines_nm: Floats, bias_nm: int) -> tuple[Mask, Floats]:
    """Columns with those between them; ``clear`` has one more on either side than the lines bound."""
    # A line along which nothing changes, such as between two halves of a gutter, would be crossed by its neighbours.
    edges = (clear[:, 1:] != clear[:, :-1]).any(axis=0)
    columns = clear[:, np.concatenate([[True], edges])]
    lines, half = lines_nm[edges], abs(bias_nm) / 2
    joined = np.logical_and if bias_nm > 0 else np.logical_or
    parts = np.empty((clear.shape[0], 2 * columns.shape[1] - 1), dtype=bool)
    parts[:, ::2] = columns
    parts[:, 1::2] = joined(columns[:, :-1], columns[:, 1:])
    return parts[:, 1:-1], np.stack([lines - half, lines + half], axis=1).ravel()
