"""The files of a front: its page, its numbers as JSON and CSV, its designs with their jobs, and the figure."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from maskfab.base import __version__
from maskfab.files.finished import write_mark
from maskfab.files.staging import Place, staged
from maskfab.opening.openings import opening_text
from maskfab.optimiser.pareto.designs import FrontDesign
from maskfab.optimiser.pareto.front import JudgedOpening, Pareto
from maskfab.plate.maps import map_text
from maskfab.report.design_text import by_level
from maskfab.report.documents.alternatives_data import alternatives_document
from maskfab.report.documents.designed_data import prices_document
from maskfab.report.page.pareto_page import pareto_page
from maskfab.report.plots.pareto_figure import pareto_png, svg

SCHEMA_VERSION = 3
DOCUMENT, TABLE, PAGE, FIGURE, DRAWING = "pareto.json", "pareto.csv", "pareto.html", "pareto.png", "pareto.svg"

Designs = Sequence[FrontDesign]


def pareto_document(
    found: Pareto, designs: Designs, job_hash: str, notes: Sequence[str], scenes: str
) -> dict[str, Any]:
    """Everything that was found, and notes for a user; what pareto.json and ``--json`` say.

    Args:
        found, designs: of a sweep.
        job_hash: of its job.
        notes: as sentences.
        scenes: that openings were judged by, in words.
    """
    best = set(map(id, found.best))
    by_point = {id(each.point): each for each in designs}

    def told(each: FrontDesign) -> dict[str, Any]:
        point = each.point
        return {
            "name": each.name,
            **_numbers(point.judged, found.levels),
            "shape": point.shape,
            "density": point.densest,
            "footprint": point.footprint,
            "lines": point.lines,
            "mapped": point.mapped is not None,
            "panel_psnr_db": point.value,
            "panel_psnr_by_level_db": by_level(found.levels, point.psnr),
            "grain_rms": point.grain,
            "best": id(point) in best,
            **_files(each),
        }

    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": job_hash,
        "seed": found.seed,
        "designed_for": found.designed_for,
        "scenes": scenes,
        "rules_kept": list(found.kept),
        "lines": list(found.lines),
        "curves": [
            {
                "clear_dots": curve.clear_dots,
                "evaluated": curve.evaluated,
                "measured": curve.measured,
                "left_out": curve.left_out,
                "misfits": list(curve.misfits),
                "complete": curve.complete,
                "refusal": curve.refusal,
                "rules": [{"rule": rule, "asked": asked} for rule, asked in curve.asked.items()],
                **prices_document(curve.prices),
                "priced_among": curve.priced_among,
                "alternatives": None if curve.alternatives is None else alternatives_document(curve.alternatives),
                "designs": [told(by_point[id(each)]) for each in curve.points],
            }
            for curve in found.curves
        ],
        "compared": [
            {"name": each.shape, **_numbers(each, found.levels), "best_gain_db": found.gain_db(each)}
            for each in found.compared
        ],
        "notes": list(notes),
    }


def table(found: Pareto, designs: Designs) -> str:
    """One line for each opening, of curves and given ones, as CSV."""
    buffer = io.StringIO()
    rows = csv.writer(buffer, lineterminator="\n")
    psnr = [f"panel_psnr_{level:g}_db" for level in found.levels]
    columns = [
        "open_ratio",
        "density",
        "expected_psnr_db",
        "panel_psnr_db",
        *psnr,
        "footprint",
        "lines",
        "grain_rms",
        "best",
    ]
    rows.writerow(["kind", "name", "shape", "clear_dots", *columns])
    best = set(map(id, found.best))
    for each in designs:
        point, judged = each.point, each.point.judged
        numbers = [judged.open_ratio, point.densest, judged.value, point.value, *point.psnr, point.footprint]
        told = [*(f"{number:.6f}" for number in numbers), point.lines, f"{point.grain:.6f}", int(id(point) in best)]
        rows.writerow(["design", each.name, point.shape, judged.clear_dots, *told])
    for other in found.compared:
        alone = [f"{number:.6f}" for number in (other.open_ratio, other.open_ratio, other.value)]
        unlaid = [""] * (1 + len(found.levels))
        told = [*alone, *unlaid, f"{other.footprint:.6f}", other.lines, "", 0]
        rows.writerow(["given", other.shape, other.shape, other.clear_dots, *told])
    return buffer.getvalue()


def write_pareto(place: Place, found: Pareto, document: Mapping[str, Any], designs: Designs) -> list[Path]:
    """Write everything, and its document, into a directory that appears whole, and return the paths.

    Raises:
        OutputError: MF401 or MF404 as :func:`maskfab.files.staging.staged`.
    """
    with staged(place) as folder:
        for each in designs:
            names = _files(each)
            _text(folder / names["opening"], opening_text(each.opening))
            if each.outer is not None:
                _text(folder / names["outer"], opening_text(each.outer))
            _text(folder / names["job"], each.job)
            if each.map is not None:
                _text(folder / names["map"], map_text(each.map))
        _text(folder / TABLE, table(found, designs))
        _text(folder / DRAWING, svg(found))
        (folder / FIGURE).write_bytes(pareto_png(found))
        _text(folder / PAGE, pareto_page(found, designs, document))
        _text(folder / DOCUMENT, _json(document))
        write_mark(folder, document["job_hash"])
    return sorted(place.asked.iterdir())


def _files(each: FrontDesign) -> dict[str, str]:
    named = {"opening": f"{each.name}.toml", "job": f"{each.name}_job.toml"}
    if each.outer is not None:
        named["outer"] = f"{each.name}_outer.toml"
    return named if each.map is None else {**named, "map": f"{each.name}_map.toml"}


def _numbers(each: JudgedOpening, levels: Sequence[float]) -> dict[str, Any]:
    return {
        "shape": each.shape,
        "clear_dots": each.clear_dots,
        "open_ratio": each.open_ratio,
        "footprint": each.footprint,
        "lines": each.lines,
        "expected_psnr_db": each.value,
        "expected_psnr_by_level_db": by_level(levels, each.psnr),
    }


def _json(told: Mapping[str, Any]) -> str:
    return json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
