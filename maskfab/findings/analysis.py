"""The optics of anything: an opening in any form, or the geometry of any mask file."""

from __future__ import annotations

import math
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.cell_size import CellSize
from maskfab.base.errors import JobError, SourceError
from maskfab.base.files import suffix_of
from maskfab.base.model import CLEAR, Die, Mtf, Opening, Panel, Plate, Psf, Quantity, Tiling
from maskfab.base.processes import release_memory
from maskfab.base.units import NM_PER_UM, to_nm
from maskfab.base.work import Progress, one_thread, silent
from maskfab.findings.drawings import drawing_quantities, parity_quantities
from maskfab.findings.optics import (
    INVARIANT_LIMIT_ROUND,
    READBACK_ERROR,
    LitPupils,
    lit_pupils,
    measure_pupils,
    measure_with_pupil,
    read_openings,
    stop_boundary,
)
from maskfab.job.camera import Camera, Stop
from maskfab.job.die import check_lens, check_optics, even_nm
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.job.sections import SceneSection
from maskfab.job.values import is_table
from maskfab.mask import opening_file
from maskfab.mask.formats.content import find_cell, find_layer, moved_nm
from maskfab.mask.formats.drawing import drawing_notes
from maskfab.mask.formats.gdsii import read_oasis, write_oasis
from maskfab.mask.layout import plate_layout, region
from maskfab.mask.panels import check_cover, check_panel_size
from maskfab.mask.process_limits import allow
from maskfab.mask.raster import aperture_in_stop, disjoint, edge_distances, outline_coverage
from maskfab.mask.sandbox import bounded
from maskfab.optics import metrics
from maskfab.optics.field.polygons import Boundary
from maskfab.optics.outline_lags import OutlineLags, outline_lags
from maskfab.optics.psf import Leak, pixel_margin
from maskfab.optics.pupil import Aperture, Lattice, Pupil, cut
from maskfab.optics.scene.model_bar import bar_of_pupil
from maskfab.optics.stop_edges import cutting_box, edges_in_stop, region_edges, stop_box, sweep_s
from maskfab.optics.tiling import orientations

if TYPE_CHECKING:
    from maskfab.findings.scene import SceneOptics  # slow to load, with all of scenes, where none is asked for
    from maskfab.optics.scene.scene import Scene

_FINEST_GRID = 4000
_LARGEST_DOT_NM = 8000
_SECONDS_OF_OPTICS, _USUAL_STOP_UM = 180, 4000.0
_SHAPES_PER_SECOND, _MANY_VERTICES, _VERTICES_OF_A_SHAPE = 4_000, 20_000, 16
_LONGEST_MERGE_S, _MOST_CROSSED = 40, 100_000_000
_MEMORY_OF_OPTICS, _MEMORY_PER_SHAPE = 2_000_000_000, 4_000

MOST_SHAPES_SEEN = 3_000_000
"""Before the stop of a mask file; the optics of a million take a minute."""


@dataclass(frozen=True)
class Request:
    """Options for the analysis of a file.

    Attributes:
        pitch_um, dot_um: the cell and its dots; where an opening does not state them itself.
        gutter_um: opaque space round every cell.
        tiling, seed: how an opening is laid out. For a layout file, a tiling says that it holds one opening.
        unit_um: one unit of a DXF; what it says itself if None.
        scene, accuracy: what the camera looks at, and the admissible error of its PSF; None for the standard numbers
            alone.
        by_parity: whether what lies within an even number of outlines is opaque, as some programs fill.
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
    by_parity: bool = False


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


def described_scene(section: SceneSection, camera: Camera, where: str) -> Scene:
    """The scene of a section that did not come from a job; tables of curves are read from their paths."""
    from maskfab.optics.response import curves_text
    from maskfab.optics.scene.scene import Scene

    stated = section.spectrum, section.illuminant, section.projection
    named = [name for name in stated if isinstance(name, str) and is_table(name)]
    return Scene.of(section, {name: curves_text(Path(name), where) for name in named}, camera=camera, where=where)


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
    measured = _is_measured(path)
    if request.unit_um is not None and not measured:
        what = f"{path.name} has no unit that could be stated"
        raise JobError("MF105", what, where="--unit", cure="Leave out --unit: only a DXF has a drawing unit to state")
    if measured and request.tiling is None:
        if request.scene is not None:
            what = f"a scene needs an opening and its tiling, which {path.name} does not state"
            cure = "If the file holds one opening, add --tiling, --dot and --pitch; else leave the scene out"
            raise JobError("MF105", what, where="--tiling", cure=cure)
        # Refused before anything is read: what no grid over the polygons could make good.
        finest = request.camera.stop.diameter_um / _FINEST_GRID
        check_optics(request.camera, min(finest, request.dot_um or finest), where=str(path))
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
        from maskfab.findings.scene import scene_reach_um
        from maskfab.optics.scene.plan import sampling_camera

        check_optics(sampling_camera(camera, scene), dot_nm / NM_PER_UM, where="the request: the ends of the spectrum")
        reach = scene_reach_um(camera, scene)
    pitch_nm = CellSize(opening.dots, dot_nm, gutter_nm).pitch_nm
    cells = 2 * math.ceil(reach * NM_PER_UM / pitch_nm)
    check_panel_size(cells, opening.dots, pitch_nm, "the panel over the stop", where="the request")
    tiling = request.tiling or Tiling.PERIODIC
    panel = Panel(
        opening,
        dot_nm,
        gutter_nm,
        orientations(tiling, cells, cells, request.seed, where="--seed"),
        tiling,
        request.seed,
    )
    return analyse_panel(panel, opening.name, request, progress)


@one_thread
def analyse_panel(panel: Panel, name: str, request: Request, progress: Progress = silent) -> Analysis:
    """Analysis of a panel, whose middle is on the axis; else as :func:`analyse`. Raises JobError MF114 for a panel that
    does not cover the stop; else as :func:`analyse`."""
    camera, scene = request.camera, None if request.scene is None else request.scene.through(request.blank)
    check_lens(camera, where="the request")
    check_optics(camera, panel.dot_nm / NM_PER_UM, where="the request")
    check_cover(panel, camera.stop, name, where="the request: stop.diameter")
    side_nm = max(panel.size_nm)
    die = Die(name, name, panel, (0, 0), side_nm)
    if scene is not None:
        from maskfab.findings.scene import measure_scene, scene_plan, scene_reach_um

        plan = scene_plan(die, camera, scene, request.accuracy, "the request")
    plate = Plate(name, "", side_nm, side_nm, (die,), (), (), ())
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "panel.oas"
        write_oasis(plate_layout(plate), file)
        read = region(read_oasis(file), CLEAR)
    progress("optics", 0, 1)
    result, pupil, sampled = measure_with_pupil(die, camera, read, request.blank)
    progress("optics", 1, 1)
    standard = (*result.quantities, *bar_of_pupil(pupil, camera, request.blank, None, sampled))
    if scene is None:
        return Analysis(name, result.psfs, result.mtfs, standard)
    progress("scene", 0, 1)
    openings = read_openings(die, read, scene_reach_um(camera, scene))
    seen = measure_scene(die, camera, scene, openings, plan, request.blank)
    progress("scene", 1, 1)
    return Analysis(name, result.psfs, result.mtfs, (*standard, *seen.quantities), seen)


def sized(opening: Opening, request: Request) -> Opening:
    """An opening that does not know its dots, such as that of an array, with those of the request. Raises JobError
    MF105 where the request states none; MF106, MF107 for a pitch of no whole dots."""
    if request.dot_um is not None:
        return replace(opening, dot_nm=to_nm(request.dot_um, where="dot", name="dot"))
    if request.pitch_um is None:
        what = "an array does not state the pitch of its pixel"
        raise JobError("MF105", what, where="analyse: pitch", cure='Add pitch="168 um"')
    return _scaled(opening, request)


def _is_measured(path: Path) -> bool:
    if path.suffix.lower() == ".toml":
        return False
    from maskfab.mask.formats.table import MEASURED_SUFFIXES  # slow to load, with every format

    return suffix_of(path) in MEASURED_SUFFIXES


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
    if not _is_measured(path):
        opening = opening_file.load_opening(
            path, dot_nm=1, name=_name(path)
        )  # what is wrong with the file itself comes first
        if request.pitch_um is not None:
            return _scaled(opening, request)
    raise JobError("MF105", f"{path.name} does not state the size of its dots", where="--dot", cure='Add --dot "8 um"')


def _dots(request: Request) -> int | None:
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


def _analyse_mask(
    path: Path, request: Request, progress: Progress
) -> tuple[str, tuple[Psf, ...], tuple[Mtf, ...], tuple[Quantity, ...]]:
    camera, leak = request.camera, Leak.of(request.blank, request.camera.stop)
    name, area, lattice, outline, pupil, lit, told = _see(path, request, leak)
    release_memory()
    method = "area of the file's polygons inside the stop over the stop's"
    header = (
        metrics.stop_open_ratio(
            area, camera, None, method + (", curves and corners moved" if told.off_um2 else ""), told.off_um2
        ),
        metrics.mtf_volume(lit.table, area, None, INVARIANT_LIMIT_ROUND, leak),
    )

    def difference(error: float, wavelength: float) -> Quantity:
        method = f"relative L2 between the polygons' PSF and that of their raster of {lattice.dot_um:g} um"
        return Quantity("readback_psf_difference", error, method, uncertainty=READBACK_ERROR, wavelength_nm=wavelength)

    found = measure_pupils(pupil, None, lit, outline, camera, INVARIANT_LIMIT_ROUND, difference, progress=progress)
    del lit, outline
    release_memory()
    bar = bar_of_pupil(pupil, camera, request.blank, None)
    otherwise = _mtf_by_parity(path, request, progress) if told.parity_matters else ()
    return name, found.psfs, found.mtfs, (*header, *found.quantities, *bar, *told.quantities, *otherwise)


def _mtf_by_parity(path: Path, request: Request, progress: Progress) -> Iterator[Quantity]:
    """The MTF50 that the file has where a house fills by parity; none where nothing is then clear."""
    with suppress(SourceError):
        *_, rows = _analyse_mask(path, replace(request, by_parity=True), progress)
        for row in rows:
            if row.name == "mtf50":
                method = f"{row.method}; where what lies within an even number of outlines is opaque"
                yield replace(row, name="mtf50_by_parity", method=method, limit=None, passed=None)


@dataclass(frozen=True)
class _Told:
    """Notes on how a file was read: its outlines' distance from it at most, the bound of error in clear area."""

    quantities: tuple[Quantity, ...]
    moved_nm: float
    off_um2: float = 0.0

    @property
    def parity_matters(self) -> bool:
        """Whether outlines lie within each other, so that who fills by parity reads the file otherwise."""
        return any(row.name == "area_by_parity" for row in self.quantities)


def _see(
    path: Path, request: Request, leak: Leak | None
) -> tuple[str, float, Lattice, Boundary, Pupil, LitPupils, _Told]:
    """Name, open area and lattice of a mask file, the outline of what is clear in the stop, and its pupil, lit.

    Polygons, edges and aperture, then outline and lags take more memory than all after them, and go when used.
    """
    name, edges, area, lattice, aperture, lags, told = _draw(path, request, outlined=leak is None)
    release_memory()
    camera = request.camera
    outline = stop_boundary(edges, area, camera, pixel_margin(camera))
    pupil = cut(aperture, camera.stop)
    del edges, aperture
    return name, area, lattice, outline, pupil, lit_pupils(pupil, leak, camera, lags), told


def _draw(
    path: Path, request: Request, *, outlined: bool
) -> tuple[str, NDArray[np.float64], float, Lattice, Aperture, OutlineLags | None, _Told]:
    """A mask file as far as the stop sees it.

    The name of the cell, edges [n, 4] as of :func:`maskfab.optics.stop_edges.edges_in_stop`, the clear area before the
    stop in um^2, and the grid of the aperture with the clear shares of its dots; then, if ``outlined``, lags of
    polygons that are not too many and lie on no grid; last, notes on how it was read. The polygons themselves, which
    take more memory than all else, are gone.
    """
    dots = _dots(request)
    name, layer, inside, told = _polygons(path, request)
    camera, stop = request.camera, request.camera.stop
    apart = not inside.merged_semantics
    edges, area = edges_in_stop(inside, stop, (0.0, 0.0), apart=apart)
    told = replace(told, off_um2=inside.perimeter() * told.moved_nm / NM_PER_UM**2)
    if area <= 0:
        what = f"{path} has nothing clear inside a stop of {stop.diameter_um:g} um round the middle of its geometry"
        cure = "Name another --cell or --layer, or use a larger --stop"
        raise SourceError("MF309", what, where=f"cell {name}, layer {layer}", cure=cure)
    twice, slanted = edge_distances(inside, stop, (0.0, 0.0))
    # Without an edge in sight every grid is exact.
    coordinates = sorted(distance // 2 for distance in twice) or [_LARGEST_DOT_NM]
    lattice = _lattice(coordinates, request, dots, slanted=slanted, outlined=outlined)
    check_optics(camera, lattice.dot_um, where=str(path))
    aperture = aperture_in_stop(lattice, lattice, inside, edges, stop, (0.0, 0.0), apart=apart)
    if not outlined or (not slanted and twice <= set(np.rint(2 * NM_PER_UM * lattice.edges_um()).astype(int).tolist())):
        return name, edges, area, lattice, aperture, None, told
    lags = outline_lags(inside, stop, (0.0, 0.0), edges, area, outline_coverage)
    return name, edges, area, lattice, aperture, lags, told


def _polygons(path: Path, request: Request) -> tuple[str, db.LayerInfo, db.Region, _Told]:
    """Cell, layer, and their polygons as far as a stop in the middle of all sees them, about that middle.

    They are merged, or have no merged semantics because they lie apart. And how the file was read.
    """
    from maskfab.mask.formats.table import read_layout

    layout = read_layout(path, request.unit_um)
    told = _Told(tuple(drawing_quantities(layout, path.name)), moved_nm(layout))
    try:
        cell = find_cell(layout, request.cell)
        layer = find_layer(layout, request.layer)
    except SourceError as problem:  # these two know the layout, but not its file
        raise SourceError(problem.code, problem.what, where=str(path), cure=problem.cure) from None
    index = layout.find_layer(layer)
    # Texts are no part of the box.
    for part in layout.each_cell():
        shapes = part.shapes(index)
        for text in list(shapes.each(db.Shapes.STexts)):
            shapes.erase(text)
    box = cell.bbox(index)
    centre = ((box.left + box.right) // 2, (box.bottom + box.top) // 2)
    near = stop_box(request.camera.stop, centre, _LARGEST_DOT_NM)
    _allow_optics(path, cell.begin_shapes_rec_overlapping(index, db.Box(*near)), request.camera.stop)
    drawn = db.Region(cell.begin_shapes_rec_overlapping(index, db.Box(*near))) & cutting_box(
        request.camera.stop, centre
    )
    drawn.move(-centre[0], -centre[1])
    drawn.merged_semantics = False
    if request.by_parity:
        drawn = db.Region(db.EdgeProcessor().simple_merge_p2p(list(drawn.each()), False, True, 0))
        drawn.merged_semantics = False
    elif drawing_notes(layout) is not None:
        told = replace(told, quantities=(*told.quantities, *parity_quantities(drawn, path.name)))
    return cell.name, layer, drawn if _lie_apart(drawn) else _merged(drawn, path), told


def _merged(drawn: db.Region, path: Path) -> db.Region:
    """Polygons merged by a sweep along the axis on which fewer edges are met at once."""
    across, up = sweep_s(drawn)
    if min(across, up) > _LONGEST_MERGE_S:
        what = f"polygons of {path.name} that touch or overlap would take {min(across, up):.0f} s to merge"
        cure = "Draw them apart or merged: a polygon of any number of vertices, which OASIS holds whole, is not merged"
        raise SourceError("MF313", f"{what}; the limit is {_LONGEST_MERGE_S} s", where=str(path), cure=cure)
    if up <= across:
        return drawn.merged(True, 1)
    turned = drawn.transformed(db.Trans.R90)
    turned.merged_semantics = False
    return turned.merged(True, 1).transformed(db.Trans.R270)


def _lie_apart(drawn: db.Region) -> bool:
    """Whether polygons of very many vertices surely do not overlap.

    None crosses itself, or the file had been refused. A sweep that merges them takes time in proportion to the square
    of their edges; few are merged in no time, and have no seams then.
    """
    if sum(polygon.num_points() for polygon in drawn.each()) < _MANY_VERTICES:
        return False
    boxes = (polygon.bbox() for polygon in drawn.each())
    ends = np.fromiter((end for box in boxes for end in (box.left, box.bottom, box.right, box.top)), dtype=np.int64)
    return disjoint(ends.reshape(-1, 4))


def _allow_optics(path: Path, shapes: db.RecursiveShapeIterator, stop: Stop) -> None:
    """Give the optics of so many shapes the time and memory that they need."""
    drawn = db.Region(shapes)
    drawn.merged_semantics = False
    edges = region_edges(drawn)
    count = max(drawn.count(), len(edges) // _VERTICES_OF_A_SHAPE)
    if count > MOST_SHAPES_SEEN:
        what = f"{path.name} has {count:.3g} shapes before the stop; the limit is {MOST_SHAPES_SEEN:.0e}"
        cure = "Use a smaller --stop, or draw the mask with fewer shapes"
        raise SourceError("MF313", what, where=str(path), cure=cure)
    # Transforms of edges take time by their lengths, and rasters of slanted ones as much again.
    spans = abs(edges[:, 2:] - edges[:, :2])
    length_um = float(spans.sum() + spans[spans.all(axis=1)].sum()) / NM_PER_UM
    crossed = length_um / (2 * stop.diameter_um / _FINEST_GRID)
    if crossed > _MOST_CROSSED:
        what = (
            f"edges of {path.name} run along {crossed:.2g} dots, slanted ones twice; the limit is {_MOST_CROSSED:.0e}"
        )
        cure = "Use a smaller --stop, or draw the mask with fewer or shorter edges"
        raise SourceError("MF313", what, where=str(path), cure=cure)
    seconds = _SECONDS_OF_OPTICS * max(1.0, stop.diameter_um / _USUAL_STOP_UM) ** 2
    allow(seconds + count / _SHAPES_PER_SECOND, _MEMORY_OF_OPTICS + count * _MEMORY_PER_SHAPE)


def _lattice(
    coordinates_nm: list[int], request: Request, dots: int | None, *, slanted: bool, outlined: bool
) -> Lattice:
    """A grid on which the geometry's edges lie, if there is one coarse enough to compute with; else a fine one.

    What the request says of the grid counts where the edges lie on it. Where they do not, because the geometry's middle
    is not that of its panel, the grid is found as if nothing were said; if there is none, the requested dot is taken.
    Slanted edges lie on no grid; of what does not a grid half as fine will do where polygons tell what it does not.
    """
    diameter = request.camera.stop.diameter_um
    if dots is not None and request.dot_um is not None and request.pitch_um is not None:
        cells = 2 * math.ceil(diameter / request.pitch_um / 2)
        start = -cells * request.pitch_um / 2 + (request.pitch_um - dots * request.dot_um) / 2
        lattice = Lattice(start, cells, dots, request.dot_um, request.pitch_um)
        if set(coordinates_nm) <= set(np.rint(NM_PER_UM * lattice.edges_um()).astype(int).tolist()):
            return lattice
    step_nm = 1 if slanted and outlined else math.gcd(*coordinates_nm)
    finest_nm = math.ceil(diameter * NM_PER_UM / _FINEST_GRID)
    dot_nm = None if request.dot_um is None else to_nm(request.dot_um, where="--dot", name="dot")
    if dot_nm is not None and (step_nm < finest_nm or step_nm % dot_nm == 0):
        step_nm = dot_nm
    elif step_nm < finest_nm:
        step_nm = 2 * finest_nm if outlined else finest_nm
    else:
        # A coarse grid would leave the phase across a dot large and the window short.
        whole = range(max(1, step_nm // _LARGEST_DOT_NM), step_nm + 1)
        step_nm //= next(n for n in whole if step_nm % n == 0 and step_nm // n <= _LARGEST_DOT_NM)
    count = 2 * math.ceil(diameter * NM_PER_UM / step_nm / 2)
    dot_um = step_nm / NM_PER_UM
    return Lattice(-count * dot_um / 2, count, 1, dot_um, dot_um)
