"""The files of a plate: refused before any work, drawn, written, and read back.

Beside the mask files lie auxiliary ones: markers of the plate's rules, KLayout's colours, and the resolved job.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from maskfab.base import __version__, provenance, resources
from maskfab.base.effort import Costs
from maskfab.base.effort import measured as effort_of
from maskfab.base.errors import InternalError, SourceError
from maskfab.base.folders import APPENDIX, JOB_COPY, NUMBERS, OVERVIEW, PAGE, REPORT, RESULT_MARK, TIMES, VIEW
from maskfab.base.model import DieOptics, Plate, Quantity, WrittenFile
from maskfab.base.processes import release_memory
from maskfab.base.work import Progress
from maskfab.display.emitter_rules import Verdict
from maskfab.display.feasibility import Feasibility
from maskfab.findings.bands import ProcessSpread, check_spread
from maskfab.job.sections import ExportSection
from maskfab.job.shop import Shop
from maskfab.job.values import PICTURES, PLATE_BITMAPS, FileFormat
from maskfab.mask.comparison.files import ReadBack, read_back
from maskfab.mask.design_rules import RuleResult
from maskfab.mask.formats.exr import PsfFile, psf_files
from maskfab.mask.formats.picture import check_pixels
from maskfab.mask.formats.plate_bitmap import check_dots, check_plate_bitmap
from maskfab.mask.formats.table import FORMATS, require_packages
from maskfab.mask.houses.adaptation import ordered_blank, written_formats
from maskfab.mask.houses.files import PlateFiles, check_plotter, check_polygons, files_of_job, plotted_dpi
from maskfab.mask.houses.findings import check_written
from maskfab.mask.houses.order import check_ordered
from maskfab.mask.houses.profiles import shop_of
from maskfab.mask.job import Job
from maskfab.mask.judge.displays import Answer
from maskfab.mask.judge.verdict import asked
from maskfab.mask.layout import plate_names
from maskfab.mask.plate_rules import check_plate, limits_as_rules, write_markers
from maskfab.mask.writer import check_bias, check_process
from maskfab.report.documents.die import DOCUMENT as MEASURED
from maskfab.report.documents.die import Beside

MANIFEST_VERSION = 1
MAX_MARKERS = 1000
"""Violations of a rule on a die that the markers place; all are counted."""


def draw_files(
    job: Job, plate: Plate, version: str = __version__, *, displays: Mapping[str, Feasibility] | None = None
) -> PlateFiles:
    """The files that a job's plate becomes, and what they are held against; the optics come from the first.

    Args:
        displays: what was found of the display of each die, which the plate shows; None for a plate without.
    """
    shop = named_shop(job)
    made = files_of_job(plate, job.spec, [job.signature, plate.title], shop)
    answers = None if displays is None else {die: _answer(found) for die, found in displays.items()}
    return replace(made, asked=asked(job.spec, shop, file=job.file, version=version, answers=answers))


def _answer(found: Feasibility) -> Answer:
    """Finding for a pixel, for the judge, which lays it over the die on its own."""
    circuits, wires = found.circuits, found.wiring
    parts = {
        "emitters": found.emitters is not None and found.footprint.verdict is Verdict.FITS and not found.broken,
        "circuits": circuits is not None and circuits.verdict is Verdict.FITS and not circuits.broken,
        "wires": wires is not None and wires.verdict is Verdict.FITS,
    }
    return Answer(
        found.emitters,
        () if circuits is None else circuits.boxes,
        () if wires is None else wires.tracks,
        () if wires is None or wires.laid is None else tuple((lines.axis, lines.paths) for lines in wires.laid),
        frozenset(part for part, fits in parts.items() if fits),
    )


def write_files(
    job: Job,
    made: PlateFiles,
    folder: Path,
    progress: Progress,
    measured: Beside | None = None,
    costs: Costs | None = None,
) -> tuple[WrittenFile, ...]:
    """Write the files of a plate, and those of :func:`auxiliary_files`; ``costs`` are told what each format takes."""
    steps: dict[str, tuple[str, Callable[[Path], object]]] = {
        **{product.name: (product.form.title, product.write) for product in made.products},
        **auxiliary_files(job, made.plate, measured),
    }
    dies = {product.name: made.plate.dies.index(product.die) for product in made.products if product.die is not None}
    formats = {product.name: product.form.name for product in made.products}
    # Die by die, for what its formats make of it alike is held no longer than it is written.
    for done, name in enumerate(sorted(steps, key=lambda name: dies.get(name, -1))):
        progress("write files", done, len(steps))
        with effort_of() as effort:
            steps[name][1](folder / name)
        if costs is not None and name in formats:
            costs.wrote(formats[name], effort)
        release_memory()
    progress("write files", len(steps), len(steps))
    return tuple(provenance.file_record(folder, folder / name, kind) for name, (kind, _) in steps.items())


def read_own(made: PlateFiles, folder: Path, progress: Progress, costs: Costs | None = None) -> ReadBack:
    """The files of a folder read back, of a run that wrote them and of one that took them from the cache."""
    try:
        return read_back(made, folder, progress, costs=costs)
    except SourceError as error:
        if error.code != "MF303":
            raise
        what = f"a mask file that was just written cannot be read back: {error.what}"
        raise InternalError("MF324", what, where=error.where, cure="Please report this with the job file") from error


def auxiliary_files(
    job: Job, plate: Plate, measured: Beside | None = None
) -> dict[str, tuple[str, Callable[[Path], object]]]:
    """Auxiliary files of a plate, title and writer: markers of its rules, KLayout's colours, the resolved job, and the
    measurement beside it, which is then beside the job that is kept."""
    more = {} if measured is None else {MEASURED: ("measurement", lambda path: path.write_bytes(measured.content))}
    return {
        **more,
        f"{plate.name}.lyrdb": (
            "KLayout markers",
            lambda path: write_markers(check_rules(job, plate), plate_names(plate).top, path),
        ),
        "layers.lyp": (
            "KLayout layer properties",
            lambda path: shutil.copyfile(resources.path("export_templates/layers.lyp"), path),
        ),
        JOB_COPY: ("resolved job", lambda path: path.write_text(job_text(job), encoding="utf-8")),
    }


def job_text(job: Job) -> str:
    """The resolved job, as a folder keeps it."""
    return json.dumps(job.spec.dump(), indent=1) + "\n"


def psfs_as_files(
    job: Job, made: PlateFiles, optics: Sequence[DieOptics], version: str = __version__
) -> tuple[PsfFile, ...]:
    """The PSFs of the report as files, if the job asks for EXR: they need what is measured in the files before them."""
    if "exr" not in made.formats:
        return ()
    return psf_files(job, made.plate, optics, made.products[0].name, version)


def write_psfs(psfs: Sequence[PsfFile], folder: Path) -> tuple[WrittenFile, ...]:
    """Write PSFs beside the files that they were measured in."""
    for psf in psfs:
        psf.write(folder / psf.name)
    return tuple(provenance.file_record(folder, folder / psf.name, FORMATS["exr"].title) for psf in psfs)


def write_manifest(job: Job, files: Sequence[WrittenFile], folder: Path) -> None:
    """Write the manifest of a finished folder: hashes of all its files, and versions of what made them."""
    names = (REPORT, PAGE, APPENDIX, NUMBERS, OVERVIEW, *((VIEW,) if (folder / VIEW).exists() else ()))
    reports = [provenance.file_record(folder, folder / name, "report") for name in names]
    manifest = {
        "schema_version": MANIFEST_VERSION,
        "maskfab_version": __version__,
        "job_hash": job.digest,
        "seeds": job.seeds,
        "provenance": TIMES,
        "versions": provenance.versions(),
        "files": [vars(file) for file in (*files, *reports)],
    }
    (folder / RESULT_MARK).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")


def check_rules(job: Job, plate: Plate) -> tuple[RuleResult, ...]:
    """Corners that only touch, and what is narrower than the job's limits, on the whole plate."""
    return check_plate(plate, limits_as_rules(job.spec.limits), most=MAX_MARKERS)


def named_shop(job: Job) -> Shop | None:
    """The mask house that the job names; None if it names none."""
    return shop_of(job.spec, job.where)


def shop_quantities(job: Job, made: PlateFiles) -> tuple[Quantity, ...]:
    """The rules of the mask house that the job names, each a check of the files as drawn; none if it names none."""
    shop = named_shop(job)
    if shop is None:
        return ()
    broken = check_written(made.figures, shop, made.formats, ordered_blank(job.spec))
    # What dots do to edges are rows of their own, with or without a house.
    plotter = check_plotter(made.plate, job.spec, shop, made.formats)
    dots = (row for row in plotter if row.rule != "edge_error")
    return tuple(
        row.quantity(shop.name) for row in check_ordered((*broken, *dots), job.spec, made.plate, made.plate, shop)
    )


def process_spread(job: Job) -> ProcessSpread:
    """Standard deviations of the job's process over the displays that are made; zeros where it states none."""
    stated = None if job.spec.process is None else job.spec.process.spread
    return ProcessSpread() if stated is None else ProcessSpread(stated.bias or 0.0, stated.radius or 0.0)


def check_processes(job: Job, plate: Plate) -> None:
    """Refuse a [process] that the dots of a die do not bear, or biased data of it, before anything is drawn."""
    if job.spec.written is not None:
        for die in plate.dies:
            place = f"{job.where}: process, die {die.name}"
            check_process(job.spec.written, die.panel, place)
            check_spread(job.spec.written, process_spread(job), die.panel, place)
    if job.spec.data_bias_nm:
        check_bias(plate, job.spec.data_bias_nm, f"{job.where}: process.cd_bias")


def check_pictures(job: Job, plate: Plate, formats: Sequence[FileFormat] | None = None) -> None:
    """Refuse pixels and dots that are larger than the smallest feature of a die, dots of which there are too many, and
    either of biased data, before anything is drawn.

    Raises:
        JobError: MF104, MF128.
        OutputError: MF415.
    """
    section, shop = job.spec.export or ExportSection(), named_shop(job)
    written = written_formats(section, shop) if formats is None else formats
    if not set(PICTURES).isdisjoint(written):
        check_pixels(plate.dies, section.dots_per_um, job.where)
    dpi = plotted_dpi(section, shop)
    check_polygons(job.spec, written, job.where)
    bitmaps = [bitmap for bitmap in PLATE_BITMAPS if bitmap in written]
    if dpi is not None and bitmaps:
        check_dots(plate.dies, dpi, job.where)
        for bitmap in bitmaps:
            check_plate_bitmap(plate, bitmap, dpi, plate.name + FORMATS[bitmap].tail)


def check_packages(job: Job) -> None:
    """Refuse formats that this installation could not write, or not read back."""
    formats = written_formats(job.spec.export or ExportSection(), named_shop(job))
    require_packages(formats, where=f"{job.where}: export.formats", otherwise="leave these formats out")
