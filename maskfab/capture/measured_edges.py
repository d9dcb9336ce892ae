"""Every slanted edge of a picture measured, beside the MTF that was designed along the same normal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maskfab.base.arrays import Floats, Mask
from maskfab.capture.designed_edge import DesignedMtf, Light, designed_mtf
from maskfab.capture.edge import WHOLE, EdgeMtf, Grid, edge_mtf
from maskfab.capture.edge_line import Order
from maskfab.capture.edge_regions import Region, found_edges
from maskfab.capture.frames import PIXELS_OF, Colour
from maskfab.capture.mtf_file import MtfCurve
from maskfab.errors import SourceError
from maskfab.model import Camera, Panel, Quantity
from maskfab.optics.image.mtf import first_below
from maskfab.units import UM_PER_MM

_LIMIT_CY_PER_PX = 0.5
_SHOWN_CY_PER_PX = (0.1, 0.25, 0.5)
# Of the distance from a curve to the end of its band: then fewer than one right design in a hundred parts anywhere.
_PARTED = 2.0
# Less is what light that is not quite even does to the lowest frequencies, where bands are narrow.
_LEAST_PARTED = 0.01


@dataclass(frozen=True)
class EdgeDesign:
    """Design that a measured MTF is held against.

    Attributes:
        die: name of the one that was before the camera.
        panel: of that die, as designed.
        camera: what looked through it.
        lights: of the colours that were measured, each a band or a line in nanometres.
        orientation: how the panel stood, as :func:`maskfab.model.orient` counts.
    """

    die: str
    panel: Panel
    camera: Camera
    lights: tuple[Light, ...]
    orientation: int = 0

    def along(self, frequency_cy_per_px: Floats, normal_deg: float, half_px: float | None) -> tuple[DesignedMtf, ...]:
        """The designed MTFs, one for each light; see :func:`maskfab.capture.designed_edge.designed_mtf`."""
        return tuple(
            designed_mtf(
                self.panel, self.camera, light, frequency_cy_per_px, normal_deg, half_px=half_px,
                orientation=self.orientation,
            )
            for light in self.lights
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class MeasuredEdge:
    """One measured edge, or a curve that was measured elsewhere.

    Attributes:
        edge: its MTF.
        designed: the die's, one for each light; none without a die.
        quantities: its numbers.
        colour: of the pixels that saw it; ``-`` where they have none, or nothing tells.
    """

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
    """The edges of a picture.

    Attributes:
        edges: at least one, colour by colour from the top left on.
        left_out: why other edges of the picture were not measured, one sentence each.
        die: name of the one that they are held against.
    """

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
        pixel_um: side of a sensor pixel; None where it is not known, for cycles per pixel alone.
        colour: of the pixels.
        valid: which of them count; all that are finite if None.
        grid: where the samples lie on the sensor.
        region: box of sensor pixels to look in; the whole picture if None.
        order: of the polynomial that an edge follows, 1 to 3; None lets the edge decide.
        window_px: largest reach to either side of an edge; less lets in less noise and fewer diffraction orders.
        clipped_at: values from it on are clipped.
        design: what they are held against.
        where: name of the picture, for errors.
        seed: of the resamples that the bands come from.

    Raises:
        SourceError: MF340 if no edge was found; MF341, MF342 or MF343 if none that was found can be measured, with the
            first one's reason; MF342 for a region outside the picture.
        JobError: as :func:`maskfab.capture.designed_edge.designed_mtf` does.
    """
    known = np.isfinite(values) if valid is None else valid & np.isfinite(values)
    values, known, grid = _within(np.where(known, values, 0.0), known, grid, region, where)
    found, refused = found_edges(values, known)
    edges: list[EdgeMtf] = []
    for each in found:
        seen = replace(each, reach=min(each.reach, window_px / grid.step))
        try:
            edge = edge_mtf(values, known, seen, pixel_um, grid=grid, order=order, clipped_at=clipped_at, seed=seed)
        except SourceError as error:
            refused.append(error)
        else:
            edges.append(edge)
    if not edges:
        raise _none(refused, values.shape, where)
    return MeasuredEdges(
        tuple(_beside(edge, design, colour) for edge in edges),
        tuple(str(error) for error in refused),
        None if design is None else design.die,
    )


def _within(values: Floats, known: Mask, grid: Grid, region: Region | None, where: str) -> tuple[Floats, Mask, Grid]:
    """The samples within a region, and where they lie."""
    if region is None:
        return values, known, grid
    box = grid.of_samples(region)
    part = np.s_[box.top : box.bottom, box.left : box.right]
    if not values[part].size:
        rows, columns = (grid.step * side for side in values.shape)
        raise SourceError(
            "MF342",
            f"{region} lie outside the picture of {rows} x {columns} pixels",
            where=where,
            cure="Give top, bottom, left and right in pixels from the picture's top left corner",
        )
    return values[part], known[part], grid.part(box)


def _none(refused: Sequence[SourceError], shape: tuple[int, ...], where: str) -> SourceError:
    if refused:
        first = refused[0]
        place = ": ".join(each for each in (where, first.where) if each)
        return SourceError(first.code, first.what, where=place, cure=first.cure)
    return SourceError(
        "MF340",
        f"no straight edge that is steeper than the noise was found in {shape[0]} x {shape[1]} samples",
        where=where,
        cure="Photograph a slanted edge between a bright and a dark field, and give its region",
    )


def compared_curve(curve: MtfCurve, design: EdgeDesign) -> MeasuredEdges:
    """A curve that was measured elsewhere beside the design's, which no window blurs.

    Raises:
        JobError: as :func:`maskfab.capture.designed_edge.designed_mtf` does.
    """
    return MeasuredEdges((_beside(curve, design, "-"),), (), design.die)


def _beside(curve: EdgeMtf | MtfCurve, design: EdgeDesign | None, colour: Colour) -> MeasuredEdge:
    half_px = curve.half_px if isinstance(curve, EdgeMtf) else None
    designed = () if design is None else design.along(curve.frequency_cy_per_px, curve.normal_deg, half_px)
    die = None if design is None else design.die
    numbers = []
    if isinstance(curve, EdgeMtf):
        method = "polynomial through the edge's place on every line"
        numbers.append(Quantity("edge_angle", curve.angle_deg, method, die=die))
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
    found = first_below(frequency, curve.mtf, 0.5)
    error = None
    if found is not None and curve.low is not None and curve.high is not None:
        least, most = (first_below(frequency, ends, 0.5) for ends in (curve.low, curve.high))
        error = max(found - (least or 0.0), (float(frequency[-1]) if most is None else most) - found)
    per_pixel = Quantity("edge_mtf50_per_pixel", found, _method(curve), uncertainty=error, die=die)
    if curve.pixel_um is None:
        return [per_pixel]
    per_mm = UM_PER_MM / curve.pixel_um
    value, half = (None if each is None else each * per_mm for each in (found, error))
    return [replace(per_pixel, name="edge_mtf50", value=value, uncertainty=half), per_pixel]


def _at_shown(curve: EdgeMtf | MtfCurve, die: str | None) -> list[Quantity]:
    """The measured MTF at a few frequencies, those that the curve holds."""
    frequency, found = curve.frequency_cy_per_px, []
    for at in _SHOWN_CY_PER_PX:
        if not frequency[0] <= at <= frequency[-1]:
            continue
        value, error = float(np.interp(at, frequency, curve.mtf)), None
        if curve.low is not None and curve.high is not None:
            low, high = (float(np.interp(at, frequency, ends)) for ends in (curve.low, curve.high))
            error = max(value - low, high - value)
        detail = f"{at:g} cy/pixel"
        found.append(Quantity("edge_mtf", value, _method(curve), uncertainty=error, die=die, detail=detail))
    return found


def _method(curve: EdgeMtf | MtfCurve) -> str:
    return curve.method if isinstance(curve, EdgeMtf) else f"read from {curve.name}"


def differences(curve: EdgeMtf | MtfCurve, designed: DesignedMtf, die: str | None = None) -> list[Quantity]:
    """Largest difference of a measured MTF from the designed one up to half a cycle per pixel, and where they part.

    Args:
        curve: what was measured.
        designed: at the same frequencies.
        die: whose it is.
    """
    told = (curve.frequency_cy_per_px > 0) & (curve.frequency_cy_per_px <= _LIMIT_CY_PER_PX)
    gap = curve.mtf - designed.seen
    size = np.where(told, abs(gap), -1.0)
    at = int(np.argmax(size))
    light = f"{designed.light}: {designed.method}"
    error = None
    found = []
    if curve.low is not None and curve.high is not None:
        # From the curve to the end of its band on the design's side.
        beside = np.where(gap < 0, curve.high - curve.mtf, curve.mtf - curve.low) + designed.uncertainty
        error = float(beside[at])
        parted = np.flatnonzero(told & (abs(gap) > np.maximum(_PARTED * beside, _LEAST_PARTED)))
        first = float(designed.frequency_cy_per_px[parted[0]] / designed.pixel_um * UM_PER_MM) if parted.size else None
        method = f"first frequency at which the design lies {_PARTED:g} half bands and {_LEAST_PARTED:g} off; {light}"
        found.append(Quantity("edge_mtf_parting", first, method, die=die, wavelength_nm=designed.wavelength_nm))
    place = curve.frequency_cy_per_px[at]
    method = f"at {place:.3g} cycles per pixel, both through one window; {light}"
    difference = Quantity(
        "edge_mtf_difference",
        float(size[at]),
        method,
        uncertainty=error,
        die=die,
        wavelength_nm=designed.wavelength_nm,
    )
    return [difference, *found]
