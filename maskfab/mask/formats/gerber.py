"""Gerber X2: every opening a region (G36, G37), so that no aperture and no macro is needed.

The Gerber layer format specification, revision 2024.05: coordinates of six decimals of a millimetre are whole
nanometres, a coordinate that does not change is left out (4.2.2), attributes are those of chapter 5 only. They stand
in comments of the form that the specification gives them (5.1.1), for older viewers warn of what they do not know.

Read from the outlines that gerbonara finds, in a process of its own: :mod:`maskfab.mask.formats.gerber_process`.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.extras import require
from maskfab.base.files import partial
from maskfab.base.model import CLEAR, Plate, Polygon
from maskfab.mask.figures import CUT, Figures, Pen, Placeholder, as_figures, polygon_lines
from maskfab.mask.formats.content import note_rounding
from maskfab.mask.formats.format import Format
from maskfab.mask.formats.gerber_process import Outlines, Run
from maskfab.mask.layout import (
    DBU_UM,
    LeftOut,
    check_file_size,
    check_limits,
    is_empty,
    layer_info,
    note_left_out,
    refuse_long,
)
from maskfab.mask.sandbox import PATIENCE_S, library_errors, read_apart, unusable, wrong_kind

_ON_GRID_NM = 1e-5
_FIRST_BYTES = 256
_BYTES_PER_SECOND = 1e5
_START = re.compile(rb"(?:\xef\xbb\xbf)?\s*(?:%|G0?[0-9])")


def read_gerber(path: Path) -> db.Layout:
    """A Gerber file as one cell on the layer CLEAR; dark is clear in the chrome, as the writer's data are.

    Raises:
        SourceError: MF303 damaged, MF304 no Gerber, MF310 open regions, MF311 arcs, MF313 too many or too far, MF315 a
            command whose effect is not certain, MF316 far slower to read than whole files are.
        MissingPackageError: MF152 without gerbonara.
    """
    require("gerber", what=f"the Gerber file {path.name}", where=str(path), otherwise="convert it to GDSII or DXF")
    with path.open("rb") as file:
        if not _START.match(file.read(_FIRST_BYTES)):
            raise wrong_kind(path, "Gerber")
    seconds = PATIENCE_S + path.stat().st_size / _BYTES_PER_SECOND
    script = Path(__file__).with_name("gerber_process.py")
    runs, curves = read_apart(path, script, kind=Outlines, seconds=seconds)
    if not all(corners.shape == (sizes.sum(), 2) and (sizes >= 0).all() for _, corners, sizes in runs):
        raise unusable(path, ValueError())
    for _, _, sizes in runs:
        refuse_long(int(sizes.max(initial=0)), path)
    with library_errors(path):
        layout = _Drawing(curves).layout(runs)
    check_limits(layout, path)
    return layout


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
        note_rounding(layout, self._rounding)
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


LARGEST_BYTES = 1_000_000_000

_HEAD_BYTES = 2_000
_OUTLINE_BYTES = 46
_VERTEX_BYTES = 16


def write_gerber(
    source: Plate | Figures, path: Path, comments: Sequence[str] = (), *, limit_bytes: int = LARGEST_BYTES
) -> None:
    """Write what a mask exposes as Gerber X2, in millimetres, byte-identical between runs.

    Dark is what the writer exposes: digitized data is clear. Holes that have a layer of their own are drawn with
    clear polarity after all else. The format has no cells that all readers know, so the file is flat.

    Args:
        comments: G04 lines, before what the figures' account has to say.

    Raises:
        OutputError: MF401 if the file cannot be written, MF415 if it would be too large.
    """
    figures = as_figures(source)
    check_file_size(gerber_bytes(figures), limit_bytes, path, 'Choose GDSII or OASIS, or hierarchy = "merged"')
    # The specification leaves line ends out of the hash.
    digest = hashlib.md5(usedforsecurity=False)
    with partial(path) as aside, aside.open("w", encoding="ascii", newline="\n") as file:
        for text in chain(_head(figures, comments), _body(figures)):
            digest.update(text.replace("\n", "").encode("ascii"))
            file.write(text)
        file.write(_attribute("MD5", digest.hexdigest()) + "M02*\n")


def gerber_bytes(figures: Figures) -> int:
    """About how large the file becomes, from above."""
    account = figures.account
    return _HEAD_BYTES + account.polygons * _OUTLINE_BYTES + account.vertices * _VERTEX_BYTES


def _head(figures: Figures, comments: Sequence[str]) -> Iterator[str]:
    lines = (
        *comments,
        *figures.account.lines(),
        f"Digitized data is {figures.options.tone}: dark areas of this image are "
        f"{'openings in the chrome' if figures.options.tone == 'clear' else 'chrome'}",
        "Unit mm, six decimals: one step is one nanometre; origin is the centre of the blank",
    )
    yield from (f"G04 {_text(line)}*\n" for line in lines)
    yield _attribute("GenerationSoftware", "maskfab", "maskfab", _field(__version__))
    yield _attribute("Part", "Other", f"Photomask {_field(figures.plate.name)}")
    yield _attribute("FileFunction", "Other", "Photomask")
    # Regions need no aperture, and some readers warn of a file that defines none.
    yield "%FSLAX46Y46*%\n%MOMM*%\n%ADD10C,0.001*%\nG01*\n"


def _attribute(name: str, *fields: str) -> str:
    return f"G04 #@! TF.{','.join((name, *fields))}*\n"


def _body(figures: Figures) -> Iterator[str]:
    for layer, polarity in ((figures.options.layer, "D"), (CUT, "C")):
        texts = polygon_lines(figures, layer, _Pen())
        first = next(texts, None)
        if first is not None:
            yield f"%LP{polarity}*%\n"
            yield first
            yield from texts


def _text(line: str) -> str:
    """The line as comments take it: ASCII, none of the characters that end a block, and no attribute."""
    return re.sub(r"[^ -~]|[*%\\]|^#(?=@!)", "_", " ".join(line.split()))


def _field(value: str) -> str:
    """The value as attributes take it: no comma either, which parts their fields."""
    return _text(value).replace(",", "_")


class _Pen(Pen):
    """Writes regions; of each vertex only the coordinate that changes."""

    def outline(self, polygon: Polygon) -> tuple[str, list[Placeholder]]:
        (x, y), texts = polygon[0], ["G36*\nX%sY%sD02*\n"]
        gaps = [Placeholder("x", x), Placeholder("y", y)]
        for next_x, next_y in (*polygon[1:], polygon[0]):
            if next_x != x or next_y == y:
                gaps.append(Placeholder("x", next_x))
            if next_y != y:
                gaps.append(Placeholder("y", next_y))
            texts.append("X%sD01*\n" if next_y == y else "Y%sD01*\n" if next_x == x else "X%sY%sD01*\n")
            x, y = next_x, next_y
        return "".join([*texts, "G37*\n"]), gaps


FORMATS = (
    Format(
        "gerber",
        "Gerber X2",
        ".gbr",
        write_plate=lambda of, to: write_gerber(of.figures, to, of.comments),
        read=read_gerber,
        readers=(("gerbonara", read_gerber),),
        suffixes=(".gbr", ".ger"),
        layers="one",
        extra="gerber",
        reading="thread",
    ),
)
