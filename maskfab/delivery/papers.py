"""The papers of a package, made from its job and profile, and whether a package holds just those."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl

from maskfab.base import __version__
from maskfab.export.cell_polygons import Figures
from maskfab.files.finished import JOB_COPY, RESULT_MARK
from maskfab.job import Job
from maskfab.jobfile.shop_profile import Format, Shop, dump_shop
from maskfab.mask_shops.dot_edges import DotEdges
from maskfab.mask_shops.drawing_sheet import drawing_sheet
from maskfab.mask_shops.judge import Finding
from maskfab.mask_shops.order import Order, order_of
from maskfab.mask_shops.order_sheet import order_sheet
from maskfab.mask_shops.profiles import load_shop, shop_names, shop_of
from maskfab.model import Quantity, WrittenFile

PROFILE = "shop.toml"
"""Name in a package of the profile of its shop."""
CERTIFICATE = "certificate.json"
"""Name in a package of the rules it was checked against, and of the result of reading its files back."""
_VERSION = 2
_SOURCES = (JOB_COPY, PROFILE)
_DRAWINGS = ("plate.svg", "plate.pdf")
_LASTING = ("plate", "shop", "job_hash", "revision", "tone", "parity")
"""Entries of a manifest that do not depend on the version that wrote it."""
_WRITERS = ("maskfab_version", "matplotlib_version")


@dataclass(frozen=True)
class MaskOrder:
    """The order that the papers of a package describe.

    Attributes:
        job: what the plate was made of.
        shop: whom the package is for.
        figures: the fitted plate as it is drawn.
        signature: of the job, by the version that drew the plate.
        findings: the house's rules.
        checks: what reading the masks back has shown.
        sent: formats of the mask files, in the order in which they were asked for.
        masks: the mask files, in that order.
        edges: what a plotter's dots make of edges; None where no file is of dots.
    """

    job: Job
    shop: Shop
    figures: Figures
    signature: str
    findings: tuple[Finding, ...]
    checks: tuple[Quantity, ...]
    sent: tuple[Format, ...]
    masks: tuple[WrittenFile, ...]
    edges: DotEdges | None = None

    @property
    def order(self) -> Order:
        """The order to the house."""
        touches = (each.value for each in self.findings if each.rule == "corner_touches")
        return order_of(self.job.spec, self.figures.plate, self.shop, int(next(touches, 0)))


def papers(ordered: MaskOrder) -> dict[str, bytes]:
    """Order sheet, drawing, the house's profile, the job and the certificate, by file name; equal for equal orders."""
    plate, shop = ordered.figures.plate, ordered.shop
    order = ordered.order
    # Corners that meet have a line of their own.
    asked = (each for each in ordered.findings if each.rule != "corner_touches")
    remarks = [
        _remark(each)
        for each in asked
        if each.passed is None and each.place and not each.question and each.rule != "edge_error"
    ]
    files = [(mask.path, mask.sha256) for mask in ordered.masks]
    questions = [each.question for each in ordered.findings if each.question]
    sheet = order_sheet(order, ordered.figures, shop, ordered.sent, files, remarks, ordered.edges, questions)
    revision = next(each.text for each in order.answers if each.key == "revision")
    bias = [each.text for each in order.answers if each.key == "bias" and ordered.job.spec.data_bias_nm]
    notes = (f"for {shop.title}", f"revision: {revision}", order.tone, order.parity, *bias, ordered.signature)
    reads_up = not ordered.job.spec.mirrored
    return {
        "order.txt": sheet.text().encode(),
        "order.html": sheet.html().encode(),
        "order.csv": sheet.csv().encode(),
        "plate.svg": drawing_sheet(plate, "svg", notes, reads_up),
        "plate.pdf": drawing_sheet(plate, "pdf", notes, reads_up),
        PROFILE: dump_shop(shop).encode(),
        JOB_COPY: (json.dumps(ordered.job.spec.dump(), indent=1) + "\n").encode(),
        CERTIFICATE: (json.dumps(_certificate(ordered), indent=1, ensure_ascii=False) + "\n").encode(),
    }


def package_facts(job: Job, shop: Shop, figures: Figures, order: Order) -> dict[str, Any]:
    """Facts of a package in its manifest, beside its files."""
    revision = None if job.spec.order is None else job.spec.order.revision
    return {
        "schema_version": _VERSION,
        "maskfab_version": __version__,
        "matplotlib_version": mpl.__version__,
        "plate": figures.plate.name,
        "shop": shop.name,
        "job_hash": job.digest,
        **({"revision": revision} if revision is not None else {}),
        "tone": order.tone,
        "parity": order.parity,
        "drawing": {key: value for key, value in vars(figures.options).items() if value is not None},
        "drawn": list(figures.account.lines()),
    }


def check_papers(
    ordered: MaskOrder, manifest: Mapping[str, Any], present: Collection[str], *, readable: bool
) -> Iterator[Quantity]:
    """Checks of a package's own statements, and of every paper in it, against what its job and profile make.

    Papers are compared by the hashes of the manifest, which are held against the files elsewhere. What another version
    of maskfab wrote otherwise is a note, and so are drawings by another matplotlib: their ``passed`` is None.

    Args:
        ordered: the package made again, its masks as the manifest lists them.
        manifest: what the package says.
        present: names of the files that it holds.
        readable: whether all its masks could be read; without them nobody can say what the certificate should say.
    """
    ours, drawn_alike = manifest.get("maskfab_version") == __version__, True
    for key, own in (("maskfab_version", __version__), ("matplotlib_version", mpl.__version__)):
        said = manifest.get(key, own)
        if said != own:
            drawn_alike = False
            method = f"{key} of {RESULT_MARK}; this is {own}, and what it would write otherwise is not judged"
            yield Quantity(f"manifest_{key}", _text(said), method)
    yield from _facts_held(ordered, manifest, ours=ours)
    if not ordered.masks:
        return
    made = papers(ordered)
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in made.items()}
    listed = {row["path"]: row for row in manifest["files"]}
    for name, digest in digests.items():
        if name in _SOURCES and name not in {*listed, *present}:
            # Whoever verifies it has named them; a house reads neither.
            yield Quantity("paper", "missing", f"it holds no {name}: without it nobody else can verify it")
        elif readable or name != CERTIFICATE:
            said = str(listed[name]["sha256"]) if name in listed else "missing"
            method = f"SHA-256 of {name} as its job and profile make it"
            yield _compared("paper", said, digest, method, judged=drawn_alike if name in _DRAWINGS else ours)
    files = [*ordered.masks, *(WrittenFile(name, "paper", len(made[name]), digests[name]) for name in made)]
    yield from _files_held({file.path: file for file in files}, listed, present, ours=ours)


def _facts_held(ordered: MaskOrder, manifest: Mapping[str, Any], *, ours: bool) -> Iterator[Quantity]:
    wanted = package_facts(ordered.job, ordered.shop, ordered.figures, ordered.order)
    for key in dict.fromkeys((*wanted, *manifest)):
        if key not in (*_WRITERS, "files"):
            said, fact = (_text(known[key]) if key in known else "nothing" for known in (manifest, wanted))
            method = f"{key} of {RESULT_MARK} against its job and profile"
            yield _compared(f"manifest_{key}", said, fact, method, judged=ours or key in _LASTING)


def check_profile(job: Job, shop: Shop, *, ours: bool) -> Iterator[Quantity]:
    """The profile that a package brings against what is known of that house here, or kept of it in the job.

    Of a house that is known from nowhere else, its hash in the certificate stands for it.

    Args:
        job: what was packed.
        shop: as the package has it.
        ours: whether this version wrote it; what another one knew of the house is a note.
    """
    known = load_shop(shop.name) if shop.name in shop_names() else shop_of(job.spec, job.where)
    if known is not None and known.name == shop.name and known != shop:
        method = f"{PROFILE} holds other rules than those known of {shop.name}"
        yield Quantity("profile", shop.name, method, limit="the known rules", passed=(None, False)[ours])


def _files_held(
    made: Mapping[str, WrittenFile], listed: Mapping[str, Mapping[str, Any]], present: Collection[str], *, ours: bool
) -> Iterator[Quantity]:
    """Files that no such package has, and those of which the manifest tells a wrong format or length."""
    for name, row in listed.items():
        if name not in present:
            continue
        if name not in made:
            yield _compared("files", name, "nothing", f"{name}: no package of this job holds it", judged=ours)
        elif row["sha256"] == made[name].sha256:
            said, fact = (f"{each.get('format')}, {each.get('bytes')} bytes" for each in (row, vars(made[name])))
            if said != fact:
                yield _compared("files", said, fact, f"what {RESULT_MARK} says of {name}", judged=True)


def _compared(name: str, said: str, made: str, method: str, *, judged: bool) -> Quantity:
    """One row; without a verdict where another version may rightly differ, and does."""
    same = said == made
    told = method if same or judged else f"{method}; it differs, and another version wrote it, so that it is not judged"
    return Quantity(name, said, told, limit=made, passed=same if same or judged else None)


def _text(said: object) -> str:
    return said if isinstance(said, str) else json.dumps(said, sort_keys=True)


def _remark(finding: Finding) -> str:
    """A question for the shop to decide, as the order puts it."""
    return f"{finding.rule}: {finding.value} {finding.unit} at {finding.place}; please confirm."


def _certificate(ordered: MaskOrder) -> dict[str, Any]:
    return {
        "plate": ordered.figures.plate.name,
        "shop": ordered.shop.name,
        "sources": list(ordered.shop.sources),
        "job_hash": ordered.job.digest,
        "profile_sha256": hashlib.sha256(dump_shop(ordered.shop).encode()).hexdigest(),
        "verdict": "pass",
        "tone": ordered.order.tone,
        "parity": ordered.order.parity,
        "order": {each.key: each.text for each in ordered.order.answers},
        "files": [vars(file) for file in ordered.masks],
        "rules": [{key: value for key, value in vars(each).items() if key != "source"} for each in ordered.findings],
        "checks": [{key: value for key, value in vars(each).items() if value is not None} for each in ordered.checks],
    }
