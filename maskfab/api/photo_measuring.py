"""A die as ordinary photographs tell it: ``maskfab measure --photos``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from markupsafe import Markup

from maskfab.api.asked import way_round
from maskfab.api.results import FolderResult
from maskfab.base import __version__
from maskfab.base.errors import JobError
from maskfab.base.folders import Place
from maskfab.base.model import Panel, Quantity
from maskfab.base.quantities import registered
from maskfab.base.units import UM_PER_NM
from maskfab.base.work import Progress
from maskfab.camera.blur import stand_words
from maskfab.camera.frames.frame import Source
from maskfab.camera.inspection.costs import TERM_NAMES
from maskfab.camera.inspection.die_image import BIAS, DEFOCUS, DieImage
from maskfab.camera.inspection.die_verdict import SURE, Answer, Promise, Verdict
from maskfab.camera.inspection.measurement import light_of, write_fitted_psf
from maskfab.camera.inspection.photo_bench import (
    FOCUS,
    SCALE,
    SIDE,
    TURN,
    WIDTH_KNOWN_UM,
    PhotoBench,
    photo_bench,
    square_pixels,
)
from maskfab.camera.noise_spectrum import noise_of
from maskfab.camera.photo import Stated, read_photo
from maskfab.camera.scores import NORMAL_95
from maskfab.mask.job import Job
from maskfab.report.documents.die import DOCUMENT
from maskfab.report.documents.shape import document_text
from maskfab.report.figures.sheet import Drawing
from maskfab.report.pages.measured import FITTED, PAGE, structure_drawing
from maskfab.report.pages.template import page_template, style, write_folder
from maskfab.report.text import Quantities, quantity_document

_SHOWN = 0.5
"""Share of the log-likelihood that photographs of this bench have, below which they do not show the die."""
_HOW = (
    "Whittle's likelihood of squares' spectra, scenes and noise fitted beside; 95 % by the scatter between photographs"
)


@dataclass(frozen=True, eq=False, repr=False)
class PhotoMeasurement(FolderResult):
    """A die and its camera as photographs tell them.

    Attributes:
        found: None where too little of any panel is seen.
    """

    die: str
    found: PhotoBench | None
    verdict: Verdict
    digest: str
    notes: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the die is accepted."""
        return self.verdict.answer is Answer.ACCEPT

    @property
    def shown(self) -> PhotoBench | None:
        """The bench, where photographs show the die."""
        return self.found if self.found is not None and self.found.gain > _SHOWN * self.found.expected > 0 else None

    @property
    def numbers(self) -> Quantities:
        """Width, turn, scale and focus; none where photographs do not show the die."""
        if self.shown is None:
            return Quantities(())
        values, errors, detail = self.shown.values, self.shown.errors, f"{DEFOCUS}, {TERM_NAMES[DEFOCUS]}, either way"
        degrees = math.degrees(1.0)
        rows = (
            Quantity("captured_cd_bias", values[BIAS], _HOW, errors[BIAS], die=self.die),
            Quantity("captured_turn", degrees * values[TURN], _HOW, degrees * errors[TURN], die=self.die),
            Quantity("captured_scale", values[SCALE], _HOW, errors[SCALE], die=self.die),
            Quantity("captured_term", values[FOCUS], _HOW, errors.get(FOCUS), die=self.die, detail=detail),
        )
        return Quantities(rows)

    def __getitem__(self, key: str) -> Quantity:
        return self.numbers[key]

    def to_dict(self) -> dict[str, Any]:
        """Everything that measure.json says."""
        found, verdict = self.found, self.verdict
        return {
            "maskfab_version": __version__,
            "job_hash": self.digest,
            "verdict": {
                "answer": verdict.answer.value,
                "reason": verdict.reason,
                "cause": verdict.cause,
                "next_step": verdict.next_step,
            },
            "die": self.die,
            "quantities": [quantity_document(row) for row in self.numbers],
            "log_likelihood": None if found is None else found.gain,
            "log_likelihood_expected": None if found is None else [found.expected, found.deviation],
            "squares": 0 if found is None else found.squares,
            "notes": list(self.notes),
        }

    def _write(self, place: Place) -> list[Path]:
        """Page and numbers, and the PSF where the die is shown."""
        texts = {PAGE: self._page(), DOCUMENT: document_text(self.to_dict())}

        def write_psf(folder: Path) -> None:
            if self.shown is not None:
                write_fitted_psf(self.shown.image, self.shown.setting, self.die, folder / FITTED)

        return write_folder(place, texts, self.digest, write_psf)

    def _page(self) -> str:
        return page_template("photo_bench.html.j2").render(
            style=style(),
            version=__version__,
            digest=self.digest,
            verdict=self.verdict,
            figure=None if self.found is None else Markup(structure_drawing(self.found).img()),
            rows=[(row, registered(row.name)) for row in self.numbers],
            notes=self.notes,
        )

    def plot(self) -> Drawing:
        """The die's structure in the photographs' power, and as it was fitted."""
        if self.found is None:
            raise JobError("MF105", "too little is seen to be drawn", where="photos", cure=self.verdict.next_step)
        return structure_drawing(self.found)

    def __str__(self) -> str:
        rows = [str(self.numbers)] if self.shown is not None else []
        return "\n".join([self.verdict.line, self.verdict.next_step, *rows, *(f"note: {note}" for note in self.notes)])


def measured_photos(
    job: Job,
    panels: dict[str, Panel],
    photos: Sequence[Source],
    stated: Stated,
    promise: Promise,
    line_nm: float | None,
    unused: Sequence[str],
    progress: Progress,
) -> PhotoMeasurement:
    """Fit one die and its camera to photographs.

    Args:
        unused: sentences on what of the job has no use.

    Raises:
        JobError: MF105 for several dies, or light of other colours than red, green and blue; as
            :func:`maskfab.camera.photo.read_photo`.
    """
    if len(panels) > 1:
        cure = f"Name the one that stood before the camera (--die): {', '.join(panels)}"
        raise JobError("MF105", f"photographs tell of one die, and there are {len(panels)}", where="die", cure=cure)
    ((die, panel),) = panels.items()
    camera = job.camera if line_nm is None else replace(job.camera, wavelengths_nm=(line_nm,))
    pixels = square_pixels(camera.pixel_um)
    half_um = float(abs(pixels[0].x_um).max())
    bands = () if job.scene is None else job.scene.bands
    light, way = light_of(("B", "G", "R"), job.camera, bands, half_um, line_nm), way_round(None, job)
    records, notes = [], [f"Assumed: the die {stand_words(way)}, in the middle of the stop, and the job's camera."]
    for done, path in enumerate(photos):
        progress("photographs", done, len(photos))
        photo = read_photo(path, stated)
        noise, said = noise_of(photo.record, stated=photo.noise_stated)
        records.append((photo.record.values, noise))
        notes += [f"{photo.name}: {sentence}" for sentence in (*photo.told, *said)]
    found = photo_bench(DieImage.of(panel, way, camera, light, pixels), records, progress)
    notes.append(
        f"Widths were taken to be known to ±{WIDTH_KNOWN_UM:g} um (one standard deviation) beforehand, and defocus is "
        "told without its sign."
    )
    if len(photos) == 1:
        notes.append("Of one photograph errors are those of smooth scenes: further ones tell how far its own is not.")
    return PhotoMeasurement(die, found, _judged(die, panel, found, promise), job.digest, (*notes, *unused))


def _judged(die: str, panel: Panel, found: PhotoBench | None, promise: Promise) -> Verdict:
    more = "Give more photographs, of detail all over, in more light; or exposures of a point light, without --photos."
    if found is None:
        what = f"of at least {SIDE} pixels a side no square shows enough above its noise."
        return Verdict(Answer.CANNOT_TELL, what, "nothing seen", 0.0, more)
    seen = f"log-likelihood {found.gain:.0f}, where {found.expected:.0f} ± {found.deviation:.0f} is expected"
    if not found.gain > _SHOWN * found.expected > 0:
        check = "Check die, camera, pixel and focal length against the job. " + more
        return Verdict(Answer.CANNOT_TELL, f"die {die} is not what the photographs show: {seen}.", "die", 0.0, check)
    width_um, bias, half = panel.dot_nm * UM_PER_NM, found.values[BIAS], found.errors[BIAS] * SURE / NORMAL_95
    kept, words = promise.kept(width_um, bias, half), promise.words(width_um)
    number = f"CD {bias:+.2f} ± {half:.2f} um (99.9 %)"
    if kept is None:
        what = f"die {die} is seen ({seen}), but {number} is too wide to hold it against {words}."
        return Verdict(Answer.CANNOT_TELL, what, "interval holds the limit", 1.0, more + " Restore by fitted_psf.exr.")
    if kept:
        return Verdict(
            Answer.ACCEPT, f"die {die} is as drawn, {number}, within {words}.", None, 1.0, "Nothing has to be done."
        )
    what = f"die {die} is not as drawn: {number}, beyond {words}."
    return Verdict(
        Answer.REJECT, what, None, 1.0, "Capture a point light through it, and hold the plate against the order."
    )
