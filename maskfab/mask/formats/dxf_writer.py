"""DXF written by ezdxf, R12 and R2010; one drawing unit is one micrometre, or one millimetre for houses that draw so.

The drawing is made by ezdxf. What there are tens of thousands of, which would take it seconds and gigabytes, is
formatted here: the vertices of R12, and spliced in, the references inside random dies, into blocks that ezdxf left
empty, and the polygons of a drawing without blocks.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import ezdxf
from ezdxf.document import Drawing
from ezdxf.entities.dxfgfx import DXFGraphic
from ezdxf.layouts import BaseLayout
from ezdxf.lldxf.tagwriter import AbstractTagWriter
from ezdxf.tools.handle import HandleGenerator

from maskfab.base.errors import OutputError
from maskfab.base.files import partial
from maskfab.base.model import CHROME, LAYERS, NOTE, Layer, Plate, Polygon
from maskfab.mask.figures import CUT, DieFigures, Figures, Pen, Placeholder, PolygonOptions, as_figures, polygon_lines
from maskfab.mask.formats.format import UNITS, DrawingStyle, Version
from maskfab.mask.layout import CellArray, check_file_size

LARGEST_BYTES = 1_000_000_000

_METRIC = 1
_R12 = "AC1009"
_TEXT_HEIGHT_NM = 500_000
_SMALL_TEXT_NM = 100_000
_COLOURS = dict(zip(LAYERS, (4, 8, 2, 1, 3, 5, 6, 30, 140, 40, 9, 251), strict=True)) | {CUT: 7, CHROME: 4}
_REFERENCE = {
    "R12": "  0\nINSERT\n  5\n{handle:X}\n  8\n{layer}\n  2\n{name}\n 10\n{x}\n 20\n{y}\n 30\n0.0\n",
    "R2010": "  0\nINSERT\n  5\n{handle:X}\n330\n{owner}\n100\nAcDbEntity\n  8\n{layer}\n"
    "100\nAcDbBlockReference\n  2\n{name}\n 10\n{x}\n 20\n{y}\n 30\n0.0\n",
}
_OUTLINE = "  0\nPOLYLINE\n  5\n{handle}\n  8\n{layer}\n 66\n1\n 10\n0.0\n 20\n0.0\n 30\n0.0\n 70\n1\n"
_VERTEX = "  0\nVERTEX\n  5\n{handle}\n  8\n{layer}\n 10\n{x}\n 20\n{y}\n 30\n0.0\n 70\n0\n"
_LIGHT = (
    "  0\nLWPOLYLINE\n  5\n{handle}\n330\n{owner}\n100\nAcDbEntity\n  8\n{layer}\n100\nAcDbPolyline\n"
    " 90\n{count}\n 70\n1\n"
)
_LIGHT_VERTEX = " 10\n%s\n 20\n%s\n"
_END = "  0\nSEQEND\n  5\n{handle}\n  8\n{layer}\n"
# Bytes of a polygon and of a vertex, coordinates of up to nine characters.
_OUTLINE_BYTES = {"R12": (80, 46), "R2010": (90, 28)}
_LAYER_NAME = re.compile(r"[A-Za-z0-9_$-]{1,31}")
_RESERVED_LAYERS = frozenset({"0", "DEFPOINTS"})


def write_dxf(
    source: Plate | Figures,
    path: Path,
    version: Version,
    comments: Sequence[str] = (),
    style: DrawingStyle | None = None,
    *,
    limit_bytes: int = LARGEST_BYTES,
) -> None:
    """Write a plate as DXF, byte-identical between runs.

    Unit cells and dies are blocks under the names of :func:`maskfab.mask.layout.plate_names`; no reference is
    mirrored, turned or scaled. A periodic die is one INSERT with rows and columns. Outlines are closed polylines
    without width, marks stand in model space, notes are TEXT. Figures that are flat or merged have no block at all. A
    layer with nothing on it is not in the file.

    Args:
        version: R12 carries no unit, so a comment and a note name it; R2010 also says it in $INSUNITS.
        comments: lines put at the top of the file (group code 999), before what the figures' account has to say.

    Raises:
        OutputError: MF401 if the file cannot be written, MF414 if a layer's name is 0, longer than 31 characters, not
            of A-Z, 0-9, _, $ and -, shared, or that of a block; MF415 if the file would be too large.
    """
    figures, style = as_figures(source), style or DrawingStyle()
    names = _checked_names(figures, style.layer_names, noted=version in style.unit_text or bool(figures.notes))
    flat = figures.options.hierarchy != "cells"
    if flat:
        check_file_size(
            flat_bytes(figures, version), limit_bytes, path, 'Choose hierarchy = "cells", or GDSII or OASIS'
        )
    with _fixed_dates():
        drawing = _blank_drawing(version, names, style)
        splices = list(_draw(figures, drawing, names, style, texted=version in style.unit_text))
        reserved = _reserve_handles(drawing, sum(splice.handles for splice in splices))
        # ezdxf would add these in the order of a set, which changes from one process to the next.
        kinds = {*drawing.entitydb.dxf_types_in_use(), *(["LWPOLYLINE"] if flat and version != "R12" else [])}
        for kind in sorted(kinds):
            drawing.classes.add_class(kind)
        stream = io.StringIO()
        drawing.write(stream)
    text = stream.getvalue()
    said = figures.account.lines() if figures.options != PolygonOptions() or figures.account.snapped else ()
    lines = (f"Units: 1 drawing unit = 1 {style.unit_name}", *comments, *said)
    head = "".join(f"999\n{_one_line(line)}\n" for line in lines)
    with (
        partial(path) as aside,
        aside.open("w", encoding=drawing.output_encoding, errors="dxfreplace", newline="\n") as file,
    ):
        file.write(head)
        done = 0
        for splice in splices:
            end = splice.place(text)
            file.write(text[done:end])
            file.writelines(splice.records(version, reserved))
            done = end
        file.write(text[done:])


def flat_bytes(figures: Figures, version: Version) -> int:
    """About how large a drawing without blocks becomes, from above; from the numbers of its written polygons."""
    outline, vertex = _OUTLINE_BYTES[version]
    return figures.account.polygons * outline + figures.account.vertices * vertex


@dataclass(frozen=True)
class _References:
    """A grid of references that is missing in its die's block."""

    grid: CellArray
    block: str
    owner: str
    layer: str
    style: DrawingStyle

    @property
    def handles(self) -> int:
        return int(self.grid.index.size)

    def place(self, text: str) -> int:
        start = text.index(f"\n  2\n{self.block}\n", text.index("\nBLOCKS\n"))
        return text.index("  0\nENDBLK\n", start)

    def records(self, version: Version, handles: Iterator[int]) -> Iterator[str]:
        form, (dx, dy), (x0, y0) = _REFERENCE[version], self.grid.step_nm, self.grid.origin_nm
        for row, kinds in enumerate(self.grid.index.tolist()):
            for column, kind in enumerate(kinds):
                yield form.format(
                    handle=next(handles),
                    owner=self.owner,
                    layer=self.layer,
                    name=self.grid.cells[kind],
                    x=self.style.length(x0 + column * dx),
                    y=self.style.length(y0 + row * dy),
                )


@dataclass(frozen=True)
class _Polygons:
    """Everything on the layers of a drawing without blocks."""

    figures: Figures
    owner: str
    names: Mapping[Layer, str]
    style: DrawingStyle

    @property
    def handles(self) -> int:
        figures, total = self.figures, 0
        for grid in (grid for die in figures.dies for grid in die.grids):
            sizes = [sum(len(shapes) for shapes in figures.cells[name].values()) for name in grid.cells]
            total += sum(sizes[kind] for kind in grid.index.ravel().tolist())
        total += sum(len(shapes) for mark in figures.marks for shapes in mark.shapes.values())
        return total + int(sum(region.count() for region in figures.merged.values()))

    def place(self, text: str) -> int:
        return text.index("  0\nENDSEC\n", text.index("\nENTITIES\n"))

    def records(self, version: Version, handles: Iterator[int]) -> Iterator[str]:
        for layer in self.figures.layers:
            if layer in self.names:
                yield from polygon_lines(
                    self.figures, layer, _Pen(version, self.names[layer], self.owner, handles, self.style)
                )


@dataclass(frozen=True)
class _Pen(Pen):
    """Writes closed polylines without width; only R12 lacks the light-weight ones, and needs no handles."""

    version: Version
    layer: str
    owner: str
    handles: Iterator[int]
    style: DrawingStyle

    def outline(self, polygon: Polygon) -> tuple[str, list[Placeholder]]:
        gaps = [gap for x, y in polygon for gap in (Placeholder("x", x), Placeholder("y", y))]
        if self.version == "R12":
            vertex = f"0\nVERTEX\n8\n{self.layer}\n10\n%s\n20\n%s\n"
            head = f"0\nPOLYLINE\n8\n{self.layer}\n66\n1\n10\n0.0\n20\n0.0\n30\n0.0\n70\n1\n"
            return f"{head}{vertex * len(polygon)}0\nSEQEND\n8\n{self.layer}\n", gaps
        head = f"0\nLWPOLYLINE\n5\n%s\n330\n{self.owner}\n100\nAcDbEntity\n8\n{self.layer}\n100\nAcDbPolyline\n"
        vertices = "10\n%s\n20\n%s\n" * len(polygon)
        return f"{head}90\n{len(polygon)}\n70\n1\n{vertices}", [Placeholder("serial", 0), *gaps]

    def number(self, nm: int) -> str:
        return repr(self.style.length(nm))

    def serial(self) -> str:
        return f"{next(self.handles):X}"


class _Outline(DXFGraphic):  # type: ignore[misc]
    """A closed polyline without width, written at once: R12 vertices as entities take a hundred times as long."""

    DXFTYPE = "POLYLINE"

    def __init__(self, points: Sequence[tuple[float, float]], layer: str, handles: HandleGenerator) -> None:
        super().__init__()
        self._points = points
        self._layer = layer
        self._handles = handles
        self._below: list[str] = []

    def post_bind_hook(self) -> None:
        """Take handles of its end and its vertices, which follow its own."""
        self._below = [self._handles.next() for _ in range(len(self._points) + 1)]

    def export_dxf(self, tagwriter: AbstractTagWriter) -> None:
        layer = self._layer
        tagwriter.write_str(_OUTLINE.format(handle=self.dxf.handle, layer=layer))
        # Layers have no name with a percent sign.
        vertex = _VERTEX.format(handle="%s", layer=layer, x="%s", y="%s")
        own = zip(self._below[1:], self._points, strict=True)
        tagwriter.write_str("".join([vertex % (handle, x, y) for handle, (x, y) in own]))
        tagwriter.write_str(_END.format(handle=self._below[0], layer=layer))


class _LightOutline(DXFGraphic):  # type: ignore[misc]
    """The light-weight polyline of later versions, which writes itself at once too: ezdxf's own packs every vertex."""

    DXFTYPE = "LWPOLYLINE"

    def __init__(self, points: Sequence[tuple[float, float]], layer: str) -> None:
        super().__init__()
        self._points = points
        self._layer = layer

    def export_dxf(self, tagwriter: AbstractTagWriter) -> None:
        own, count = self.dxf, len(self._points)
        head = _LIGHT.format(handle=own.handle, owner=own.owner, layer=self._layer, count=count)
        tagwriter.write_str(head + "".join([_LIGHT_VERTEX % point for point in self._points]))


def _checked_names(figures: Figures, wanted: Mapping[str, str] | None, *, noted: bool) -> dict[Layer, str]:
    """Names of the layers that are drawn; a house that wants its drawings purged gets no empty ones."""
    used = {figures.options.layer, *figures.layers, *([NOTE] if noted else [])}
    layers = [layer for layer in (*LAYERS, CUT, CHROME) if layer in used]
    if wanted is None:
        return {layer: layer.name for layer in layers}
    strange = sorted(set(wanted) - {layer.name for layer in (*LAYERS, CUT, CHROME)})
    if strange:
        raise OutputError("MF414", f"there is no layer {strange[0]!r} to name", cure="Name a layer of the plate")
    lacking = [layer.name for layer in figures.layers if layer.written and layer.name not in wanted]
    if lacking:
        what = f"the layer {lacking[0]} is written on the mask but has no name"
        raise OutputError("MF414", what, cure="Give that layer a name as well")
    names = {layer: wanted[layer.name] for layer in layers if layer.name in wanted}
    for name in names.values():
        if not _LAYER_NAME.fullmatch(name) or name.upper() in _RESERVED_LAYERS:
            cure = "Take 1 to 31 letters, digits, _, $ or -, and neither 0 nor DEFPOINTS"
            raise OutputError("MF414", f"{name!r} is not a valid DXF layer name", cure=cure)
    folded = [name.upper() for name in names.values()]
    blocks = {*figures.cells, *(die.name for die in figures.dies)} if figures.options.hierarchy == "cells" else set()
    for name in folded:
        if folded.count(name) > 1 or name in blocks:
            what = "another layer" if folded.count(name) > 1 else "a block"
            cure = "Choose a name that no other layer or block has"
            raise OutputError("MF414", f"the layer name {name!r} is also that of {what}", cure=cure)
    return names


def _blank_drawing(version: Version, names: Mapping[Layer, str], style: DrawingStyle) -> Drawing:
    # Not ezdxf.new(), which warns on stderr that R12 has no units whatever is asked of it.
    drawing = Drawing.new(version)
    drawing.header["$MEASUREMENT"] = _METRIC
    if version != "R12":
        drawing.units = UNITS[style.unit][2]
    for name in [layer.dxf.name for layer in drawing.layers if layer.dxf.name != "0"]:
        drawing.layers.remove(name)
    for layer, name in names.items():
        drawing.layers.add(name, color=_COLOURS[layer])
    return drawing


def _draw(
    figures: Figures, drawing: Drawing, names: Mapping[Layer, str], style: DrawingStyle, *, texted: bool
) -> Iterator[_References | _Polygons]:
    """Draw all but what there are very many of; that is handed back."""
    plate, space = figures.plate, drawing.modelspace()
    if figures.options.hierarchy == "cells":
        for die in figures.dies:
            yield from _draw_die(figures, die, drawing, names, style)
        for mark in figures.marks:
            _add_shapes(space, mark.shapes, names, style)
    else:
        yield _Polygons(figures, space.layout_key, names, style)
    half = plate.blank_nm // 2
    x0, y0, x1, y1 = style.frame_nm or (-half, -half, half, half)
    text, height, corner = f"UNITS: 1 DRAWING UNIT = 1 {style.unit_name.upper()}", _TEXT_HEIGHT_NM, (x0, y0)
    if style.frame_nm is not None:
        # Small, along the lower edge, where no mark stands; letters reach below their base line.
        height, corner = _SMALL_TEXT_NM, (x0 + _SMALL_TEXT_NM, y0 + _SMALL_TEXT_NM // 2)
    texts = [(text, height, corner)] if texted else []
    texts += [(note.text, _TEXT_HEIGHT_NM, note.position_nm) for note in figures.notes]
    for line, high, place in texts if NOTE in names else ():
        attributes = {"layer": names[NOTE], "insert": style.point(place)}
        space.add_text(_one_line(line), height=style.length(high), dxfattribs=attributes)
    low, far = style.point((x0, y0)), style.point((x1, y1))
    space.reset_extents((*low, 0.0), (*far, 0.0))
    space.reset_limits(low, far)


def _draw_die(
    figures: Figures, die: DieFigures, drawing: Drawing, names: Mapping[Layer, str], style: DrawingStyle
) -> Iterator[_References]:
    on_layer = {"layer": names[figures.options.layer]}
    for name in (name for grid in die.grids for name in grid.cells):
        if name not in drawing.blocks:
            _add_shapes(drawing.blocks.new(name), figures.cells[name], names, style)
    block = drawing.blocks.new(die.name)
    for grid in die.grids:
        if len(grid.cells) > 1:
            yield _References(grid, die.name, block.block_record_handle, names[figures.options.layer], style)
            continue
        rows, columns = grid.index.shape
        dx, dy = style.point(grid.step_nm)
        spread = {"row_count": rows, "column_count": columns, "row_spacing": dy, "column_spacing": dx}
        block.add_blockref(grid.cells[0], style.point(grid.origin_nm), dxfattribs=on_layer | spread)
    drawing.modelspace().add_blockref(die.name, style.point(die.origin_nm), dxfattribs=on_layer)


def _add_shapes(
    space: BaseLayout, shapes: Mapping[Layer, Sequence[Polygon]], names: Mapping[Layer, str], style: DrawingStyle
) -> None:
    handles, unit_nm = space.doc.entitydb.handles, UNITS[style.unit][0]
    for layer, polygons in shapes.items():
        if layer in names:
            for points in ([(x / unit_nm, y / unit_nm) for x, y in polygon] for polygon in polygons):
                if space.dxfversion == _R12:  # it lacks the light-weight polyline
                    space.add_entity(_Outline(points, names[layer], handles))
                else:
                    space.add_entity(_LightOutline(points, names[layer]))


def _one_line(text: str) -> str:
    """The text without the line breaks that would end its group."""
    return " ".join(text.split())


def _reserve_handles(drawing: Drawing, number: int) -> Iterator[int]:
    """That many entity handles which ezdxf will not give out itself."""
    handles = drawing.entitydb.handles
    first = int(str(handles), 16)
    handles.reset(f"{first + number:X}")
    return iter(range(first, first + number))


@contextmanager
def _fixed_dates() -> Iterator[None]:
    """ezdxf stamps every drawing with the time and two random identifiers unless this option is set."""
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before
