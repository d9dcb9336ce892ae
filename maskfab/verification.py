"""A finished output directory checked again from its files alone, and any mask file held against a job."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from jinja2 import TemplateError

from maskfab import provenance
from maskfab.base import __version__
from maskfab.comparison.files import read_back
from maskfab.comparison.foreign.alignment import Alignment
from maskfab.comparison.foreign.foreign_mask import Foreign, How, check_foreign, only_die
from maskfab.comparison.foreign.layer_choice import LayersRead, StatedLayers
from maskfab.comparison.psf_files import check_psf_file
from maskfab.comparison.roundtrip import RoundTrip
from maskfab.display.place import Populated
from maskfab.errors import InputError, JobError
from maskfab.files.finished import JOB_COPY, PAGE, REPORT, RESULT_MARK, TIMES, read_manifest
from maskfab.files.staging import put_back
from maskfab.geometry.plate_layout import clear_shapes, plate_layout
from maskfab.job import Job, load_job
from maskfab.judge.verdict import asked, judged
from maskfab.mask_shops.profiles import shop_of
from maskfab.measurement.apertures import light_box, sees_light
from maskfab.measurement.verdicts import Verdicts
from maskfab.measurement.view import layout_as_seen, plate_as_seen
from maskfab.model import Camera, Die, Quantity, WrittenFile
from maskfab.optics.numbers.metrics import fast_lens
from maskfab.pipeline import (
    OVERVIEW,
    Findings,
    aids,
    begin_photographs,
    crew_of,
    die_quantities,
    draw_files,
    draw_pictures,
    expand_photographs,
    measure_dies,
    measure_process,
    measure_scenes,
    plan_scenes,
    psfs_as_files,
    shop_quantities,
)
from maskfab.plate.plate import compose
from maskfab.processes import Alone
from maskfab.progress import Progress, silent
from maskfab.readers.image_mask import IMAGE_SUFFIXES
from maskfab.readers.layout_file import LAYOUT_SUFFIXES
from maskfab.readers.sandbox.bounded import bounded
from maskfab.report.documents import report_data
from maskfab.report.documents.measured_data import measured_beside
from maskfab.report.measured_files import DOCUMENT as MEASURED
from maskfab.report.page import differences, html
from maskfab.threads import one_thread

_PHOTOGRAPHS = "other noise in photographs, of which a last bit of light may draw another photon"
_SCHEMA = "report_schema"
_FORMER_UNITS = {"um^2": "um2"}
"""Units as reports of earlier versions spell them."""
_PLACES = (("wavelength_nm", "nm"), ("level_db", "dB"))
_PHOTOGRAPHED, _LAID, _JUDGED = 3, 4, 5
"""Schemas of the first reports whose numbers of photographs are those of photographs, whose lines may be laid across a
panel, and which tell three verdicts."""
_SAME = 1e-6
"""Relative difference that another machine's arithmetic may make to a number well above the rounding floor."""


@dataclass(frozen=True)
class Verified:
    """A finished directory checked again.

    Attributes:
        checks: in the order in which they were made, notes among them.
        verdicts: what they come to.
    """

    checks: tuple[Quantity, ...]
    verdicts: Verdicts

    @classmethod
    def of(cls, checks: Sequence[Quantity], built: Populated | None = None) -> Verified:
        """From the checks, and from the plate with its displays, where it could be laid out again."""
        displays, dies = ({}, 0) if built is None else (built.found, len(built.plate.dies))
        return cls(tuple(checks), Verdicts.of(checks, displays, dies))


@one_thread
def verify(directory: str | Path, progress: Progress = silent) -> Verified:
    """Repeat every check of an output directory: hashes, geometry, optics, and the numbers of its report.

    A file that changed, is missing or cannot be read is a failed check that names it; so is a polygon that moved, and a
    mask file that the run did not write. Other files that it did not write are notes, whose ``passed`` is None.

    Raises:
        OutputError: MF403 if the directory is not one that maskfab finished.
    """
    folder = Path(directory)
    put_back(Path(os.path.realpath(folder)))
    manifest = read_manifest(folder)
    checks = [*_hashes(folder, manifest), *_unlisted(folder, manifest)]
    try:
        job = load_job(folder / JOB_COPY)
        # A later version would sign its plates differently, which is no fault of this one.
        signature = job.signature.replace(__version__, str(manifest["maskfab_version"]), 1)
        plate = compose(job.spec, job.openings, signature, where=job.where)
        with crew_of(job) as crew:
            built = job.displays_of(plate, progress, crew=crew)
        # A run takes its photographs beside its displays, before these are there.
        bare, plate = plate, built.plate
        made = draw_files(job, plate, str(manifest["maskfab_version"]))
        of_shop = shop_quantities(job, made)
    except InputError as error:
        return Verified.of([*checks, _failed("job", f"{JOB_COPY} cannot be used: {error}")])
    checks += fast_lens(job.camera)
    checks.append(_equal("job_hash", job.digest, manifest.get("job_hash"), f"hash of {JOB_COPY} against the manifest"))
    with crew_of(job) as crew:
        photographs = begin_photographs(job, bare, crew)
        refused: list[tuple[str, InputError]] = []
        back = read_back(made, folder, progress, refused)
        checks += [_failed("readable", f"{name}: {error}") for name, error in refused]
        trips, read = back.trips, [*back.quantities, *made.account(), *of_shop]
        checks += [quantity for quantity in read if quantity.passed is not None and quantity.die is None]
        if not trips:
            return Verified.of(checks, built)
        seen = [die for die in plate.dies if _sees_light(die, job.camera, trips[0])]
        lit = plate_as_seen(job, replace(plate, dies=tuple(seen)))
        layout = layout_as_seen(job, trips[0].layout)
        optics = measure_dies(lit, job.camera, layout, progress, None, job.blank, crew)
        for psf in psfs_as_files(job, made, optics, str(manifest["maskfab_version"])):
            try:
                read += check_psf_file(psf, folder)
            except InputError as error:
                refused.append((psf.name, error))
                checks.append(_failed("readable", f"{psf.name}: {error}"))
        scenes = measure_scenes(job, lit, plan_scenes(job, lit, progress), layout, progress)
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
            process = measure_process(job, lit, progress), expand_photographs(job, lit, progress, None, crew)
            found = Findings(job, built, read, optics, scenes, photographs.result(progress), *process, beside)
            checks += _made_again(folder, manifest, found, crew)
    return Verified.of(checks, built)


def _made_again(folder: Path, manifest: Mapping[str, Any], found: Findings, crew: Alone) -> Iterator[Quantity]:
    """Report, page and pictures of a folder against the same made again."""
    now = found.document(found.report(_listed(manifest), {}))
    now["maskfab_version"] = manifest["maskfab_version"]
    told = list(_reported(folder, now))
    yield from told
    alike = manifest["maskfab_version"] == __version__ and manifest.get("versions") == provenance.versions()
    alike = alike and not any(each.name == _SCHEMA for each in told)
    overview, pictures = draw_pictures(found, now, crew)
    for name, differs in (
        *_aids_differ(folder, found),
        *_page_differs(folder, now, pictures, held=all(each.passed is not False for each in told)),
        *_overview_differs(folder, overview),
    ):
        yield _again(name, differs, judged=alike and differs != _PHOTOGRAPHS)


@one_thread
def verify_file(
    path: Path, job: Job, die: str | None = None, how: How | None = None, progress: Progress = silent
) -> Foreign:
    """Any mask file held against a job, or against one of its dies, within limits of time and memory.

    The plate that it is compared with is held against the job, too.

    Raises:
        SourceError, JobError: as :func:`maskfab.comparison.foreign.foreign_mask.check_foreign`; MF322 beyond limits.
    """
    if job.spec.data_bias_nm:
        raise JobError(
            "MF128",
            "files from elsewhere are held against designs as drawn, and this job has its data biased",
            where=f"{job.where}: order.bias",
            cure='Verify the directory or the package that holds the file, or hold it against a job of bias = "none"',
        )
    job.check_window()
    house = shop_of(job.spec, job.where)
    plate, drawing = job.plate(), job.spec.export
    # A design holds what is clear, whatever tone the job's own files have.
    plan = replace(asked(job.spec), dark=False)
    opinion = tuple(row for row in judged(plate_layout(plate), "the design", plan) if die in (None, row.die))
    stated = drawing is not None and "max_vertices" in drawing.model_fields_set

    def checked(tell: Progress) -> tuple[Alignment, tuple[Quantity, ...], LayersRead]:
        found = check_foreign(
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
        return found.alignment, found.quantities, found.layers

    alignment, quantities, layers = bounded(
        path, checked, progress, kind=tuple[Alignment, tuple[Quantity, ...], LayersRead]
    )
    return Foreign(path, alignment, None, (*quantities, *opinion), layers)


def _aids_differ(folder: Path, found: Findings) -> Iterator[tuple[str, str]]:
    """Each of the smaller files, and how it differs from the same made again; empty if it does not."""
    with tempfile.TemporaryDirectory(prefix="maskfab-verify-") as aside:
        for name, (_, write) in aids(found.job, found.plate, found.measured).items():
            write(Path(aside) / name)
            yield name, "" if _bytes(folder / name) == (Path(aside) / name).read_bytes() else "its bytes differ"


def _page_differs(
    folder: Path, now: report_data.Document, pictures: Mapping[str, Mapping[str, str]], *, held: bool
) -> Iterator[tuple[str, str]]:
    """The page against the one of the pictures made again, and of the report, to its last digit if that held."""
    try:
        document = json.loads((folder / REPORT).read_text(encoding="utf-8")) if held else now
        page = html.html_page(document, pictures)
        found = list(differences.differences((folder / PAGE).read_text(encoding="utf-8"), page, pictures))
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError, TemplateError) as error:
        yield PAGE, f"it cannot be compared: {error!r}"
        return
    faults = [name for name in found if name != differences.NOISE]
    yield PAGE, f"other {', '.join(faults)}" if faults else _PHOTOGRAPHS if found else ""


def _overview_differs(folder: Path, made: bytes) -> Iterator[tuple[str, str]]:
    yield OVERVIEW, "" if differences.alike_images(_bytes(folder / OVERVIEW), made) else "it shows something else"


def _bytes(path: Path) -> bytes:
    """Content of a file; nothing if it is not there, which is reported elsewhere."""
    return path.read_bytes() if path.is_file() else b""


def _again(name: str, differs: str, *, judged: bool) -> Quantity:
    """One row; without a verdict where other versions of what makes it may rightly make it otherwise, and do."""
    told = f"{name} made again"
    if differs and not judged:
        told += "; other versions wrote it, or it holds photographs, so that it is not judged"
    return Quantity(
        "made_again", differs or "the same", told, limit="the same", passed=not differs or (None, False)[judged]
    )


def _sees_light(die: Die, camera: Camera, trip: RoundTrip) -> bool:
    return sees_light(die, camera.stop, clear_shapes(trip.layout, light_box(die, camera.stop)))


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
    for path in sorted(each for each in folder.rglob("*") if each.is_file()):
        name = path.relative_to(folder).as_posix()
        if name in listed or name in (RESULT_MARK, TIMES):
            continue
        if path.suffix.lower() in masks:
            problem = f"{name} is a mask file that the run did not write: it could go to the house by mistake"
            yield Quantity("unlisted", name, problem, limit="", passed=False)
        else:
            yield Quantity("unlisted", name, f"{RESULT_MARK} does not know {name}")


def _listed(manifest: Mapping[str, Any]) -> tuple[WrittenFile, ...]:
    """The files that report.json lists: all but those made after it."""
    rows = [file for file in manifest["files"] if file.get("format") != "report"]
    return tuple(WrittenFile(row["path"], row.get("format", ""), row["bytes"], row["sha256"]) for row in rows)


def _reported(folder: Path, now: report_data.Document) -> Iterator[Quantity]:
    """Everything that report.json says against what is measured now; notes first on an earlier schema or unit."""
    try:
        then = json.loads((folder / REPORT).read_text(encoding="utf-8"))
        stated, present = then["schema_version"], now["schema_version"]
        earlier = type(stated) is int and 1 <= stated < present
        expected = {**now, "schema_version": stated} if earlier else now
        found = list(_differences(_lasting(expected), _lasting(then), ()))
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        yield _failed("report", f"{REPORT} cannot be read: {error}")
        return
    if earlier:
        told = f"{REPORT} was written by schema {stated}, before the present {present}: all that it says is compared"
        yield Quantity(_SCHEMA, stated, told)
    renamed = [old for place, new, old in found if _former_unit(place, new, old)]
    if renamed:
        told = f"{REPORT} spells the unit of {len(renamed)} numbers as earlier versions did: it is not judged"
        yield Quantity("report_units", renamed[0], told)
    lapsed = set()
    for name, since, of, told in (
        ("report_photographs", _PHOTOGRAPHED, _of_photographs, "predicts photographs by a model"),
        ("report_wires", _LAID, _of_wires, "counts the wires of one pixel for all"),
        ("report_protocol", _LAID, _of_protocol, "does not name the protocol of designs"),
        ("report_verdicts", _JUDGED, _of_verdicts, "has one verdict for files, optics and displays"),
    ):
        places = [place for place, _, _ in found if earlier and stated < since and of(place)]
        if places:
            why = f"{REPORT} {told}, as earlier versions did: these numbers are not compared"
            yield Quantity(name, len(places), why)
        lapsed |= set(places)
    differences = [
        _equal("reported", new, old, f"{', '.join(place)}: measured now against {REPORT}")
        for place, new, old in found
        if not _former_unit(place, new, old) and place not in lapsed
    ]
    yield from differences
    yield _equal("reported_differences", len(differences), 0, f"numbers and words of {REPORT} against those found now")


def _of_photographs(place: Sequence[str]) -> bool:
    """Whether a place in a report tells of photographs: their section, a row of a die, or a part of its design."""
    return any(part.startswith("photograph") or "restored_" in part or part == "predicted_psnr" for part in place)


def _of_wires(place: Sequence[str]) -> bool:
    """Whether a place in a report tells of wires, or of an answer that rests on them."""
    answered = "display" in place and ("verdict" in place or "proofs" in place)
    return answered or any(part == "wires" or "wire_lines" in part for part in place)


def _of_protocol(place: Sequence[str]) -> bool:
    """Whether a place in a report tells by which protocol a die was designed."""
    return "design" in place and place[-1] == "protocol"


def _of_verdicts(place: Sequence[str]) -> bool:
    """Whether a place in a report tells of its three verdicts."""
    return place[0] == "verdicts"


def _former_unit(place: tuple[str, ...], now: object, then: object) -> bool:
    return place[-1] == "unit" and isinstance(now, str) and _FORMER_UNITS.get(now) == then


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
    elif not (_alike_photographs(place[-1], now, then) if _of_photographs(place) else _alike(now, then)):
        yield place, now, then


def _keyed(rows: Any) -> Any:
    """A list as a dictionary under its rows' names, so that a missing row is told by its name."""
    if not isinstance(rows, list):
        return rows
    keyed: dict[str, Any] = {}
    for number, row in enumerate(rows):
        key = _name_of(row) if isinstance(row, dict) else str(number)
        count = 1 + sum(known == key or known.startswith(f"{key} (") for known in keyed)
        keyed[key if count == 1 else f"{key} ({count})"] = row
    return keyed


def _name_of(row: Mapping[str, Any]) -> str:
    named = [str(row[key]) for key in ("die", "name", "path") if row.get(key) is not None]
    placed = [f"{row[key]:g} {unit}" for key, unit in _PLACES if row.get(key) is not None]
    return ", ".join([*named, *placed])


def _alike(now: object, then: object) -> bool:
    if isinstance(now, float) and isinstance(then, int | float):
        # Errors at the rounding floor differ between machines without meaning anything.
        return abs(now - then) <= max(_SAME * abs(then), 1e-8)
    return now == then


def _alike_photographs(what: str, now: object, then: object) -> bool:
    """Whether two numbers of photographs are alike, of which a last bit of light may draw another photon."""
    if isinstance(now, float) and isinstance(then, int | float):
        # The filter's constant is one of a few, and may be the next one.
        return abs(now - then) <= (now / 2 if what == "epsilon" else differences.DECIBELS)
    return now == then


def _equal(name: str, value: Any, expected: Any, method: str) -> Quantity:
    return Quantity(name, value, method, limit=expected, passed=value == expected)


def _failed(name: str, problem: str) -> Quantity:
    return Quantity(name, "failed", problem, limit="ok", passed=False)
