"""Polygons of a plate for every format: cells, their positions, and the way their polygons were drawn.

Plate + PolygonOptions -> Figures -> GDSII, OASIS, DXF, CIF, Gerber, SVG

For mask software that allows only so many references, cells are paired: half as many do, of at most 64 kinds. Text
formats write the polygons of a layer cell after cell, without ever holding them all: a cell's text is made once, with
gaps for its numbers. Numbers of a column are the same in every row and those of a row the same in every column, so they
are formatted once too; what is left for each of ten thousand cells is to fill gaps.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Ints
from maskfab.base.errors import OutputError
from maskfab.base.model import CHROME, CLEAR, LAYERS, NOTE, Box, Layer, Note, Plate, Point, Polygon, Snapping
from maskfab.base.units import NM_PER_UM
from maskfab.job.order import Tone
from maskfab.mask.layout import (
    CellArray,
    CellNames,
    drawn_region,
    insert_polygons,
    layer_info,
    orientations_in_use,
    placed,
    plate_names,
)
from maskfab.mask.outlines import (
    Corners,
    Holes,
    Recut,
    exact,
    hull_points,
    recut,
    text_polygons,
    triangles,
    unit_key,
    unit_shapes,
)
from maskfab.mask.writer import biased_data, check_bias


@dataclass(frozen=True, eq=False)
class CellPairs:
    """A grid of cells as cells of two.

    Attributes:
        kinds: int64 [n, 2], what stands left and right in each kind of pair, ascending.
        index: int64 [rows, columns // 2], the kind of every pair.
        rest: int64 [rows, columns % 2], the last cells of an odd number of columns.
    """

    kinds: Ints
    index: Ints
    rest: Ints


def pairs(cells: NDArray[np.integer]) -> CellPairs:
    """Pair the cells [rows, columns] of every row from the left."""
    rows, columns = cells.shape
    even = columns - columns % 2
    left, right = (cells[:, first:even:2].astype(np.int64) for first in (0, 1))
    kinds, index = np.unique(np.stack([left.ravel(), right.ravel()], axis=1), axis=0, return_inverse=True)
    return CellPairs(kinds, index.reshape(rows, even // 2).astype(np.int64), cells[:, even:].astype(np.int64))


Hierarchy: TypeAlias = Literal["cells", "flat", "merged"]
Shapes: TypeAlias = Mapping[Layer, tuple[Polygon, ...]]

MAX_VERTICES = 4094
"""A GDSII record holds 32767 bytes: as many vertices of 8 bytes each and the closing one fit."""

CUT = Layer("CUT", 2, 0, True, "subtracted from CLEAR or CHROME: holes that have a layer of their own")
"""Holes under ``holes = "layer"``: what counts is CLEAR, or CHROME, minus CUT."""

DRAWN_LAYERS = (CLEAR, CHROME, CUT, *(layer for layer in LAYERS if layer is not CLEAR))

_FEWEST_VERTICES = 4
_NOTE_HEIGHT_NM = 500_000


@dataclass(frozen=True)
class PolygonOptions:
    """Options for drawing polygons; the plate is the same for all of them.

    Attributes:
        tone: ``clear`` draws what is clear, ``dark`` the chrome that remains of the writable area.
        hierarchy: ``cells`` draws each unit cell once and places it; ``flat`` draws every opening in the top cell;
            ``merged`` does so and joins openings across pixels wherever they share a side.
        max_vertices: no polygon has more, 4 to 4094.
        holes: as in :func:`maskfab.mask.outlines.recut`; ``layer`` puts them on :data:`CUT`.
        corners: whether dots that only share a corner stay ``apart`` or are ``joined`` in one outline.
        max_references: a die with more draws two pixels in each cell.
        notes: notes for people as ``text``, as ``polygons`` on their layer, or ``none``.
        bias_nm: by which the writer makes clear widths wider, taken out of the data, see
            :mod:`maskfab.mask.writer`; even. Shapes are then merged.
    """

    hierarchy: Hierarchy = "cells"
    max_vertices: int = MAX_VERTICES
    holes: Holes = "bisect"
    corners: Corners = "apart"
    max_references: int | None = None
    notes: Literal["text", "polygons", "none"] = "text"
    tone: Tone = "clear"
    bias_nm: int | None = None

    def __post_init__(self) -> None:
        choices: tuple[tuple[str, str, tuple[str, ...]], ...] = (
            ("hierarchy", self.hierarchy, ("cells", "flat", "merged")),
            ("holes", self.holes, ("bisect", "keyhole", "trapezoids", "layer")),
            ("corners", self.corners, ("apart", "joined")),
            ("notes", self.notes, ("text", "polygons", "none")),
            ("tone", self.tone, ("clear", "dark")),
        )
        for key, value, allowed in choices:
            if value not in allowed:
                what = f"{key} = {value!r} is none of {', '.join(allowed)}"
                raise OutputError("MF413", what, cure="Use one of the values listed")
        if not _FEWEST_VERTICES <= self.max_vertices <= MAX_VERTICES:
            what = f"max_vertices = {self.max_vertices} is not between {_FEWEST_VERTICES} and {MAX_VERTICES}"
            raise OutputError("MF413", what, cure="4094 suits every reader of today, 200 those of 1978")
        if self.bias_nm is not None and (self.bias_nm % 2 or self.hierarchy != "merged"):
            what = f"bias_nm = {self.bias_nm} with hierarchy = {self.hierarchy!r} is not drawn"
            raise OutputError("MF413", what, cure='Use an even number of nanometres and hierarchy = "merged"')
        if self.max_references is not None and self.max_references < 1:
            what = f"max_references = {self.max_references} is not positive"
            raise OutputError("MF413", what, cure="Give 1 or more, or leave max_references out for no limit")

    @property
    def redrawn(self) -> bool:
        """Whether the unit cells' own outlines, bisected and apart, will not do."""
        own = (self.holes, self.corners, self.tone) == ("bisect", "apart", "clear")
        return self.hierarchy == "merged" or not own

    @property
    def layer(self) -> Layer:
        """The layer that is written."""
        return CLEAR if self.tone == "clear" else CHROME


@dataclass(frozen=True)
class Account:
    """Counts of what was drawn on written layers and of the changes made; every reference is followed.

    Attributes:
        definitions: cells below the dies.
        references: placements of them, an array of a periodic die counted once.
        holed: outlines that had holes, by what ``holes`` did to them.
        parted: outlines that touched themselves and were parted there.
        split: outlines cut for their number of vertices.
        paired: dies drawn with two pixels in each cell.
    """

    polygons: int
    vertices: int
    definitions: int
    references: int
    holed: int
    parted: int
    split: int
    paired: tuple[str, ...]
    options: PolygonOptions
    snapped: Snapping | None = None

    def lines(self) -> tuple[str, ...]:
        """For a file's comments and a manifest: nothing is changed without being said here."""
        written = self.options.layer.name
        done = {
            "bisect": "cut through their holes",
            "keyhole": "joined to their holes by a keyhole of no width",
            "trapezoids": "taken apart into trapezoids for their holes",
            "layer": f"filled, their holes on layer {CUT.name}; what counts is {written} minus {CUT.name}",
        }
        said = [f"{self.polygons} polygons, {self.vertices} vertices, {self.options.hierarchy}"]
        if self.options.bias_nm:
            said.append(
                f"the data are already biased by {-self.options.bias_nm / NM_PER_UM:+g} um per clear width, but for "
                "letters, stars and squares at the corners, which are as designed; do not bias"
            )
        if self.options.tone == "dark":
            said.append("digitized data are dark: polygons are the chrome of the writable area, and beyond it is none")
        if self.holed:
            said.append(f"{self.holed} outlines {done[self.options.holes]}")
        if self.parted:
            said.append(f"{self.parted} outlines parted where they touched themselves")
        if self.split:
            said.append(f"{self.split} outlines cut for having more than {self.options.max_vertices} vertices")
        if self.paired:
            said.append(f"two pixels in each cell of {', '.join(self.paired)}")
        if self.snapped is not None:
            said.append(str(self.snapped))
        return tuple(said)


@dataclass(frozen=True, eq=False)
class DieFigures:
    """One die: its cell's name, its place, and the grids that fill it."""

    name: str
    origin_nm: Point
    box_nm: Box
    grids: tuple[CellArray, ...]


@dataclass(frozen=True, eq=False)
class MarkFigures:
    """One mark, in plate coordinates."""

    name: str
    shapes: Shapes


@dataclass(frozen=True, eq=False)
class Figures:
    """Everything that a file of polygons holds.

    Attributes:
        cells: shapes of every cell that grids place, in its own coordinates, in the order of first use.
        merged: written layers joined across pixels, in plate coordinates and raw; cells and marks then lack them.
    """

    plate: Plate
    options: PolygonOptions
    top: str
    cells: Mapping[str, Shapes]
    dies: tuple[DieFigures, ...]
    marks: tuple[MarkFigures, ...]
    notes: tuple[Note, ...]
    merged: Mapping[Layer, db.Region]
    account: Account

    @property
    def layers(self) -> tuple[Layer, ...]:
        """Layers with something on them, written ones first."""
        used = {layer for shapes in self.cells.values() for layer in shapes}
        used |= {layer for mark in self.marks for layer in mark.shapes} | set(self.merged)
        return tuple(layer for layer in DRAWN_LAYERS if layer in used)

    def layout(self) -> db.Layout:
        """The figures as a klayout layout with one top cell; for the order of its cells see :func:`placed`."""
        names = [self.top, *self.cells, *(die.name for die in self.dies), *(mark.name for mark in self.marks)]
        layout = placed(names, {die.name: die.grids for die in self.dies})
        layers = {layer: layout.layer(layer_info(layer)) for layer in LAYERS}
        layers |= {layer: layout.layer(layer_info(layer)) for layer in self.layers if layer in (CHROME, CUT)}
        cells = {cell.name: cell for cell in layout.each_cell()}
        top = cells[self.top]
        for name, shapes in self.cells.items():
            _draw(cells[name], shapes, layers)
        for die in self.dies:
            top.insert(db.CellInstArray(cells[die.name].cell_index(), db.Trans(*die.origin_nm)))
        for mark in self.marks:
            _draw(cells[mark.name], mark.shapes, layers)
            top.insert(db.CellInstArray(cells[mark.name].cell_index(), db.Trans()))
        for note in self.notes:
            top.shapes(layers[NOTE]).insert(db.Text(note.text, db.Trans(*note.position_nm)))
        if self.options.hierarchy != "cells":
            top.flatten(True)
        for layer, region in self.merged.items():
            top.shapes(layers[layer]).insert(region)
        return layout


def as_figures(source: Plate | Figures, options: PolygonOptions | None = None) -> Figures:
    """The figures themselves, or those of a plate."""
    return source if isinstance(source, Figures) else draw(source, options or PolygonOptions())


def draw(plate: Plate, options: PolygonOptions | None = None) -> Figures:
    """Draw a plate's polygons in the way that a mask house wants them.

    Args:
        options: how; by default cells whose outlines are bisected and apart.

    Raises:
        OutputError: MF413 if no cut on the grid draws a polygon, MF416 if a die needs too many references.
        JobError: MF127 for a bias that the plate does not bear; MF413 for one off its data grid.
    """
    chosen = options or PolygonOptions()
    if chosen.bias_nm:
        check_bias(plate, chosen.bias_nm)
        grid = 1 if plate.snapped is None else plate.snapped.grid_nm
        if chosen.bias_nm // 2 % grid:
            what = f"half a bias of {chosen.bias_nm} nm moves edges off the data grid of {grid} nm"
            raise OutputError("MF413", what, cure=f"Use a process.cd_bias that is a multiple of {2 * grid} nm")
    return _Drawing(plate, chosen).figures()


class _Drawing:
    """Collects the cells of a plate and what was done to them."""

    def __init__(self, plate: Plate, options: PolygonOptions) -> None:
        self._plate, self._options = plate, options
        self._names = plate_names(plate)
        self._cells: dict[str, Shapes] = {}
        self._done: dict[str, _Done] = {}
        self._paired: list[str] = []
        self._extra = CellNames()
        for name in (self._names.top, *self._names.dies, *self._names.marks, *self._names.units.values()):
            self._extra.unique(name)

    def figures(self) -> Figures:
        plate, options = self._plate, self._options
        dies = tuple(self._die(number) for number in range(len(plate.dies)))
        marks, marks_done = self._marks()
        if options.notes == "polygons" and plate.notes:
            drawn = chain.from_iterable(map(_lettered, plate.notes))
            marks = (*marks, MarkFigures(self._extra.unique("NOTES"), {NOTE: tuple(drawn)}))
        used = [name for die in dies for grid in die.grids for name in grid.cells]
        cells = {name: self._cells[name] for name in dict.fromkeys(used)}
        notes = plate.notes if options.notes == "text" else ()
        figures = Figures(plate, options, self._names.top, cells, dies, marks, notes, {}, _NOTHING)
        counts = dict.fromkeys(cells, 0)
        for grid in (grid for die in dies for grid in die.grids):
            for name, count in zip(grid.cells, np.bincount(grid.index.ravel(), minlength=len(grid.cells)), strict=True):
                counts[name] += int(count)
        done = sum((self._done[name].times(count) for name, count in counts.items()), start=marks_done)
        if options.hierarchy == "merged":
            figures, done = _merged(figures)
        account = Account(
            polygons=done.polygons,
            vertices=done.vertices,
            definitions=len(cells) if options.hierarchy == "cells" else 0,
            references=_count_references(dies) if options.hierarchy == "cells" else 0,
            holed=done.holed,
            parted=done.parted,
            split=done.split,
            paired=tuple(self._paired),
            options=options,
            snapped=plate.snapped,
        )
        figures = replace(figures, account=account)
        _refuse_off_grid(figures)
        return self._told(figures) if CUT in figures.layers else figures

    def _told(self, figures: Figures) -> Figures:
        half = self._plate.blank_nm // 2
        layer, what = self._options.layer, "EXPOSED" if self._options.tone == "clear" else "CHROME"
        text = f"{what} = {layer.name} {layer.number}/{layer.datatype} MINUS {CUT.name} {CUT.number}/{CUT.datatype}"
        note = Note(text, (-half, -half + 2 * _NOTE_HEIGHT_NM))
        if self._options.notes == "text":
            return replace(figures, notes=(*figures.notes, note))
        # Without notes the layer's own name must do, and the account.
        drawn = MarkFigures(self._extra.unique("HOW_TO_EXPOSE"), {NOTE: _lettered(note)})
        return replace(figures, marks=(*figures.marks, drawn)) if self._options.notes == "polygons" else figures

    def _die(self, number: int) -> DieFigures:
        die, name = self._plate.dies[number], self._names.dies[number]
        panel, pitch = die.panel, die.panel.pitch_nm
        kinds = orientations_in_use(panel)
        units = []
        for kind in kinds:
            unit = self._names.units[unit_key(panel, kind)]
            units.append(unit)
            if unit not in self._cells:
                cell = db.Region(db.Box(0, 0, pitch, pitch))
                self._cells[unit], self._done[unit] = self._redrawn(unit_shapes(panel, kind), unit, cell)
        index = np.searchsorted(np.array(kinds), panel.orientations).astype(np.int64)
        most, needed = self._options.max_references, index.size if len(kinds) > 1 else 1
        grids: tuple[CellArray, ...] = (CellArray(tuple(units), index, (0, 0), (pitch, pitch)),)
        if self._options.hierarchy == "cells" and most is not None and needed > most:
            grids = self._in_pairs(units, index, pitch)
            needed = sum(grid.index.size for grid in grids)
            self._paired.append(die.name)
            if needed > most:
                what = f"the die {die.name} needs {needed} references even with two pixels in each; at most {most}"
                cure = 'Choose hierarchy = "flat", a smaller panel, or a house that allows more'
                raise OutputError("MF416", what, cure=cure)
        return DieFigures(name, die.origin_nm, die.box_nm, grids)

    def _in_pairs(self, units: Sequence[str], index: Ints, pitch: int) -> tuple[CellArray, ...]:
        cell_pairs = pairs(index)
        names = []
        for left, right in cell_pairs.kinds.tolist():
            one, other = self._cells[units[left]], self._cells[units[right]]
            stem = units[left].rpartition("_R")[0]
            name = self._extra.unique(stem, f"_P{units[left].rpartition('_R')[2]}{units[right].rpartition('_R')[2]}")
            names.append(name)
            self._cells[name] = {
                layer: (*one.get(layer, ()), *moved(other.get(layer, ()), (pitch, 0)))
                for layer in DRAWN_LAYERS
                if layer in one or layer in other
            }
            self._done[name] = self._done[units[left]] + self._done[units[right]]
        grids = [CellArray(tuple(names), cell_pairs.index, (0, 0), (2 * pitch, pitch))] if names else []
        if cell_pairs.rest.size:
            kinds, rest = np.unique(cell_pairs.rest, return_inverse=True)
            last = tuple(units[kind] for kind in kinds.tolist())
            place = (2 * pitch * cell_pairs.index.shape[1], 0)
            grids.append(CellArray(last, rest.reshape(cell_pairs.rest.shape).astype(np.int64), place, (pitch, pitch)))
        return tuple(grids)

    def _marks(self) -> tuple[tuple[MarkFigures, ...], _Done]:
        marks, done = [], _Done()
        for mark, name in zip(self._plate.marks, self._names.marks, strict=True):
            if mark.layer.written and self._options.tone == "dark":
                continue
            own = {mark.layer: mark.polygons}
            shapes, did = self._redrawn(own, name)
            if CUT in shapes and self._cuts_others(mark.name, shapes[CUT]):
                shapes, did = self._redrawn(own, name, options=_without_cut(self._options))
            marks.append(MarkFigures(name, shapes))
            done += did
        if self._options.tone == "dark":
            name = self._extra.unique("FIELD")
            shapes, did = self._field(name)
            marks.append(MarkFigures(name, shapes))
            done += did
        return tuple(marks), done

    def _field(self, name: str) -> tuple[Shapes, _Done]:
        """Chrome between the dies, out of which the marks are taken.

        No cut through slanted edges is exact, so round letters and stars it is drawn as triangles. Its holes are dies
        and those triangles, so none may go on :data:`CUT`, which would be subtracted from their chrome too.
        """
        marks = [drawn_region(mark.polygons) for mark in self._plate.marks if mark.layer.written]
        half = self._plate.writable_nm // 2
        field = db.Region(db.Box(-half, -half, half, half))
        field -= db.Region([db.Box(*die.box_nm) for die in self._plate.dies])
        round_slants = _round_slants(self._plate) & field
        clear = sum(marks, start=db.Region())
        drawn = _checked(field - round_slants - clear, _without_cut(self._options), name)
        corners = triangles(round_slants - clear)
        shapes = {CHROME: _sorted(drawn.pieces + corners)}
        return shapes, _Done.of(drawn) + _Done(corners.count(), 3 * corners.count())

    def _cuts_others(self, own: str, holes: tuple[Polygon, ...]) -> bool:
        """Whether something written, which is not of the mark itself, lies in its holes."""
        marks = (mark for mark in self._plate.marks if mark.layer.written and mark.name != own)
        others = drawn_region(polygon for mark in marks for polygon in mark.polygons)
        others.insert(db.Region([db.Box(*die.box_nm) for die in self._plate.dies]))
        return not (drawn_region(holes) & others).is_empty()

    def _redrawn(
        self, shapes: Shapes, where: str, whole: db.Region | None = None, options: PolygonOptions | None = None
    ) -> tuple[Shapes, _Done]:
        """The shapes of a cell under the options, and what that took; layers for orientation stay as they are.

        ``whole`` is the cell, of which dark data show what is not clear; ``options`` take the place of the plate's.
        """
        chosen = options or self._options
        dark = self._options.tone == "dark" and whole is not None
        if dark:
            shapes = {CLEAR: (), **shapes}
        redrawn: dict[Layer, tuple[Polygon, ...]] = {}
        done = _Done()
        for layer, polygons in shapes.items():
            if not layer.written:
                redrawn[layer] = polygons
                continue
            region = drawn_region(polygons)
            if dark:
                region = whole - region
            parted = region.merged(True, 1)
            long = any(len(polygon) > self._options.max_vertices for polygon in polygons)
            if not self._options.redrawn and not long:
                # Parted outlines are counted on what the outlines were made of, before they were cut.
                counted = recut(parted)
                redrawn[layer] = polygons
                done += _Done(len(polygons), sum(map(len, polygons)), counted.holed, counted.parted, 0)
                continue
            drawn = _checked(parted, chosen, where)
            redrawn[CHROME if dark else layer] = _sorted(drawn.pieces)
            if not drawn.holes.is_empty():
                redrawn[CUT] = _sorted(drawn.holes)
            done += _Done.of(drawn)
        return redrawn, done


@dataclass(frozen=True)
class _Done:
    """Sums of an account."""

    polygons: int = 0
    vertices: int = 0
    holed: int = 0
    parted: int = 0
    split: int = 0

    @classmethod
    def of(cls, drawn: Recut) -> _Done:
        return cls(drawn.polygons, drawn.vertices, drawn.holed, drawn.parted, drawn.split)

    def __add__(self, other: _Done) -> _Done:
        return _Done(*(one + two for one, two in zip(self._all, other._all, strict=True)))

    def times(self, count: int) -> _Done:
        return _Done(*(one * count for one in self._all))

    @property
    def _all(self) -> tuple[int, ...]:
        return self.polygons, self.vertices, self.holed, self.parted, self.split


_NOTHING = Account(0, 0, 0, 0, 0, 0, 0, (), PolygonOptions())


def moved(polygons: Sequence[Polygon], by_nm: Point) -> tuple[Polygon, ...]:
    """The polygons, displaced."""
    dx, dy = by_nm
    return tuple(tuple((x + dx, y + dy) for x, y in polygon) for polygon in polygons)


def _merged(figures: Figures) -> tuple[Figures, _Done]:
    """Written layers joined across pixels and marks, and what that took."""
    layout = replace(figures, options=replace(figures.options, hierarchy="cells", bias_nm=None)).layout()
    layer = figures.options.layer
    written = db.Region(layout.top_cell().begin_shapes_rec(layout.layer(layer_info(layer))))
    cut = layout.find_layer(layer_info(CUT))
    if cut is not None:
        written = written.merged() - db.Region(layout.top_cell().begin_shapes_rec(cut))
    if figures.options.bias_nm:
        written = _biased(written, figures, figures.options.bias_nm)
    # As between dies that are not merged, chrome round slanted edges is drawn as triangles; but triangles would lie in
    # the holes of what surrounds them, and holes with a layer of their own need no cut through a slanted edge.
    parted = figures.options.tone == "dark" and figures.options.holes != "layer"
    slants = _round_slants(figures.plate) if parted else db.Region()
    drawn = _checked(written - slants, figures.options, figures.top)
    corners = triangles(written & slants)
    merged = {layer: drawn.pieces + corners}
    if not drawn.holes.is_empty():
        merged[CUT] = drawn.holes
    cells = {name: _unwritten(shapes) for name, shapes in figures.cells.items()}
    marks = tuple(MarkFigures(mark.name, _unwritten(mark.shapes)) for mark in figures.marks)
    return replace(figures, cells=cells, marks=marks, merged=merged), _Done.of(drawn) + _Done(
        corners.count(), 3 * corners.count()
    )


def _round_slants(plate: Plate) -> db.Region:
    """Boxes of written marks with slanted edges."""
    marks = (drawn_region(mark.polygons) for mark in plate.marks if mark.layer.written)
    return db.Region([mark.bbox() for mark in marks if not mark.non_rectilinear().is_empty()])


def _biased(written: db.Region, figures: Figures, bias_nm: int) -> db.Region:
    """Written shapes as data out of which the bias is taken; dark data are what that leaves of the writable area."""
    plate, half = figures.plate, figures.plate.writable_nm // 2
    if figures.options.tone == "clear":
        return biased_data(written, plate, bias_nm)
    whole = db.Region(db.Box(-half, -half, half, half))
    return whole - biased_data(whole - written, plate, bias_nm)


def _refuse_off_grid(figures: Figures) -> None:
    """Refuse (MF413) what drawing has put off the data grid, such as a cut through slanted edges."""
    grid = 1 if figures.plate.snapped is None else figures.plate.snapped.grid_nm
    if grid == 1:
        return
    drawn = [*figures.cells.items(), *((mark.name, mark.shapes) for mark in figures.marks)]
    drawn += [
        (figures.top, {layer: tuple(map(hull_points, region.each()))}) for layer, region in figures.merged.items()
    ]
    for name, shapes in drawn:
        for layer, polygons in shapes.items():
            off = (point for polygon in polygons for point in polygon if point[0] % grid or point[1] % grid)
            if layer.written and (point := next(off, None)) is not None:
                what = f"{name} has a vertex at {point} nm, off the data grid of {grid} nm, where an outline is cut"
                cure = 'Use a finer export.grid, or holes = "bisect" and max_vertices = 4094'
                raise OutputError("MF413", what, cure=cure)


def _without_cut(options: PolygonOptions) -> PolygonOptions:
    return replace(options, holes="bisect") if options.holes == "layer" else options


def _unwritten(shapes: Shapes) -> Shapes:
    return {layer: polygons for layer, polygons in shapes.items() if not layer.written}


def _checked(region: db.Region, options: PolygonOptions, where: str) -> Recut:
    """The region redrawn, or a refusal if that is not possible on the grid."""
    drawn = recut(region, options.holes, options.corners, options.max_vertices)
    slanted = not drawn.pieces.non_rectilinear().is_empty()
    if drawn.longest > options.max_vertices or (slanted and not exact(region, drawn)):
        cure = 'Choose another holes or a larger max_vertices; "bisect" and 4094 suit most houses'
        raise OutputError("MF413", f"{where} has slanted edges that no cut on the 1 nm grid parts exactly", cure=cure)
    return drawn


def _sorted(region: db.Region) -> tuple[Polygon, ...]:
    return tuple(sorted(map(hull_points, region.each()), key=lambda polygon: [(y, x) for x, y in polygon]))


def _lettered(note: Note) -> tuple[Polygon, ...]:
    """The note as polygons; what the font lacks is shown as a question mark."""
    text = "".join(letter if " " <= letter <= "~" else "?" for letter in " ".join(note.text.split()))
    return text_polygons(text, _NOTE_HEIGHT_NM, note.position_nm)


def _draw(cell: db.Cell, shapes: Shapes, layers: Mapping[Layer, int]) -> None:
    for layer, polygons in shapes.items():
        insert_polygons(cell.shapes(layers[layer]), polygons)


def _count_references(dies: Sequence[DieFigures]) -> int:
    return sum(grid.index.size if len(grid.cells) > 1 else 1 for die in dies for grid in die.grids)


class Placeholder(NamedTuple):
    """Where a number goes: a coordinate, or the next serial number."""

    axis: Literal["x", "y", "serial"]
    value_nm: int


class Pen(ABC):
    """Writer of a polygon in one text format."""

    @abstractmethod
    def outline(self, polygon: Polygon) -> tuple[str, Sequence[Placeholder]]:
        """Text of a polygon with ``%s`` for every number, and what goes there."""

    def number(self, nm: int) -> str:
        """A coordinate; whole nanometres unless a format has others."""
        return str(nm)

    def serial(self) -> str:
        """The next serial number, of a format whose polygons have any."""
        raise NotImplementedError


def polygon_lines(figures: Figures, layer: Layer, pen: Pen, die: DieFigures | None = None) -> Iterator[str]:
    """The text of everything on a layer, in pieces of about one cell; of one die, if it is given, without marks."""
    for drawn in figures.dies if die is None else (die,):
        for grid in drawn.grids:
            yield from _grid(figures, layer, pen, drawn.origin_nm, grid)
    if die is not None:
        return
    for mark in figures.marks:
        for polygon in mark.shapes.get(layer, ()):
            yield _filled(pen, polygon)
    if layer in figures.merged:
        for piece in figures.merged[layer].each():
            yield _filled(pen, hull_points(piece))


def _filled(pen: Pen, polygon: Polygon) -> str:
    """The text of one polygon where it is drawn."""
    text, gaps = pen.outline(polygon)
    return text % tuple(pen.serial() if gap.axis == "serial" else pen.number(gap.value_nm) for gap in gaps)


@dataclass(frozen=True, eq=False)
class _Form:
    """A cell's text with gaps, their positions by axis, and the numbers for the cell at the origin."""

    text: str
    size: int
    at: dict[str, list[int]]
    values: dict[str, list[int]]


def _form(pen: Pen, polygons: Sequence[Polygon]) -> _Form:
    texts: list[str] = []
    gaps: list[Placeholder] = []
    for polygon in polygons:
        text, new = pen.outline(polygon)
        texts.append(text)
        gaps.extend(new)
    at: dict[str, list[int]] = {"x": [], "y": [], "serial": []}
    values: dict[str, list[int]] = {"x": [], "y": [], "serial": []}
    for place, gap in enumerate(gaps):
        at[gap.axis].append(place)
        values[gap.axis].append(gap.value_nm)
    return _Form("".join(texts), len(gaps), at, values)


def _grid(figures: Figures, layer: Layer, pen: Pen, origin_nm: Point, grid: CellArray) -> Iterator[str]:
    forms = [_form(pen, figures.cells[name].get(layer, ())) for name in grid.cells]
    x0, y0 = origin_nm[0] + grid.origin_nm[0], origin_nm[1] + grid.origin_nm[1]
    dx, dy = grid.step_nm
    columns: dict[tuple[int, int], list[str]] = {}
    for row, kinds in enumerate(grid.index.tolist()):
        rows: dict[int, list[str]] = {}
        for column, kind in enumerate(kinds):
            form = forms[kind]
            if not form.size:
                continue
            if kind not in rows:
                rows[kind] = [pen.number(value + y0 + row * dy) for value in form.values["y"]]
            if (column, kind) not in columns:
                columns[column, kind] = [pen.number(value + x0 + column * dx) for value in form.values["x"]]
            numbers = np.empty(form.size, dtype=object)
            numbers[form.at["x"]] = columns[column, kind]
            numbers[form.at["y"]] = rows[kind]
            if form.at["serial"]:
                numbers[form.at["serial"]] = [pen.serial() for _ in form.at["serial"]]
            yield form.text % tuple(numbers)
