"""Dies as designed, in the form of a finished report: photographed and measured without a file that is written.

Numbers are those of the panels as designed, where a run has them of polygons that were written and read back; the two
differ by rounding, and the photographs by nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

from maskfab.base.model import Die, DieOptics, Mtf, Panel, Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.base.work import Progress, one_thread, silent
from maskfab.findings.photographs import Conditions, Photographs, Surroundings, photograph_die
from maskfab.job.camera import Camera
from maskfab.job.die import check_lens, check_pupil
from maskfab.job.sections import AssumedPlate
from maskfab.mask.job import Job
from maskfab.mask.panels import check_cover
from maskfab.mask.plate_rules import judged
from maskfab.optics import metrics
from maskfab.optics.lags import lag_table
from maskfab.optics.mtf import longest_lag_um, presampled_mtf, worst_directions
from maskfab.optics.pupil import cut, panel_aperture
from maskfab.report.documents.die import photographs_document
from maskfab.report.documents.report import FinishedReport, designed_document


@dataclass(frozen=True, eq=False)
class AsDesigned:
    """Dies of a job, measured and photographed as designed; ``optics`` of each at every wavelength of the camera."""

    report: FinishedReport
    optics: tuple[DieOptics, ...]


@one_thread
def as_designed(job: Job, name: str, progress: Progress = silent) -> AsDesigned:
    """Measure and photograph the dies of a job.

    Raises:
        JobError: MF114 for a panel smaller than the stop, MF115 for one too fine; MF140, MF141 for a sensor or a light
            that cannot be; of one that cannot be photographed the report says why.
    """
    conditions, around = Conditions.of(job, "camera"), Surroundings.of(job)
    panels = job.panels()
    for die, panel in panels.items():
        check_lens(job.camera, where=f"{job.where}: camera.stop")
        check_pupil(job.camera, panel.dot_nm / NM_PER_UM, where=f"{job.where}: {die}")
        check_cover(panel, job.camera.stop, die, where=f"{job.where}: camera.stop")
    optics, restored = [], {}
    for done, (die, panel) in enumerate(panels.items()):
        progress("photographs", done, len(panels))
        optics.append(_optics(die, panel, job))
        restored[die] = photograph_die(conditions, around, die, panel, False)
    progress("photographs", len(panels), len(panels))
    taken = Photographs(conditions, restored, None if job.spec.report is None else job.spec.report.reference)
    rows = {
        item.die.name: [judged(row, job.spec.limits) for row in (*item.quantities, *taken.quantities(item.die.name))]
        for item in optics
    }
    dies = [item.die for item in optics]
    document = designed_document(job.digest, dies, rows, job.camera, photographs_document(taken))
    # What Python assumed of a plate of panels is no difference of jobs.
    stated = None if isinstance(job.spec.plate, AssumedPlate) else job.spec.dump()
    return AsDesigned(FinishedReport(name, document, stated, True), tuple(optics))


def _optics(name: str, panel: Panel, job: Job) -> DieOptics:
    """Open ratio and MTF of a die, and its numbers."""
    camera, die = job.camera, Die(name, panel.opening.name, panel, (0, 0), max(panel.size_nm))
    pupil = cut(panel_aperture(panel, camera.stop.diameter_um / 2), camera.stop)
    table = lag_table(pupil, longest_lag_um(camera))
    mtfs = tuple(presampled_mtf(table, camera, line) for line in camera.wavelengths_nm)
    ratios = [
        Quantity("open_ratio", panel.open_ratio, "clear share of one cell of the design, exact", die=name),
        metrics.stop_open_ratio(pupil.energy_um2, camera, name, "clear area of the design in the stop over the stop's"),
    ]
    return DieOptics(die, (), mtfs, (*ratios, *_rows(mtfs, camera, job, name)))


def _rows(mtfs: tuple[Mtf, ...], camera: Camera, job: Job, name: str) -> list[Quantity]:
    found = [row for mtf in mtfs for row in metrics.mtf_quantities(mtf, camera.pixel_um, name)]
    frequencies = job.spec.frequencies_cy_per_mm
    return found + [row for mtf in mtfs for row in worst_directions(mtf, frequencies, name)]
