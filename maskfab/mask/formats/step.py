"""STEP files (AP214, millimetres) of dies and plates, byte-identical between runs, and dies as objects of modellers.

The film of each opening is one solid, cut out of a box; every orientation in use is an assembly that holds it under a
rigid placement, and the die holds those, once for each cell. Nothing is copied, and nothing that is not used is
defined, for a part without a use would become a second root. Colours are added as text: the library's own writer
numbers them in the order of addresses in memory, which differs between runs.

Read back by OCP in a process of its own (:mod:`maskfab.mask.formats.step_process`): a file whose references were
damaged can end the process that reads it, and what OCP took of memory it keeps. An assembly of cadquery and a scene of
trimesh, both in millimetres, are for those who go on with a die.
"""

from __future__ import annotations

import colorsys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maskfab.base import __version__
from maskfab.base.arrays import Floats
from maskfab.base.errors import OutputError
from maskfab.base.files import partial
from maskfab.base.model import ORIENTATIONS, Die, Panel, Plate, Quantity
from maskfab.base.processes import quiet
from maskfab.base.units import MM_PER_NM
from maskfab.mask.formats import solid
from maskfab.mask.formats.format import Format, Stack
from maskfab.mask.formats.solid_check import NM, OCP, check_file, check_reach, step_rows
from maskfab.mask.formats.step_process import Parts
from maskfab.mask.sandbox import PATIENCE_S, read_apart

if TYPE_CHECKING:
    import cadquery
    import trimesh


_END = b"ENDSEC;\nEND-ISO-10303-21;"
_TAIL = 200
_BYTES_PER_SECOND = 1e5


@dataclass(frozen=True)
class Shade:
    """A colour: red, green and blue, 0 to 1."""

    rgb: tuple[float, float, float]
    transparency: float = 0.0


def add_colours(path: Path, model: Any, shades: Mapping[str, Shade]) -> None:
    """Give every solid of a file that the library has written the colour of its product; others get none."""
    lines, number = [], model.NbEntities()
    for name, solids, context in _parts(model):
        if name not in shades:
            continue
        shade = shades[name]
        styled = [number + 2 + n for n in range(len(solids))]
        lines.append(
            f"#{number + 1} = MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('',"
            f"({','.join(f'#{item}' for item in styled)}),#{context});"
        )
        first = number + 2 + len(solids)
        lines += [f"#{n} = STYLED_ITEM('colour',(#{first}),#{solid});" for n, solid in zip(styled, solids, strict=True)]
        style = list(_style(first, shade))
        lines += style
        number = first + len(style) - 1
    with path.open("r+b") as file:
        size = file.seek(0, 2)
        start = max(0, size - _TAIL)
        file.seek(start)
        end = file.read().rindex(_END)
        file.seek(start + end)
        file.write(("\n".join(lines) + "\n").encode() + _END + b"\n")


def _style(n: int, shade: Shade) -> Iterator[str]:
    red, green, blue = shade.rgb
    yield f"#{n} = PRESENTATION_STYLE_ASSIGNMENT((#{n + 1}));"
    yield f"#{n + 1} = SURFACE_STYLE_USAGE(.BOTH.,#{n + 2});"
    more = f",#{n + 6}" if shade.transparency else ""
    yield f"#{n + 2} = SURFACE_SIDE_STYLE('',(#{n + 3}{more}));"
    yield f"#{n + 3} = SURFACE_STYLE_FILL_AREA(#{n + 4});"
    yield f"#{n + 4} = FILL_AREA_STYLE('',(#{n + 5}));"
    yield f"#{n + 5} = FILL_AREA_STYLE_COLOUR('',#{n + (8 if more else 6)});"
    if more:
        yield f"#{n + 6} = SURFACE_STYLE_RENDERING_WITH_PROPERTIES(.NORMAL_SHADING.,#{n + 8},(#{n + 7}));"
        yield f"#{n + 7} = SURFACE_STYLE_TRANSPARENT({shade.transparency:.6f});"
    yield f"#{n + (8 if more else 6)} = COLOUR_RGB('',{red:.6f},{green:.6f},{blue:.6f});"


def _parts(model: Any) -> Iterator[tuple[str, list[int], int]]:
    """Product name, numbers of the solids and number of their context, for every product with solids."""
    from OCP.StepShape import StepShape_ManifoldSolidBrep, StepShape_ShapeDefinitionRepresentation

    entities = [model.Value(n) for n in range(1, model.NbEntities() + 1)]
    # One Python object stands for one entity as long as it lives, so identity tells its number.
    number = {id(entity): n for n, entity in enumerate(entities, 1)}
    for entity in entities:
        if not isinstance(entity, StepShape_ShapeDefinitionRepresentation):
            continue
        shape = entity.UsedRepresentation()
        items = [shape.ItemsValue(n) for n in range(1, shape.NbItems() + 1)]
        solids = [number[id(item)] for item in items if isinstance(item, StepShape_ManifoldSolidBrep)]
        if solids:
            product = entity.Definition().PropertyDefinition().Definition().ProductDefinition()
            yield product.Formation().OfProduct().Name().ToCString(), solids, number[id(shape.ContextOfItems())]


_CHROME = Shade(solid.CHROME_RGB)
_GLASS = Shade(solid.GLASS_RGB, transparency=1 - solid.GLASS_ALPHA)


def write_step(
    die: Die,
    path: Path,
    comments: Sequence[str] = (),
    stack: Stack | None = None,
    *,
    most_vertices: int = solid.MOST_CAD_VERTICES,
    most_cells: int = solid.MOST_CAD_CELLS,
) -> None:
    """Write a die: glass and chrome film, the centre of the die's slot the origin, one instance for each cell.

    Args:
        most_vertices: of all outlines of the openings in use, as the cut takes 0.5 s for 230, 8 s for 2200.
        most_cells: of the panel, as a thousand take 0.6 s and 0.65 MB.

    Raises:
        OutputError: MF401 if the file cannot be written; MF410 or MF412 as
            :func:`maskfab.mask.formats.solid.check_solid_size`.
    """
    stack = stack or Stack()
    solid.check_solid_size(die, "step", most_vertices, most_cells)
    panel = die.panel
    with quiet():
        assembly = _Assembly(die.name)
        low, high = solid.glass(die, stack)
        assembly.place(assembly.root, assembly.part(_box(high - low), f"{die.name}_GLASS", _GLASS), "GLASS", low)
        tiles = {}
        for opening in solid.openings_in_use(panel):
            name = f"{panel.openings[opening].name}_FILM{opening}"
            tiles[opening] = assembly.part(_film(panel, opening, stack), name, _CHROME)
        units = {}
        for cell, name in solid.unit_names(panel).items():
            units[cell] = assembly.group(f"{die.name}_{name}")
            turn = solid.rotation(cell % ORIENTATIONS)
            assembly.place(units[cell], tiles[cell // ORIENTATIONS], "FILM", np.zeros(3), turn)
        for name, cell, centre in solid.cells(die):
            assembly.place(assembly.root, units[cell], name, centre)
        assembly.write(path, (*comments, *stack.remarks()))


def write_plate_step(plate: Plate, path: Path, comments: Sequence[str] = (), stack: Stack | None = None) -> None:
    """Write a plate in outline: its blank, and each die as a box of the film's thickness in a colour of its own.

    The centre of the plate is the origin, and a die's box is placed by its own centre.
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
        return self._named(self._shapes.NewShape(), name)

    def place(self, parent: Any, child: Any, name: str, position_nm: Floats, turn: Floats | None = None) -> None:
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
                what = f"{path} cannot be written"
                raise OutputError("MF401", what, cure="Give --out a writable folder with room to spare")
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


def _box(size_nm: Floats, low_nm: Floats | None = None) -> Any:
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt

    low = np.zeros(3) if low_nm is None else low_nm * MM_PER_NM
    return BRepPrimAPI_MakeBox(gp_Pnt(*low.tolist()), gp_Pnt(*(low + size_nm * MM_PER_NM).tolist())).Shape()


def _film(panel: Panel, opening: int, stack: Stack) -> Any:
    """A box less the prisms of the openings; a prism of the film's face fails where holes touch by a corner."""
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
    for hole in solid.holes_nm(panel, opening):
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


_SOLID_CHROME, _SOLID_GLASS = (*solid.CHROME_RGB, 1.0), (*solid.GLASS_RGB, solid.GLASS_ALPHA)


def cadquery_assembly(die: Die, stack: Stack | None = None) -> cadquery.Assembly:
    """A die as an assembly: ``GLASS``, and the film of each cell, ``R0C0`` onwards, under its rigid placement."""
    stack = stack or Stack()
    solid.check_solid_size(die, "cadquery assembly", solid.MOST_CAD_VERTICES, solid.MOST_CAD_CELLS)
    import cadquery

    low, high = solid.glass(die, stack)
    whole = cadquery.Assembly(name=die.name)
    substrate = cadquery.Workplane(obj=cadquery.Shape.cast(_box(high - low)))
    whole.add(substrate, name="GLASS", loc=_location(low), color=cadquery.Color(*_SOLID_GLASS))
    films = {
        opening: cadquery.Shape.cast(_film(die.panel, opening, stack)) for opening in solid.openings_in_use(die.panel)
    }
    for name, cell, centre in solid.cells(die):
        opening, turn = divmod(cell, ORIENTATIONS)
        tile, place = cadquery.Workplane(obj=films[opening]), _location(centre, turn)
        whole.add(tile, name=name, loc=place, color=cadquery.Color(*_SOLID_CHROME))
    return whole


def trimesh_scene(die: Die, stack: Stack | None = None) -> trimesh.Scene:
    """A die as a scene of two closed meshes, ``GLASS`` and ``FILM``: see :func:`maskfab.mask.formats.solid.film`.

    Raises:
        OutputError: MF410 or MF412 as :func:`maskfab.mask.formats.solid.check_mesh_size`; MF436 as
            :func:`maskfab.mask.formats.solid.film`.
    """
    stack = stack or Stack()
    solid.check_mesh_size(die, "trimesh scene")
    import trimesh

    scene = trimesh.Scene(base_frame=die.name)
    scene.units = "millimeters"
    for name, mesh, colour in (
        ("GLASS", solid.box_mesh(*solid.glass(die, stack)), _SOLID_GLASS),
        ("FILM", solid.film(die, stack)[0], _SOLID_CHROME),
    ):
        scene.add_geometry(_trimesh(mesh, colour), node_name=name, geom_name=name)
    return scene


def _location(place_nm: Floats, orientation: int = 0) -> cadquery.Location:
    import cadquery
    from OCP.gp import gp_Trsf

    to = gp_Trsf()
    to.SetValues(*np.column_stack([solid.rotation(orientation), place_nm * MM_PER_NM]).ravel().tolist())
    return cadquery.Location(to)


def _trimesh(mesh: solid.Mesh, colour: tuple[float, float, float, float]) -> trimesh.Trimesh:
    import trimesh

    made = trimesh.Trimesh(mesh.vertices_nm * MM_PER_NM, mesh.triangles, process=False)
    made.visual.face_colors = [round(255 * part) for part in colour]
    return made


def read_step(path: Path) -> Parts:
    """The parts of a file with one root, and where each is placed.

    Raises:
        SourceError: MF303 if the file cannot be read, has no solids or no root, or is not in millimetres; MF316 if it
            takes far longer than whole files do.
    """
    seconds = PATIENCE_S + path.stat().st_size / _BYTES_PER_SECOND
    read, placed = read_apart(path, Path(__file__).with_name("step_process.py"), kind=Parts, seconds=seconds)
    for shape in read.shapes:
        check_reach(path, shape.vertices_nm)
    check_reach(path, *(part.matrix for part in placed))
    return read, placed


def check_step(die: Die, path: Path, stack: Stack | None = None) -> tuple[Quantity, ...]:
    """Read a die's STEP file back and compare it with the design, see :func:`step_rows`."""
    check_file(path)
    return tuple(step_rows(die, path, stack or Stack(), read_step(path)[0]))


def check_plate_step(plate: Plate, path: Path) -> tuple[Quantity, ...]:
    """Read a plate's STEP file back: as many boxes as dies, under their names, where and as large as the dies are."""
    check_file(path)
    read, placed = read_step(path)
    dies = {die.name: die for die in plate.dies}
    boxes = [(name, item) for item in placed if (name := item.name) != "BLANK"]
    error = 0.0
    for name, item in boxes:
        if name in dies:
            corners = read.shapes[item.part].vertices_nm @ item.matrix[:3, :3].T + item.matrix[:3, 3]
            box = np.concatenate([corners.min(axis=0)[:2], corners.max(axis=0)[:2]])
            error = max(error, float(np.abs(box - dies[name].box_nm).max()))
    named = len({name for name, _ in boxes} & dies.keys())
    method = f"{path.name}, {OCP}"
    flaws = sum(not shape.sound for shape in read.shapes)
    counts = (
        Quantity("solid_dies", named, f"boxes under a die's name in {method}", limit=len(dies)),
        Quantity("solid_strangers", len(boxes) - named, f"boxes under no die's name in {method}", limit=0),
        Quantity("solid_flaws", flaws, f"solids that BRepCheck refuses in {method}", limit=0),
    )
    exact = (replace(item, passed=item.value == item.limit) for item in counts)
    corners_of = f"corners of the dies in {method}"
    return (*exact, Quantity("solid_position_error", error, corners_of, limit=NM, passed=error <= NM))


FORMATS = (
    Format(
        "step",
        "STEP",
        ".step",
        write_plate=lambda of, to: write_plate_step(of.plate, to, of.comments, of.settings.stack),
        write_die=lambda of, die, to: write_step(die, to, of.comments, of.settings.stack),
        compare_plate=lambda made, path: check_plate_step(made.plate, path),
        compare_die=lambda made, die, path: check_step(die, path, made.settings.stack),
        extra="solid",
        loads=("OCP",),
        reading="thread",
    ),
)
