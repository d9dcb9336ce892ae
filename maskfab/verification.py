"""A finished output directory, checked again from its files alone."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from maskfab import provenance
from maskfab.errors import InputError, OutputError
from maskfab.export.staging import RESULT_MARK
from maskfab.geometry.region import plate_layout
from maskfab.layout.job import load
from maskfab.model import Quantity
from maskfab.pipeline import JOB_COPY, REPORT, die_quantities, mask_names, measure_dies
from maskfab.progress import Progress, silent
from maskfab.validate.roundtrip import RoundTrip, roundtrip

_SAME = 1e-6
"""Relative difference that another machine's arithmetic may make to a number well above the rounding floor."""


def verify(directory: str | Path, progress: Progress = silent) -> tuple[Quantity, ...]:
    """Repeat every check of an output directory: hashes, geometry, optics, and the numbers of its report.

    A file that changed, is missing or cannot be read is a failed check that names it; so is a polygon that moved.

    Raises:
        OutputError: MF403 if the directory is not one that maskfab finished.
    """
    folder = Path(directory)
    manifest = _manifest(folder)
    checks = list(_hashes(folder, manifest))
    try:
        job = load(folder / JOB_COPY)
    except InputError as error:
        return (*checks, _failed("job", f"{JOB_COPY} cannot be used: {error}"))
    checks.append(_equal("job_hash", job.digest, manifest.get("job_hash"), f"hash of {JOB_COPY} against the manifest"))
    plate = job.plate()
    design = plate_layout(plate)
    trips: list[RoundTrip] = []
    names = list(mask_names(plate))
    for done, name in enumerate(names):
        progress("read back", done, len(names))
        try:
            trips.append(roundtrip(plate, design, folder / name, dots=not trips))
        except InputError as error:
            checks.append(_failed("readable", f"{name}: {error}"))
    progress("read back", len(names), len(names))
    read = [quantity for trip in trips for quantity in trip.quantities()]
    checks += [quantity for quantity in read if quantity.passed is not None and quantity.die is None]
    if trips:
        optics = measure_dies(plate, job.camera, trips[0].layout, progress)
        measured = [quantity for item in optics for quantity in die_quantities(item, read, job.spec.limits)]
        checks += [quantity for quantity in measured if quantity.passed is not None]
        checks += _reported(folder, measured)
    return tuple(checks)


def _manifest(folder: Path) -> Mapping[str, Any]:
    try:
        manifest = json.loads((folder / RESULT_MARK).read_text(encoding="utf-8"))
        listed = manifest["files"]
        complete = all({"path", "sha256", "bytes"} <= file.keys() for file in listed)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise OutputError(
            "MF403", f"{folder} has no readable {RESULT_MARK}: {error}", cure="Name the --out of a finished maskfab run"
        ) from error
    if not complete:
        raise OutputError("MF403", f"{folder / RESULT_MARK} lacks hashes", cure="Run the job again")
    return dict(manifest)


def _hashes(folder: Path, manifest: Mapping[str, Any]) -> Iterator[Quantity]:
    for file in manifest["files"]:
        path = folder / file["path"]
        if path.parent != folder or not path.is_file():
            yield _failed("sha256", f"{file['path']} is missing")
        else:
            yield _equal("sha256", provenance.sha256_of_file(path), file["sha256"], f"SHA-256 of {file['path']}")


def _reported(folder: Path, measured: list[Quantity]) -> Iterator[Quantity]:
    """Every number of report.json against the same number measured now."""
    try:
        document = json.loads((folder / REPORT).read_text(encoding="utf-8"))
        kept = {
            (die["name"], q["name"], q.get("wavelength_nm"), q["method"]): q["value"]
            for die in document["dies"]
            for q in die["quantities"]
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        yield _failed("report", f"{REPORT} cannot be read: {error}")
        return
    for now in measured:
        then = kept.get((now.die, now.name, now.wavelength_nm, now.method), "missing")
        if not _alike(now.value, then):
            place = f"{now.die}, {now.name}" + (f", {now.wavelength_nm:g} nm" if now.wavelength_nm else "")
            yield _equal("reported", now.value, then, f"{place}: measured now against {REPORT}")
    yield _equal("reported_quantities", len(kept), len(measured), f"quantities of {REPORT} measured again")


def _alike(now: object, then: object) -> bool:
    if isinstance(now, float) and isinstance(then, int | float):
        # Errors at the rounding floor differ between machines without meaning anything.
        return abs(now - then) <= max(_SAME * abs(then), 1e-8)
    return now == then


def _equal(name: str, value: Any, expected: Any, method: str) -> Quantity:
    return Quantity(name, "", value, "", method, limit=expected, passed=value == expected)


def _failed(name: str, problem: str) -> Quantity:
    return Quantity(name, "", "failed", "", problem, limit="ok", passed=False)
