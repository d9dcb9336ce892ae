"""STEP files (AP214, millimetres) of dies and plates, byte-identical between runs.

The film of each opening is one solid, cut out of a box; every orientation in use is an assembly that holds it under a
rigid placement, and the die holds those, once for each cell. Nothing is copied, and nothing that is not used is
defined, for a part without a use would become a second root.
"""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.errors import OutputError
from maskfab.export.solid.step_colours import Shade, add_colours
from maskfab.export.solid.tiles import (
    CHROME_RGB,
    GLASS_ALPHA,
    GLASS_RGB,
    MOST_CAD_CELLS,
    MOST_CAD_VERTICES,
    Stack,
    cells,
    check_solid_size,
    glass,
    holes_nm,
    openings_in_use,
    rotation,
    unit_names,
)
from maskfab.files.atomic import partial
from maskfab.files.silence_stdout import quiet
from maskfab.model import ORIENTATIONS, Die, Panel, Plate
from maskfab.units import MM_PER_NM

_CHROME = Shade(CHROME_RGB)
_GLASS = Shade(GLASS_RGB, transparency=1 - GLASS_ALPHA)


def write_step(
    die: Die,
    path: Path,
    comments: Sequence[str] = (),
    stack: Stack | None = None,
    *,
    most_vertices: int = MOST_CAD_VERTICES,
    most_cells: int = MOST_CAD_CELLS,
) -> None:
    """Write a die: glass and chrome film, the centre of the die's slot the origin, one instance for each cell.

    Args:
        die: what to write.
        path: the file.
        comments: lines for the header.
        stack: thicknesses; 100 nm of chrome on 2.3 mm of glass if None.
        most_vertices: of all outlines of the openings in use, as the cut takes 0.5 s for 230, 8 s for 2200.
        most_cells: of the panel, as a thousand take 0.6 s and 0.65 MB.

    Raises:
        OutputError: MF401 if the file cannot be written; MF410 or MF412 as
            :func:`maskfab.export.solid.tiles.check_solid_size`.
    """
    stack = stack or Stack()
    check_solid_size(die, "step", most_vertices, most_cells)
    panel = die.panel
    with quiet():
        assembly = _Assembly(die.name)
        low, high = glass(die, stack)
        assembly.place(assembly.root, assembly.part(_box(high - low), f"{die.name}_GLASS", _GLASS), "GLASS", low)
        tiles = {}
        for opening in openings_in_use(panel):
            name = f"{panel.openings[opening].name}_FILM{opening}"
            tiles[opening] = assembly.part(_film(panel, opening, stack), name, _CHROME)
        units = {}
        for cell, name in unit_names(panel).items():
            units[cell] = assembly.group(f"{die.name}_{name}")
            turn = rotation(cell % ORIENTATIONS)
            assembly.place(units[cell], tiles[cell // ORIENTATIONS], "FILM", np.zeros(3), turn)
        for name, cell, centre in cells(die):
            assembly.place(assembly.root, units[cell], name, centre)
        assembly.write(path, (*comments, *stack.remarks()))


def write_plate_step(plate: Plate, path: Path, comments: Sequence[str] = (), stack: Stack | None = None) -> None:
    """Write a plate in outline: its blank, and each die as a box of the film's thickness in a colour of its own.

    The centre of the plate is the origin, and a die's box is placed by its own centre.

    Raises:
        OutputError: MF401 if the file cannot be written.
    """
    stack = stack or Stack()
    with quiet():
        assembly = _Assembly(plate.name)
        side = plate.blank_nm
        blank = assembly.part(_box(np.array([side, side, stack.glass_nm])), f"{plate.name}_BLANK", _GLASS)
        low = np.array([-side / 2, -side / 2, -stack.film_nm / 2 - stack.glass_nm])
        assembly.place(assembly.root, blank, "BLANK", low)
        for n, die in enumerate(plate.dies):
            x0, y0, x1, y1 = die.box_nm
            size = np.array([x1 - x0, y1 - y0, stack.film_nm])
            shade = Shade(colorsys.hsv_to_rgb(n / len(plate.dies), 0.6, 0.9))
            part = assembly.part(_box(size, -size / 2), f"{die.name}_DIE", shade)
            assembly.place(assembly.root, part, die.name, np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0.0]))
        assembly.write(path, (*comments, *stack.remarks()))


class _Assembly:
    """An XDE document with one root; lengths in nanometres here, in millimetres there."""

    def __init__(self, name: str) -> None:
        from OCP.TCollection import TCollection_ExtendedString
        from OCP.TDocStd import TDocStd_Document
        from OCP.XCAFDoc import XCAFDoc_DocumentTool

        self._document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
        self._shapes = XCAFDoc_DocumentTool.ShapeTool_s(self._document.Main())
        self._shades: dict[str, Shade] = {}
        self._name = name
        self.root = self.group(name)

    def part(self, shape: Any, name: str, shade: Shade) -> Any:
        """A shape that can be placed; its name is unique."""
        self._shades[name] = shade
        return self._named(self._shapes.AddShape(shape, False), name)

    def group(self, name: str) -> Any:
        """An empty assembly."""
        return self._named(self._shapes.NewShape(), name)

    def place(
        self,
        parent: Any,
        child: Any,
        name: str,
        position_nm: NDArray[np.float64],
        turn: NDArray[np.float64] | None = None,
    ) -> None:
        """Put a part or an assembly into an assembly."""
        from OCP.gp import gp_Trsf, gp_Vec
        from OCP.TopLoc import TopLoc_Location

        to = gp_Trsf()
        position = (position_nm * MM_PER_NM).tolist()
        if turn is None:
            to.SetTranslation(gp_Vec(*position))
        else:
            to.SetValues(*(value for row, x in zip(turn.tolist(), position, strict=True) for value in (*row, x)))
        self._named(self._shapes.AddComponent(parent, child, TopLoc_Location(to)), name)

    def write(self, path: Path, comments: Sequence[str]) -> None:
        from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
        from OCP.IFSelect import IFSelect_ReturnStatus
        from OCP.Interface import Interface_HArray1OfHAsciiString, Interface_Static
        from OCP.STEPCAFControl import STEPCAFControl_Writer
        from OCP.STEPControl import STEPControl_StepModelType
        from OCP.TCollection import TCollection_HAsciiString
        from OCP.XSControl import XSControl_WorkSession

        self._shapes.UpdateAssemblies()
        writer = STEPCAFControl_Writer(XSControl_WorkSession(), False)
        # Curves on surfaces would double the file and say nothing new about planes.
        Interface_Static.SetIVal_s("write.surfacecurve.mode", 0)
        Interface_Static.SetCVal_s("write.step.unit", "MM")
        Interface_Static.SetCVal_s("write.step.schema", "AP214IS")
        writer.SetColorMode(False)
        writer.SetLayerMode(False)
        writer.SetPropsMode(False)
        writer.Transfer(self._document, STEPControl_StepModelType.STEPControl_AsIs)
        model = writer.ChangeWriter().Model()
        header = APIHeaderSection_MakeHeader(model)
        text = [_ascii(line) for line in comments] or [""]
        lines = Interface_HArray1OfHAsciiString(1, len(text))
        for n, line in enumerate(text, 1):
            lines.SetValue(n, TCollection_HAsciiString(line))
        header.SetDescription(lines)
        header.SetName(TCollection_HAsciiString(_ascii(self._name)))
        header.SetTimeStamp(TCollection_HAsciiString(""))
        header.SetAuthorValue(1, TCollection_HAsciiString(""))
        header.SetOrganizationValue(1, TCollection_HAsciiString(""))
        header.SetOriginatingSystem(TCollection_HAsciiString(f"maskfab {__version__}"))
        header.SetAuthorisation(TCollection_HAsciiString(""))
        _number_occurrences(model)
        with partial(path) as place:
            if writer.Write(str(place)) != IFSelect_ReturnStatus.IFSelect_RetDone:
                raise OutputError(
                    "MF401", f"{path} cannot be written", cure="Give --out a writable folder with room to spare"
                )
            add_colours(place, model, self._shades)

    @staticmethod
    def _named(label: Any, name: str) -> Any:
        from OCP.TCollection import TCollection_ExtendedString
        from OCP.TDataStd import TDataStd_Name

        TDataStd_Name.Set_s(label, TCollection_ExtendedString(name))
        return label


def _number_occurrences(model: Any) -> None:
    """The library counts occurrences through all files of a process; here each file counts from one."""
    from OCP.StepRepr import StepRepr_NextAssemblyUsageOccurrence
    from OCP.TCollection import TCollection_HAsciiString

    count = 0
    for n in range(1, model.NbEntities() + 1):
        entity = model.Value(n)
        if isinstance(entity, StepRepr_NextAssemblyUsageOccurrence):
            count += 1
            entity.SetId(TCollection_HAsciiString(str(count)))


def _ascii(text: str) -> str:
    """One line of printable ASCII, all that a STEP header can hold."""
    return " ".join(text.split()).encode("ascii", "replace").decode()


def _box(size_nm: NDArray[np.float64], low_nm: NDArray[np.float64] | None = None) -> Any:
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt

    low = np.zeros(3) if low_nm is None else low_nm * MM_PER_NM
    return BRepPrimAPI_MakeBox(gp_Pnt(*low.tolist()), gp_Pnt(*(low + size_nm * MM_PER_NM).tolist())).Shape()


def _film(panel: Panel, opening: int, stack: Stack) -> Any:
    """A box less the prisms of the openings.

    Not a prism of the film's face: where holes touch by a corner that passes every check, but not once it is read back.
    """
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakePolygon
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
    from OCP.gp import gp_Pnt, gp_Vec
    from OCP.TopTools import TopTools_ListOfShape

    pitch, thick = float(panel.pitch_nm), stack.film_nm
    size = np.array([pitch, pitch, thick])
    whole = _box(size, -size / 2)
    below, height = -thick * MM_PER_NM, 2 * thick * MM_PER_NM
    prisms = TopTools_ListOfShape()
    for hole in holes_nm(panel, opening):
        wire = BRepBuilderAPI_MakePolygon()
        for x, y in (hole * MM_PER_NM).tolist():
            wire.Add(gp_Pnt(x, y, below))
        wire.Close()
        face = BRepBuilderAPI_MakeFace(wire.Wire()).Face()
        prisms.Append(BRepPrimAPI_MakePrism(face, gp_Vec(0.0, 0.0, height)).Shape())
    if prisms.IsEmpty():
        return whole
    arguments = TopTools_ListOfShape()
    arguments.Append(whole)
    cut = BRepAlgoAPI_Cut()
    cut.SetArguments(arguments)
    cut.SetTools(prisms)
    cut.Build()
    return cut.Shape()
