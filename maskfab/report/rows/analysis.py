"""The optics of anything: an opening in any form, or the geometry of any mask file."""

from __future__ import annotations

import math
import os
import re
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.cell_size import CellSize
from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import CLEAR, Die, Mtf, Opening, Panel, Plate, Psf, Quantity, Tiling
from maskfab.base.processes import release_memory
from maskfab.base.units import NM_PER_UM, to_nm
from maskfab.base.work import Progress, one_thread, silent
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.job.read import check_lens, check_optics, even_nm
from maskfab.job.sections import SceneSection
from maskfab.job.values import is_table
from maskfab.mask import opening_file
from maskfab.mask.formats.content import find_cell, find_layer
from maskfab.mask.formats.gdsii import write_oasis
from maskfab.mask.formats.table import MEASURED_SUFFIXES, read_layout
from maskfab.mask.layout import plate_layout, region
from maskfab.mask.limits import allow
from maskfab.mask.panels import check_light, check_panel_size
from maskfab.mask.raster import aperture_in_stop, edge_distances
from maskfab.mask.sandbox import bounded
from maskfab.optics import metrics
from maskfab.optics.field.polygons import Boundary
from maskfab.optics.psf import Leak, pixel_margin
from maskfab.optics.pupil import Aperture, Lattice, Pupil, cut
from maskfab.optics.response import curves_text
from maskfab.optics.scene.model_bar import bar_of_panel, bar_quantities, model_bar
from maskfab.optics.scene.plan import sampling_camera
from maskfab.optics.scene.scene import Scene
from maskfab.optics.stop_edges import edges_in_stop, stop_box
from maskfab.optics.tiling import orientations
from maskfab.report.rows.optics import (
    INVARIANT_LIMIT_ROUND,
    LitPupils,
    lit_pupils,
    measure,
    measure_pupils,
    read_openings,
    stop_boundary,
)
from maskfab.report.rows.scene import SceneOptics, measure_scene, scene_plan, scene_reach_um

_FINEST_GRID = 4000
_LARGEST_DOT_NM = 8000
_SECONDS_OF_OPTICS, _USUAL_STOP_UM = 60, 4000.0
_SHAPES_PER_SECOND = 4_000
_MEMORY_OF_OPTICS, _MEMORY_PER_SHAPE = 2_000_000_000, 4_000

MOST_SHAPES_SEEN = 3_000_000
"""Before the stop of a mask file; the optics of a million take a minute."""


@dataclass(frozen=True)
class Request:
    """Options for the analysis of a file.

    Attributes:
        camera: what looks through it.
        pitch_um, dot_um: the cell and its dots; where an opening does not state them itself.
        gutter_um: opaque space round every cell.
        tiling, seed: how an opening is laid out. For a layout file, a tiling says that it holds one opening.
        layer, cell: where in a layout file to look.
        unit_um: one unit of a DXF; what it says itself if None.
        scene, accuracy: what the camera looks at, and the admissible error of its PSF; None for the standard numbers
            alone.
        blank: what the plate is made of, as far as it is known.
    """

    camera: Camera
    pitch_um: float | None = None
    dot_um: float | None = None
    gutter_um: float = 0.0
    tiling: Tiling | None = None
    seed: int | None = None
    layer: str | None = None
    cell: str | None = None
    unit_um: float | None = None
    scene: Scene | None = None
    accuracy: float = 1e-3
    blank: MaskBlank = UNSTATED


@dataclass(frozen=True, eq=False)
class Analysis:
    """The numbers and curves of one file; ``quantities`` end with those of the scene, where one was asked for."""

    name: str
    psfs: tuple[Psf, ...]
    mtfs: tuple[Mtf, ...]
    quantities: tuple[Quantity, ...]
    scene: SceneOptics | None = None

    @property
    def passed(self) -> bool:
        return all(q.passed is not False for q in self.quantities)


def described_scene(section: SceneSection, where: str) -> Scene:
    """The scene of a section that did not come from a job; tables of curves are read from their paths.

    Raises:
        SourceError, JobError: for a table that is at fault.
    """
    named = [name for name in (section.spectrum, section.illuminant) if isinstance(name, str) and is_table(name)]
    return Scene.of(section, {name: curves_text(Path(name), where) for name in named}, where=where)


@one_thread
def analyse(path: str | Path, request: Request, progress: Progress = silent) -> Analysis:
    """PSF, MTF and invariants of an opening or a mask file.

    An opening is laid out over the stop, written, and read back, so that its numbers have the same meaning as those of
    a plate. A layout file is taken as it is, its bounding box centred on the optical axis, unless a tiling is given.

    Raises:
        SourceError, OpeningError, JobError: if the file or the request is at fault; MF313 and MF322 for a mask file
            of too many shapes, or that takes longer than one like it may.
    """
    check_lens(request.camera, where="--stop")
    path = Path(path)
    if request.unit_um is not None and path.suffix.lower() not in MEASURED_SUFFIXES:
        what = f"{path.name} has no unit that could be stated"
        raise JobError("MF105", what, where="--unit", cure="Leave out --unit: only a DXF has a drawing unit to state")
    if path.suffix.lower() in MEASURED_SUFFIXES and request.tiling is None:
        if request.scene is not None:
            what = f"a scene needs an opening and its tiling, which {path.name} does not state"
            cure = "If the file holds one opening, add --tiling, --dot and --pitch; else leave the scene out"
            raise JobError("MF105", what, where="--tiling", cure=cure)
        _check_finest(path, request)
        kind = tuple[str, tuple[Psf, ...], tuple[Mtf, ...], tuple[Quantity, ...]]
        return Analysis(*bounded(path, lambda tell: _analyse_mask(path, request, tell), progress, kind=kind))
    return analyse_opening(_load(path, request), request, progress)


@one_thread
def analyse_opening(opening: Opening, request: Request, progress: Progress = silent) -> Analysis:
    """Analysis of an opening that is already loaded; else as :func:`analyse`."""
    check_lens(request.camera, where="the request")
    dot_nm = opening.dot_nm if request.dot_um is None else to_nm(request.dot_um, where="--dot", name="dot")
    gutter_nm = _gutter_nm(request)
    if request.seed is not None and request.seed < 0:
        what = f"seed = {request.seed} is below 0"
        raise JobError("MF104", what, where="--seed", cure="Give a whole number of 0 or more, such as --seed 1")
    camera, scene = request.camera, None if request.scene is None else request.scene.through(request.blank)
    check_optics(camera, dot_nm / NM_PER_UM, where="the request")
    reach = camera.stop.diameter_um / 2
    if scene is not None:
        check_optics(sampling_camera(camera, scene), dot_nm / NM_PER_UM, where="the request: the ends of the spectrum")
        reach = scene_reach_um(camera, scene)
    pitch_nm = CellSize(opening.dots, dot_nm, gutter_nm).pitch_nm
    cells = 2 * math.ceil(reach * NM_PER_UM / pitch_nm)
    check_panel_size(cells, opening.dots, "the panel over the stop", where="the request")
    tiling = request.tiling or Tiling.PERIODIC
    panel = Panel(
        opening,
        dot_nm,
        gutter_nm,
        orientations(tiling, cells, cells, request.seed, where="--seed"),
        tiling,
        request.seed,
    )
    check_light(panel, camera.stop, where="the request: stop.diameter")
    die = Die(opening.name, opening.name, panel, (0, 0), cells * pitch_nm)
    plan = None if scene is None else scene_plan(die, camera, scene, request.accuracy, "the request")
    plate = Plate(opening.name, "", cells * pitch_nm, cells * pitch_nm, (die,), (), (), ())
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "panel.oas"
        write_oasis(plate_layout(plate), file)
        read = region(read_layout(file), CLEAR)
    progress("optics", 0, 1)
    result = measure(die, camera, read, request.blank)
    progress("optics", 1, 1)
    bar = bar_of_panel(panel, camera, request.blank, None)
    standard = (*result.quantities, *bar)
    if scene is None or plan is None:
        return Analysis(opening.name, result.psfs, result.mtfs, standard)
    progress("scene", 0, 1)
    seen = measure_scene(die, camera, scene, read_openings(die, read, reach), plan, request.blank)
    progress("scene", 1, 1)
    return Analysis(opening.name, result.psfs, result.mtfs, (*standard, *seen.quantities), seen)


def _check_finest(path: Path, request: Request) -> None:
    """Refuse before anything is read what no grid over the file's polygons could make good: the finest is the best."""
    finest = request.camera.stop.diameter_um / _FINEST_GRID
    check_optics(request.camera, min(finest, request.dot_um or finest), where=str(path))


def _load(path: Path, request: Request) -> Opening:
    if not os.path.isfile(path):
        problem = "is a directory" if os.path.isdir(path) else "does not exist"
        raise SourceError("MF301", f"the file {problem}", where=str(path), cure="Give the path of an existing file")
    dots = _dots(request)
    if path.suffix.lower() == ".toml":
        opening = opening_file.load_opening(path, dots=dots)
        return opening if request.dot_um or request.pitch_um is None else _scaled(opening, request)
    if request.dot_um is not None:
        dot_nm = to_nm(request.dot_um, where="--dot", name="dot")
        return opening_file.load_opening(
            path,
            dots=dots,
            dot_nm=dot_nm,
            layer=request.layer,
            cell=request.cell,
            unit_um=request.unit_um,
            name=_name(path),
        )
    if path.suffix.lower() not in MEASURED_SUFFIXES:
        opening = opening_file.load_opening(
            path, dot_nm=1, name=_name(path)
        )  # what is wrong with the file itself comes first
        if request.pitch_um is not None:
            return _scaled(opening, request)
    raise JobError("MF105", f"{path.name} does not state the size of its dots", where="--dot", cure='Add --dot "8 um"')


def _dots(request: Request) -> int | None:
    """Dots along a cell, if the request says both of what they follow from."""
    if request.pitch_um is None or request.dot_um is None:
        return None
    if request.gutter_um >= request.pitch_um:
        raise _no_room(request)
    dot_nm = to_nm(request.dot_um, where="--dot", name="dot")
    nearest = CellSize.filling(request.pitch_um, dot_nm, _gutter_nm(request))
    cell = replace(nearest, dots=max(1, nearest.dots))
    if not cell.has_pitch(request.pitch_um):
        what = (
            f"pitch {request.pitch_um:g} um is not a whole number of dots of {request.dot_um:g} um"
            f" plus a gutter of {request.gutter_um:g} um"
        )
        raise JobError("MF106", what, where="--pitch", cure=f"Use --pitch '{cell.pitch_um:g} um'")
    return cell.dots


def _gutter_nm(request: Request) -> int:
    return even_nm(request.gutter_um, where="--gutter", name="gutter")


def _no_room(request: Request) -> JobError:
    what = f"a gutter of {request.gutter_um:g} um leaves no dots in a pitch of {request.pitch_um:g} um"
    return JobError("MF106", what, where="--gutter", cure="Use a gutter narrower than the pitch by at least one dot")


def _scaled(opening: Opening, request: Request) -> Opening:
    """The opening with the dot that its number of dots gives the requested pitch."""
    assert request.pitch_um is not None
    if request.gutter_um >= request.pitch_um:
        raise _no_room(request)
    cell = CellSize.of_pitch(request.pitch_um, opening.dots, _gutter_nm(request), where="--pitch")
    return Opening(opening.name, opening.mask, cell.dot_nm, opening.provenance)


def _name(path: Path) -> str:
    """A file's stem made into a name that layouts take."""
    name = "".join(c if c.isascii() and c.isalnum() else "_" for c in path.stem)
    name = re.sub("(?i)(m)(ain)", r"\1_\2", name)[:22]
    return name if name[:1].isalpha() else f"O_{name}"


@dataclass(frozen=True, eq=False)
class _Drawn:
    """A mask file as far as the stop sees it; the polygons themselves, which take more memory than all else, are gone.

    Attributes:
        name: of the cell.
        edges_um: float64 [n, 4], see :func:`maskfab.optics.stop_edges.edges_in_stop`.
        area_um2: clear area before the stop.
        lattice: the grid that the aperture is on.
        aperture: clear shares of its dots.
    """

    name: str
    edges_um: NDArray[np.float64]
    area_um2: float
    lattice: Lattice
    aperture: Aperture


@dataclass(frozen=True, eq=False)
class _Seen:
    """Parts of a mask file that the optics needs; edges and aperture, as large as all of these, are gone.

    Attributes:
        name: of the cell.
        area_um2: clear area before the stop.
        dot_um: side of the raster's dots.
        outline: the polygons, cut by the stop.
        pupil: their raster inside the stop.
        lit: the lags.
    """

    name: str
    area_um2: float
    dot_um: float
    outline: Boundary
    pupil: Pupil
    lit: LitPupils


def _analyse_mask(
    path: Path, request: Request, progress: Progress
) -> tuple[str, tuple[Psf, ...], tuple[Mtf, ...], tuple[Quantity, ...]]:
    seen = _see(path, request)
    release_memory()
    standard, pupil = _measure_seen(seen, request, progress), seen.pupil
    del seen
    release_memory()
    bar = bar_quantities(model_bar(pupil, request.camera, request.blank), request.camera, None)
    return standard.name, standard.psfs, standard.mtfs, (*standard.quantities, *bar)


def _see(path: Path, request: Request) -> _Seen:
    drawn, camera = _draw(path, request), request.camera
    release_memory()
    name, area, dot_um, aperture = drawn.name, drawn.area_um2, drawn.lattice.dot_um, drawn.aperture
    outline = stop_boundary(drawn.edges_um, area, camera, pixel_margin(camera))
    pupil, leak = cut(aperture, camera.stop), Leak.of(request.blank, camera.stop)
    parts = () if leak is None else leak.pupils(aperture)
    del drawn, aperture
    return _Seen(name, area, dot_um, outline, pupil, lit_pupils(pupil, parts, leak, camera))


def _draw(path: Path, request: Request) -> _Drawn:
    dots = _dots(request)
    name, layer, inside = _polygons(path, request)
    camera, stop = request.camera, request.camera.stop
    edges, area = edges_in_stop(inside, stop, (0.0, 0.0))
    if area <= 0:
        what = f"{path} has nothing clear inside a stop of {stop.diameter_um:g} um round the middle of its geometry"
        cure = "Name another --cell or --layer, or use a larger --stop"
        raise SourceError("MF309", what, where=f"cell {name}, layer {layer}", cure=cure)
    lattice = _lattice(_coordinates_nm(inside, stop), request, dots)
    check_optics(camera, lattice.dot_um, where=str(path))
    return _Drawn(name, edges, area, lattice, aperture_in_stop(lattice, lattice, inside, edges, stop, (0.0, 0.0)))


def _polygons(path: Path, request: Request) -> tuple[str, db.LayerInfo, db.Region]:
    """Cell, layer, and their polygons as far as a stop in the middle of all sees them, about that middle."""
    layout = read_layout(path, request.unit_um)
    try:
        cell = find_cell(layout, request.cell)
        layer = find_layer(layout, request.layer)
    except SourceError as problem:  # these two know the layout, but not its file
        raise SourceError(problem.code, problem.what, where=str(path), cure=problem.cure) from None
    index = layout.find_layer(layer)
    box = _polygons_box(layout, index, cell)
    centre = ((box.left + box.right) // 2, (box.bottom + box.top) // 2)
    near = stop_box(request.camera.stop, centre, _LARGEST_DOT_NM)
    _allow_optics(path, cell.begin_shapes_rec_overlapping(index, db.Box(*near)), request.camera.stop)
    return cell.name, layer, region(layout, layer, near, cell.name).moved(-centre[0], -centre[1])


def _measure_seen(seen: _Seen, request: Request, progress: Progress) -> Analysis:
    camera, lit = request.camera, seen.lit
    header = (
        metrics.stop_open_ratio(
            seen.area_um2, camera, None, "area of the file's polygons inside the stop over the stop's"
        ),
        metrics.mtf_volume(lit.table, seen.area_um2, None, INVARIANT_LIMIT_ROUND, lit.leak),
    )

    def difference(error: float, wavelength: float) -> Quantity:
        method = f"relative L2 between the polygons' PSF and that of their raster of {seen.dot_um:g} um"
        return Quantity("readback_psf_difference", error, method, uncertainty=1e-8, wavelength_nm=wavelength)

    measured = measure_pupils(
        seen.pupil, None, lit, seen.outline, camera, INVARIANT_LIMIT_ROUND, difference, progress=progress
    )
    return Analysis(seen.name, measured.psfs, measured.mtfs, (*header, *measured.quantities))


def _polygons_box(layout: db.Layout, index: int, cell: db.Cell) -> db.Box:
    """Bounding box of all polygons on a layer of a cell; its texts are dropped."""
    for part in layout.each_cell():
        shapes = part.shapes(index)
        for text in list(shapes.each(db.Shapes.STexts)):
            shapes.erase(text)
    return cell.bbox(index)


def _allow_optics(path: Path, shapes: db.RecursiveShapeIterator, stop: Stop) -> None:
    """Give the optics of so many shapes the time and memory that they need.

    Raises:
        SourceError: MF313 if they are too many.
    """
    count = db.Region(shapes).count()
    if count > MOST_SHAPES_SEEN:
        what = f"{path.name} has {count:.3g} shapes before the stop; the limit is {MOST_SHAPES_SEEN:.0e}"
        cure = "Use a smaller --stop, or draw the mask with fewer shapes"
        raise SourceError("MF313", what, where=str(path), cure=cure)
    seconds = _SECONDS_OF_OPTICS * max(1.0, stop.diameter_um / _USUAL_STOP_UM) ** 2
    allow(seconds + count / _SHAPES_PER_SECOND, _MEMORY_OF_OPTICS + count * _MEMORY_PER_SHAPE)


def _coordinates_nm(inside: db.Region, stop: Stop) -> list[int]:
    """Distances from the axis at which upright and level edges before the stop lie."""
    twice, _ = edge_distances(inside, stop, (0.0, 0.0))
    # Without an edge in sight every grid is exact.
    return sorted(distance // 2 for distance in twice) or [_LARGEST_DOT_NM]


def _lattice(coordinates_nm: list[int], request: Request, dots: int | None) -> Lattice:
    """A grid on which the geometry's edges lie, if there is one coarse enough to compute with; else a fine one.

    What the request says of the grid counts where the edges lie on it. Where they do not, because the geometry's middle
    is not that of its panel, the grid is found as if nothing were said; if there is none, the requested dot is taken.
    """
    diameter = request.camera.stop.diameter_um
    if dots is not None and request.dot_um is not None and request.pitch_um is not None:
        cells = 2 * math.ceil(diameter / request.pitch_um / 2)
        start = -cells * request.pitch_um / 2 + (request.pitch_um - dots * request.dot_um) / 2
        lattice = Lattice(start, cells, dots, request.dot_um, request.pitch_um)
        if set(coordinates_nm) <= set(np.rint(NM_PER_UM * lattice.edges_um()).astype(int).tolist()):
            return lattice
    step_nm = math.gcd(*coordinates_nm)
    finest_nm = math.ceil(diameter * NM_PER_UM / _FINEST_GRID)
    dot_nm = None if request.dot_um is None else to_nm(request.dot_um, where="--dot", name="dot")
    if dot_nm is not None and (step_nm < finest_nm or step_nm % dot_nm == 0):
        step_nm = dot_nm
    elif step_nm < finest_nm:
        step_nm = finest_nm
    else:
        # A coarse grid would leave the phase across a dot large and the window short.
        step_nm = _divided(step_nm, _LARGEST_DOT_NM)
    count = 2 * math.ceil(diameter * NM_PER_UM / step_nm / 2)
    dot_um = step_nm / NM_PER_UM
    return Lattice(-count * dot_um / 2, count, 1, dot_um, dot_um)


def _divided(step_nm: int, largest_nm: int) -> int:
    """The largest divisor of a step that is not above a limit."""
    pieces = next(
        n for n in range(max(1, step_nm // largest_nm), step_nm + 1) if step_nm % n == 0 and step_nm // n <= largest_nm
    )
    return step_nm // pieces
