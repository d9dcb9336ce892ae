"""A finished run as a page shows it: which of its mask files, and what was found of its dies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from klayout import db

from maskfab.errors import OutputError
from maskfab.files.finished import PAGE, read_manifest
from maskfab.geometry.plate_layout import CellNames
from maskfab.provenance import sha256_of_file
from maskfab.readers.layout_file import LAYOUT_SUFFIXES, read_layout
from maskfab.report.page.die_table import die_table
from maskfab.report.side_by_side.finished_report import read_reports
from maskfab.report.viewer.drawn_cells import drawn_cells
from maskfab.report.viewer.psf_pictures import psf_pictures
from maskfab.report.viewer.rule_places import rule_places
from maskfab.units import UM_PER_NM

Document = Mapping[str, Any]

_CELLS_FIRST = (".gds", ".oas")
"""Files in which cells are placed by references, whatever the job; others may be flat."""


@dataclass(frozen=True)
class ShownRun:
    """One run as a page shows it.

    Attributes:
        file: the mask file whose polygons are shown, as the manifest knows it.
        document: all that the page draws and tells.
    """

    file: Document
    document: Document


def shown_run(folder: Path) -> ShownRun:
    """A finished directory, its mask file read back.

    Raises:
        OutputError: MF403 if it is no finished run, MF407 if a file that would be shown was changed since, MF409 if
            none of its files has polygons.
        SourceError: as :func:`maskfab.readers.layout_file.read_layout` raises it.
    """
    files = {str(row["path"]): {"format": "", **row} for row in read_manifest(folder)["files"]}
    (report,) = read_reports([folder])
    mask = _mask_file(folder, files)
    layout = read_layout(_unchanged(folder, mask))
    page = _unchanged(folder, files[PAGE]).read_text(encoding="utf-8") if PAGE in files else ""
    markers = [_unchanged(folder, row) for name, row in files.items() if name.endswith(".lyrdb")]
    box = layout.top_cell().bbox()
    return ShownRun(
        mask,
        {
            "title": report.document["title"],
            "folder": report.name,
            "file": {key: mask[key] for key in ("path", "format", "bytes", "sha256")},
            "job_hash": report.document["job_hash"],
            "maskfab_version": report.document["maskfab_version"],
            "box": [box.left, box.bottom, box.right, box.top],
            **drawn_cells(layout),
            "dies": _dies(report.document, layout, psf_pictures(page)),
            "rules": [rule for path in markers for rule in rule_places(path)],
            "markers": [path.name for path in markers],
        },
    )


def _mask_file(folder: Path, files: Mapping[str, Document]) -> Document:
    """The first file with cells, else the first with polygons."""
    for suffixes in (_CELLS_FIRST, LAYOUT_SUFFIXES):
        for name, row in files.items():
            if Path(name).suffix in suffixes:
                return row
    formats = ", ".join(dict.fromkeys(str(row["format"]) for row in files.values() if row["format"]))
    raise OutputError(
        "MF409",
        f"{folder} holds no mask file with polygons, only {formats or 'other files'}",
        where=str(folder),
        cure='Add "gdsii" or "oasis" to [export] formats, and run the job again',
    )


def _unchanged(folder: Path, row: Document) -> Path:
    """Path of a file that the manifest knows as it is.

    Raises:
        OutputError: MF407 if it was changed, or cannot be read.
    """
    path, cure = folder / str(row["path"]), "Run its job again, or put the file back as the run wrote it"
    try:
        same = sha256_of_file(path) == row["sha256"]
    except OSError as error:
        raise OutputError("MF407", f"{path} cannot be read: {error.strerror or error}", cure=cure) from error
    if not same:
        raise OutputError("MF407", f"{path} was changed since its run finished", where=str(path), cure=cure)
    return path


def _dies(report: Document, layout: db.Layout, pictures: Mapping[str, tuple[str, str]]) -> list[dict[str, Any]]:
    """Dies of a report in its order, each with its numbers, its place in the layout, nm, and its PSF."""
    table = die_table(report)
    lines = {line.name: line for line in table.lines}
    found = []
    for die, box in zip(report["dies"], _boxes(report, layout), strict=True):
        line = lines[die["name"]]
        ratio = next((row["value"] for row in die["quantities"] if row["name"] == "open_ratio"), None)
        address, words = pictures.get(die["name"], (None, None))
        rows = [
            [
                "Restored PSNR" if table.level_db is None else f"PSNR, {table.level_db:g} dB of light",
                _decibels(line.psnr),
            ],
            ["Gain" if table.reference is None else f"Gain over {table.reference}", _decibels(line.gain)],
            ["Open ratio", "–" if ratio is None else f"{ratio:.4f}"],
            ["Display", line.display or "–"],
            ["Opening", die["opening"]],
            ["Tiling", die["tiling"] if die["seed"] is None else f"{die['tiling']}, seed {die['seed']}"],
            ["Pitch, µm", f"{die['pitch_um']:g}"],
            ["Cells", " × ".join(str(each) for each in die["cells"])],
        ]
        found.append(
            {
                "name": die["name"],
                "label": die["label"],
                "best": line.best,
                "box": box,
                "rows": rows,
                "psf": address,
                "psf_words": words,
            }
        )
    return found


def _decibels(told: str) -> str:
    """A number with its unit; words as they are."""
    return f"{told} dB" if any(each.isdigit() for each in told) else told


def _boxes(report: Document, layout: db.Layout) -> list[list[int]]:
    """Where panels are in the file: by the reference to the die's cell, else, in a flat file, by the report."""
    names = CellNames()
    top = layout.top_cell()
    names.unique(top.name)
    corners = {each.cell.name: (each.trans.disp.x, each.trans.disp.y) for each in top.each_inst()}
    boxes = []
    for die in report["dies"]:
        size = [round(count * die["pitch_um"] / UM_PER_NM) for count in die["cells"]]
        stated = [round(middle / UM_PER_NM - length / 2) for middle, length in zip(die["centre_um"], size, strict=True)]
        x, y = corners.get(names.unique(die["name"]), stated)
        boxes.append([x, y, x + size[0], y + size[1]])
    return boxes
