"""Dies as a camera sees them: from exposures of a point light to which die it is, how it stands and how it was made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maskfab.api.jobs import AnyJob, dies_of, job_of
from maskfab.api.lengths import Wavelength, wavelength_text
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.folders import check_target
from maskfab.base.model import Quantity
from maskfab.base.units import parse_time_s, parse_wavelength_nm
from maskfab.base.work import Progress, one_thread, silent
from maskfab.camera.frames.frame import Frame, read_frames
from maskfab.camera.frames.merge import merged
from maskfab.camera.frames.stack import Gain, light_place, photon_transfer, window_middle
from maskfab.camera.inspection.verdict import Measured, Promise, light_of, measured
from maskfab.camera.sensor import stated_sensor
from maskfab.job.reference import USES, Keys, in_words, unused
from maskfab.mask.houses.profiles import shop_of
from maskfab.mask.job import Job
from maskfab.report.pages.measured import capture_document, captured_drawing, write_capture
from maskfab.report.rows.optics import sees_mirrored
from maskfab.report.rows.text import Quantities

if TYPE_CHECKING:
    from maskfab.report.figures.sheet import Drawing


_LEAST_WINDOW, _MOST_WINDOW = 32, 400


@dataclass(frozen=True, eq=False, repr=False)
class Measurement:
    """A capture and what it tells of the plate.

    Attributes:
        found: everything.
        digest: of the job.
        notes: what a user should know, as sentences.
    """

    found: Measured
    digest: str
    notes: tuple[str, ...] = ()

    @property
    def numbers(self) -> Quantities:
        """Every reported number."""
        return Quantities(self.found.quantities)

    def __getitem__(self, key: str) -> Quantity:
        return self.numbers[key]

    def to_dict(self) -> dict[str, Any]:
        """Everything that measure.json says."""
        return capture_document(self.found, self.digest, self.notes)

    def save(self, out: str | Path, *, force: bool = False) -> list[Path]:
        """Write page, numbers and the merged capture into a directory.

        Raises:
            OutputError: MF401 or MF402 for a place that cannot be written.
        """
        return write_capture(check_target(Path(out), force=force), self.found, self.to_dict(), self.notes)

    def plot(self) -> Drawing:
        """Captured, expected, and their difference."""

        return captured_drawing(self.found)

    def __str__(self) -> str:
        return "\n".join([*self.found.verdict, str(self.numbers), *(f"note: {note}" for note in self.notes)])

    def _repr_svg_(self) -> str:
        return self.plot().svg()


@checked_arguments
@one_thread
def measure(
    captures: str | Path | Sequence[str | Path],
    job: AnyJob,
    *,
    die: str | Sequence[str] | None = None,
    times: Sequence[str] | None = None,
    gain: float | None = None,
    read_noise: float | None = None,
    pair: Sequence[str | Path] = (),
    dark: Sequence[str | Path] = (),
    flat: Sequence[str | Path] = (),
    window: int = 150,
    line: Wavelength | None = None,
    black: float | None = None,
    white: float | None = None,
    mosaic: str | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Tell which die a camera saw, how it stands and how it was written, from exposures of a point light.

    Args:
        captures: one frame or a stack of exposures: RAW, linear TIFF or PNG of 16 bits, EXR.
        job: of the plate, with the camera.
        die: those that it may be; by default all of the job.
        times: of the exposures, such as ``"4 ms"``, in the order of the files; by default as the files state them.
        gain: electrons for each count; by default told from ``pair``.
        read_noise: of a pixel, electrons; by default told from ``pair``.
        pair: two or more equal frames with light, from which gain and read noise are told.
        dark: frames without light.
        flat: frames of even light.
        window: pixels along a side of what is looked at.
        line: wavelength of the light, if it is one line; by default the light is that of the job's camera and scene.
        black, white: levels in counts; by default as the files state them.
        mosaic: ``rggb bggr grbg gbrg`` of grey pictures that hold one.
        progress: told where the work stands.

    Raises:
        SourceError: for frames that cannot be read or merged, MF339 for light that is like no die of the job.
        JobError: MF105 for a die that the job does not have, or a gain that nothing states; else as for the job.
        OutputError: MF420, MF421 for a mask house of the job that has no profile, or a malformed one.
    """
    known = job_of(job)
    if not _LEAST_WINDOW <= window <= _MOST_WINDOW:
        raise JobError(
            "MF104",
            f"a window of {window} pixels is not from {_LEAST_WINDOW} to {_MOST_WINDOW}",
            where="window",
            cure="Use 150, or up to 400 for wide pictures",
        )
    panels = known.panels()
    wanted = dies_of(die, panels)
    stated = None if times is None else [parse_time_s(each, where="times") for each in times]
    line_nm = None if line is None else parse_wavelength_nm(wavelength_text(line), where="line")
    written = known.spec.written
    promise = Promise(0.0 if written is None else written.cd_bias_um, shop_of(known.spec, known.where))
    sensor = stated_sensor(known.spec.sensor)
    if not pair:
        _noise(gain, read_noise, None)

    def read(paths: Sequence[str | Path], times_s: Sequence[float] | None = None) -> tuple[Frame, ...]:
        files = [Path(each) for each in paths]
        return read_frames(files, times_s=times_s, black=black, white=white, mosaic=mosaic) if files else ()

    given = [captures] if isinstance(captures, str | Path) else captures
    progress("captures", 0, 1)
    frames, darks, flats = read(given, stated), read(dark), read(flat)
    gained = None if not pair else photon_transfer(read(pair), darks if len(darks) > 1 else ())
    side = min(window, *frames[0].shape) // 2 * 2
    middle = window_middle(light_place(frames, side), frames[0], side)
    electrons_per_count, read_noise_e = _noise(gain, read_noise, gained)
    merging = merged(
        [each.cropped(middle, side) for each in frames],
        electrons_per_count=electrons_per_count,
        read_noise_e=read_noise_e,
        dark=[each.cropped(middle, side) for each in darks],
        flat=[each.cropped(middle, side) for each in flats],
    )
    progress("captures", 1, 1)
    colours = tuple(sorted({plane.colour for plane in merging.planes}))
    bands = () if known.scene is None else known.scene.bands
    light = light_of(colours, known.camera, bands, side / 2 * known.camera.pixel_um, line_nm)
    found = measured(
        merging,
        {name: panels[name] for name in wanted},
        known.camera,
        light,
        seen_mirrored=sees_mirrored(known),
        promise=promise,
        sensor=sensor,
        progress=progress,
    )
    return Measurement(found, known.digest, _notes(known, line_nm, gained))


def _noise(gain: float | None, read_noise: float | None, told: Gain | None) -> tuple[float, float]:
    """Electrons for each count, and the read noise in electrons: as stated, else as a pair of frames told.

    Raises:
        JobError: MF105 if neither does.
    """
    if told is not None:
        gain = told.electrons_per_count if gain is None else gain
        read_noise = told.read_noise_e if read_noise is None else read_noise
    if gain is None or read_noise is None:
        raise JobError(
            "MF105",
            "nothing states the sensor's gain and read noise",
            where="gain",
            cure="Give gain and read_noise in electrons, or a pair of equal frames that they are told from",
        )
    return gain, read_noise


def _notes(job: Job, line_nm: float | None, gain: Gain | None) -> tuple[str, ...]:
    """Sentences on what was assumed, what was told from a pair, and what of the job was not used."""
    notes = [f"Assumed: the job's camera, a light that is a point, and {light_words(job, line_nm)}."]
    if gain is not None:
        notes.append(
            f"Told from the pair by photon transfer: {gain.electrons_per_count:.3f} ± {gain.error:.3f} electrons for "
            f"each count, read noise {gain.read_noise_e:.2f} ± {gain.read_noise_error_e:.2f} electrons (one standard "
            "error); what is stated counts instead."
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
    lines = [f"{each:g} nm" for each in job.camera.wavelengths_nm]
    return f"one line of {lines[0]}" if len(lines) == 1 else f"lines of {', '.join(lines)}, one for each colour"


def unused_notes(job: Job, use: str, line_nm: float | None) -> tuple[str, ...]:
    """Sentence that names what a measurement leaves of the job; the light counts where no line is stated."""
    light: Keys = ()
    if line_nm is None:
        lines = job.scene is None or not job.scene.bands
        light = USES["measure without --line"] + (USES["measure by lines"] if lines else ())
    return in_words(unused(job.spec, *USES[use], *light))
