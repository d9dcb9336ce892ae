"""From a job to one zip for a mask house: drawn to its format, checked by its rules, written, read back, certified; and
back again, when a package is verified.

One plate is also judged at several houses, each as its package would be: by its rules, and by the file that it would be
sent, written, read back and compared with the design."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

from klayout import db

from maskfab.base import __version__, provenance
from maskfab.base.errors import InputError, JobError, MissingPackageError, OutputError, SourceError
from maskfab.base.folders import JOB_COPY, RESULT_MARK, check_file, write_bytes, write_text
from maskfab.base.model import Box, Mark, Plate, Quantity, Snapping, WrittenFile
from maskfab.base.units import NM_PER_UM
from maskfab.base.work import Progress, silent
from maskfab.job.read import read as read_spec
from maskfab.job.sections import JobSpec
from maskfab.job.shop import Shop, parse_shop
from maskfab.job.values import PLATE_BITMAPS, SHOP_FORMATS, ShopFormat, is_table
from maskfab.mask.comparison.files import compare_mask, read_mask
from maskfab.mask.composition import compose
from maskfab.mask.figures import CUT, PolygonOptions
from maskfab.mask.formats import table
from maskfab.mask.formats.format import DrawingStyle
from maskfab.mask.formats.plate_bitmap import check_dots, check_drawn_dots
from maskfab.mask.houses.adaptation import drawing_style, extent_nm, fitted, kept_grid_nm
from maskfab.mask.houses.files import PlateFiles, check_package, files_for_shop, package_options, plotted_dpi
from maskfab.mask.houses.findings import Finding, PlateFacts, Taken, accepted, answer_of, extent, mail_of
from maskfab.mask.houses.order import Answer, order_of
from maskfab.mask.job import Job, load_job
from maskfab.mask.package.archive import (
    Wrapping,
    check_earlier,
    check_same,
    package_stem,
    placed,
    safe_stem,
    unpack,
    wrapping,
    write_package,
)
from maskfab.mask.package.papers import PROFILE, MaskOrder, check_papers, check_profile, package_facts, papers
from maskfab.mask.sandbox import bounded, seconds_of

_HEADER_BYTES = 1_000_000
_HEADER = re.compile(rb"\$EXTMIN\s+10\s+(\S+)\s+20\s+(\S+)\s.*?\$EXTMAX\s+10\s+(\S+)\s+20\s+(\S+)\s", re.DOTALL)
_BELOW = 0.3
"""Descent of letters below their base line, in their heights."""

_FAR = 2**31 - 1


def file_box(path: Path, read: db.Layout, style: DrawingStyle) -> Box:
    """The bounding box of everything in a file, in nanometres; all 0 if there is nothing.

    A letter is taken to be as wide as it is high, which those of a plain font are not quite.

    Args:
        style: in which a drawing was made; its unit is that of the header's extents.
    """
    box = read.top_cell().bbox()
    for index in read.layer_indexes():
        shapes = read.top_cell().begin_shapes_rec(index)
        shapes.shape_flags = db.Shapes.STexts
        for shape in shapes.each():
            text = shape.shape().text.transformed(shape.trans())
            height, x, y = text.size, text.trans.disp.x, text.trans.disp.y
            box += db.Box(x, y - round(_BELOW * height), x + height * len(text.string), y + height)
    if path.suffix == ".dxf":
        with path.open("rb") as file:
            header = _HEADER.search(file.read(_HEADER_BYTES))
        with suppress(ValueError, OverflowError):
            corners = [round(float(value) / style.length(1)) for value in header.groups()] if header else []
            # Where a layout ends, what reaches further is too far all the same.
            box += db.Box(*(max(-_FAR, min(_FAR, value)) for value in corners))
    return (0, 0, 0, 0) if box.empty() else (box.left, box.bottom, box.right, box.top)


PACKED: tuple[ShopFormat, ...] = SHOP_FORMATS
"""Formats that a package can hold."""
_TAILS = tuple(table.FORMATS[each].tail for each in PACKED)
_MASK_SUFFIXES = tuple(f".{tail.rpartition('.')[2]}" for tail in _TAILS)


@dataclass(frozen=True, repr=False)
class Package:
    """Result of packing.

    Attributes:
        path: the zip; None if the house would refuse the plate or a file did not read back, so that none was written.
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

    def __repr__(self) -> str:
        if self.path is None:
            return f"<Package: none, for {', '.join(self.refused_by)}>"
        return f"<Package {self.path}: {len(self.files)} files; {self.answer}>"

    @property
    def answer(self) -> Taken:
        """Whether the house takes the plate, as far as it publishes what it takes."""
        return answer_of(self.findings) if self.path is not None else "does not"

    @property
    def refused_by(self) -> tuple[str, ...]:
        """Names of the rules that are broken, and of the checks of the files that fail."""
        rules = [finding.rule for finding in self.findings if finding.passed is False]
        return tuple(dict.fromkeys((*rules, *(check.name for check in self.checks if check.passed is False))))


def pack(
    job: Job,
    shop: Shop,
    target: str | Path,
    formats: Sequence[ShopFormat] = (),
    *,
    force: bool = False,
    progress: Progress = silent,
) -> Package:
    """Make the package of a job for a house.

    Args:
        target: the zip to write, or a folder for one that is named by plate, house and revision; it appears when
            everything in it is complete, and only if every rule and check holds.
        formats: of the mask files; the house's first if empty.
        force: replace an earlier file, but no package of another revision, nor one of this that holds anything else.

    Raises:
        OutputError: MF401 or MF402 if ``target`` cannot be written; MF406 for a revision that would be lost.
        JobError: MF105 for a target that is no .zip or a format that no package holds, and whatever laying out the job
            refuses.
        MissingPackageError: MF152 for a format that this installation could not read back.
    """
    revision = None if job.spec.order is None else job.spec.order.revision
    whole = job.plate()
    stem = package_stem(whole.name, shop.name, revision)
    zipped = placed(Path(target), stem)
    sent = tuple(dict.fromkeys(formats)) or tuple(each for each in shop.formats if each in PACKED)[:1]
    _check_target(zipped, force=force)
    check_earlier(zipped, revision)
    for form in sent:
        if form not in PACKED:
            raise JobError("MF105", f"a package holds no {form}", cure=f"Choose among {', '.join(PACKED)}")
    table.require_packages(sent, where="format", otherwise="choose other formats")
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
    drawn = files_for_shop(plate, shop, sent, comments, safe_stem(plate.name), job.spec, file=job.file)
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
    judged = sorted((extent(box, asked) for box in boxes), key=lambda row: bool(row.passed))
    return tuple(
        replace(judged[0], source=finding.source) if finding.rule == "extent" else finding for finding in findings
    )


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
        job: the job that it is held against; None takes the one that it holds.
        shop: whom it is for; None takes the profile that it holds.

    Raises:
        JobError: MF105 if neither the caller nor the package says whom it is for.
    """
    with _aside() as folder:
        names = unpack(Path(package), folder)
        manifest = _manifest(folder / RESULT_MARK)
        listed = {str(row["path"]): str(row["sha256"]) for row in manifest["files"]}
        wrapped = wrapping(Path(package))
        checks = list(_held(folder, names, listed, wrapped))
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
            plotted = plotted_dpi(made.spec.export, house) is not None
            forms: tuple[ShopFormat, ...] = tuple(form for form in PACKED if plotted or form not in PLATE_BITMAPS)
            drawn = files_for_shop(plate, house, forms, (), safe_stem(plate.name), made.spec, version=version)
        except InputError as error:
            if job is not None and not isinstance(error, OutputError):
                raise
            return (*checks, _failed("drawn_again", str(error)))
        # By their suffixes: a mask that the manifest calls something else is a mask all the same.
        masks = [name for name in listed if name in names and name.lower().endswith(_MASK_SUFFIXES)]
        readings, boxes, unreadable = _masks_read_back(drawn, folder, masks)
        checks += [_failed("readable", f"{name}: {error}") for name, error in unreadable.items()]
        checks += [row for name, box in boxes.items() for row in _spans(name, box, house)]
        checks += readings
        if not masks:
            checks.append(Quantity("mask_files", 0, "mask files that the manifest lists", limit=1, passed=False))
        named = zip(drawn.products, forms, strict=True)
        kinds = {product.name: kind for product, kind in named if product.name in listed}
        # By the hashes that the manifest gives, which are held against the files above.
        sent = [
            WrittenFile(name, kinds[name], (folder / name).stat().st_size if name in names else 0, digest)
            for name, digest in listed.items()
            if name in kinds
        ]
        formats = tuple(kinds[file.path] for file in sent)
        edges = drawn.edges if set(PLATE_BITMAPS) & set(formats) else None
        findings = check_package(made.spec, whole, house, formats)
        checks += [finding.quantity(house.name) for finding in findings if finding.passed is False]
        findings = as_measured(findings, house, tuple(boxes.values()))
        ordered = MaskOrder(
            made, house, drawn.figures, signature, findings, tuple(readings), formats, tuple(sent), edges
        )
        if shop is None:
            checks += check_profile(made, house, ours=version == __version__)
        checks += check_papers(ordered, manifest, names, readable=kinds.keys() <= set(masks) - unreadable.keys())
    return tuple(checks)


def _masks_read_back(
    drawn: PlateFiles, folder: Path, masks: Sequence[str]
) -> tuple[list[Quantity], dict[str, Box], dict[str, InputError]]:
    """Rows of the masks that can be read, boxes of their shapes, and why others cannot be read."""
    readings: list[Quantity] = []
    boxes: dict[str, Box] = {}
    refused: dict[str, InputError] = {}
    for name in masks:
        try:
            box, rows = _read_back_bounded(drawn, folder / name)
        except MissingPackageError:
            raise
        except InputError as error:
            refused[name] = error
            continue
        if box is not None:
            boxes[name] = box
        readings += [row for row in rows if row.passed is not None]
    return readings, boxes, refused


def _held(folder: Path, names: Sequence[str], listed: Mapping[str, str], wrapped: Wrapping) -> Iterator[Quantity]:
    """The files of a package against their hashes, and what its manifest does not list."""
    for name, digest in listed.items():
        path = folder / Path(name).name
        found = provenance.sha256_of_file(path) if path.is_file() and path.name == name else "missing"
        yield Quantity("sha256", found, f"SHA-256 of {name}", limit=digest, passed=found == digest)
    for name in sorted(set(names) - set(listed) - {RESULT_MARK}):
        yield Quantity("unlisted", name, f"the manifest does not know {name}", None, "", False)
    method = "; ".join(("bytes of the zip that belong to none of its files", *wrapped.strange))
    yield Quantity("foreign_bytes", wrapped.strange_bytes, method, limit=0, passed=not wrapped.strange_bytes)


def _spans(name: str, box: Box, shop: Shop) -> Iterator[Quantity]:
    """Extent of everything in a file, where the house asks for an exact extent."""
    asked = extent_nm(shop)
    if asked is not None:
        row = extent(box, asked)
        method = f"everything in {name}, texts and header included"
        yield Quantity("extent", row.value, method, limit=row.limit, passed=row.passed)


def _packed_job(folder: Path, package: Path) -> Job:
    """The job that a package holds; MF105 if there is none, or one that reads files beyond itself."""
    path = folder / JOB_COPY
    if not path.is_file():
        what = f"{package} holds no {JOB_COPY}, so that its polygons cannot be compared with anything"
        raise JobError("MF105", what, where="--against", cure="Name the job that it was made of")
    spec = read_spec(path)
    wanted = [(opening, spec.openings) for die in spec.die for opening in (die.opening, *(die.others or ()))]
    wanted += [(die.map, spec.maps) for die in spec.die if die.map is not None]
    if spec.scene is not None:
        tables = (table for table in (spec.scene.spectrum, spec.scene.illuminant) if isinstance(table, str))
        wanted += [(table, spec.curves) for table in tables if is_table(table)]
    if spec.export is not None and spec.export.shop is not None and spec.export.shop.endswith(".toml"):
        wanted.append((spec.export.shop, spec.shops))
    for name, held in wanted:
        if name not in held:
            what = f"its job names {name!r}, which it does not hold"
            raise JobError("MF105", what, where=JOB_COPY, cure="Pack the job again with maskfab order pack")
    return load_job(path)


def _folder_named(wrapped: Wrapping, whole: Plate, house: Shop, job: Job) -> Quantity:
    stem = package_stem(whole.name, house.name, None if job.spec.order is None else job.spec.order.revision)
    method = "folder in the zip, named by plate, shop and revision"
    return Quantity("package_folder", wrapped.folder, method, limit=stem, passed=wrapped.folder == stem)


def _failed(name: str, problem: str) -> Quantity:
    return Quantity(name, "failed", problem, limit="ok", passed=False)


def _packed_shop(folder: Path, package: Path, name: str) -> Shop:
    """The profile that a package holds, under the name that its manifest gives it."""
    path = folder / PROFILE
    if not path.is_file():
        what, cure = f"{package} holds no {PROFILE}, and no shop is named", "Name the shop that it was packed for"
        raise JobError("MF105", what, where="--shop", cure=cure)
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
    form = table.layout_format(path)
    if form is None:
        return None, check_drawn_dots(drawn, path)
    read = read_mask(path)
    box = file_box(path, read, drawn.settings.drawing)
    rows = compare_mask(drawn, read, path, dots=dots).quantities()
    if CUT in drawn.figures.layers and form.layers == "one":
        # Its reader takes the holes away, so that polygons are no longer those that were drawn.
        return box, tuple(row for row in rows if row.name != "polygons")
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
        what = f"its {RESULT_MARK} cannot be used: {error!r}"
        raise SourceError("MF422", what, cure="Name a zip that maskfab order pack wrote") from error
    return dict(manifest)


_HOLES = {"keyhole": "holes as keyholes", "trapezoids": "holes as trapezoids", "layer": "holes on a layer of their own"}


@dataclass(frozen=True)
class Bid:
    """A house's answer to a plate, as far as its published rules give one.

    Attributes:
        title: the house.
        format: of the file that would be sent.
        findings: its rules, and of a plate that keeps them what reading the file back has shown.
        changes: in which the data differ from those for a house without rules, a phrase each.
        blanks: keys of [order] that nobody has answered.
        mail: questions to the house as one text; empty where it publishes all that has to be known.
    """

    shop: str
    title: str
    format: ShopFormat
    findings: tuple[Finding, ...]
    changes: tuple[str, ...]
    blanks: tuple[str, ...]
    mail: str

    @property
    def answer(self) -> Taken:
        """Whether it takes the plate: no rule is broken, nothing has to be asked, and the file shows the plate."""
        return answer_of(self.findings)

    @property
    def taken(self) -> bool:
        """Whether it is known to take the plate."""
        return self.answer == "takes it"

    @property
    def refusals(self) -> tuple[Finding, ...]:
        """Rules that the plate breaks."""
        return tuple(finding for finding in self.findings if finding.passed is False)

    @property
    def asked(self) -> tuple[Finding, ...]:
        """Rules on which the house publishes nothing and has to be asked."""
        return tuple(finding for finding in self.findings if finding.question)

    @property
    def agreed(self) -> tuple[Finding, ...]:
        """Questions to agree with the house before it starts."""
        left = (finding for finding in self.findings if finding.passed is None)
        return tuple(finding for finding in left if finding.rule != "corner_touches" or finding.rule in self.blanks)


def compare_shops(spec: JobSpec, plate: Plate, shops: Sequence[Shop], progress: Progress = silent) -> tuple[Bid, ...]:
    """Judge a composed plate by several houses' rules, and by their files (alike ones shared) in a passing folder."""
    bids, facts = [], PlateFacts()
    with tempfile.TemporaryDirectory(prefix="maskfab-compare-") as folder:
        files = _Files(spec, facts, Path(folder))
        for done, shop in enumerate(shops):
            progress("rules and files", done, len(shops))
            bids.append(_bid(spec, plate, shop, facts, files))
    progress("rules and files", len(shops), len(shops))
    return tuple(bids)


def _bid(spec: JobSpec, plate: Plate, shop: Shop, facts: PlateFacts, files: _Files) -> Bid:
    drawn, sent = fitted(plate, shop, spec.tone), shop.formats[0]
    options = package_options(spec, drawn, shop)
    findings = check_package(spec, plate, shop, (sent,), facts)
    if accepted(findings):
        box, faults = files.read(drawn, shop, options, sent)
        findings = (*as_measured(findings, shop, () if box is None else (box,)), *faults)
    touches = next((int(finding.value) for finding in findings if finding.rule == "corner_touches"), 0)
    blanks = tuple(line.key for line in order_of(spec, drawn, shop, touches).missing)
    changes = tuple(_changes(drawn, shop, options, sent))
    return Bid(shop.name, shop.title, sent, findings, changes, blanks, mail_of(drawn.name, findings))


Reading: TypeAlias = tuple[Box | None, tuple[Finding, ...]]
"""Extent of everything in a file that was read back, and in what it fails."""


@dataclass(frozen=True, eq=False)
class _Files:
    """Files that were written and read back, each once; openings are compared in the first, the same in all."""

    spec: JobSpec
    facts: PlateFacts
    folder: Path
    readings: dict[tuple[tuple[Mark, ...], Snapping | None, PolygonOptions, ShopFormat, str], Reading] = field(
        default_factory=dict
    )

    def read(self, drawn: Plate, shop: Shop, options: PolygonOptions, sent: ShopFormat) -> Reading:
        # Of all formats only these are written in a house's own style.
        style = repr(drawing_style(drawn, shop)) if sent.startswith("dxf") or shop.names.layers else ""
        key = drawn.marks, drawn.snapped, options, sent, style
        if key not in self.readings:
            self.readings[key] = self._read(drawn, shop, sent)
        return self.readings[key]

    def _read(self, drawn: Plate, shop: Shop, sent: ShopFormat) -> Reading:
        try:
            made = files_for_shop(drawn, shop, (sent,), (), safe_stem(drawn.name), self.spec, self.facts)
            (product,) = made.products
            path = self.folder / product.name
            product.write(path)
            box, rows = read_written(made, path, dots=not self.readings)
            path.unlink()
        except InputError as error:
            return None, (Finding("drawing", False, error.what, None, cure=error.cure),)
        failed = [row for row in rows if row.passed is False]
        if not failed:
            return box, ()
        cure = "This is a fault of maskfab's own, not of the plate: please report it with the job"
        return box, (Finding("read_back", False, failed[0].name, "the plate as designed", cure=cure),)


def _changes(drawn: Plate, shop: Shop, options: PolygonOptions, sent: ShopFormat) -> Iterator[str]:
    if sent.startswith("dxf") and shop.accepts.drawing_unit == "mm":
        yield "drawn in mm"
    if options.bias_nm:
        yield f"data biased by {-options.bias_nm / NM_PER_UM:+g} um"
    if options.hierarchy != "cells":
        yield "openings merged across cells" if options.hierarchy == "merged" else "without cells"
    if options.max_references is not None:
        yield "two pixels share a cell"
    if options.holes in _HOLES:
        yield _HOLES[options.holes]
    if options.corners == "joined":
        yield "corners that meet in one outline"
    if shop.polygons.shared_boundaries is False:
        yield "marks as stencils"
    grid = kept_grid_nm(drawn, shop)
    if grid > 1:
        yield f"marks on a grid of {grid} nm"
    if extent_nm(shop) is not None and shop.plate.corner_square_um is not None:
        yield "squares at its corners"
    if shop.names.layers:
        yield "layers renamed"
