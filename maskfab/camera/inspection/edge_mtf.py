"""Every slanted edge of a picture or frame measured, beside the MTF that was designed along the same normal.

A frame is measured colour by colour on the places of its own pixels, nothing interpolated. An MTF may also have been
measured elsewhere, and come as a table of comma-separated values.

The designed die's presampled MTF is told as it is and as the edge's window shows it. A window of finite reach blurs the
transfer function along the frequency by its own transform. A display's is a comb (its orders lie beside each other on
the sensor), so a measured and a designed curve can only be held against each other through one window.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from maskfab.base.arrays import Floats, Mask
from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import Frozen, Panel, Quantity
from maskfab.base.units import UM_PER_MM
from maskfab.camera.frames.frame import PIXELS_OF, Colour, Frame
from maskfab.camera.inspection.edge_health import faults
from maskfab.camera.inspection.edge_regions import Order, Region, found_edges
from maskfab.camera.inspection.slanted_edge import WHOLE, EdgeMtf, Grid, edge_mtf, window
from maskfab.job.camera import Camera
from maskfab.optics.lags import LagTable, lag_table
from maskfab.optics.mtf import first_below
from maskfab.optics.psf import cutoff, image_scale_um2
from maskfab.optics.pupil import cut, panel_aperture
from maskfab.optics.response import curves_text, numeric_table
from maskfab.optics.spectrum import Band, Spectrum, line_spectrum, pixel_transfer, quadrature, reach_um

PER_PIXEL, PER_MM = "cycles/pixel", "cycles/mm"
"""Names of the first column."""

_OTHERS = ("mtf", "low", "high")
_HIGHEST = 2.0
_COLUMNS = f"{PER_PIXEL} or {PER_MM}, mtf, and low and high where there is a band"


@dataclass(frozen=True, eq=False)
class MtfCurve(Frozen):
    """A measured MTF.

    Attributes:
        frequency_cy_per_px: float64 [n >= 2], ascending.
        mtf: float64 [n].
        low, high: float64 [n], ends of its band; None if the file has none.
        normal_deg: direction of its waves, from the picture's x axis (right) towards its y axis (up).
    """

    name: str
    pixel_um: float
    frequency_cy_per_px: Floats
    mtf: Floats
    low: Floats | None
    high: Floats | None
    normal_deg: float = 0.0

    @property
    def frequency_cy_per_mm(self) -> Floats:
        return np.asarray(self.frequency_cy_per_px * (UM_PER_MM / self.pixel_um))

    @property
    def title(self) -> str:
        """Which curve it is, in words."""
        return f"waves at {self.normal_deg:g}° of".replace("-", "−") + f" {self.name}"


def read_mtf(path: Path, pixel_um: float, normal_deg: float = 0.0) -> MtfCurve:
    """A curve from a table whose header is ``cycles/pixel`` or ``cycles/mm``, ``mtf``, and perhaps ``low``, ``high``.

    Args:
        path: a .csv; lines that begin with ``#`` are skipped.

    Raises:
        SourceError: MF308 for another suffix, MF301 missing, MF302 empty, MF304 not text; MF303 for a header, row or
            number that is damaged, or frequencies out of order.
        JobError: MF104 for a value that is negative, not finite, above 2, or a band that does not hold the curve.
    """
    where = str(path)
    header, numbers = numeric_table(curves_text(path, where, _COLUMNS), where, (PER_PIXEL, PER_MM))
    if header[1:] not in (list(_OTHERS[:1]), list(_OTHERS)):
        what = f"the columns are {', '.join(header)}"
        raise SourceError("MF303", what, where=where, cure=f"Name the columns {_COLUMNS}")
    frequency, values = numbers[:, 0], numbers[:, 1:]
    if not np.isfinite(frequency).all() or frequency[0] < 0 or (np.diff(frequency) <= 0).any():
        what = f"the {header[0]} do not ascend from 0 or more"
        raise SourceError("MF303", what, where=where, cure="Sort the rows by frequency, each frequency once")
    wrong = ~((values >= 0) & (values <= _HIGHEST))
    if wrong.any():
        what = f"a modulation of {values[wrong][0]:g} is not 0 to {_HIGHEST:g}"
        raise JobError("MF104", what, where=where, cure="Write shares, not per cent: 0.5 for one half")
    if values.shape[1] > 1 and ((values[:, 1] > values[:, 0]) | (values[:, 0] > values[:, 2])).any():
        what = "the band does not hold the curve"
        raise JobError("MF104", what, where=where, cure="Give low <= mtf <= high in every row")
    low, high = (values[:, 1], values[:, 2]) if values.shape[1] > 1 else (None, None)
    per_px = frequency if header[0] == PER_PIXEL else frequency * (pixel_um / UM_PER_MM)
    return MtfCurve(path.name, pixel_um, per_px, values[:, 0], low, high, normal_deg)


Light = Band | float
"""A colour of the camera, response times illuminant, or a line's wavelength in nanometres."""

_BAND_TOLERANCE = 1e-3
# Of the line spread: its period in reaches of the window, and samples per pixel.
_PERIOD, _PER_PX = 16, 8


@dataclass(frozen=True, eq=False)
class DesignedMtf(Frozen):
    """The designed presampled MTF along an edge's normal, at the frequencies of the measured one.

    Attributes:
        seen: float64 [n], through the window of the measurement, 1 at 0: what a perfect measurement shows; ``mtf``
            itself where nothing is known of a window.
    """

    light: str
    wavelength_nm: float | None
    pixel_um: float
    frequency_cy_per_px: Floats
    mtf: Floats
    seen: Floats
    uncertainty: float
    method: str


def designed_mtf(
    panel: Panel,
    camera: Camera,
    light: Light,
    frequency_cy_per_px: Floats,
    normal_deg: float,
    *,
    half_px: float | None = None,
    orientation: int = 0,
) -> DesignedMtf:
    """The MTF of a panel in focus, along one direction.

    Args:
        frequency_cy_per_px: float64 [n], 0 first.
        half_px: reach of the measurement's window to either side of the edge; None if nothing is known of one.
        orientation: how the panel stood before the camera, as :func:`maskfab.base.model.orient` counts.
    """
    frequency = frequency_cy_per_px
    longest = light.range_nm[1] if isinstance(light, Band) else light
    shortest = light.range_nm[0] if isinstance(light, Band) else light
    ends = max(math.sqrt(2) * cutoff(camera, shortest), float(frequency[-1]) / camera.pixel_um)
    pupil = cut(panel_aperture(panel, camera.stop.diameter_um / 2), camera.stop)
    table = lag_table(pupil, reach_um(camera, np.array([longest]), ends))
    along = math.radians(normal_in_die(normal_deg, orientation))
    direction = math.cos(along), math.sin(along)
    spectrum = _lines(light, table, camera, direction, ends)
    mtf, error = _transfer(table, camera, spectrum, direction, frequency)
    count = spectrum.wavelengths_nm.size
    return DesignedMtf(
        light.name if isinstance(light, Band) else f"{light:g} nm",
        None if isinstance(light, Band) else light,
        camera.pixel_um,
        frequency,
        abs(mtf),
        abs(mtf if half_px is None else _seen(table, camera, spectrum, direction, frequency, half_px, ends)),
        error,
        f"autocorrelation of the designed pupil in focus at {count} wavelength{'' if count == 1 else 's'}, times the "
        "pixel's transfer",
    )


def normal_in_die(normal_deg: float, orientation: int) -> float:
    """The direction in the die's own axes of a wave that has another one in the picture's."""
    turned = normal_deg - 90 * (orientation % 4)
    return 180 - turned if orientation >= 4 else turned


def _lines(light: Light, table: LagTable, camera: Camera, direction: tuple[float, float], highest: float) -> Spectrum:
    if not isinstance(light, Band):
        return line_spectrum([light])
    nu = np.linspace(0, highest, 257)
    return quadrature(light, table, camera, _BAND_TOLERANCE, nu * direction[0], nu * direction[1])[0]


def _transfer(
    table: LagTable, camera: Camera, spectrum: Spectrum, direction: tuple[float, float], cycles_per_px: Floats
) -> tuple[Floats, float]:
    """Optics times pixel along a direction, signed, and a bound of its error."""
    nu_x, nu_y = (cycles_per_px / camera.pixel_um * part for part in direction)
    total, error = np.zeros(cycles_per_px.size), 0.0
    for wavelength, weight in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True):
        scale = image_scale_um2(camera, float(wavelength))
        otf, off = table.bounded_otf(scale * nu_x, scale * nu_y)
        total += weight * otf
        error += float(weight * off.max(initial=0.0))
    return total * pixel_transfer(camera, nu_x, nu_y), error


def _seen(
    table: LagTable,
    camera: Camera,
    spectrum: Spectrum,
    direction: tuple[float, float],
    frequency: Floats,
    half_px: float,
    highest: float,
) -> Floats:
    """The transfer function of the line spread within the window."""
    side = round(_PERIOD * half_px) * _PER_PX // 2
    step = _PER_PX / 2 / side
    cycles = step * np.arange(side + 1, dtype=np.float64)
    passes = cycles <= highest * camera.pixel_um
    transfer = np.zeros(side + 1)
    transfer[passes] = _transfer(table, camera, spectrum, direction, cycles[passes])[0]
    line = np.fft.fftshift(np.fft.irfft(transfer))
    place = (np.arange(line.size, dtype=np.float64) - side) / _PER_PX
    inside = abs(place) < half_px
    cut_off = line[inside] * window(place[inside], half_px)
    transfer_seen = np.cos(2 * np.pi * frequency[:, None] * place[inside]) @ cut_off
    return np.asarray(transfer_seen / transfer_seen[0])


_LIMIT_CY_PER_PX = 0.5
_SHOWN_CY_PER_PX = (0.1, 0.25, 0.5)
# Of the distance from a curve to the end of its band: then fewer than one right design in a hundred parts anywhere.
_PARTED = 2.0
# Less is what light that is not quite even does to the lowest frequencies, where bands are narrow.
_LEAST_PARTED = 0.01


@dataclass(frozen=True)
class EdgeDesign:
    """Design that a measured MTF is held against."""

    die: str
    panel: Panel
    camera: Camera
    lights: tuple[Light, ...]
    orientation: int = 0

    def along(self, frequency_cy_per_px: Floats, normal_deg: float, half_px: float | None) -> tuple[DesignedMtf, ...]:
        return tuple(
            designed_mtf(
                self.panel, self.camera, light, frequency_cy_per_px, normal_deg, half_px=half_px,
                orientation=self.orientation,
            )
            for light in self.lights
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class MeasuredEdge:
    """One measured edge, or a curve from elsewhere; ``colour`` is ``-`` where its pixels have none, or none known."""

    edge: EdgeMtf | MtfCurve
    designed: tuple[DesignedMtf, ...]
    quantities: tuple[Quantity, ...]
    colour: Colour = "-"

    @property
    def title(self) -> str:
        """Which one it is, in words."""
        return self.edge.title if self.colour == "-" else f"{PIXELS_OF[self.colour]}, {self.edge.title}"


@dataclass(frozen=True, eq=False)
class MeasuredEdges:
    """The edges of a picture."""

    edges: tuple[MeasuredEdge, ...]
    left_out: tuple[str, ...]
    die: str | None


def measured_edges(
    values: Floats,
    pixel_um: float | None,
    *,
    colour: Colour = "-",
    valid: Mask | None = None,
    grid: Grid = WHOLE,
    region: Region | None = None,
    order: Order | None = None,
    window_px: float = math.inf,
    clipped_at: float = math.inf,
    design: EdgeDesign | None = None,
    where: str = "",
    seed: int = 0,
) -> MeasuredEdges:
    """Find the slanted edges of a picture and measure their presampled MTFs.

    Args:
        values: linear light, float64 [rows, columns], row 0 the top, of any unit, black 0; of a mosaic the samples of
            one colour.
        valid: which of them count; all that are finite if None.
        order: of the polynomial that an edge follows, 1 to 3; None lets the edge decide.
        window_px: largest reach to either side of an edge; less lets in less noise and fewer diffraction orders.

    Raises:
        SourceError: MF340 if no edge was found; MF341, MF342 or MF343 if none that was found can be measured, with the
            first one's reason; MF342 for a region outside the picture.
        JobError: as :func:`maskfab.camera.inspection.edge_mtf.designed_mtf` does.
    """
    counts = np.isfinite(values) if valid is None else valid & np.isfinite(values)
    values, counts, grid = _within(np.where(counts, values, 0.0), counts, grid, region, where)
    straight, refused = found_edges(values, counts)
    edges: list[EdgeMtf] = []
    for line in straight:
        seen = replace(line, reach=min(line.reach, window_px / grid.step))
        try:
            edge = edge_mtf(values, counts, seen, pixel_um, grid=grid, order=order, clipped_at=clipped_at, seed=seed)
        except SourceError as error:
            refused.append(error)
        else:
            edges.append(edge)
    if not edges and refused:
        first = refused[0]
        place = ": ".join(part for part in (where, first.where) if part)
        raise SourceError(first.code, first.what, where=place, cure=first.cure)
    if not edges:
        rows, columns = values.shape
        what = f"no straight edge that is steeper than the noise was found in {rows} x {columns} samples"
        cure = "Photograph a slanted edge between a bright and a dark field, and give its region"
        raise SourceError("MF340", what, where=where, cure=cure)
    return MeasuredEdges(
        tuple(_beside(edge, design, colour) for edge in edges),
        tuple(str(error) for error in refused),
        None if design is None else design.die,
    )


def _within(values: Floats, counts: Mask, grid: Grid, region: Region | None, where: str) -> tuple[Floats, Mask, Grid]:
    if region is None:
        return values, counts, grid
    box = grid.of_samples(region)
    part = np.s_[box.top : box.bottom, box.left : box.right]
    if not values[part].size:
        rows, columns = (grid.step * side for side in values.shape)
        what = f"{region} lie outside the picture of {rows} x {columns} pixels"
        cure = "Give top, bottom, left and right in pixels from the picture's top left corner"
        raise SourceError("MF342", what, where=where, cure=cure)
    return values[part], counts[part], grid.part(box)


def compared_curve(curve: MtfCurve, design: EdgeDesign) -> MeasuredEdges:
    """A curve measured elsewhere beside the design's, which no window blurs; errors as of :func:`designed_mtf`."""
    return MeasuredEdges((_beside(curve, design, "-"),), (), design.die)


def _beside(curve: EdgeMtf | MtfCurve, design: EdgeDesign | None, colour: Colour) -> MeasuredEdge:
    half_px = curve.half_px if isinstance(curve, EdgeMtf) else None
    designed = () if design is None else design.along(curve.frequency_cy_per_px, curve.normal_deg, half_px)
    die = None if design is None else design.die
    numbers = []
    if isinstance(curve, EdgeMtf):
        method = "polynomial through the edge's place on every line"
        numbers.append(Quantity("edge_angle", curve.angle_deg, method, die=die))
        numbers += [excess.quantity(die) for excess in curve.excesses]
    if faults(numbers):
        # It is one of the picture, and of no optics: no fact to go by.
        numbers += [replace(row, value=None, uncertainty=None) for row in mtf50(curve, die)]
    else:
        numbers += mtf50(curve, die)
    numbers += _at_shown(curve, die)
    for each in designed:
        numbers += differences(curve, each, die)
    return MeasuredEdge(curve, designed, tuple(numbers), colour)


def mtf50(curve: EdgeMtf | MtfCurve, die: str | None = None) -> list[Quantity]:
    """The frequency at which a measured MTF first falls below one half; its error reaches to where its band does.

    In cycles per pixel, and in cycles per millimetre where the pixel is known.
    """
    frequency = curve.frequency_cy_per_px
    half = first_below(frequency, curve.mtf, 0.5)
    error = None
    if half is not None and curve.low is not None and curve.high is not None:
        least, most = (first_below(frequency, ends, 0.5) for ends in (curve.low, curve.high))
        error = max(half - (least or 0.0), (float(frequency[-1]) if most is None else most) - half)
    per_pixel = Quantity("edge_mtf50_per_pixel", half, _method(curve), uncertainty=error, die=die)
    if curve.pixel_um is None:
        return [per_pixel]
    per_mm = UM_PER_MM / curve.pixel_um
    value, error = (None if number is None else number * per_mm for number in (half, error))
    return [replace(per_pixel, name="edge_mtf50", value=value, uncertainty=error), per_pixel]


def _at_shown(curve: EdgeMtf | MtfCurve, die: str | None) -> list[Quantity]:
    frequency, numbers = curve.frequency_cy_per_px, []
    for at in _SHOWN_CY_PER_PX:
        if not frequency[0] <= at <= frequency[-1]:
            continue
        value, error = float(np.interp(at, frequency, curve.mtf)), None
        if curve.low is not None and curve.high is not None:
            low, high = (float(np.interp(at, frequency, ends)) for ends in (curve.low, curve.high))
            error = max(value - low, high - value)
        detail = f"{at:g} cy/pixel"
        numbers.append(Quantity("edge_mtf", value, _method(curve), uncertainty=error, die=die, detail=detail))
    return numbers


def _method(curve: EdgeMtf | MtfCurve) -> str:
    return curve.method if isinstance(curve, EdgeMtf) else f"read from {curve.name}"


def differences(curve: EdgeMtf | MtfCurve, designed: DesignedMtf, die: str | None = None) -> list[Quantity]:
    """Largest difference of a measured MTF from the designed one up to half a cycle per pixel, and where they part."""
    resolved = (curve.frequency_cy_per_px > 0) & (curve.frequency_cy_per_px <= _LIMIT_CY_PER_PX)
    gap = curve.mtf - designed.seen
    size = np.where(resolved, abs(gap), -1.0)
    at = int(np.argmax(size))
    light = f"{designed.light}: {designed.method}"
    error = None
    parting = []
    if curve.low is not None and curve.high is not None:
        # From the curve to the end of its band on the design's side.
        beside = np.where(gap < 0, curve.high - curve.mtf, curve.mtf - curve.low) + designed.uncertainty
        error = float(beside[at])
        parted = np.flatnonzero(resolved & (abs(gap) > np.maximum(_PARTED * beside, _LEAST_PARTED)))
        first = float(designed.frequency_cy_per_px[parted[0]] / designed.pixel_um * UM_PER_MM) if parted.size else None
        method = f"first frequency at which the design lies {_PARTED:g} half bands and {_LEAST_PARTED:g} off; {light}"
        parting.append(Quantity("edge_mtf_parting", first, method, die=die, wavelength_nm=designed.wavelength_nm))
    place = curve.frequency_cy_per_px[at]
    method = f"at {place:.3g} cycles per pixel, both through one window; {light}"
    line_nm = designed.wavelength_nm
    largest = Quantity(
        "edge_mtf_difference", float(size[at]), method, uncertainty=error, die=die, wavelength_nm=line_nm
    )
    return [largest, *parting]


def frame_edges(
    frame: Frame,
    pixel_um: float | None,
    *,
    region: Region | None = None,
    window_px: float = math.inf,
    designs: Mapping[Colour, EdgeDesign] | None = None,
) -> MeasuredEdges:
    """Every edge of a frame in each of its colours, held beside ``designs``, all of one die, if given."""
    edges: list[MeasuredEdge] = []
    left_out: list[str] = []
    refused: list[SourceError] = []
    die = None
    for colour in dict.fromkeys(lattice.colour for lattice in frame.lattices):
        values, grid, clipped_at = _light(frame, colour)
        try:
            measured = measured_edges(
                values,
                pixel_um,
                colour=colour,
                grid=grid,
                region=region,
                window_px=window_px,
                clipped_at=clipped_at,
                design=None if designs is None else designs[colour],
                where=frame.name,
            )
        except SourceError as error:
            refused.append(error)
            left_out.append(f"{PIXELS_OF[colour]}: {error}")
            continue
        edges += measured.edges
        left_out += [f"{PIXELS_OF[colour]}: {sentence}" for sentence in measured.left_out]
        die = measured.die
    if not edges:
        raise refused[0]
    return MeasuredEdges(tuple(edges), tuple(left_out), die)


def _light(frame: Frame, colour: Colour) -> tuple[Floats, Grid, float]:
    """Counts above black of one colour, where they lie, and from where on they are clipped."""
    own = [(place, lattice) for place, lattice in enumerate(frame.lattices) if lattice.colour == colour]
    clipped_at = frame.white - max(frame.black[place] for place, _ in own)
    (first, lattice), *others = own
    if not others:
        return frame.signal(first), Grid(lattice.first, lattice.step), clipped_at
    # The two greens of a mosaic together have twice the places across an edge that either has.
    values = np.full(frame.shape, np.nan)
    for place, lattice in own:
        lattice.at(values)[...] = frame.signal(place)
    return values, WHOLE, clipped_at


_TOLD = ("edge_mtf50_per_pixel", "edge_mtf50", "edge_mtf_difference", "edge_mtf_parting")


def edge_verdict(measured: MeasuredEdges) -> tuple[str, ...]:
    """A sentence for each edge, and one for each light that it is held against."""
    return tuple(sentence for edge in measured.edges for sentence in _sentences(edge, measured.die))


def _sentences(measured: MeasuredEdge, die: str | None) -> list[str]:
    of = {name: [quantity for quantity in measured.quantities if quantity.name == name] for name in _TOLD}
    if wrong := faults(measured.quantities):
        cure = "Take the edge from the camera's RAW, with even light, and not from a picture that was developed"
        return [f"{measured.title[0].upper()}{measured.title[1:]}: no MTF of a camera, for {'; '.join(wrong)}. {cure}."]
    half = [str(row) for name in ("edge_mtf50_per_pixel", "edge_mtf50") for row in of[name] if row.value is not None]
    fall = f"is one half at {', '.join(half)}" if half else "does not fall below one half"
    sentences = [f"{measured.title[0].upper()}{measured.title[1:]}: the MTF {fall}."]
    partings: list[Quantity | None] = [*of["edge_mtf_parting"]] or [None] * len(measured.designed)
    for designed, difference, parting in zip(measured.designed, of["edge_mtf_difference"], partings, strict=True):
        design = f"the design of {die} in {designed.light}"
        if parting is None:
            place = f"Without a band nothing tells from where on it parts from {design}"
        elif parting.value is None:
            place = f"It agrees with {design} up to half a cycle per pixel"
        else:
            place = f"It parts from {design} at {float(parting):.1f} cycles per mm"
        sentences.append(f"{place}; largest difference {difference}.")
    return sentences
