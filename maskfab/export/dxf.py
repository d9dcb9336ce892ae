"""DXF files, R12 and R2010; one drawing unit is one micrometre.

The drawing is made by ezdxf. Only the references inside random dies, tens of thousands that would take it seconds,
are formatted here and spliced into the blocks that ezdxf left empty.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import ezdxf
from ezdxf.document import Drawing
from ezdxf.layouts import BaseLayout

from maskfab.geometry.region import orientations_in_use, plate_names
from maskfab.geometry.unit import unit_key, unit_shapes
from maskfab.model import CLEAR, LAYERS, NOTE, Die, Layer, Note, Plate, Polygon
from maskfab.units import NM_PER_UM

Version: TypeAlias = Literal["R12", "R2010"]

_MICRONS = 13
_METRIC = 1
_TEXT_HEIGHT_UM = 500.0
_COLOURS = dict(zip(LAYERS, (4, 8, 2, 1, 3, 5, 6, 30, 140, 9, 251), strict=True))
_REFERENCE = {
    "R12": "  0\nINSERT\n  5\n{handle:X}\n  8\n{layer}\n  2\n{name}\n 10\n{x}\n 20\n{y}\n 30\n0.0\n",
    "R2010": "  0\nINSERT\n  5\n{handle:X}\n330\n{owner}\n100\nAcDbEntity\n  8\n{layer}\n"
    "100\nAcDbBlockReference\n  2\n{name}\n 10\n{x}\n 20\n{y}\n 30\n0.0\n",
}


def write_dxf(plate: Plate, path: Path, version: Version, comments: Sequence[str] = ()) -> None:
    """Write a plate as DXF, byte-identical between runs.

    Unit cells and dies are blocks under the names of :func:`maskfab.geometry.region.plate_names`; no reference is
    mirrored, turned or scaled. A periodic die is one INSERT with rows and columns. Outlines are closed polylines
    without width, marks stand in model space, notes are TEXT.

    Args:
        plate: what to draw.
        path: the file to write.
        version: R12 carries no unit, so a comment and a note name it; R2010 also says $INSUNITS = 13, microns.
        comments: lines put at the top of the file (group code 999).
    """
    with _fixed_dates():
        drawing = _blank_drawing(version)
        random_dies = list(_draw(plate, drawing))
        reserved = _reserve_handles(drawing, sum(each.die.panel.orientations.size for each in random_dies))
        stream = io.StringIO()
        drawing.write(stream)
    text = stream.getvalue()
    head = "".join(f"999\n{_one_line(line)}\n" for line in ("Units: 1 drawing unit = 1 micrometre", *comments))
    with path.open("w", encoding=drawing.output_encoding, errors="dxfreplace", newline="\n") as file:
        file.write(head)
        done = 0
        for random_die in random_dies:
            start = text.index(f"\n  2\n{random_die.block}\n", text.index("\nBLOCKS\n"))
            end = text.index("  0\nENDBLK\n", start)
            file.write(text[done:end])
            file.writelines(random_die.references(version, reserved))
            done = end
        file.write(text[done:])


@dataclass(frozen=True)
class _RandomDie:
    """A die whose block is still empty.

    Attributes:
        block: name of the die's block.
        owner: handle of its block record.
        units: name of the block of each orientation.
    """

    die: Die
    block: str
    owner: str
    units: dict[int, str]

    def references(self, version: Version, handles: Iterator[int]) -> Iterator[str]:
        """One INSERT record for each cell."""
        form, pitch = _REFERENCE[version], self.die.panel.pitch_nm
        for row, orientations in enumerate(self.die.panel.orientations.tolist()):
            for column, orientation in enumerate(orientations):
                yield form.format(
                    handle=next(handles),
                    owner=self.owner,
                    layer=CLEAR.name,
                    name=self.units[orientation],
                    x=column * pitch / NM_PER_UM,
                    y=row * pitch / NM_PER_UM,
                )


def _blank_drawing(version: Version) -> Drawing:
    # Not ezdxf.new(), which warns on stderr that R12 has no units whatever is asked of it.
    drawing = Drawing.new(version)
    drawing.header["$MEASUREMENT"] = _METRIC
    if version != "R12":
        drawing.units = _MICRONS
    for layer in LAYERS:
        drawing.layers.add(layer.name, color=_COLOURS[layer])
    return drawing


def _draw(plate: Plate, drawing: Drawing) -> Iterator[_RandomDie]:
    """Draw all but the references of random dies; these dies are handed back."""
    names, space = plate_names(plate), drawing.modelspace()
    on_clear = {"layer": CLEAR.name}
    for die, name in zip(plate.dies, names.dies, strict=True):
        panel, units = die.panel, {}
        for orientation in orientations_in_use(panel):
            unit = units[orientation] = names.units[unit_key(panel, orientation)]
            if unit not in drawing.blocks:
                unit_block = drawing.blocks.new(unit)
                for layer, polygons in unit_shapes(panel, orientation).items():
                    _add_polygons(unit_block, polygons, layer)
        block = drawing.blocks.new(name)
        if len(units) == 1:
            (unit,) = units.values()
            rows, columns = panel.orientations.shape
            pitch = panel.pitch_nm / NM_PER_UM
            grid = {"row_count": rows, "column_count": columns, "row_spacing": pitch, "column_spacing": pitch}
            block.add_blockref(unit, (0, 0), dxfattribs=on_clear | grid)
        else:
            yield _RandomDie(die, name, block.block_record_handle, units)
        space.add_blockref(name, _um(die.origin_nm), dxfattribs=on_clear)
    for mark in plate.furniture:
        _add_polygons(space, mark.polygons, mark.layer)
    half = plate.blank_nm // 2
    unit_note = Note("UNITS: 1 DRAWING UNIT = 1 MICROMETRE", (-half, -half))
    for note in (unit_note, *plate.notes):
        place = {"layer": NOTE.name, "insert": _um(note.position_nm)}
        space.add_text(_one_line(note.text), height=_TEXT_HEIGHT_UM, dxfattribs=place)
    space.reset_extents((*_um((-half, -half)), 0.0), (*_um((half, half)), 0.0))
    space.reset_limits(_um((-half, -half)), _um((half, half)))


def _add_polygons(space: BaseLayout, polygons: tuple[Polygon, ...], layer: Layer) -> None:
    # Only R12 lacks the light-weight polyline.
    add = space.add_polyline2d if space.dxfversion == "AC1009" else space.add_lwpolyline
    for polygon in polygons:
        add([_um(point) for point in polygon], close=True, dxfattribs={"layer": layer.name})


def _one_line(text: str) -> str:
    """The text without the line breaks that would end its group."""
    return " ".join(text.split())


def _um(point_nm: tuple[int, int]) -> tuple[float, float]:
    return point_nm[0] / NM_PER_UM, point_nm[1] / NM_PER_UM


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
