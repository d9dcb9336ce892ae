"""From a job to one zip for a mask shop: drawn to its format, checked by its rules, written, read back, certified."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from maskfab import provenance
from maskfab.base import __version__
from maskfab.comparison.files import compare_mask, plate_dots_row, read_mask
from maskfab.comparison.plate_dots import check_dots
from maskfab.delivery.archive import Wrapping, safe_stem, unpack, wrapping, write_package
from maskfab.delivery.extents import file_box
from maskfab.delivery.papers import PROFILE, MaskOrder, check_papers, check_profile, package_facts, papers
from maskfab.delivery.revision import check_earlier, check_same, package_stem, placed
from maskfab.errors import InputError, JobError, OutputError, SourceError
from maskfab.export import outputs
from maskfab.export.cell_polygons import CUT
from maskfab.files.finished import JOB_COPY, RESULT_MARK
from maskfab.files.staging import check_file, write_bytes, write_text
from maskfab.job import Job, load_job
from maskfab.jobfile import PLATE_BITMAPS, is_table
from maskfab.jobfile import read as read_spec
from maskfab.jobfile.shop_profile import FORMATS, Format, Shop, parse_shop
from maskfab.mask_shops.adapt import extent_nm, fitted
from maskfab.mask_shops.dot_edges import plotted_dpi
from maskfab.mask_shops.judge import Finding, Taken, accepted, answer_of, extent, mail_of
from maskfab.mask_shops.order import Answer
from maskfab.mask_shops.package_rules import check_package
from maskfab.mask_shops.plate_files import PlateFiles, files_for_shop
from maskfab.model import Box, Plate, Quantity, WrittenFile
from maskfab.plate.plate import compose
from maskfab.progress import Progress, silent
from maskfab.readers.gerber import require_gerbonara
from maskfab.readers.sandbox.bounded import bounded, seconds_of

PACKED: tuple[Format, ...] = FORMATS
"""Formats that a package can hold."""
_TAILS = tuple(outputs.FORMATS[each].tail for each in PACKED)
_MASK_SUFFIXES = tuple(f".{tail.rpartition('.')[2]}" for tail in _TAILS)


@dataclass(frozen=True)
class Package:
    """Result of packing.

    Attributes:
        path: the zip; None if the house would refuse the plate or a file did not read back, so that none was written.
        findings: the house's rules.
        checks: what reading the files back has shown; empty if the house would refuse the plate.
        files: what is in the zip, the manifest excepted.
        missing: lines of the order that are blank.
        unused: keys and tables that the job states and the package does not depend on.
        mail: questions to the house as one text; empty where it publishes all that has to be known.
    """

    path: Path | None
    findings: tuple[Finding, ...]
    checks: tuple[Quantity, ...] = ()
    files: tuple[WrittenFile, ...] = ()
    missing: tuple[Answer, ...] = ()
    unused: tuple[str, ...] = ()
    mail: str = ""

    @property
    def answer(self) -> Taken:
        """Whether the house takes the plate, as far as it publishes what it takes."""
        return answer_of(self.findings) if self.path is not None else "does not"

    @property
    def refused_by(self) -> tuple[str, ...]:
        """Names of the rules that are broken, and of the checks of the files that fail."""
        rules = [each.rule for each in self.findings if each.passed is False]
        return tuple(dict.fromkeys((*rules, *(each.name for each in self.checks if each.passed is False))))


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
        target: the zip to write, or a folder for one that is named by plate, shop and revision; it appears when
            everything in it is complete, and only if every rule and check holds.
        formats: of the mask files; the shop's first if empty.
        force: replace an earlier file, but no package of another revision, nor one of this that holds anything else.
        progress: told where the work stands.

    Raises:
        OutputError: MF401 or MF402 if ``target`` cannot be written; MF406 for a revision that would be lost.
        JobError: MF105 for a target that is no .zip or a format that no package holds, and whatever laying out the job
            refuses.
        SourceError: MF308 for Gerber that this installation could not read back.
    """
    revision = None if job.spec.order is None else job.spec.order.revision
    whole = job.plate()
    stem = package_stem(whole.name, shop.name, revision)
    zipped = placed(Path(target), stem)
    sent = tuple(dict.fromkeys(formats)) or tuple(each for each in shop.formats if each in PACKED)[:1]
    _check_target(zipped, force=force)
    check_earlier(zipped, revision)
    for each in sent:
        if each not in PACKED:
            raise JobError("MF105", f"a package holds no {each}", cure=f"Choose among {', '.join(PACKED)}")
    if "gerber" in sent:
        require_gerbonara(zipped.name, where="format", cure="choose other formats")
    plate = fitted(whole, shop, job.spec.tone)
    dpi = plotted_dpi(job.spec.export, shop)
    if dpi is not None and set(PLATE_BITMAPS) & set(sent):
        check_dots(plate.dies, dpi, job.where)
    progress("rules", 0, 1)
    findings = check_package(job.spec, whole, shop, sent)
    progress("rules", 1, 1)
    mail = mail_of(plate.name, findings)
    if not accepted(findings):
        return Package(None, findings, mail=mail)
    comments = [job.signature, plate.title]
    drawn = files_for_shop(plate, shop, sent, comments, safe_stem(plate.name), job.spec)
    with _aside() as folder:
        checks: list[Quantity] = []
        boxes: list[Box] = []
        for done, product in enumerate(drawn.products):
            progress("write and read back", done, len(drawn.products))
            product.write(folder / product.name)
            box, rows = read_written(drawn, folder / product.name)
            boxes += [] if box is None else [box]
            checks += rows
        progress("write and read back", len(drawn.products), len(drawn.products))
        judged = tuple(check for check in checks if check.passed is not None)
        findings = as_measured(findings, shop, boxes)
        if not (accepted(findings) and all(check.passed for check in judged)):
            return Package(None, findings, judged, mail=mail)
        names = [product.name for product in drawn.products]
        masks = tuple(
            provenance.file_record(folder, folder / name, kind) for name, kind in zip(names, sent, strict=True)
        )
        ordered = MaskOrder(job, shop, drawn.figures, job.signature, findings, judged, sent, masks, drawn.edges)
        made = papers(ordered)
        for name, content in made.items():
            write_bytes(folder / name, content)
        files = (*masks, *(provenance.file_record(folder, folder / name, "paper") for name in made))
        manifest = {**package_facts(job, shop, drawn.figures, ordered.order), "files": [vars(file) for file in files]}
        write_text(folder / RESULT_MARK, json.dumps(manifest, indent=1) + "\n")
        check_same(zipped, manifest)
        _make_parents(zipped)
        write_package(zipped, folder, [RESULT_MARK, *names, *made], stem, replace=force)
    return Package(zipped, findings, judged, files, ordered.order.missing, mail=mail)


def as_measured(findings: Sequence[Finding], shop: Shop, boxes: Sequence[Box]) -> tuple[Finding, ...]:
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
        SourceError: MF301, MF303, MF422 or MF423 as :func:`maskfab.delivery.archive.unpack`.
        JobError: MF105 if neither the caller nor the package says whom it is for.
    """
    with _aside() as folder:
        names = unpack(Path(package), folder)
        manifest = _manifest(folder / RESULT_MARK)
        listed = {str(row["path"]): str(row["sha256"]) for row in manifest["files"]}
        wrapped = wrapping(Path(package))
        checks = [*_held(folder, names, listed), _foreign_bytes(wrapped)]
        version = str(manifest.get("maskfab_version"))
        try:
            house = _packed_shop(folder, Path(package), str(manifest.get("shop"))) if shop is None else shop
            made = _packed_job(folder, Path(package)) if job is None else job
            # A later version would sign its plates differently, which is no fault of this one.
            signature = made.signature.replace(__version__, version, 1)
            whole = compose(made.spec, made.openings, signature, where=made.where)
            plate = fitted(whole, house, made.spec.tone)
            checks.append(_folder_named(wrapped, whole, house, made))
            # Without dots per inch there is no bitmap to compare one with.
            known = plotted_dpi(made.spec.export, house) is not None
            kept: tuple[Format, ...] = tuple(each for each in PACKED if known or each not in PLATE_BITMAPS)
            drawn = files_for_shop(plate, house, kept, (), safe_stem(plate.name), made.spec, version=version)
        except InputError as error:
            if job is not None and not isinstance(error, OutputError):
                raise
            return (*checks, _failed("drawn_again", str(error)))
        # By their suffixes: a mask that the manifest calls something else is a mask all the same.
        masks = [name for name in listed if name in names and name.lower().endswith(_MASK_SUFFIXES)]
        readings: list[Quantity] = []
        boxes: dict[str, Box] = {}
        readable: set[str] = set()
        for name in masks:
            try:
                box, rows = _read_back_bounded(drawn, folder / name)
            except InputError as error:
                checks.append(_failed("readable", f"{name}: {error}"))
                continue
            readable.add(name)
            if box is not None:
                boxes[name] = box
                checks += _spans(name, box, house)
            readings += [each for each in rows if each.passed is not None]
        checks += readings
        if not masks:
            checks.append(Quantity("mask_files", 0, "mask files that the manifest lists", limit=1, passed=False))
        named = zip(drawn.products, kept, strict=True)
        kinds = {product.name: kind for product, kind in named if product.name in listed}
        sent = [_as_listed(folder / name, kinds[name], listed[name]) for name in listed if name in kinds]
        formats = tuple(kinds[file.path] for file in sent)
        edges = drawn.edges if set(PLATE_BITMAPS) & set(formats) else None
        findings = check_package(made.spec, whole, house, formats)
        checks += [each.quantity(house.name) for each in findings if each.passed is False]
        findings = as_measured(findings, house, tuple(boxes.values()))
        ordered = MaskOrder(
            made, house, drawn.figures, signature, findings, tuple(readings), formats, tuple(sent), edges
        )
        if shop is None:
            checks += check_profile(made, house, ours=version == __version__)
        checks += check_papers(ordered, manifest, names, readable=kinds.keys() <= readable)
    return tuple(checks)


def _held(folder: Path, names: Sequence[str], listed: Mapping[str, str]) -> Iterator[Quantity]:
    """The files of a package against their hashes, and those that its manifest does not list."""
    yield from (_hash(folder, name, digest) for name, digest in listed.items())
    for name in sorted(set(names) - set(listed) - {RESULT_MARK}):
        yield Quantity("unlisted", name, f"the manifest does not know {name}", None, "", False)


def _as_listed(path: Path, kind: Format, digest: str) -> WrittenFile:
    """The record of a mask file by the hash that the manifest gives it, which is held against the file elsewhere."""
    return WrittenFile(path.name, kind, path.stat().st_size if path.is_file() else 0, digest)


def _spans(name: str, box: Box, shop: Shop) -> Iterator[Quantity]:
    """Extent of everything in a file, where the shop asks for an exact extent."""
    asked = extent_nm(shop)
    if asked is not None:
        found = extent(box, asked)
        method = f"everything in {name}, texts and header included"
        yield Quantity("extent", found.value, method, limit=found.limit, passed=found.passed)


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
    return load_job(path)


def _failed(name: str, problem: str) -> Quantity:
    return Quantity(name, "failed", problem, limit="ok", passed=False)


def _foreign_bytes(wrapped: Wrapping) -> Quantity:
    method = "; ".join(("bytes of the zip that belong to none of its files", *wrapped.strange))
    return Quantity("foreign_bytes", wrapped.strange_bytes, method, limit=0, passed=not wrapped.strange_bytes)


def _folder_named(wrapped: Wrapping, whole: Plate, house: Shop, job: Job) -> Quantity:
    stem = package_stem(whole.name, house.name, None if job.spec.order is None else job.spec.order.revision)
    method = "folder in the zip, named by plate, shop and revision"
    return Quantity("package_folder", wrapped.folder, method, limit=stem, passed=wrapped.folder == stem)


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


def _read_back_bounded(drawn: PlateFiles, path: Path) -> tuple[Box | None, tuple[Quantity, ...]]:
    """:func:`read_written`, within limits, of a file from any source."""
    return bounded(
        path,
        lambda _tell: read_written(drawn, path),
        seconds=seconds_of(drawn.figures.account.polygons),
        kind=tuple[Box | None, tuple[Quantity, ...]],
    )


def read_written(drawn: PlateFiles, path: Path, *, dots: bool = True) -> tuple[Box | None, tuple[Quantity, ...]]:
    """Extent of everything in a mask file, which a bitmap does not tell, and the file against the design, against what
    the job asks for, and, if ``dots``, the openings dot by dot."""
    if path.suffix in {outputs.FORMATS[each].tail for each in PLATE_BITMAPS}:
        return None, (plate_dots_row(drawn, path),)
    read = read_mask(path)
    box = file_box(path, read, drawn.settings.drawing)
    rows = compare_mask(drawn, read, path, dots=dots).quantities()
    if CUT in drawn.figures.layers and path.suffix == outputs.FORMATS["gerber"].tail:
        # Its reader takes the holes away, so that polygons are no longer those that were drawn.
        return box, tuple(each for each in rows if each.name != "polygons")
    return box, rows


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
            "MF422", f"its {RESULT_MARK} cannot be used: {error!r}", cure="Name a zip that maskfab package wrote"
        ) from error
    return dict(manifest)


def _hash(folder: Path, name: str, digest: str) -> Quantity:
    path = folder / Path(name).name
    found = provenance.sha256_of_file(path) if path.is_file() and path.name == name else "missing"
    return Quantity("sha256", found, f"SHA-256 of {name}", limit=digest, passed=found == digest)
