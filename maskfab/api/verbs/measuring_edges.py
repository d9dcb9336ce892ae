"""MTFs as a camera saw them: across the slanted edges of a picture, or of a curve that was measured elsewhere."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maskfab.api.jobs import AnyJob, dies_of, job_of
from maskfab.api.lengths import Length, Wavelength, length_text, wavelength_text
from maskfab.api.stands import way_round
from maskfab.api.verbs.measuring import light_words, unused_notes
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.folders import check_target
from maskfab.base.model import Panel
from maskfab.base.provenance import sha256_of_file
from maskfab.base.units import parse_length_um, parse_wavelength_nm
from maskfab.base.work import one_thread
from maskfab.camera.blur import stand_named, stand_words
from maskfab.camera.frames.frame import read_frame
from maskfab.camera.inspection.edge_mtf import (
    EdgeDesign,
    Light,
    MeasuredEdges,
    compared_curve,
    edge_verdict,
    frame_edges,
    read_mtf,
)
from maskfab.camera.inspection.edge_regions import NARROWEST_PX, Region
from maskfab.camera.inspection.verdict import seen_light
from maskfab.job.reference import USES, in_words, unused
from maskfab.mask.job import Job
from maskfab.report.documents.measured import edge_document, write_measured
from maskfab.report.pages.measured import edge_page, edges_drawing
from maskfab.report.rows.optics import sees_mirrored
from maskfab.report.rows.text import Quantities

if TYPE_CHECKING:
    from maskfab.report.figures.sheet import Drawing


@dataclass(frozen=True, eq=False, repr=False)
class EdgeMeasurement:
    """MTFs across the edges of a picture, or one that was measured elsewhere, beside the design's.

    Attributes:
        found: everything.
        name: of the file.
        sha256: of the file.
        digest: of the job; None without one.
        notes: what a user should know, as sentences.
    """

    found: MeasuredEdges
    name: str
    sha256: str
    digest: str | None
    notes: tuple[str, ...] = ()

    @property
    def edges(self) -> tuple[Quantities, ...]:
        """The numbers of every edge."""
        return tuple(Quantities(each.quantities) for each in self.found.edges)

    @property
    def verdict(self) -> tuple[str, ...]:
        """Sentences, two for each edge that is held against a design."""
        return edge_verdict(self.found)

    def to_dict(self) -> dict[str, Any]:
        """Everything that measure.json says."""
        return edge_document(self.found, self.name, self.sha256, self.digest, self.notes)

    def save(self, out: str | Path, *, force: bool = False) -> list[Path]:
        """Write page and numbers into a directory.

        Raises:
            OutputError: MF401 or MF402 for a place that cannot be written.
        """
        place, document = check_target(Path(out), force=force), self.to_dict()
        return write_measured(place, document, edge_page(self.found, document))

    def plot(self) -> Drawing:
        """Every MTF with its band, and the designed ones."""

        return edges_drawing(self.found)

    def __str__(self) -> str:
        tables = [f"{each.title}\n{Quantities(each.quantities)}" for each in self.found.edges]
        left_out = [f"not measured: {each}" for each in self.found.left_out]
        return "\n".join([*self.verdict, *tables, *left_out, *(f"note: {note}" for note in self.notes)])

    def _repr_svg_(self) -> str:
        return self.plot().svg()


@checked_arguments
@one_thread
def measure_edge(
    picture: str | Path,
    job: AnyJob | None = None,
    *,
    die: str | None = None,
    stands: str | None = None,
    pixel: Length | None = None,
    region: str | Sequence[int] | None = None,
    window: int | None = None,
    line: Wavelength | None = None,
    black: float | None = None,
    white: float | None = None,
    mosaic: str | None = None,
) -> EdgeMeasurement:
    """Measure the presampled MTF across the slanted edges of a picture, and hold it against a die's.

    Args:
        picture: RAW, linear TIFF or PNG of 16 bits, EXR; every colour is measured by its own pixels.
        job: of the plate, with the camera.
        die: of the job, that was before the camera; without one nothing is held against a design.
        stands: ``drawn``, ``turned`` (by 90 degrees), ``mirrored`` or ``mirrored-turned``: how the die stood; None for
            what the job says, mirrored if the plate's chrome is away from the lens.
        pixel: side of the sensor's pixel, where there is no job; without either, frequencies are per pixel alone.
        region: first row, first column, end row and end column of a box to look in, ends not in it; text with commas,
            or numbers.
        window: pixels across an edge that are looked at; by default as far as its blur reaches.
        line: wavelength of the light, if it is one line; by default the light is that of the job's camera and scene.
        black, white: levels in counts; by default as the file states them.
        mosaic: ``rggb bggr grbg gbrg`` of a grey picture that holds one.

    Raises:
        SourceError: for a picture that cannot be read; MF340 without an edge, MF341 to MF343 for edges that cannot be
            measured.
        JobError: MF105 for a die that the job does not have, or an argument that others leave without use.
    """
    box = _region(region)
    if window is not None and window < 2 * NARROWEST_PX:
        raise JobError(
            "MF104",
            f"a window of {window} pixels is below {2 * NARROWEST_PX:g}",
            where="window",
            cure="State no window, or one of 50 or more",
        )
    _refuse_idle(job, die, pixel, {"stands": stands, "line": line})
    if stands is not None:
        stand_named(stands)
    pixel_um = None if pixel is None else parse_length_um(length_text(pixel), where="pixel")
    line_nm = _line_nm(line)
    known = None if job is None else job_of(job)
    panels = {} if known is None or die is None else known.panels()
    if die is not None:
        dies_of(die, panels)
    frame = read_frame(Path(picture), black=black, white=white, mosaic=mosaic)
    colours = tuple(dict.fromkeys(each.colour for each in frame.lattices))
    designs = None
    if known is not None:
        pixel_um = known.camera.pixel_um
        if die is not None:
            bands = () if known.scene is None else known.scene.bands
            light = seen_light(colours, known.camera, bands, line_nm)
            designs = {colour: _design(known, panels, die, (light[colour],), stands) for colour in colours}
    reach = math.inf if window is None else window / 2
    found = frame_edges(frame, pixel_um, region=box, window_px=reach, designs=designs)
    notes = ["Assumed: counts above black are linear in the light, and both fields beside the edge are evenly lit."]
    if frame.black == (0.0,) * len(frame.black) and black is None:
        notes.append("The file states no black level: it was taken to be 0, which matters where light is uneven.")
    if known is None and pixel is None:
        notes.append("The pixel is not known, so frequencies are told per pixel alone.")
    if known is not None:
        notes += _design_notes(known, die, line_nm, stands)
    return EdgeMeasurement(found, frame.name, frame.sha256, None if known is None else known.digest, tuple(notes))


@checked_arguments
@one_thread
def measure_mtf(
    curve: str | Path,
    job: AnyJob,
    *,
    die: str,
    stands: str | None = None,
    angle: float = 0.0,
    line: Wavelength | None = None,
) -> EdgeMeasurement:
    """Hold an MTF that was measured elsewhere against a die's.

    Args:
        curve: table (.csv) of ``cycles/pixel`` or ``cycles/mm``, ``mtf``, and perhaps ``low`` and ``high``.
        job: of the plate, with the camera.
        die: of the job, that was before the camera.
        stands: as of :func:`measure_edge`.
        angle: direction of the curve's waves in the picture, degrees from right towards up: 0 horizontal, 90 vertical.
        line: wavelength of the light; by default every colour of the job's light is held beside.

    Raises:
        SourceError: MF301 to MF308 for a table that cannot be read.
        JobError: MF104 for values that no MTF has, or an angle beyond 180 degrees; MF105 for a die that the job does
            not have.
    """
    if not abs(angle) <= 180:
        raise JobError(
            "MF104", f"an angle of {angle:g} deg is not -180 to 180 deg", where="angle", cure="Use 0 or 90, say"
        )
    line_nm = _line_nm(line)
    known = job_of(job)
    panels = known.panels()
    dies_of(die, panels)
    path = Path(curve)
    read = read_mtf(path, known.camera.pixel_um, float(angle))
    bands = () if known.scene is None else known.scene.bands
    lights: tuple[Light, ...] = (line_nm,) if line_nm is not None else bands or known.camera.wavelengths_nm
    found = compared_curve(read, _design(known, panels, die, lights, stands))
    notes = [
        "Nothing tells the window of the curve: the design is shown without one.",
        *_design_notes(known, die, line_nm, stands),
    ]
    return EdgeMeasurement(found, read.name, sha256_of_file(path), known.digest, tuple(notes))


def _design(
    job: Job, panels: Mapping[str, Panel], die: str, lights: tuple[Light, ...], stands: str | None
) -> EdgeDesign:
    (name,) = dies_of(die, panels)
    return EdgeDesign(name, panels[name], job.camera, lights, way_round(stands, job))


def _design_notes(job: Job, die: str | None, line_nm: float | None, stands: str | None) -> list[str]:
    """Sentences on what the design was assumed to stand in, and on what of the job was not used."""
    if die is None:
        rest = in_words(unused(job.spec, *USES["measure without a die"]))
        return ["No die was named: of the job its camera's pixel alone was used.", *rest]
    stood = stand_words(way_round(stands, job))
    if stands is None:
        stood += ", by the side of its chrome" if sees_mirrored(job) else ""
    notes = [f"Assumed: the job's camera in focus, the die {stood}, and {light_words(job, line_nm)}."]
    return [*notes, *unused_notes(job, "measure --edge", line_nm)]


def _line_nm(line: Wavelength | None) -> float | None:
    return None if line is None else parse_wavelength_nm(wavelength_text(line), where="line")


def _region(stated: str | Sequence[int] | None) -> Region | None:
    if stated is None:
        return None
    parts = re.split(r"\s*,\s*", stated.strip()) if isinstance(stated, str) else list(stated)
    try:
        top, left, bottom, right = (int(each) for each in parts)
    except (TypeError, ValueError) as error:
        raise JobError(
            "MF105",
            f"{stated!r} is no region of four whole numbers",
            where="region",
            cure="Write first row, first column, end row, end column: 100,200,500,300",
        ) from error
    if not (0 <= top < bottom and 0 <= left < right):
        raise JobError(
            "MF104",
            f"the region from row {top} to {bottom} and column {left} to {right} holds no pixel",
            where="region",
            cure="Write first row, first column, end row, end column: 100,200,500,300",
        )
    return Region(top, bottom, left, right)


def _refuse_idle(
    job: AnyJob | None, die: str | None, pixel: Length | None, of_design: Mapping[str, object | None]
) -> None:
    """Refuse what others leave without use; ``of_design`` goes with a job and a die."""
    if job is not None and pixel is not None:
        raise _without("pixel", "the job states its camera's pixel", "Leave the pixel out, or the job")
    if job is None and die is not None:
        raise _without("die", "there is no job that it refers to", "Give the job too")
    for name, value in of_design.items():
        if value is not None and die is None:
            raise _without(name, "nothing is held against a design without a job and a die", "Give these too")


def _without(name: str, why: str, cure: str) -> JobError:
    return JobError("MF105", f"{name} has no use: {why}", where=name, cure=cure)
