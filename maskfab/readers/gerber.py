"""Gerber X2 as a layout, from the outlines that gerbonara finds in it, see :mod:`maskfab.readers.gerber_process`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.errors import SourceError
from maskfab.geometry.plate_layout import DBU_UM, layer_info
from maskfab.geometry.shape_limits import ROUNDING_KEY, LeftOut, is_empty, note_left_out, refuse_long
from maskfab.model import CLEAR
from maskfab.readers.gerber_process import Outlines, Run
from maskfab.readers.sandbox.bounded import library_errors
from maskfab.readers.sandbox.child_process import PATIENCE_S, read_apart
from maskfab.readers.sandbox.messages import unusable

_ON_GRID_NM = 1e-5
_FIRST_BYTES = 256
_BYTES_PER_SECOND = 1e5
_START = re.compile(rb"(?:\xef\xbb\xbf)?\s*(?:%|G0?[0-9])")


def read_gerber(path: Path) -> db.Layout:
    """A Gerber file as one cell on the layer CLEAR; dark is clear in the chrome, as the writer's data are.

    Raises:
        SourceError: MF303 damaged, MF304 no Gerber, MF308 without gerbonara, MF310 open regions, MF311 arcs, MF313 too
            many or too far, MF315 a command whose effect is not certain, MF316 far slower to read than whole files are.
    """
    with path.open("rb") as file:
        if not _START.match(file.read(_FIRST_BYTES)):
            raise SourceError(
                "MF304", f"{path.name} is not a Gerber file", where=str(path), cure="Give it its true suffix"
            )
    seconds = PATIENCE_S + path.stat().st_size / _BYTES_PER_SECOND
    script = Path(__file__).with_name("gerber_process.py")
    runs, curves = read_apart(path, script, kind=Outlines, seconds=seconds)
    if not all(corners.shape == (sizes.sum(), 2) and (sizes >= 0).all() for _, corners, sizes in runs):
        raise unusable(path, ValueError())
    for _, _, sizes in runs:
        refuse_long(int(sizes.max(initial=0)), path)
    with library_errors(path):
        return _Drawing(curves).layout(runs)


def require_gerbonara(name: str, *, where: str = "export.formats", cure: str = "leave gerber out") -> None:
    """Refuse to write a Gerber file that this installation could not read back.

    Args:
        name: of what the file belongs to.
        where: it was asked for.
        cure: what else could be done.

    Raises:
        SourceError: MF308.
    """
    if find_spec("gerbonara") is None:
        raise SourceError(
            "MF308",
            f"the Gerber file of {name} could be written, but not read back without gerbonara",
            where=where,
            cure=f"Run pip install 'maskfab[gerber]', or {cure}",
        )


class _Drawing:
    """Outlines as polygons, in the order in which dark and clear cover each other."""

    def __init__(self, curves: int) -> None:
        self._curves = curves
        self._rounding = 0.0
        self._empty = 0
        self._repeated = 0

    def layout(self, runs: Sequence[Run]) -> db.Layout:
        layout = db.Layout()
        layout.dbu = DBU_UM
        shapes = layout.create_cell("GERBER").shapes(layout.layer(layer_info(CLEAR)))
        if all(dark for dark, _, _ in runs):
            for _, corners, sizes in runs:
                for polygon in self._polygons(corners, sizes):
                    shapes.insert(polygon)
        else:
            drawn = db.Region()
            for dark, corners, sizes in runs:
                region = db.Region(list(self._polygons(corners, sizes)))
                drawn = drawn + region if dark else drawn - region
            shapes.insert(drawn.merged(True, 1))
        told = "largest rounding to the nanometre grid"
        layout.add_meta_info(db.LayoutMetaInfo(ROUNDING_KEY, self._rounding, told))
        note_left_out(layout, LeftOut(self._repeated, self._empty, self._curves))
        return layout

    def _polygons(self, points: NDArray[np.float64], sizes: NDArray[np.int64]) -> Iterator[db.Polygon]:
        """Polygons of so many points each, in nanometres."""
        nearest = np.rint(points)
        rounding = float(np.abs(points - nearest).max(initial=0.0))
        if rounding > _ON_GRID_NM:
            self._rounding = max(self._rounding, rounding)
        corners, ends = nearest.astype(np.int64), np.cumsum(sizes)
        for size, end in zip(sizes.tolist(), ends.tolist(), strict=True):
            outline = corners[end - size : end].tolist()
            polygon = db.Polygon([db.Point(x, y) for x, y in outline])
            if polygon.num_points() < size > 1:
                self._repeated += sum(
                    one == other for one, other in zip(outline, [outline[-1], *outline], strict=False)
                )
            if is_empty(polygon):
                self._empty += 1
            else:
                yield polygon
