"""One plate at several houses: which take it, drawn how, which have to be asked first, and why the others refuse.

JobSpec + Plate + Shops -> Bids, judged as their packages would be: by the rules of each house, and by the file that it
would be sent, written, read back and compared with the design.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from maskfab.delivery.archive import safe_stem
from maskfab.delivery.pack import as_measured, read_written
from maskfab.errors import InputError
from maskfab.export.cell_polygons import PolygonOptions
from maskfab.jobfile import JobSpec
from maskfab.jobfile.shop_profile import Format, Shop
from maskfab.mask_shops.adapt import drawing_style, extent_nm, fitted, kept_grid_nm
from maskfab.mask_shops.judge import Finding, PlateFacts, Taken, accepted, answer_of, mail_of
from maskfab.mask_shops.order import order_of
from maskfab.mask_shops.package_rules import check_package, package_options
from maskfab.mask_shops.plate_files import files_for_shop
from maskfab.model import Box, Furniture, Plate, Snapping
from maskfab.progress import Progress, silent
from maskfab.units import NM_PER_UM

_HOLES = {"keyhole": "holes as keyholes", "trapezoids": "holes as trapezoids", "layer": "holes on a layer of their own"}


@dataclass(frozen=True)
class Bid:
    """A house's answer to a plate, as far as its published rules give one.

    Attributes:
        shop: name of its profile.
        title: the house.
        format: of the file that would be sent.
        findings: its rules, and of a plate that keeps them what reading the file back has shown.
        changes: in which the data differ from those for a house without rules, a phrase each.
        blanks: keys of [order] that nobody has answered.
        mail: questions to the house as one text; empty where it publishes all that has to be known.
    """

    shop: str
    title: str
    format: Format
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
        return tuple(each for each in self.findings if each.passed is False)

    @property
    def asked(self) -> tuple[Finding, ...]:
        """Rules on which the house publishes nothing and has to be asked."""
        return tuple(each for each in self.findings if each.question)

    @property
    def agreed(self) -> tuple[Finding, ...]:
        """Questions to agree with the house before it starts."""
        left = (each for each in self.findings if each.passed is None)
        return tuple(each for each in left if each.rule != "corner_touches" or each.rule in self.blanks)


def compare_shops(spec: JobSpec, plate: Plate, shops: Sequence[Shop], progress: Progress = silent) -> tuple[Bid, ...]:
    """Judge a composed plate by the rules of several houses, and by the files that they would be sent.

    Houses that are sent the same share it. Files are written into a folder that is deleted.

    Args:
        spec: of the job.
        plate: laid out of it.
        shops: to compare.
        progress: told where the work stands.
    """
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
        read = files.read(drawn, shop, options, sent)
        findings = (*as_measured(findings, shop, () if read.box is None else (read.box,)), *read.findings)
    touches = next((int(each.value) for each in findings if each.rule == "corner_touches"), 0)
    order = order_of(spec, drawn, shop, touches)
    changes = tuple(_changes(drawn, shop, options, sent))
    blanks = tuple(each.key for each in order.missing)
    return Bid(shop.name, shop.title, sent, findings, changes, blanks, mail_of(drawn.name, findings))


@dataclass(frozen=True)
class _Read:
    """A file that was read back: the extent of everything in it, and in what it fails."""

    box: Box | None
    findings: tuple[Finding, ...]


@dataclass(frozen=True, eq=False)
class _Files:
    """Files that were written and read back, each once, however many houses are sent it.

    The openings are compared dot by dot in the first alone: they are the same in all, and so is the design with which
    every file is compared.
    """

    spec: JobSpec
    facts: PlateFacts
    folder: Path
    known: dict[tuple[tuple[Furniture, ...], Snapping | None, PolygonOptions, Format, str], _Read] = field(
        default_factory=dict
    )

    def read(self, drawn: Plate, shop: Shop, options: PolygonOptions, sent: Format) -> _Read:
        # Of all formats only these are written in a house's own style.
        style = repr(drawing_style(drawn, shop)) if sent.startswith("dxf") or shop.names.layers else ""
        key = drawn.furniture, drawn.snapped, options, sent, style
        if key not in self.known:
            self.known[key] = self._read(drawn, shop, sent)
        return self.known[key]

    def _read(self, drawn: Plate, shop: Shop, sent: Format) -> _Read:
        try:
            made = files_for_shop(drawn, shop, (sent,), (), safe_stem(drawn.name), self.spec, self.facts)
            (product,) = made.products
            path = self.folder / product.name
            product.write(path)
            box, rows = read_written(made, path, dots=not self.known)
            path.unlink()
        except InputError as error:
            return _Read(None, (Finding("drawing", False, error.what, None, cure=error.cure),))
        failed = [each for each in rows if each.passed is False]
        if not failed:
            return _Read(box, ())
        cure = "This is a fault of maskfab's own, not of the plate: please report it with the job"
        return _Read(box, (Finding("read_back", False, failed[0].name, "the plate as designed", cure=cure),))


def _changes(drawn: Plate, shop: Shop, options: PolygonOptions, sent: Format) -> Iterator[str]:
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
