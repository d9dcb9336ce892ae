"""From a job to one zip for a mask shop: drawn to its format, checked by its rules, written, read back, certified."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from klayout import db

from maskfab import __version__, provenance
from maskfab.errors import InputError, JobError, OutputError, SourceError
from maskfab.export.cell_polygons import CUT, Figures, draw
from maskfab.export.dxf import DrawingStyle
from maskfab.export.outputs import MASK_TAILS, mask_writer
from maskfab.files.staging import check_file, write_bytes, write_text
from maskfab.geometry.plate_layout import DBU_UM, layer_info, plate_layout, region
from maskfab.job import Job, load
from maskfab.jobfile import is_table
from maskfab.jobfile import read as read_spec
from maskfab.jobfile.shop_profile import Format, Shop, parse_shop
from maskfab.model import CLEAR, Box, Plate, Quantity, WrittenFile
from maskfab.package.archive import MANIFEST, safe_stem, unpack, write_package
from maskfab.package.papers import JOB_COPY, PROFILE, Ordered, check_papers, check_profile, facts, papers
from maskfab.plate.plate import compose
from maskfab.progress import Progress, silent
from maskfab.readers.layout_file import find_cell, read_layout
from maskfab.readers.sandbox.bounded import bounded, library_errors, seconds_of
from maskfab.shops.adapt import blank_of, drawing_options, drawing_style, extent_nm, fitted
from maskfab.shops.judge import Finding, accepted, check_shop, extent
from maskfab.verify.foreign.extents import file_box
from maskfab.verify.roundtrip import compare

PACKED: tuple[Format, ...] = ("gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber")
"""Formats that a package can hold."""
_MASK_SUFFIXES = tuple(f".{MASK_TAILS[each].rpartition('.')[2]}" for each in PACKED)


@dataclass(frozen=True)
class Package:
    """Result of packing.

    Attributes:
        path: the zip; None if the house would refuse the plate or a file did not read back, so that none was written.
        findings: the house's rules.
        checks: what reading the files back has shown; empty if the house would refuse the plate.
        files: what is in the zip, the manifest excepted.
    """

    path: Path | None
    findings: tuple[Finding, ...]
    checks: tuple[Quantity, ...] = ()
    files: tuple[WrittenFile, ...] = ()


def pack(
    job: Job,
    shop: Shop,
    target: str | Path,
    formats: Sequence[Format] = (),
    *,
    force: bool = False,
    progress: Progress = silent,
) -> Package:
    """Make the package of a job for a shop.

    Args:
        job: a loaded job.
        shop: its profile.
        target: the zip to write; it appears when everything in it is complete, and only if every rule and check holds.
        formats: of the mask files; the shop's first if empty.
        force: replace an earlier file.
        progress: told where the work stands.

    Raises:
        OutputError: MF401 or MF402 if ``target`` cannot be written.
        JobError: MF105 for a target that is no .zip or a format that no package holds, and whatever laying out the job
            refuses.
    """
    zipped = Path(target)
    sent = tuple(dict.fromkeys(formats)) or tuple(each for each in shop.formats if each in PACKED)[:1]
    _check_target(zipped, force=force)
    for each in sent:
        if each not in PACKED:
            raise JobError("MF105", f"a package holds no {each}", cure=f"Choose among {', '.join(PACKED)}")
    whole = job.plate()
    plate = fitted(whole, shop)
    options = drawing_options(plate, shop)
    progress("rules", 0, 1)
    findings = check_shop(whole, shop, sent, options, blank_of(job.spec))
    progress("rules", 1, 1)
    if not accepted(findings):
        return Package(None, findings)
    figures, style = draw(plate, options), drawing_style(plate, shop)
    stem = safe_stem(plate.name)
    with _aside() as folder:
        names = _names(plate, sent)
        checks: list[Quantity] = []
        boxes: list[Box] = []
        for done, (name, kind) in enumerate(names.items()):
            progress("write and read back", done, len(names))
            mask_writer(figures, kind, [job.signature, plate.title], style)(folder / name)
            read = _read(folder / name)
            boxes.append(file_box(folder / name, read, style))
            checks += read_back(figures, folder / name, style, read)
        progress("write and read back", len(names), len(names))
        judged = tuple(check for check in checks if check.passed is not None)
        findings = _measured(findings, shop, boxes)
        if not (accepted(findings) and all(check.passed for check in judged)):
            return Package(None, findings, judged)
        masks = tuple(provenance.written(folder, folder / name, kind) for name, kind in names.items())
        made = papers(Ordered(job, shop, figures, job.signature, findings, judged, sent, masks))
        for name, content in made.items():
            write_bytes(folder / name, content)
        files = (*masks, *(provenance.written(folder, folder / name, "paper") for name in made))
        manifest = {**facts(job, shop, figures), "files": [vars(file) for file in files]}
        write_text(folder / MANIFEST, json.dumps(manifest, indent=1) + "\n")
        _make_parents(zipped)
        write_package(zipped, folder, [MANIFEST, *names, *made], f"{stem}_{safe_stem(shop.name)}", replace=force)
    return Package(zipped, findings, judged, files)


def _measured(findings: Sequence[Finding], shop: Shop, boxes: Sequence[Box]) -> tuple[Finding, ...]:
    """The findings with the extent that the files have, not the one that was planned; the worst of them."""
    asked = extent_nm(shop)
    if asked is None or not boxes:
        return tuple(findings)
    judged = sorted((extent(box, asked) for box in boxes), key=lambda each: bool(each.passed))
    return tuple(replace(judged[0], source=each.source) if each.rule == "extent" else each for each in findings)


@contextmanager
def _aside() -> Iterator[Path]:
    """A folder to work in; where it has no room left, that is told as such, and not as a fault of the target."""
    try:
        with tempfile.TemporaryDirectory(prefix="maskfab-package-") as folder:
            try:
                yield Path(folder)
            except OutputError as error:
                # What names this folder is about it, and all else about the target.
                if error.code != "MF401" or folder not in error.what:
                    raise
                raise _no_room(error.what) from error
    except OSError as error:
        raise _no_room(str(error)) from error


def _no_room(what: str) -> OutputError:
    cure = f"Make room in {tempfile.gettempdir()}, or set TMPDIR to a folder with more"
    return OutputError("MF401", f"the temporary folder is full or cannot be written: {what}", cure=cure)


def _check_target(target: Path, *, force: bool) -> None:
    """Refuse a zip before any work starts; folders above it may be missing, for they are made with it."""
    if target.suffix.lower() != ".zip":
        cure = f"Call it {target.name}.zip"
        raise JobError("MF105", f"a package must be a .zip file, got {target}", where="--out", cure=cure)
    parent = target.absolute().parent
    if parent.exists():
        check_file(target, force=force)
        return
    while not parent.exists():
        parent = parent.parent
    check_file(parent / f".{target.name}.partial", force=True)


def _make_parents(target: Path) -> None:
    try:
        target.absolute().parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what = f"{target.parent} cannot be made: {error.strerror or error}"
        raise OutputError("MF401", what, cure="Give --out a path in a writable folder with room to spare") from error


def verify_package(package: str | Path, job: Job | None = None, shop: Shop | None = None) -> tuple[Quantity, ...]:
    """Check a package by making it again of its job and profile: hashes, geometry, papers, and what it says of itself.

    Args:
        package: the zip.
        job: the job that it is held against; None takes the one that it holds.
        shop: whom it is for; None takes the profile that it holds.

    Raises:
        SourceError: MF301, MF303, MF422 or MF423 as :func:`maskfab.package.archive.unpack`.
        JobError: MF105 if neither the caller nor the package says whom it is for.
    """
    with _aside() as folder:
        names = unpack(Path(package), folder)
        manifest = _manifest(folder / MANIFEST)
        listed = {str(row["path"]): str(row["sha256"]) for row in manifest["files"]}
        checks = [_hash(folder, name, digest) for name, digest in listed.items()]
        for name in sorted(set(names) - set(listed) - {MANIFEST}):
            checks.append(Quantity("unlisted", "", name, "", f"the manifest does not know {name}", None, "", False))
        try:
            house = _packed_shop(folder, Path(package), str(manifest.get("shop"))) if shop is None else shop
            made = _packed_job(folder, Path(package)) if job is None else job
            # A later version would sign its plates differently, which is no fault of this one.
            signature = made.signature.replace(__version__, str(manifest.get("maskfab_version")), 1)
            whole = compose(made.spec, made.openings, signature, where=made.where)
            plate = fitted(whole, house)
            figures, style = draw(plate, drawing_options(plate, house)), drawing_style(plate, house)
        except InputError as error:
            if job is not None and not isinstance(error, OutputError):
                raise
            return (*checks, _failed("drawn_again", str(error)))
        # By their suffixes: a mask that the manifest calls something else is a mask all the same.
        masks = [name for name in listed if name in names and name.lower().endswith(_MASK_SUFFIXES)]
        readings: list[Quantity] = []
        boxes: dict[str, Box] = {}
        for name in masks:
            try:
                boxes[name], rows = _held(figures, folder / name, style)
            except InputError as error:
                checks.append(_failed("readable", f"{name}: {error}"))
                continue
            checks += _spans(name, boxes[name], house)
            readings += [each for each in rows if each.passed is not None]
        checks += readings
        if not masks:
            listing = "mask files that the manifest lists"
            checks.append(Quantity("mask_files", "", 0, "", listing, limit=1, passed=False))
        kinds = {name: kind for name, kind in _names(plate, PACKED).items() if name in listed}
        sent = [_as_listed(folder / name, kinds[name], listed[name]) for name in listed if name in kinds]
        formats = tuple(kinds[file.path] for file in sent)
        findings = check_shop(whole, house, formats, figures.options, blank_of(made.spec))
        checks += [each.quantity(house.name) for each in findings if each.passed is False]
        findings = _measured(findings, house, tuple(boxes.values()))
        ordered = Ordered(made, house, figures, signature, findings, tuple(readings), formats, tuple(sent))
        if shop is None:
            checks += check_profile(made, house, ours=manifest.get("maskfab_version") == __version__)
        checks += check_papers(ordered, manifest, names, readable=kinds.keys() <= boxes.keys())
    return tuple(checks)


def _names(plate: Plate, formats: Sequence[Format]) -> dict[str, Format]:
    """The mask files of a package in some formats, by name."""
    return {f"{safe_stem(plate.name)}{MASK_TAILS[each]}": each for each in formats}


def _as_listed(path: Path, kind: Format, digest: str) -> WrittenFile:
    """The record of a mask file by the hash that the manifest gives it, which is held against the file elsewhere."""
    return WrittenFile(path.name, kind, path.stat().st_size if path.is_file() else 0, digest)


def _spans(name: str, box: Box, shop: Shop) -> Iterator[Quantity]:
    """Extent of everything in a file, where the shop asks for an exact extent."""
    asked = extent_nm(shop)
    if asked is not None:
        found = extent(box, asked)
        method = f"everything in {name}, texts and header included"
        yield Quantity("extent", "", found.value, found.unit, method, limit=found.limit, passed=found.passed)


def _packed_job(folder: Path, package: Path) -> Job:
    """The job that a package holds; it may read no file beyond itself.

    Raises:
        InputError: MF105 if there is none, or one that names other files; whatever :func:`load` refuses.
    """
    path = folder / JOB_COPY
    if not path.is_file():
        raise JobError(
            "MF105",
            f"{package} holds no {JOB_COPY}, so that its polygons cannot be compared with anything",
            where="--against",
            cure="Name the job that it was made of",
        )
    spec = read_spec(path)
    wanted = [(each, spec.openings) for die in spec.die for each in (die.opening, *(die.others or ()))]
    wanted += [(die.map, spec.maps) for die in spec.die if die.map is not None]
    if spec.scene is not None:
        tables = (each for each in (spec.scene.spectrum, spec.scene.illuminant) if isinstance(each, str))
        wanted += [(each, spec.curves) for each in tables if is_table(each)]
    if spec.export is not None and spec.export.shop is not None and spec.export.shop.endswith(".toml"):
        wanted.append((spec.export.shop, spec.shops))
    for name, held in wanted:
        if name not in held:
            raise JobError(
                "MF105",
                f"its job names {name!r}, which it does not hold",
                where=JOB_COPY,
                cure="Pack the job again with maskfab package",
            )
    return load(path)


def _failed(name: str, problem: str) -> Quantity:
    return Quantity(name, "", "failed", "", problem, limit="ok", passed=False)


def _packed_shop(folder: Path, package: Path, name: str) -> Shop:
    """The profile that a package holds, under the name that its manifest gives it."""
    path = folder / PROFILE
    if not path.is_file():
        raise JobError(
            "MF105",
            f"{package} holds no {PROFILE}, and no shop is named",
            where="--shop",
            cure="Name the shop that it was packed for",
        )
    text = path.read_text(encoding="utf-8", errors="replace")
    return parse_shop(text, name, where=f"{package}: {PROFILE}")


def _read(path: Path) -> db.Layout:
    read = read_layout(path)
    find_cell(read)
    return read


def _held(figures: Figures, path: Path, style: DrawingStyle) -> tuple[Box, tuple[Quantity, ...]]:
    """Extent of a whole file, and :func:`read_back`, within limits, of a file from any source."""

    def work(_tell: Progress) -> tuple[Box, tuple[Quantity, ...]]:
        read = _read(path)
        return file_box(path, read, style), read_back(figures, path, style, read)

    return bounded(path, work, seconds=seconds_of(figures.account.polygons))


def read_back(figures: Figures, path: Path, style: DrawingStyle, read: db.Layout) -> tuple[Quantity, ...]:
    """A written file, read by another library, against what was drawn and against the openings dot by dot."""
    plate, cut = figures.plate, CUT in figures.layers
    names = style.layer_names if path.suffix == ".dxf" else None
    with library_errors(path):
        drawn = compare(plate, figures.layout(), read, path, dots=not cut, layer_names=names).quantities()
    if not cut:
        return drawn
    with library_errors(path):
        exposed = compare(plate, plate_layout(plate), _exposed(read), path).quantities()
    dark = [each for each in exposed if each.name != "polygons"]
    if path.suffix == MASK_TAILS["gerber"]:
        return tuple(dark)  # its reader takes the holes away, so that polygons are no longer those that were drawn
    return (*(each for each in drawn if each.name == "polygons"), *dark)


def _exposed(read: db.Layout) -> db.Layout:
    """The exposed layout of a file whose holes lie on a layer of their own."""
    layout = db.Layout()
    layout.dbu = DBU_UM
    top = layout.create_cell(read.top_cell().name)
    top.shapes(layout.layer(layer_info(CLEAR))).insert(region(read, CLEAR) - region(read, CUT))
    return layout


def _manifest(path: Path) -> Mapping[str, Any]:
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        for row in manifest["files"]:
            str(row["path"]), str(row["format"]), str(row["sha256"])
        json.dumps(manifest)  # what cannot be said again cannot be reported
        if len({row["path"] for row in manifest["files"]}) < len(manifest["files"]):
            raise ValueError("it lists a file twice")
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise SourceError(
            "MF422", f"its {MANIFEST} cannot be used: {error!r}", cure="Name a zip that maskfab package wrote"
        ) from error
    return dict(manifest)


def _hash(folder: Path, name: str, digest: str) -> Quantity:
    path = folder / Path(name).name
    found = provenance.sha256_of_file(path) if path.is_file() and path.name == name else "missing"
    return Quantity("sha256", "", found, "", f"SHA-256 of {name}", limit=digest, passed=found == digest)
