"""Dies as a camera saw them: by exposures of a point light, across slanted edges, and by a curve from elsewhere."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from maskfab.api.asked import AnyJob, AnyPhoto, dies_of, job_of, require_form, sources, way_round
from maskfab.api.camera import Camera
from maskfab.api.lengths import Length, Wavelength, length_text, wavelength_nm
from maskfab.api.photo_measuring import PhotoMeasurement, measured_photos
from maskfab.api.results import FolderResult, answers, saved_at
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.folders import Place
from maskfab.base.model import Panel, Quantity
from maskfab.base.provenance import sha256_of_file
from maskfab.base.units import parse_length_um, parse_time_s
from maskfab.base.work import Progress, one_thread, silent
from maskfab.camera.blur import stand_named, stand_words
from maskfab.camera.frames.frame import Colour, Frame, Source, read_frame, read_frames
from maskfab.camera.frames.merge import merged
from maskfab.camera.frames.stack import Gain, light_place, photon_transfer, window_middle
from maskfab.camera.inspection.die_verdict import Answer, Promise, Verdict, strength
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
from maskfab.camera.inspection.measurement import Measured, light_of, measured, seen_light
from maskfab.camera.photo import Stated
from maskfab.camera.sensor import counted
from maskfab.findings.optics import sees_mirrored
from maskfab.job.camera import Sensor
from maskfab.job.reference import USES, Keys, in_words, unused
from maskfab.mask.houses.profiles import shop_of
from maskfab.mask.job import Job
from maskfab.optics.spectrum import Band
from maskfab.report.pages.measured import (
    capture_document,
    captured_drawing,
    edge_document,
    edges_drawing,
    write_capture,
    write_edges,
)
from maskfab.report.text import Quantities

if TYPE_CHECKING:
    from maskfab.report.figures.sheet import Drawing


_WINDOW, _LEAST_WINDOW, _MOST_WINDOW = 150, 32, 400


@dataclass(frozen=True, eq=False, repr=False)
class Measurement(FolderResult):
    """A capture and what it tells of the plate."""

    found: Measured
    digest: str
    notes: tuple[str, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """ACCEPT, REJECT or CANNOT TELL, why, and what to do next."""
        return self.found.verdict

    @property
    def passed(self) -> bool:
        """Whether the die is accepted."""
        return self.verdict.answer is Answer.ACCEPT

    @property
    def numbers(self) -> Quantities:
        """Every number that was found; of a die that nothing can be told of, none of the die."""
        return Quantities(self.found.quantities)

    def __getitem__(self, key: str) -> Quantity:
        return self.numbers[key]

    def to_dict(self) -> dict[str, Any]:
        """Everything that measure.json says."""
        return capture_document(self.found, self.digest, self.notes)

    def _write(self, place: Place) -> list[Path]:
        """Page, numbers and the merged capture."""
        return write_capture(place, self.found, self.to_dict(), self.notes)

    def plot(self) -> Drawing:
        """Captured, expected, and their difference."""

        return captured_drawing(self.found)

    def __str__(self) -> str:
        found = self.found
        likely = [f"{each.cause}, {strength(each)} ({each.gain / 2:.0f})" for each in found.suspects]
        behind = [f"What may be behind it, by log-likelihood: {'; '.join(likely)}."] if likely else []
        lines = [found.verdict.line, found.verdict.next_step, *behind, *found.sentences, str(self.numbers)]
        if found.if_sentences:
            lines += [found.if_words, *found.if_sentences, str(Quantities(found.if_numbers))]
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


@checked_arguments
@one_thread
def measure(
    captures: Annotated[AnyPhoto | Sequence[AnyPhoto], "FILE"],
    job: AnyJob,
    camera: Camera | None = None,
    *,
    die: str | Sequence[str] | None = None,
    times: Annotated[Sequence[str] | None, "--times TIME"] = None,
    gain: float | None = None,
    read_noise: float | None = None,
    pair: Sequence[AnyPhoto] = (),
    dark: Sequence[AnyPhoto] = (),
    flat: Sequence[AnyPhoto] = (),
    window: int = _WINDOW,
    line: Wavelength | None = None,
    black: float | None = None,
    white: float | None = None,
    mosaic: str | None = None,
    photos: bool = False,
    progress: Progress = silent,
) -> Measurement | PhotoMeasurement:
    """Tell whether a die is as drawn, from exposures of a point light: ACCEPT, REJECT or CANNOT TELL, and why.

    Or from ordinary photographs through it (photos): they tell focus, turn and scale with their errors, the PSF that
    goes with these, and of widths what they can.

    Which die it is, how it stands and how it was written is told where the frames are explained; the exit code is 0 of
    ACCEPT alone.

    Examples:
        $ maskfab measure 1ms.dng 4ms.dng 16ms.dng --job layouts/upc12.toml --gain 1.3 --read-noise 4.9 -o build/led
        $ maskfab measure led.tif --job job.toml --line '530 nm' --pair a.tif --pair b.tif
        $ maskfab measure street.dng garden.dng face.dng --photos --job layouts/upc12.toml --die FITS_M150 -o build/psf

    Args:
        captures: one frame or a stack of exposures: RAW, linear TIFF or PNG of 16 bits, EXR. In Python also arrays of
            counts, [rows, columns] or [rows, columns, 3], row 0 the top, with times.
        job: job file (.toml) of the plate, with the camera. In Python also a plate, panels or a loaded job.
        camera: of a plate or of panels; by default the plate's, or that of protocol F1.
        die: die that it may be; by default all of the job.
        times: exposure, such as ``"4 ms"``, in the order of the files; by default as the files state them.
        gain: electrons for each count, not the analog gain; by default told from pair, else by [sensor]'s bits and
            gain, or base_iso and the file's ISO: full_well over the analog gain is white above black.
        read_noise: read noise in electrons; by default told likewise.
        pair: frame of two or more equal ones with light, from which gain and read noise are told.
        dark: frame without light.
        flat: frame of even light.
        window: pixels along a side of what is looked at.
        line: wavelength of a light of one line, such as ``"530 nm"``; by default the job's light.
        black: counts of no light; by default as the files state it.
        white: counts of a full pixel; by default as the files state it.
        mosaic: mosaic that grey pictures hold: rggb, bggr, grbg or gbrg.
        photos: the captures are ordinary photographs of any scenes, in colour, through one die.
        progress: told where the work stands.

    Raises:
        SourceError: for frames that cannot be read or merged, MF339 for light that is like no die of the job.
        JobError: MF105 for a die that the job does not have, or a gain that nothing states; else as for the job.
        OutputError: MF420, MF421 for a mask house of the job that has no profile, or a malformed one.
    """
    loaded = job_of(job, camera)
    if not _LEAST_WINDOW <= window <= _MOST_WINDOW:
        what = f"a window of {window} pixels is not from {_LEAST_WINDOW} to {_MOST_WINDOW}"
        raise JobError("MF104", what, where="window", cure="Use 150, or up to 400 for wide pictures")
    panels = loaded.panels()
    wanted = dies_of(die, panels)
    stated = None if times is None else [parse_time_s(time, where="times") for time in times]
    line_nm = None if line is None else wavelength_nm(line, "line")
    written = loaded.spec.written
    ordered = None if loaded.spec.order is None else loaded.spec.order.cd
    promise = Promise(
        0.0 if written is None else written.cd_bias_um,
        shop_of(loaded.spec, loaded.where),
        None if ordered is None else ordered.tolerance,
    )
    if photos:
        of_stack = {"times": times, "pair": pair or None, "dark": dark or None, "flat": flat or None}
        require_form("exposures of a point light", of_stack, of=False)
        if window != _WINDOW:
            raise _without("window", "photographs are looked at in squares", "Leave it out")
        facts = Stated(black, white, mosaic, gain, read_noise, loaded.spec.sensor)
        dies = {name: panels[name] for name in wanted}
        files, idle = sources(captures, "photo"), unused_notes(loaded, "measure", line_nm)
        return measured_photos(loaded, dies, files, facts, promise, line_nm, idle, progress)
    # Waves are those of the line that is stated.
    seen_by = loaded.camera if line_nm is None else replace(loaded.camera, wavelengths_nm=(line_nm,))
    sensor = loaded.spec.sensor or Sensor()
    if not pair and not sensor.known_gain:
        _noise(gain, read_noise, None)

    def read(
        pictures: AnyPhoto | Sequence[AnyPhoto], name: str, times_s: Sequence[float] | None = None
    ) -> tuple[Frame, ...]:
        files = sources(pictures, name)
        return read_frames(files, times_s=times_s, black=black, white=white, mosaic=mosaic) if files else ()

    progress("captures", 0, 1)
    frames, darks, flats = read(captures, "capture", stated), read(dark, "dark"), read(flat, "flat")
    by_sensor = counted(loaded.spec.sensor, next((frame for frame in frames if frame.sensitivity), frames[0]))
    gained = None if not pair else photon_transfer(read(pair, "pair"), darks if len(darks) > 1 else ())
    side = min(window, *frames[0].shape) // 2 * 2
    middle = window_middle(light_place(frames, side), frames[0], side)
    known = by_sensor if gained is None else (gained.electrons_per_count, gained.read_noise_e)
    electrons_per_count, read_noise_e = _noise(gain, read_noise, known)
    merging = merged(
        [frame.cropped(middle, side) for frame in frames],
        electrons_per_count=electrons_per_count,
        read_noise_e=read_noise_e,
        dark=[frame.cropped(middle, side) for frame in darks],
        flat=[frame.cropped(middle, side) for frame in flats],
    )
    progress("captures", 1, 1)
    colours = tuple(sorted({plane.colour for plane in merging.planes}))
    bands = () if loaded.scene is None else loaded.scene.bands
    light = light_of(colours, loaded.camera, bands, side / 2 * loaded.camera.pixel_um, line_nm)
    measurement = measured(
        merging,
        {name: panels[name] for name in wanted},
        seen_by,
        light,
        others=panels,
        seen_mirrored=sees_mirrored(loaded),
        promise=promise,
        sensor=sensor,
        progress=progress,
    )
    return Measurement(measurement, loaded.digest, _notes(loaded, line_nm, gained, by_sensor))


answers(measure)(saved_at)


def _noise(gain: float | None, read_noise: float | None, known: tuple[float, float] | None) -> tuple[float, float]:
    """Electrons for each count, and the read noise in electrons: as stated, else as two frames or a sensor told."""
    if known is not None:
        gain = known[0] if gain is None else gain
        read_noise = known[1] if read_noise is None else read_noise
    if gain is None or read_noise is None:
        cure = "Give gain and read_noise in electrons, or a pair of equal frames that they are told from"
        raise JobError("MF105", "nothing states the sensor's gain and read noise", where="gain", cure=cure)
    return gain, read_noise


def _notes(
    job: Job, line_nm: float | None, gain: Gain | None, by_sensor: tuple[float, float] | None
) -> tuple[str, ...]:
    """Sentences on what was assumed, what was told from a pair or a sensor, and what of the job was not used."""
    notes = [f"Assumed: the job's camera, a light that is a point, and {light_words(job, line_nm)}."]
    if gain is not None:
        notes.append(
            f"Told from the pair by photon transfer: {gain.electrons_per_count:.3f} ± {gain.error:.3f} electrons for "
            f"each count, read noise {gain.read_noise_e:.2f} ± {gain.read_noise_error_e:.2f} electrons (one standard "
            "error); what is stated counts instead."
        )
    elif by_sensor is not None:
        notes.append(
            f"By [sensor], full well over analog gain: {by_sensor[0]:.3f} electrons for each count, read noise "
            f"{by_sensor[1]:.2f} electrons; what is stated counts instead."
        )
    notes += unused_notes(job, "measure", line_nm)
    if job.spec.scene is not None:
        notes.append("Of the scene, the fit finds what it sees of gap, depth and lens as Zernike terms.")
    if job.spec.process is not None or job.blank.optical_density is not None:
        notes.append("The die is fitted with sharp corners, smooth edges and no leak.")
    return tuple(notes)


def light_words(job: Job, line_nm: float | None) -> str:
    """The light that is assumed, in words: one line, or that of the job."""
    if line_nm is not None:
        return f"one line of {line_nm:g} nm"
    if job.scene is not None and job.scene.bands:
        return f"bands of [scene] {', '.join(band.name for band in job.scene.bands)}"
    lines = [f"{line:g} nm" for line in job.camera.wavelengths_nm]
    return f"one line of {lines[0]}" if len(lines) == 1 else f"lines of {', '.join(lines)}, one for each colour"


def unused_notes(job: Job, use: str, line_nm: float | None) -> tuple[str, ...]:
    """Sentence that names what a measurement leaves of the job; the light counts where no line is stated."""
    light: Keys = ()
    if line_nm is None:
        lines = job.scene is None or not job.scene.bands
        light = USES["measure without --line"] + (USES["measure by lines"] if lines else ())
    return in_words(unused(job.spec, *USES[use], *light))


@dataclass(frozen=True, eq=False, repr=False)
class EdgeMeasurement(FolderResult):
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
    def passed(self) -> bool:
        """Whether every edge is one that light made: not sharpened, linear, evenly lit."""
        return all(row.passed is not False for edge in self.found.edges for row in edge.quantities)

    @property
    def edges(self) -> tuple[Quantities, ...]:
        """The numbers of every edge."""
        return tuple(Quantities(edge.quantities) for edge in self.found.edges)

    @property
    def verdict(self) -> tuple[str, ...]:
        """Sentences, two for each edge that is held against a design."""
        return edge_verdict(self.found)

    def to_dict(self) -> dict[str, Any]:
        """Everything that measure.json says."""
        return edge_document(self.found, self.name, self.sha256, self.digest, self.notes)

    def _write(self, place: Place) -> list[Path]:
        """Page and numbers."""
        return write_edges(place, self.found, self.to_dict())

    def plot(self) -> Drawing:
        """Every MTF with its band, and the designed ones."""

        return edges_drawing(self.found)

    def __str__(self) -> str:
        tables = [f"{edge.title}\n{Quantities(edge.quantities)}" for edge in self.found.edges]
        left_out = [f"not measured: {name}" for name in self.found.left_out]
        return "\n".join([*self.verdict, *tables, *left_out, *(f"note: {note}" for note in self.notes)])


@checked_arguments
@one_thread
def edge(
    picture: Annotated[AnyPhoto, "PICTURE|CURVE.csv"],
    job: AnyJob | None = None,
    camera: Camera | None = None,
    *,
    die: str | Sequence[str] | None = None,
    stands: str | None = None,
    pixel: Length | None = None,
    region: Annotated[str | Sequence[int] | None, "ROW,COLUMN,ROW,COLUMN"] = None,
    window: int | None = None,
    line: Wavelength | None = None,
    black: float | None = None,
    white: float | None = None,
    mosaic: str | None = None,
    angle: float | None = None,
) -> EdgeMeasurement:
    """Measure the presampled MTF across the slanted edges of a picture, and hold it against a die's.

    An edge that was sharpened, tone-curved or unevenly lit fails (exit code 1) and tells no MTF50.

    Or hold an MTF that was measured elsewhere against a die's: a table (.csv) in place of the picture.

    Examples:
        $ maskfab edge chart.dng --job layouts/upc12.toml --die TOLED_P150 -o build/edge
        $ maskfab edge curve.csv --job job.toml --die TOLED_P150 --angle 90

    Args:
        picture: RAW, linear TIFF or PNG of 16 bits, EXR, every colour measured by its own pixels; or a table (.csv) of
            cycles/pixel or cycles/mm, mtf, and perhaps low and high. In Python also an array of linear light,
            [rows, columns] or [rows, columns, 3], row 0 the top.
        job: job file (.toml) of the plate, with the camera. In Python also a plate, panels or a loaded job.
        camera: of a plate or of panels; by default the plate's, or that of protocol F1.
        die: die of the job that was before the camera; without one nothing is held against a design, unless the job is
            a panel.
        stands: how the die stood: drawn, turned (by 90 degrees), mirrored or mirrored-turned; by default what the job
            says, mirrored if the plate's chrome is away from the lens.
        pixel: side of the sensor's pixel of a picture without a job, such as ``"2 um"``; without either, frequencies
            are per pixel alone.
        region: box of pixels of a picture to look in, its last row and column not in it.
        window: pixels of a picture across an edge that are looked at; by default as far as its blur reaches.
        line: wavelength of a light of one line, such as ``"530 nm"``; by default the job's light.
        black: counts of no light in a picture; by default as the file states it.
        white: counts of a full pixel in a picture; by default as the file states it.
        mosaic: mosaic that a grey picture holds: rggb, bggr, grbg or gbrg.
        angle: direction of a table's waves in the picture, degrees from right towards up; by default 0.

    Raises:
        SourceError: for a picture that cannot be read; MF340 without an edge, MF341 to MF343 for edges that cannot be
            measured; MF301 to MF308 for a table that cannot be read.
        JobError: MF104 for values that no MTF has, or an angle beyond 180 degrees; MF105 for a die that the job does
            not have, or an argument that others leave without use.
    """
    die = _only(die)
    if job is not None and not isinstance(job, Job | str | Path):
        job, camera = job_of(job, camera), None
        die = job.spec.die[0].name if die is None and len(job.spec.die) == 1 else die
    source = _picture(picture)
    if isinstance(source, Path) and source.suffix.lower() == ".csv":
        of_picture = {"pixel": pixel, "region": region, "window": window, "black": black, "white": white}
        require_form("a picture of edges", {**of_picture, "mosaic": mosaic}, of=False)
        for name, stated in {"job": job, "die": die}.items():
            if stated is None:
                why = f"{name} is missing: a curve is held against the die of a job"
                raise JobError("MF105", why, where=name, cure=f"Add {name}")
        assert job is not None
        assert die is not None
        held = _Beside.of(job_of(job, camera), die, stands, line)
        return _curve(source, held, 0.0 if angle is None else angle)
    require_form("a table (.csv) of an MTF", {"angle": angle}, of=False)
    box = _region(region)
    if window is not None and window < 2 * NARROWEST_PX:
        what = f"a window of {window} pixels is below {2 * NARROWEST_PX:g}"
        raise JobError("MF104", what, where="window", cure="State no window, or one of 50 or more")
    _refuse_idle(job, die, pixel, {"stands": stands, "line": line})
    if stands is not None:
        stand_named(stands)
    pixel_um = None if pixel is None else parse_length_um(length_text(pixel, "pixel"), where="pixel")
    beside = None if job is None else _Beside.of(job_of(job, camera), die, stands, line)
    if beside is not None:
        pixel_um = beside.job.camera.pixel_um
    frame = read_frame(source, black=black, white=white, mosaic=mosaic)
    colours = tuple(dict.fromkeys(lattice.colour for lattice in frame.lattices))
    designs = None if beside is None or beside.die is None else beside.by_colour(colours)
    reach = math.inf if window is None else window / 2
    edges = frame_edges(frame, pixel_um, region=box, window_px=reach, designs=designs)
    notes = ["Assumed: counts above black are linear in the light, and both fields beside the edge are evenly lit."]
    if frame.black == (0.0,) * len(frame.black) and black is None:
        notes.append("The file states no black level: it was taken to be 0, which matters where light is uneven.")
    if pixel_um is None:
        notes.append("The pixel is not known, so frequencies are told per pixel alone.")
    notes += [] if beside is None else beside.notes
    return EdgeMeasurement(edges, frame.name, frame.sha256, None if beside is None else beside.job.digest, tuple(notes))


answers(edge)(saved_at)


def _picture(stated: AnyPhoto) -> Source:
    given = sources(stated, "picture")
    if len(given) != 1:
        what = f"{len(given)} pictures are given, and edges are measured in one"
        raise JobError("MF105", what, where="picture", cure="Give one after the other")
    return given[0]


@dataclass(frozen=True)
class _Beside:
    """A job whose die, if one is named, MTFs are held against."""

    job: Job
    panels: Mapping[str, Panel]
    die: str | None
    stands: str | None
    line_nm: float | None

    @classmethod
    def of(cls, job: Job, die: str | None, stands: str | None, line: Wavelength | None) -> _Beside:
        line_nm = None if line is None else wavelength_nm(line, "line")
        panels = {} if die is None else job.panels()
        if die is not None:
            dies_of(die, panels)
        return cls(job, panels, die, stands, line_nm)

    @property
    def bands(self) -> tuple[Band, ...]:
        """Bands of the job's light; none for lines."""
        return () if self.job.scene is None else self.job.scene.bands

    def design(self, lights: tuple[Light, ...]) -> EdgeDesign:
        assert self.die is not None
        way = way_round(self.stands, self.job)
        return EdgeDesign(self.die, self.panels[self.die], self.job.camera, lights, way)

    def by_colour(self, colours: tuple[Colour, ...]) -> dict[Colour, EdgeDesign]:
        light = seen_light(colours, self.job.camera, self.bands, self.line_nm)
        return {colour: self.design((light[colour],)) for colour in colours}

    @property
    def notes(self) -> list[str]:
        """Sentences on what the design was assumed to stand in, and on what of the job was not used."""
        if self.die is None:
            rest = in_words(unused(self.job.spec, *USES["measure without a die"]))
            return ["No die was named: of the job its camera's pixel alone was used.", *rest]
        stood = stand_words(way_round(self.stands, self.job))
        if self.stands is None:
            stood += ", by the side of its chrome" if sees_mirrored(self.job) else ""
        light = light_words(self.job, self.line_nm)
        notes = [f"Assumed: the job's camera in focus, the die {stood}, and {light}."]
        return [*notes, *unused_notes(self.job, "edge", self.line_nm)]


def _curve(path: Path, beside: _Beside, angle: float) -> EdgeMeasurement:
    """An MTF that was measured elsewhere, held against a die's; every colour of the job's light without a line."""
    if not abs(angle) <= 180:
        what = f"an angle of {angle:g} deg is not -180 to 180 deg"
        raise JobError("MF104", what, where="angle", cure="Use 0 or 90, say")
    job, line_nm = beside.job, beside.line_nm
    read = read_mtf(path, job.camera.pixel_um, float(angle))
    lights: tuple[Light, ...] = (line_nm,) if line_nm is not None else beside.bands or job.camera.wavelengths_nm
    edges = compared_curve(read, beside.design(lights))
    notes = ["Nothing tells the window of the curve: the design is shown without one.", *beside.notes]
    return EdgeMeasurement(edges, read.name, sha256_of_file(path), job.digest, tuple(notes))


def _only(die: str | Sequence[str] | None) -> str | None:
    if die is None or isinstance(die, str):
        return die
    if len(die) > 1:
        what = f"{len(die)} dies are given, and an MTF is held against one"
        raise JobError("MF105", what, where="die", cure=f"Give one of them, such as {die[0]}")
    return die[0] if die else None


def _region(stated: str | Sequence[int] | None) -> Region | None:
    if stated is None:
        return None
    parts = re.split(r"\s*,\s*", stated.strip()) if isinstance(stated, str) else list(stated)
    try:
        top, left, bottom, right = (int(part) for part in parts)
    except (TypeError, ValueError) as error:
        cure = "Write first row, first column, end row, end column: 100,200,500,300"
        raise JobError("MF105", f"{stated!r} is no region of four whole numbers", where="region", cure=cure) from error
    if not (0 <= top < bottom and 0 <= left < right):
        what = f"the region from row {top} to {bottom} and column {left} to {right} holds no pixel"
        cure = "Write first row, first column, end row, end column: 100,200,500,300"
        raise JobError("MF104", what, where="region", cure=cure)
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
