"""A finished output directory checked: again from its files alone, or byte against byte, made once more from its job.

Any mask file can be held against a job, too. Which rows repeat within the noise of photographs only, and which work
makes a file, tells :mod:`maskfab.base.findings`.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from jinja2 import TemplateError

from maskfab.base import __version__, provenance
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import InputError, JobError, MissingPackageError, OutputError
from maskfab.base.files import suffix_of
from maskfab.base.findings import maker, origins
from maskfab.base.folders import (
    APPENDIX,
    JOB_COPY,
    NUMBERS,
    OVERVIEW,
    PAGE,
    PRINT,
    REPORT,
    RESULT_MARK,
    TIMES,
    VIEW,
    put_back,
    read_manifest,
)
from maskfab.base.model import CIRCUIT, EMITTERS, OUTLINE, WIRES, Plate, Quantity, WrittenFile
from maskfab.base.processes import SerialExecutor
from maskfab.base.provenance import sha256_of_file
from maskfab.base.work import Progress, one_thread, silent
from maskfab.display.feasibility import PlateWithDisplays, displays
from maskfab.findings.foreign import Foreign, How, check_foreign, only_die
from maskfab.findings.optics import layout_as_seen, plate_as_seen
from maskfab.mask.comparison.alignment import Alignment, LayersRead, StatedLayers
from maskfab.mask.comparison.files import read_back
from maskfab.mask.composition import compose
from maskfab.mask.formats.exr import check_psf_file
from maskfab.mask.formats.picture import IMAGE_SUFFIXES
from maskfab.mask.formats.table import LAYOUT_SUFFIXES
from maskfab.mask.houses.files import PlateFiles
from maskfab.mask.houses.profiles import shop_of
from maskfab.mask.job import Job, load_job
from maskfab.mask.judge.verdict import asked, judged
from maskfab.mask.layout import clear_shapes, plate_layout
from maskfab.mask.raster import light_box, sees_light
from maskfab.mask.sandbox import bounded
from maskfab.optics.metrics import fast_lens
from maskfab.report.documents.die import DOCUMENT as MEASURED
from maskfab.report.documents.die import measured_beside
from maskfab.report.documents.numbers import numbers_text
from maskfab.report.documents.shape import Document
from maskfab.report.pages import differences
from maskfab.report.pages.appendix import appendix_page
from maskfab.report.pages.page import html_page
from maskfab.report.pages.viewer import shown_run, viewer_page
from maskfab.report.verdicts import Verdicts
from maskfab.runs.pipeline import run
from maskfab.runs.plate_files import auxiliary_files, check_packages, draw_files, psfs_as_files, shop_quantities
from maskfab.runs.result import PlateFindings, die_quantities
from maskfab.runs.stages import (
    begin_photographs,
    executor_of,
    expand_photographs,
    measure_dies,
    measure_process,
    measure_scenes,
    plan_scenes,
)

_PHOTOGRAPHS = "other noise in photographs, of which a last bit of light may draw another photon"
_SCHEMA = "report_schema"
_PLACES = (("wavelength_nm", "nm"), ("level_db", "dB"))
_SAME = 1e-6
"""Relative difference that another machine's arithmetic may make to a number well above the rounding floor."""


@dataclass(frozen=True)
class Verified:
    """A finished directory checked again."""

    checks: tuple[Quantity, ...]
    verdicts: Verdicts

    @classmethod
    def of(
        cls, checks: Sequence[Quantity], built: PlateWithDisplays | None = None, reference: str | None = None
    ) -> Verified:
        """From the checks, and from the plate with its displays and the die that others are compared with, where it
        could be laid out again."""
        displays, dies = ({}, 0) if built is None else (built.displays, len(built.plate.dies))
        return cls(tuple(checks), Verdicts.of(checks, displays, dies, reference))


@one_thread
def verify(directory: str | Path, progress: Progress = silent) -> Verified:
    """Repeat every check of an output directory: hashes, geometry, optics, and the numbers of its report.

    A file that changed, is missing or cannot be read is a failed check that names it; so is a polygon that moved, and a
    mask file that the run did not write. Other files that it did not write are notes, whose ``passed`` is None.

    Raises:
        OutputError: MF403 if the directory is not one that maskfab finished.
        MissingPackageError: MF152 for files that this installation could not read back.
    """
    folder = Path(directory)
    put_back(Path(os.path.realpath(folder)))
    manifest = read_manifest(folder)
    checks = [*_hashes(folder, manifest), *_unlisted(folder, manifest)]
    try:
        job, bare, built, made = _drawn_again(folder, str(manifest["maskfab_version"]), progress)
        of_shop = shop_quantities(job, made)
    except MissingPackageError:
        raise
    except InputError as error:
        return Verified.of([*checks, _failed("job", f"{JOB_COPY} cannot be used: {error}")])
    plate = built.plate
    checks += fast_lens(job.camera)
    checks.append(_equal("job_hash", job.digest, manifest.get("job_hash"), f"hash of {JOB_COPY} against the manifest"))
    with executor_of(job) as executor:
        photographs = begin_photographs(job, bare, executor)
        refused: list[tuple[str, InputError]] = []
        back = read_back(made, folder, progress, refused)
        checks += [_failed("readable", f"{name}: {error}") for name, error in refused]
        trips, read = back.trips, [*back.quantities, *made.account(), *of_shop]
        checks += [quantity for quantity in read if quantity.passed is not None and quantity.die is None]
        if not trips:
            return Verified.of(checks, built, job.compared_with)
        seen = [
            die
            for die in plate.dies
            if sees_light(die, job.camera.stop, clear_shapes(trips[0].layout, light_box(die, job.camera.stop)))
        ]
        lit = plate_as_seen(job, replace(plate, dies=tuple(seen)))
        layout = layout_as_seen(job, trips[0].layout)
        optics = measure_dies(lit, job.camera, layout, progress, None, job.blank, executor)
        for psf in psfs_as_files(job, made, optics, str(manifest["maskfab_version"])):
            try:
                read += check_psf_file(psf, folder)
            except InputError as error:
                refused.append((psf.name, error))
                checks.append(_failed("readable", f"{psf.name}: {error}"))
        scenes = measure_scenes(job, lit, plan_scenes(job, lit, progress), layout, progress, None, executor)
        for measured in (
            *(die_quantities(item, read, job) for item in optics),
            *(scene.quantities for scene in scenes),
        ):
            checks += [quantity for quantity in measured if quantity.passed is not None]
        blind = [die.name for die in plate.dies if die not in seen]
        checks += [quantity for quantity in read if quantity.passed is not None and quantity.die in blind]
        checks += [
            _failed("optics", f"{trips[0].path.name}: nothing of {name} is clear before the stop") for name in blind
        ]
        beside = None
        if any(file["path"] == MEASURED for file in manifest["files"]):
            try:
                beside = measured_beside(job)
            except InputError as error:
                refused.append((MEASURED, error))
                checks.append(_failed("readable", f"{MEASURED}: {error}"))
        if not (blind or refused) and all(trip.xor_area_um2 == 0 for trip in trips):
            # Of files that differ from the design the numbers differ as well; what differs is told above.
            process = measure_process(job, lit, progress, None, executor)
            changes = expand_photographs(job, lit, progress, None, executor)
            findings = PlateFindings(
                job, built, read, optics, scenes, photographs.result(progress), process, changes, beside
            )
            checks += _made_again(folder, manifest, findings, executor)
    return Verified.of(checks, built, job.compared_with)


def _drawn_again(folder: Path, version: str, progress: Progress) -> tuple[Job, Plate, PlateWithDisplays, PlateFiles]:
    """The job of a folder, its plate without displays and with them, and its files as that version drew them."""
    job = load_job(folder / JOB_COPY)
    check_packages(job)
    # A later version would sign its plates differently, which is no fault of this one.
    bare = compose(job.spec, job.openings, job.signature.replace(__version__, version, 1), where=job.where)
    with executor_of(job) as executor:
        # A run takes its photographs beside its displays, before these are there.
        built = displays(job, bare, progress, executor=executor)
    return job, bare, built, draw_files(job, built.plate, version, displays=built.displays)


def _made_again(
    folder: Path, manifest: Mapping[str, Any], findings: PlateFindings, executor: SerialExecutor
) -> Iterator[Quantity]:
    """Report, page and pictures of a folder against the same made again."""
    now = findings.document(findings.report(_listed(manifest), {}))
    now["maskfab_version"] = manifest["maskfab_version"]
    rows = list(_reported(folder, now))
    yield from rows
    alike = manifest["maskfab_version"] == __version__ and manifest.get("versions") == provenance.versions()
    alike = alike and not any(row.name == _SCHEMA for row in rows)
    from maskfab.runs.drawing import draw_pictures  # slow to load

    overview, pictures = draw_pictures(findings, now, executor)
    for name, differs in (
        *_aids_differ(folder, findings),
        *_pages_differ(folder, manifest, now, pictures, held=all(row.passed is not False for row in rows)),
        (OVERVIEW, "" if differences.alike_images(_bytes(folder / OVERVIEW), overview) else "it shows something else"),
    ):
        yield _again(name, differs, judged=alike and differs != _PHOTOGRAPHS)


@one_thread
def verify_file(
    path: Path, job: Job, die: str | None = None, how: How | None = None, progress: Progress = silent
) -> Foreign:
    """Any mask file held against a job, or against one of its dies, within limits of time and memory.

    The plate that it is compared with is held against the job, too.

    Raises:
        SourceError, JobError: as :func:`maskfab.findings.foreign.check_foreign`; MF322 beyond limits.
    """
    if job.spec.data_bias_nm:
        what = "files from elsewhere are held against designs as drawn, and this job has its data biased"
        cure = 'Verify the directory or the package that holds the file, or hold it against a job of bias = "none"'
        raise JobError("MF128", what, where=f"{job.where}: order.bias", cure=cure)
    job.check_window()
    house = shop_of(job.spec, job.where)
    plate, drawing = job.plate(), job.spec.export
    # A design holds what is clear, whatever tone the job's own files have.
    plan = replace(asked(job.spec, file=job.file), dark=False)
    opinion = tuple(row for row in judged(plate_layout(plate), "the design", plan) if die in (None, row.die))
    stated = drawing is not None and "max_vertices" in drawing.model_fields_set

    def checked(tell: Progress) -> tuple[Alignment, tuple[Quantity, ...], LayersRead]:
        foreign = check_foreign(
            plate if die is None else only_die(plate, die),
            job.camera,
            job.spec.limits,
            path,
            how,
            tell,
            blank=job.blank,
            max_vertices=drawing.max_vertices if drawing is not None and stated else None,
            ordered=StatedLayers()
            if house is None
            else StatedLayers(house.layer_names, house.polygons.holes == "layer"),
        )
        return foreign.alignment, foreign.quantities, foreign.layers

    alignment, quantities, layers = bounded(
        path, checked, progress, kind=tuple[Alignment, tuple[Quantity, ...], LayersRead]
    )
    return Foreign(path, alignment, None, (*quantities, *_display_layers(job, layers, path), *opinion), layers)


def _display_layers(job: Job, layers: LayersRead, path: Path) -> Iterator[Quantity]:
    """Whether a file that has layers for people has those of the display, too; others have what is written alone."""
    spec, there = job.spec, {word for label in layers.passed_over for word in label.split()}
    asked = [
        *(EMITTERS if spec.emitters else ()),
        *([CIRCUIT] if spec.circuits else ()),
        *(WIRES if spec.wires else ()),
    ]
    lacking = [layer.name for layer in asked if there.isdisjoint((layer.name, f"{layer.number}/{layer.datatype}"))]
    if asked and OUTLINE.name in there:
        method = f"layers of the display that the job asks for, and {path.name} has not: {', '.join(lacking) or 'none'}"
        yield Quantity("layer_display", len(lacking), method, limit=0, passed=not lacking)


def _aids_differ(folder: Path, findings: PlateFindings) -> Iterator[tuple[str, str]]:
    """Each of the smaller files, and how it differs from the same made again; empty if it does not."""
    with tempfile.TemporaryDirectory(prefix="maskfab-verify-") as aside:
        for name, (_, write) in auxiliary_files(findings.job, findings.plate, findings.measured).items():
            write(Path(aside) / name)
            yield name, "" if _bytes(folder / name) == (Path(aside) / name).read_bytes() else "its bytes differ"


def _pages_differ(
    folder: Path, manifest: Mapping[str, Any], now: Document, pictures: Mapping[str, Mapping[str, str]], *, held: bool
) -> Iterator[tuple[str, str]]:
    """Pages and table against those of the pictures and the report made again; earlier versions wrote fewer of them."""
    there = {file["path"] for file in manifest["files"]}
    versions = manifest.get("versions")
    made_with = versions if isinstance(versions, Mapping) else None
    try:
        document = json.loads((folder / REPORT).read_text(encoding="utf-8")) if held else now
    except (OSError, ValueError, RecursionError):
        document = now
    pages: dict[str, Callable[..., str]] = {
        PAGE: partial(html_page, made_with=made_with, view=VIEW in there),
        APPENDIX: partial(appendix_page, view=VIEW in there),
    }
    for name in (each for each in pages if each in there):
        try:
            page = pages[name](document, pictures)
            parts = list(differences.differences((folder / name).read_text(encoding="utf-8"), page, pictures))
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError, TemplateError) as error:
            yield name, f"it cannot be compared: {error!r}"
            continue
        faults = [part for part in parts if part != differences.NOISE]
        yield name, f"other {', '.join(faults)}" if faults else _PHOTOGRAPHS if parts else ""
    if NUMBERS in there:
        yield NUMBERS, "" if _bytes(folder / NUMBERS) == numbers_text(document).encode() else "its bytes differ"
    if VIEW in there:
        # Of a file that it shows and that was changed is told by its hash.
        with suppress(OutputError):
            view = viewer_page(shown_run(folder, report=document))
            yield VIEW, "" if _bytes(folder / VIEW) == view.encode() else "its bytes differ"


def _bytes(path: Path) -> bytes:
    """Content of a file; nothing if it is not there, which is reported elsewhere."""
    return path.read_bytes() if path.is_file() else b""


def _again(name: str, differs: str, *, judged: bool) -> Quantity:
    """One row; without a verdict where other versions of what makes it may rightly make it otherwise, and do."""
    method = f"{name} made again"
    if differs and not judged:
        method += "; other versions wrote it, or it holds photographs, so that it is not judged"
    return Quantity(
        "made_again", differs or "the same", method, limit="the same", passed=not differs or (None, False)[judged]
    )


def _hashes(folder: Path, manifest: Mapping[str, Any]) -> Iterator[Quantity]:
    for file in manifest["files"]:
        path = folder / file["path"]
        if path.parent != folder or not path.is_file():
            yield _failed("sha256", f"{file['path']} is missing")
        else:
            yield _equal("sha256", provenance.sha256_of_file(path), file["sha256"], f"SHA-256 of {file['path']}")


def _unlisted(folder: Path, manifest: Mapping[str, Any]) -> Iterator[Quantity]:
    """Files that the run did not write: a mask among them could go to the house in place of the plate."""
    listed = {file["path"]: file.get("format") for file in manifest["files"]}
    drawn = {Path(name).suffix.lower() for name, kind in listed.items() if kind != "report"}
    masks = {*LAYOUT_SUFFIXES, *(drawn & {*IMAGE_SUFFIXES})}
    for path in sorted(entry for entry in folder.rglob("*") if entry.is_file()):
        name = path.relative_to(folder).as_posix()
        if name in listed or name in (RESULT_MARK, TIMES):
            continue
        if suffix_of(path) in masks:
            problem = f"{name} is a mask file that the run did not write: it could go to the house by mistake"
            yield Quantity("unlisted", name, problem, limit="", passed=False)
        else:
            yield Quantity("unlisted", name, f"{RESULT_MARK} does not know {name}")


def _listed(manifest: Mapping[str, Any]) -> tuple[WrittenFile, ...]:
    """The files that report.json lists: all but those made after it."""
    rows = [file for file in manifest["files"] if file.get("format") != "report"]
    return tuple(WrittenFile(row["path"], row.get("format", ""), row["bytes"], row["sha256"]) for row in rows)


def _reported(folder: Path, now: Document) -> Iterator[Quantity]:
    """Everything that report.json says against what is measured now; a note first on an earlier schema."""
    try:
        then = json.loads((folder / REPORT).read_text(encoding="utf-8"))
        stated, present = then["schema_version"], now["schema_version"]
        earlier = type(stated) is int and 1 <= stated < present
        expected = {**now, "schema_version": stated} if earlier else now
        changes = list(_differences(_lasting(expected), _lasting(then), ()))
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        yield _failed("report", f"{REPORT} cannot be read: {error}")
        return
    if earlier:
        reason = f"{REPORT} was written by schema {stated}, before the present {present}: all that it says is compared"
        yield Quantity(_SCHEMA, stated, reason)
    differences = [
        _equal("reported", new, old, f"{', '.join(place)}: measured now against {REPORT}")
        for place, new, old in changes
    ]
    yield from differences
    yield _equal("reported_differences", len(differences), 0, f"numbers and words of {REPORT} against those found now")


def _lasting(document: Mapping[str, Any]) -> dict[str, Any]:
    """A report without its former times, and without the name of the file that has them now."""
    return {key: value for key, value in document.items() if key not in ("time", "provenance")}


def _differences(now: Any, then: Any, place: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any, Any]]:
    """Where two documents differ, and what each says there."""
    now, then = _keyed(now), _keyed(then)
    if isinstance(now, dict) and isinstance(then, dict):
        for key in dict.fromkeys((*now, *then)):
            yield from _differences(now.get(key, "missing"), then.get(key, "missing"), (*place, key))
    elif isinstance(now, dict) or isinstance(then, dict):
        yield place, "there" if isinstance(now, dict) else now, "there" if isinstance(then, dict) else then
    elif not _alike(place, now, then):
        yield place, now, then


def _keyed(rows: Any) -> Any:
    """A list as a dictionary under its rows' names, so that a missing row is told by its name."""
    if not isinstance(rows, list):
        return rows
    keyed: dict[str, Any] = {}
    for number, row in enumerate(rows):
        key = _name_of(row) if isinstance(row, dict) else str(number)
        count = 1 + sum(other == key or other.startswith(f"{key} (") for other in keyed)
        keyed[key if count == 1 else f"{key} ({count})"] = row
    return keyed


def _name_of(row: Mapping[str, Any]) -> str:
    named = [str(row[key]) for key in ("die", "name", "path") if row.get(key) is not None]
    placed = [f"{row[key]:g} {unit}" for key, unit in _PLACES if row.get(key) is not None]
    return ", ".join([*named, *placed])


def _alike(place: Sequence[str], now: object, then: object) -> bool:
    """Whether two values are alike; in photographs (their section, a row of a die, a part of its design) a last bit of
    light may draw another photon."""
    if not (isinstance(now, float) and isinstance(then, int | float)):
        return now == then
    # Errors at the rounding floor differ between machines without meaning anything.
    most = max(_SAME * abs(then), 1e-8)
    if any(finding.noisy for part in place for word in part.split(", ") for finding in origins(word)):
        # The filter's constant is one of a few, and may be the next one.
        most = now / 2 if place[-1] == "epsilon" else differences.DECIBELS
    return abs(now - then) <= most


def _equal(name: str, value: Any, expected: Any, method: str) -> Quantity:
    return Quantity(name, value, method, limit=expected, passed=value == expected)


def _failed(name: str, problem: str) -> Quantity:
    return Quantity(name, "failed", problem, limit="ok", passed=False)


@dataclass(frozen=True)
class RemadeFile:
    """One file of a directory and the same made once more; ``difference`` in words, None if every byte is the same."""

    name: str
    stage: str
    difference: str | None


@dataclass(frozen=True, repr=False)
class Reproduction:
    """A directory made once more; ``versions`` that differ: program, then, now ("-" where there is none)."""

    directory: Path
    files: tuple[RemadeFile, ...]
    versions: tuple[tuple[str, str, str], ...]

    @property
    def passed(self) -> bool:
        """Whether every byte is the same."""
        return all(file.difference is None for file in self.files)

    def to_dict(self) -> dict[str, Any]:
        """Files and versions."""
        return {
            "directory": str(self.directory),
            "reproduced": self.passed,
            "files": [vars(file) for file in self.files],
            "versions": [{"name": name, "then": then, "now": now} for name, then, now in self.versions],
        }

    def __str__(self) -> str:
        width = max(len(file.name) for file in self.files)
        lines = [
            f"{file.name.ljust(width)}  {'same bytes' if file.difference is None else f'differs: {file.difference}'}"
            for file in self.files
        ]
        lines += [f"{name} was {then} then, and is {now} now" for name, then, now in self.versions]
        other = [file for file in self.files if file.difference is not None]
        stages = ", ".join(dict.fromkeys(file.stage for file in other))
        differ = "1 file differs" if len(other) == 1 else f"{len(other)} files differ"
        summary = "every byte is the same" if self.passed else f"{differ}, made by: {stages}"
        return "\n".join([*lines, f"{len(self.files)} files: {summary}"])

    def __repr__(self) -> str:
        return str(self)


@checked_arguments
def reproduce(directory: str | Path, *, progress: Progress = silent) -> Reproduction:
    """Make a finished output directory once more, from the job that lies in it, and compare every byte.

    Nothing is taken from the cache, and nothing is written into the directory. A file that was changed since differs as
    one does that other versions make otherwise; :func:`maskfab.runs.verification.verify` tells whether it was changed.
    """
    folder = Path(directory)
    put_back(Path(os.path.realpath(folder)))
    manifest = read_manifest(folder)
    names, versions = [str(row["path"]) for row in manifest["files"]], manifest.get("versions")
    if not isinstance(versions, Mapping) or JOB_COPY not in names:
        what = f"{folder} holds other results than a plate"
        raise OutputError("MF403", what, cure="Name a directory that maskfab run has made")
    then = {str(name): str(number) for name, number in versions.items()}
    with tempfile.TemporaryDirectory(prefix="maskfab-") as scratch:
        again = Path(scratch) / "again"
        run(folder / JOB_COPY, again, progress=progress, pdf=PRINT in names)
        every = sorted({*names, *(path.name for path in again.iterdir())} - {TIMES, RESULT_MARK})
        files = tuple(_compared(folder, again, name) for name in (*every, RESULT_MARK))
    now = provenance.versions()
    changed = (
        (name, then.get(name, "-"), now.get(name, "-"))
        for name in sorted(then.keys() | now.keys())
        if then.get(name) != now.get(name)
    )
    return Reproduction(folder, files, tuple(changed))


def _compared(folder: Path, again: Path, name: str) -> RemadeFile:
    stage = maker(name).name
    one, other = folder / name, again / name
    if not one.is_file() or not other.is_file():
        return RemadeFile(name, stage, "it is missing" if other.is_file() else "it is not made any more")
    if sha256_of_file(one) == sha256_of_file(other):
        return RemadeFile(name, stage, None)
    return RemadeFile(name, stage, _first_difference(one, other))


def _first_difference(one: Path, other: Path) -> str:
    """Where two files begin to differ: by the path of a value in JSON, by the byte in all others."""
    if one.suffix == ".json":
        try:
            then, now = (json.loads(path.read_bytes()) for path in (one, other))
        except (ValueError, RecursionError):
            return "it is no JSON any more"
        value = _first_value(then, now, "")
        if value is not None:
            return value
    then, now = one.read_bytes(), other.read_bytes()
    place = next((at for at, (a, b) in enumerate(zip(then, now, strict=False)) if a != b), min(len(then), len(now)))
    return f"from byte {place} on, of {len(then)} then and {len(now)} now"


def _first_value(then: object, now: object, where: str) -> str | None:
    if isinstance(then, Mapping) and isinstance(now, Mapping) and then.keys() == now.keys():
        pairs = [(f"{where}.{key}".lstrip("."), then[key], now[key]) for key in then]
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        pairs = [(f"{where}[{number}]", *both) for number, both in enumerate(zip(then, now, strict=True))]
    else:
        return None if then == now else f"{where or 'its keys'}: {_short(then)} then, {_short(now)} now"
    return next((difference for key, a, b in pairs if (difference := _first_value(a, b, key)) is not None), None)


def _short(value: object, most: int = 60) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= most else f"{text[:most]}..."
