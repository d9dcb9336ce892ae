"""The optics of a die as the mask writer makes it, beside those of its drawing, in both readings of kissing corners.

The written shape of a whole stop is laid out from the sixteen tiles that can stand round a vertex of the grid of dots,
see :func:`maskfab.mask.writer.written_corners`. Its edges go the way of all polygons to the PSF. For the MTF
the clear share of every tile's parts, a fraction of a dot wide, is autocorrelated; lag 0 is the polygons' area.

Notes:
    Arcs have 16 sides of a circle here, and its area: corners are small beside what a PSF's window resolves, so that
    finer ones change the difference to the drawing by less than a ten-thousandth of itself.
    The rounded-off corners of two dots meet each other at lags of whole dots, in peaks as narrow as the corner radius,
    which parts of a dot blunt. What that is worth is told by parts twice as wide: twice the change is the error.
    Rough edges are taken in the mean over all displays: the PSF by :mod:`maskfab.optics.psf`, the MTF
    from parts whose shares are spread by the same variance. What their halo adds to the MTF lies below the frequency
    that belongs to the correlation length, and is left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from klayout import db
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError
from maskfab.base.model import Die, Mtf, Psf, Quantity, split_cells
from maskfab.base.units import NM_PER_UM
from maskfab.findings.optics import polygon_psf, stop_boundary
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import Process, Roughness
from maskfab.mask.raster import coverage
from maskfab.mask.writer import (
    CONFIGURATIONS,
    UNITS_PER_UM,
    Reading,
    WrittenCorner,
    check_process,
    configurations,
    sagitta_um,
    written_corners,
)
from maskfab.optics import metrics
from maskfab.optics.lags import lag_table
from maskfab.optics.mtf import area_under_radial_min, longest_lag_um, presampled_mtf
from maskfab.optics.psf import EdgeLengths, ReadyPupil, image_scale_um2, rough_psf, scattered_um2
from maskfab.optics.pupil import Aperture, Lattice, Pupil, covered_aperture, cut, panel_aperture
from maskfab.optics.stop import inside
from maskfab.optics.stop_edges import edges_in_stop, stop_region, whole_or_away

Vertices = NDArray[np.uint8]

_ARC_SIDES = 16
_CLOSE_UP_DOTS = 3
_FINE_SIDE, _LARGEST_SIDE = 2400, 6000
_FEWEST_PARTS, _MOST_PARTS = 2, 8
_PATH_ERROR = 1e-8
_ARC_ERROR = 1e-4


@dataclass(frozen=True, eq=False)
class WrittenImage:
    """One reading of a written die, by its outlines alone.

    Attributes:
        reading: what became of corners that only touch.
        psf: at points, at the camera's middle wavelength.
        open_ratio: clear share of the stop.
        scattered: share of all light that rough edges scatter, wherever it goes.
        scatter_error: uncertainty of the change of the PSF by it, as a share of the PSF.
    """

    reading: Reading
    psf: Psf
    open_ratio: float
    scattered: float
    scatter_error: float


@dataclass(frozen=True, eq=False)
class WrittenOptics(WrittenImage):
    """One reading of a written die, with its MTFs.

    Attributes:
        radial_errors: uncertainty of each MTF's radial mean and minimum, which average over directions or lie below
            the peaks that need the finest parts.
        auc_errors: uncertainty of the area under each MTF's radial minimum.
    """

    mtfs: tuple[Mtf, ...]
    radial_errors: tuple[float, ...]
    auc_errors: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Written:
    """A die as drawn and as written.

    Attributes:
        drawn_psf: of the drawing, at points, on the same grid as those of the readings.
        drawn: MTFs of the drawing, by wavelength, from the same parts, so that what the stop's rim adds cancels.
        readings: the written die with kissing corners fused, and with them open.
        kissing: corners in front of the stop at which dots only touch; where there are none the readings are alike.
        close_up_nm: int64 [n, 4] drawn dots x0, y0, x1, y1 round the kissing corner nearest to the axis, or where there
            is none round the nearest corner; that corner is the origin.
        quantities: numbers of both readings, named ``..._fused`` and ``..._open``.
    """

    die: Die
    process: Process
    drawn_psf: Psf
    drawn: tuple[Mtf, ...]
    readings: Mapping[Reading, WrittenOptics]
    kissing: int
    close_up_nm: NDArray[np.int64]
    quantities: tuple[Quantity, ...]


class _Transfer(NamedTuple):
    """MTFs by wavelength, and the uncertainties of their radial cuts and of the area under the radial minimum."""

    mtfs: tuple[Mtf, ...]
    radial_errors: tuple[float, ...]
    auc_errors: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class _Vertices:
    """The vertices of a panel's dots near the stop.

    Attributes:
        x_um, y_um: float64 [cells, dots + 1] where they are; one cell of many dots where there is no gutter.
        held: uint8 [cells y, dots + 1, cells x, dots + 1] configurations.
    """

    x_um: Floats
    y_um: Floats
    held: Vertices
    x: Lattice
    y: Lattice
    dot_um: float


@dataclass(frozen=True, eq=False)
class _Parts:
    """The parts into which the dots of a panel, and a margin round every cell, are divided for the MTF.

    Attributes:
        margin: parts round every cell.
        stop: float64 [ny, nx] share of every part that the stop leaves; read-only 1 before any stop.
    """

    x: Lattice
    y: Lattice
    margin: int
    stop: Floats

    def clear(self, held: Vertices, shares: Floats) -> Floats:
        """Clear share of every part, [cells y, parts y, cells x, parts x], from those of the tiles."""
        parts = shares.shape[1]
        spare = parts // 2 - self.margin
        cells_y, rows, cells_x, columns = held.shape
        parts_clear = np.empty((cells_y, self.y.dots, cells_x, self.x.dots))
        for cell, index in enumerate(self.y.dot_index()):
            strip = shares[held[cell]].transpose(0, 3, 1, 2, 4).reshape(rows * parts, cells_x, columns * parts)
            inner = strip[spare : rows * parts - spare, :, spare : columns * parts - spare]
            stop = self.stop[np.ix_(index, self.x.dot_index().ravel())]
            np.multiply(inner, stop.reshape(inner.shape), out=parts_clear[cell])
        return parts_clear


def measure_written(die: Die, camera: Camera, process: Process, where: str = "") -> Written:
    """PSF (at the middle wavelength), MTF (at every one) and open ratio of a die as written, in both readings."""
    check_process(process, die.panel, where)
    designed = _designed(die, camera)
    vertices = _vertices(designed)
    parts = _parts(vertices, die, process, where)
    pupil = cut(designed, camera.stop)
    drawn_psf = _drawn_psf(pupil, camera)
    stop_share = _stop_share(_part_lattices(vertices, parts, _margin(vertices, process, parts)), camera.stop)
    sharp = written_corners(vertices.dot_um, Process(0.0), Reading.OPEN, parts)
    drawn = _transfer(vertices, sharp, stop_share, camera, pupil.energy_um2)
    kissing, corner = _kissing(vertices, camera.stop)
    readings: dict[Reading, WrittenOptics] = {}
    quantities: list[Quantity] = []
    for reading in Reading:
        if reading is Reading.OPEN and not kissing:
            readings[reading] = replace(readings[Reading.FUSED], reading=reading)
        else:
            corners = written_corners(vertices.dot_um, process, reading, parts, _ARC_SIDES)
            readings[reading] = _optics(vertices, corners, stop_share, camera, process, reading, drawn_psf)
        quantities += _image_quantities(die, camera, process, readings[reading], drawn_psf)
        quantities += _mtf_quantities(die, camera, process, readings[reading])
    close_up = _close_up(designed, corner)
    return Written(die, process, drawn_psf, drawn.mtfs, readings, kissing, close_up, tuple(quantities))


def written_psf_quantities(die: Die, camera: Camera, process: Process, where: str = "") -> tuple[Quantity, ...]:
    """The quantities of :func:`measure_written` that need no MTF, equal to them, in a fifth of the time."""
    check_process(process, die.panel, where)
    designed = _designed(die, camera)
    vertices = _vertices(designed)
    drawn_psf = _drawn_psf(cut(designed, camera.stop), camera)
    kissing, _ = _kissing(vertices, camera.stop)
    quantities: list[Quantity] = []
    for reading in Reading:
        if reading is Reading.FUSED or kissing:
            corners = written_corners(vertices.dot_um, process, reading, _FEWEST_PARTS, _ARC_SIDES)
            image, _ = _image(vertices, corners, camera, process, reading, drawn_psf)
        quantities += _image_quantities(die, camera, process, replace(image, reading=reading), drawn_psf)
    return tuple(quantities)


def fused_optics(die: Die, camera: Camera, process: Process, like: Psf, where: str = "") -> WrittenOptics:
    """A written die, kissing corners fused, for the comparison of processes that differ a little."""
    check_process(process, die.panel, where)
    vertices = _vertices(_designed(die, camera))
    parts = _parts(vertices, die, process, where)
    stop_share = _stop_share(_part_lattices(vertices, parts, _margin(vertices, process, parts)), camera.stop)
    corners = written_corners(vertices.dot_um, process, Reading.FUSED, parts, _ARC_SIDES)
    return _optics(vertices, corners, stop_share, camera, process, Reading.FUSED, like)


def written_openings(
    die: Die, camera: Camera, process: Process, parts: int, half_width_um: float | None = None, where: str = ""
) -> Aperture:
    """The openings of a written die before any stop, kissing corners fused, by the clear shares of parts of its dots.

    Rough edges are taken in the mean over all displays, as for the MTF.

    Args:
        parts: along a dot. An odd number, so that the edges of dots lie in the middle of parts: what moves them either
            way then changes the share of one part, and its middle hardly at all.
        half_width_um: cells farther than this from the axis are left out; None for those beyond the stop.
    """
    check_process(process, die.panel, where)
    vertices = _vertices(_designed(die, camera, half_width_um))
    lattices = _part_lattices(vertices, parts, _margin(vertices, process, parts))
    corners = written_corners(vertices.dot_um, process, Reading.FUSED, parts, _ARC_SIDES)
    tiles = np.stack([corner.shares for corner in corners])
    if process.roughness is not None:
        tiles = _spread(tiles, process.roughness.sigma_um / lattices.x.dot_um)
    return covered_aperture(
        lattices.x, lattices.y, _laid_out(lattices.x, lattices.y, lattices.clear(vertices.held, tiles))
    )


def parts_about_edges(die: Die, camera: Camera, process: Process, where: str = "") -> tuple[int, int]:
    """Odd numbers of parts of a dot for :func:`written_openings`, and other ones that tell the error of the first.
    Raises JobError MF115 for too many dots across the stop, MF127 for a gutter too narrow."""
    even = _parts(_vertices(_designed(die, camera)), die, process, where)
    dot, gutter = die.panel.dot_nm / NM_PER_UM, die.panel.gutter_nm / NM_PER_UM

    def held(parts: int) -> bool:
        beyond = 3 if process.cd_bias_um > dot / parts or process.roughness is not None else 1
        return not gutter or beyond * dot / parts <= gutter

    usual = next((count for count in range(max(3, even - 1), _MOST_PARTS + 2, 2) if held(count)), None)
    if usual is None:
        what = (
            f"a gutter of {gutter:g} um is too narrow for photographs through cells as they are written, with dots of "
            f"{dot:g} um"
        )
        cure = f"Use a gutter of at least {3 * dot / (_MOST_PARTS + 1):g} um, or leave process.spread out"
        raise JobError("MF127", what, where=where, cure=cure)
    others = (1 if usual == 3 else 3, usual - 2, usual + 2)
    return usual, next(other for other in others if held(other))


def _designed(die: Die, camera: Camera, half_width_um: float | None = None) -> Aperture:
    """The drawing before the stop and a little beyond, without wires."""
    bare = replace(die.panel, tracks=())
    reach = camera.stop.diameter_um / 2 if half_width_um is None else half_width_um
    return panel_aperture(bare, reach + 2 * bare.dot_nm / NM_PER_UM)


def _optics(
    vertices: _Vertices,
    corners: tuple[WrittenCorner, ...],
    stop_share: _Parts,
    camera: Camera,
    process: Process,
    reading: Reading,
    like: Psf,
) -> WrittenOptics:
    image, area = _image(vertices, corners, camera, process, reading, like)
    transfer = _transfer(vertices, corners, stop_share, camera, area, process.roughness)
    return WrittenOptics(**vars(image), **transfer._asdict())


def _image(
    vertices: _Vertices,
    corners: tuple[WrittenCorner, ...],
    camera: Camera,
    process: Process,
    reading: Reading,
    like: Psf,
) -> tuple[WrittenImage, float]:
    inside, area = _edges_in_stop(vertices, corners, camera.stop)
    outline = stop_boundary(inside, area, replace(camera, wavelengths_nm=(like.wavelength_nm,)))
    psf = polygon_psf(outline, camera, like)
    ratio, rough = area / camera.stop.area_um2, process.roughness
    edges = _lengths(vertices, corners, camera.stop)
    if rough is None or edges.total_um == 0:
        return WrittenImage(reading, psf, ratio, 0.0, 0.0), area
    changed = rough_psf(psf, edges, area, image_scale_um2(camera, like.wavelength_nm), rough)
    # The stop's rim is smooth, and the factor takes it for rough; the halo forgets the ends of edges.
    rim_um = 2 * math.sqrt(math.pi * camera.stop.area_um2)
    share = rim_um / edges.total_um + rough.correlation_um / (math.sqrt(math.pi) * vertices.dot_um)
    error = share * metrics.relative_difference(changed, psf)
    return WrittenImage(reading, changed, ratio, scattered_um2(edges, rough) / area, error), area


def _drawn_psf(pupil: Pupil, camera: Camera) -> Psf:
    (psf,) = ReadyPupil.of(pupil, replace(camera, wavelengths_nm=(camera.middle_nm,))).psfs()
    return psf


def _lengths(vertices: _Vertices, corners: tuple[WrittenCorner, ...], stop: Stop) -> EdgeLengths:
    """Lengths of the tiles' outlines, of a tile on the rim as far as its middle is inside the stop."""
    within = inside(stop, vertices.x_um, vertices.y_um[..., None, None])
    outlines = [corner.outline_um for corner in corners]
    counts = np.bincount(vertices.held[within], minlength=CONFIGURATIONS).astype(np.float64)
    return EdgeLengths.of(np.concatenate(outlines), np.repeat(counts, [len(outline) for outline in outlines]))


def _transfer(
    vertices: _Vertices,
    corners: tuple[WrittenCorner, ...],
    stop_share: _Parts,
    camera: Camera,
    area_um2: float,
    rough: Roughness | None = None,
) -> _Transfer:
    """MTFs of the tiles at every wavelength; errors are twice the change against parts twice as wide."""
    tiles = np.stack([corner.shares for corner in corners])
    if rough is not None:
        tiles = _spread(tiles, rough.sigma_um / stop_share.x.dot_um)
    shares = stop_share.clear(vertices.held, tiles)
    pupils = [
        _grey(stop_share.x, stop_share.y, shares, camera.stop),
        _grey(_paired(stop_share.x), _paired(stop_share.y), _means(shares), camera.stop),
    ]
    # A table of lags is many times as large as what it is made of: there is one at a time, and little beside it.
    del shares
    fine, wide = (_mtfs(pupil, camera, area_um2) for pupil in pupils)
    mtfs, radial, areas = [], [], []
    for mtf, coarse in zip(fine, wide, strict=True):
        change = {name: 2 * float(abs(mtf.cuts[name] - coarse.cuts[name]).max()) for name in mtf.cuts}
        mtfs.append(replace(mtf, uncertainty=max(change.values())))
        radial.append(max(change["radial_mean"], change["radial_min"]))
        areas.append(2 * abs(area_under_radial_min(mtf) - area_under_radial_min(coarse)))
    return _Transfer(tuple(mtfs), tuple(radial), tuple(areas))


def _spread(shares: Floats, sigma: float) -> Floats:
    """Shares [..., k, k] of parts, spread to their neighbours with the variance of edges that are off by so many parts.

    A tile ends in the middle of dots, where what is beyond its border is as what is before it.
    """
    for axis in (-2, -1):
        sides = [(0, 0)] * shares.ndim
        sides[axis] = (1, 1)
        wide = np.moveaxis(np.pad(shares, sides, mode="edge"), axis, 0)
        shares = np.moveaxis((1 - sigma**2) * wide[1:-1] + sigma**2 / 2 * (wide[:-2] + wide[2:]), 0, axis)
    return shares


def _vertices(aperture: Aperture) -> _Vertices:
    x, y = aperture.x, aperture.y
    clear = aperture.transmission[np.ix_(y.dot_index().ravel(), x.dot_index().ravel())] > 0
    held = configurations(split_cells(clear, _blocks(y)[1], _blocks(x)[1])).transpose(0, 2, 1, 3)
    return _Vertices(_lines(x), _lines(y), held, x, y, x.dot_um)


def _blocks(lattice: Lattice) -> tuple[int, int]:
    """Cells that a gutter parts, and the dots of each."""
    return (lattice.cells, lattice.dots) if lattice.has_gutter else (1, lattice.cells * lattice.dots)


def _lines(lattice: Lattice) -> Floats:
    cells, dots = _blocks(lattice)
    first = lattice.start_um + lattice.pitch_um * np.arange(cells, dtype=np.float64)[:, None]
    return np.asarray(first + lattice.dot_um * np.arange(dots + 1, dtype=np.float64))


def _kissing(vertices: _Vertices, stop: Stop) -> tuple[int, tuple[float, float]]:
    """Number of touching corners inside the stop, and the place of the one nearest the axis, or else of any corner."""
    x, y = vertices.x_um, vertices.y_um[..., None, None]
    distance = np.hypot(x, y) if stop.round else np.maximum(abs(x), abs(y))
    kissing = inside(stop, x, y) & np.isin(vertices.held, (6, 9))
    count = int(kissing.sum())
    chosen = kissing if count else ~np.isin(vertices.held, (0, 3, 5, 10, 12, 15))
    nearest = np.zeros(chosen.shape, dtype=np.bool_)
    nearest.flat[np.argmin(np.where(chosen, distance, np.inf))] = True
    (place,) = _positions(vertices, nearest)
    return count, (float(place[0]), float(place[1]))


def _close_up(designed: Aperture, corner: tuple[float, float]) -> NDArray[np.int64]:
    lines = [lattice.edges_um() - at for lattice, at in zip((designed.x, designed.y), corner, strict=True)]
    reach = _CLOSE_UP_DOTS * designed.x.dot_um
    columns, rows = (np.flatnonzero((line[:-1] < reach) & (line[1:] > -reach)) for line in lines)
    row, column = np.nonzero(designed.transmission[np.ix_(rows, columns)])
    x, y = columns[column], rows[row]
    boxes = np.stack([lines[0][x], lines[1][y], lines[0][x + 1], lines[1][y + 1]], axis=1)
    return np.rint(boxes * NM_PER_UM).astype(np.int64)


def _edges_in_stop(vertices: _Vertices, corners: tuple[WrittenCorner, ...], stop: Stop) -> tuple[Floats, float]:
    """Edges [n, 4] of what is clear inside the stop, as of :func:`maskfab.optics.stop_edges.edges_in_stop`, and its
    area.

    Tiles wholly inside give their outlines as they are; those that the stop's rim crosses are cut by it as polygons.
    Where the two meet, both have the border between them, in opposite directions.
    """
    half = vertices.dot_um / 2
    x, y = vertices.x_um[None, None], vertices.y_um[..., None, None]
    ends = [NM_PER_UM * (at + side) for side in (-half, half) for at in (x, y)]
    whole_tile, outside = whole_or_away(stop.scaled(NM_PER_UM, NM_PER_UM), *ends)
    held = vertices.held
    facing = _facing(whole_tile)
    rim = db.Region()
    parts: list[Floats] = []
    area = 0.0
    for configuration in range(1, CONFIGURATIONS):
        corner, here = corners[configuration], held == configuration
        whole = here & whole_tile
        parts.append(_placed(corner.outline_um, vertices, whole))
        parts += [
            _placed(border, vertices, whole & side) for border, side in zip(corner.border_um, facing, strict=True)
        ]
        area += corner.area_um2 * int(whole.sum())
        pieces = list(corner.region.each())
        for dx, dy in (
            np.rint(_positions(vertices, here & ~whole_tile & ~outside) * UNITS_PER_UM).astype(np.int64).tolist()
        ):
            for piece in pieces:
                rim.insert(piece.moved(dx, dy))
    # The rim keeps the corners' finer grid: a thousand of its units stand for a micrometre there.
    finer = UNITS_PER_UM / NM_PER_UM
    cut_edges, cut_area = edges_in_stop(rim, stop.scaled(finer, finer), (0.0, 0.0))
    return np.concatenate([*parts, cut_edges / finer]), area + cut_area / finer**2


def _facing(inside: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Tiles inside the stop whose right, upper, left, lower neighbour in the same cell is not."""
    alone = np.zeros_like(inside)
    right, upper, left, lower = (alone.copy() for _ in range(4))
    right[..., :-1] = inside[..., :-1] & ~inside[..., 1:]
    left[..., 1:] = inside[..., 1:] & ~inside[..., :-1]
    upper[:, :-1] = inside[:, :-1] & ~inside[:, 1:]
    lower[:, 1:] = inside[:, 1:] & ~inside[:, :-1]
    return [right, upper, left, lower]


def _positions(vertices: _Vertices, chosen: NDArray[np.bool_]) -> Floats:
    """x and y of the chosen vertices, [n, 2]."""
    cell_y, row, cell_x, column = np.nonzero(chosen)
    return np.stack([vertices.x_um[cell_x, column], vertices.y_um[cell_y, row]], axis=1)


def _placed(edges: Floats, vertices: _Vertices, chosen: NDArray[np.bool_]) -> Floats:
    if not len(edges):
        return np.zeros((0, 4))
    return (edges + np.tile(_positions(vertices, chosen), 2)[:, None]).reshape(-1, 4)


def _parts(vertices: _Vertices, die: Die, process: Process, where: str) -> int:
    """Into how many parts a dot is divided for the MTF; even, and the more the fewer dots there are."""
    side = max(lines.size for lines in (vertices.x_um, vertices.y_um))
    if 2 * side > _LARGEST_SIDE:
        what = f"the MTF of the written die needs {2 * side} parts along the stop, more than {_LARGEST_SIDE}"
        cure = f"Use larger dots than {die.panel.dot_nm / NM_PER_UM:g} um, or leave the process out"
        raise JobError("MF115", what, where=where, cure=cure)
    parts = min(_MOST_PARTS, max(_FEWEST_PARTS, 2 * (_FINE_SIDE // side // 2)))
    gutter = die.panel.gutter_nm / NM_PER_UM
    if gutter == 0 or (process.cd_bias_um <= 0 and process.roughness is None):
        return parts
    while parts < _MOST_PARTS and 2 * vertices.dot_um / parts > gutter:
        parts += 2
    if 2 * vertices.dot_um / parts > gutter:
        what = (
            f"a gutter of {gutter:g} um is too narrow for the MTF of cells that grow into it: below a quarter of a "
            f"dot of {vertices.dot_um:g} um"
        )
        cure = f"Use a gutter of at least {vertices.dot_um / 4:g} um, or a bias of 0 or less and smooth edges"
        raise JobError("MF127", what, where=where, cure=cure)
    return parts


def _margin(vertices: _Vertices, process: Process, parts: int) -> int:
    """Number of parts round every cell that take what grows out of it; the outermost of an odd number take half."""
    taken = vertices.dot_um / parts if parts % 2 else 0.0
    grown = process.cd_bias_um > taken or process.roughness is not None
    return 1 if vertices.x.has_gutter and grown else 0


def _part_lattices(vertices: _Vertices, parts: int, margin: int) -> _Parts:
    lattices = []
    for lattice, lines in ((vertices.x, vertices.x_um), (vertices.y, vertices.y_um)):
        odd = parts % 2
        count, step = (lines.shape[1] - 1) * parts + odd + 2 * margin, lattice.dot_um / parts
        pitch = lattice.pitch_um if lattice.has_gutter else count * step
        start = lattice.start_um - (margin + odd / 2) * step
        lattices.append(Lattice(start, lines.shape[0], count, step, pitch))
    x, y = lattices
    return _Parts(x, y, margin, np.broadcast_to(1.0, (y.edges_um().size - 1, x.edges_um().size - 1)))


def _stop_share(parts: _Parts, stop: Stop) -> _Parts:
    """The share of every part that the stop leaves; a circle is a polygon of its area."""
    x, y = (lattice.edges_um() * UNITS_PER_UM for lattice in (parts.x, parts.y))
    return replace(parts, stop=coverage(stop_region(stop, UNITS_PER_UM), x, y))


def _paired(lattice: Lattice) -> Lattice:
    step = 2 * lattice.dot_um
    pitch = lattice.pitch_um if lattice.has_gutter else lattice.dots // 2 * step
    return Lattice(lattice.start_um, lattice.cells, lattice.dots // 2, step, pitch)


def _means(shares: Floats) -> Floats:
    cells_y, rows, cells_x, columns = shares.shape
    pairs = shares.reshape(cells_y, rows // 2, 2, cells_x, columns // 2, 2)
    means: Floats = pairs.mean(axis=(2, 5))
    return means


def _grey(x: Lattice, y: Lattice, shares: Floats, stop: Stop) -> Pupil:
    """Parts that are clear by their shares, [cells y, parts y, cells x, parts x], less what the stop takes."""
    return Pupil.of_whole_dots(x, y, _laid_out(x, y, shares), stop)


def _laid_out(x: Lattice, y: Lattice, shares: Floats) -> Floats:
    """Shares [cells y, parts y, cells x, parts x] over all intervals, 0 in gutters; read-only."""
    grey = np.zeros((y.edges_um().size - 1, x.edges_um().size - 1))
    grey[np.ix_(y.dot_index().ravel(), x.dot_index().ravel())] = shares.reshape(y.dot_index().size, -1)
    grey.flags.writeable = False
    return grey


def _mtfs(pupil: Pupil, camera: Camera, area_um2: float) -> list[Mtf]:
    """MTFs of a pupil whose clear area is better known than its parts tell, by wavelength."""
    table = lag_table(pupil, longest_lag_um(camera))
    # Nobody else has this table, and a copy of it would be the largest thing there is.
    table.values.flags.writeable = True
    table.values[0, 0, 0, 0] = area_um2
    table.values.flags.writeable = False
    corrected = replace(table, energy_um2=area_um2)
    return [presampled_mtf(corrected, camera, wavelength) for wavelength in camera.wavelengths_nm]


def _how(process: Process, reading: Reading) -> str:
    rough = process.roughness
    uneven = "" if rough is None else f"edges rough by {rough.sigma_um:g} um over {rough.correlation_um:g} um, "
    shape = f"corners of {process.corner_radius_um:g} um, bias {process.cd_bias_um:g} um"
    return f"{shape}, {uneven}kissing corners {reading.value}"


def _image_quantities(die: Die, camera: Camera, process: Process, written: WrittenImage, drawn: Psf) -> list[Quantity]:
    reading, how = written.reading.value, _how(process, written.reading)
    difference = metrics.relative_difference(written.psf, drawn)
    quantities = [
        Quantity(
            f"written_open_ratio_{reading}",
            written.open_ratio,
            f"area of the written polygons inside the stop over the stop's: {how}",
            uncertainty=metrics.AREA_ERROR * written.open_ratio,
            die=die.name,
        ),
        Quantity(
            f"written_psf_difference_{reading}",
            difference,
            f"relative L2 between the PSF of the written polygons (edges, NUFFT) and the drawing's (matrix): {how}, "
            f"arcs as polygons within {sagitta_um(process, _ARC_SIDES) * NM_PER_UM:.2g} nm and of the circle's area",
            uncertainty=_PATH_ERROR + _ARC_ERROR * difference + written.scatter_error,
            die=die.name,
            wavelength_nm=written.psf.wavelength_nm,
        ),
        Quantity(
            f"written_psf_shape_{reading}",
            metrics.relative_difference(_to_peak(written.psf), _to_peak(drawn)),
            f"the same of both PSFs over their values on the axis: {how}",
            uncertainty=_PATH_ERROR + _ARC_ERROR * difference + written.scatter_error,
            die=die.name,
            wavelength_nm=written.psf.wavelength_nm,
        ),
    ]
    if process.roughness is not None:
        quantities.append(
            Quantity(
                f"written_scattered_{reading}",
                written.scattered,
                f"length of the written edges inside the stop by σ / √π, over what is clear: {how}",
                uncertainty=written.scattered * die.panel.dot_nm / NM_PER_UM / camera.stop.diameter_um,
                die=die.name,
            )
        )
    return quantities


def _mtf_quantities(die: Die, camera: Camera, process: Process, written: WrittenOptics) -> list[Quantity]:
    reading, how = written.reading.value, _how(process, written.reading)
    quantities = []
    for mtf, radial, area in zip(written.mtfs, written.radial_errors, written.auc_errors, strict=True):
        corrected = replace(mtf, falls=replace(mtf.falls, error=mtf.falls.error + radial))
        by_name = {quantity.name: quantity for quantity in metrics.mtf_quantities(corrected, camera.pixel_um, die.name)}
        for row in (replace(by_name["auc_radial_min"], uncertainty=area), by_name["mtf50"]):
            quantities.append(replace(row, name=f"written_{row.name}_{reading}", method=f"{row.method}; {how}"))
    return quantities


def _to_peak(psf: Psf) -> Psf:
    """The PSF with a peak of 1."""
    return replace(psf, values=psf.values / psf.values.max())
