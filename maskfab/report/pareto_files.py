"""The files of a sweep: its numbers as JSON and CSV, the openings of its curves, and the figure."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from maskfab import __version__, provenance
from maskfab.camera.protocol import LEVELS
from maskfab.files.finished import RESULT_MARK
from maskfab.files.staging import Place, staged
from maskfab.model import Opening
from maskfab.opening.openings import opening_text
from maskfab.optimiser.pareto import JudgedOpening, Pareto
from maskfab.report.plots.pareto_figure import pareto_png, svg

SCHEMA_VERSION = 1
DOCUMENT, TABLE, FIGURE, DRAWING = "pareto.json", "pareto.csv", "pareto.png", "pareto.svg"

Named = Mapping[str, tuple[JudgedOpening, Opening]]


def pareto_document(found: Pareto, named: Named, job_hash: str, notes: Sequence[str]) -> dict[str, Any]:
    """Everything that was found, and notes for a user; what pareto.json and ``--json`` say."""
    names = {id(judged): name for name, (judged, _) in named.items()}
    best = {id(each) for each in found.best}

    def told(each: JudgedOpening) -> dict[str, Any]:
        name = names[id(each)]
        return {"name": name, **_numbers(each), "best": id(each) in best, "opening": f"{name}.toml"}

    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": job_hash,
        "curves": [
            {
                "clear_dots": curve.clear_dots,
                "evaluated": curve.evaluated,
                "footprints_measured": curve.measured,
                "complete": curve.complete,
                "refusal": curve.refusal,
                "openings": [told(each) for each in curve.front],
            }
            for curve in found.curves
        ],
        "compared": [
            {"name": each.shape, **_numbers(each), "best_gain_db": found.gain_db(each)} for each in found.compared
        ],
        "notes": list(notes),
    }


def table(found: Pareto, named: Named) -> str:
    """One line for each opening, of curves and given ones, as CSV."""
    buffer = io.StringIO()
    rows = csv.writer(buffer, lineterminator="\n")
    psnr = [f"expected_psnr_{level}_db" for level in LEVELS]
    rows.writerow(["kind", "name", "shape", "clear_dots", "open_ratio", "footprint", "expected_psnr_db", *psnr, "best"])
    best = {id(each) for each in found.best}
    given = [("given", each.shape, each) for each in found.compared]
    for kind, name, each in [*(("curve", name, judged) for name, (judged, _) in named.items()), *given]:
        numbers = (each.open_ratio, each.footprint, each.value, *each.psnr)
        rows.writerow(
            [kind, name, each.shape, each.clear_dots, *(f"{number:.6f}" for number in numbers), int(id(each) in best)]
        )
    return buffer.getvalue()


def write_pareto(place: Place, found: Pareto, document: Mapping[str, Any], named: Named) -> list[Path]:
    """Write everything, and its document, into a directory that appears whole, and return the paths.

    Raises:
        OutputError: MF401 or MF404 as :func:`maskfab.files.staging.staged`.
    """
    with staged(place) as folder:
        for name, (_, opening) in named.items():
            _text(folder / f"{name}.toml", opening_text(opening))
        _text(folder / TABLE, table(found, named))
        _text(folder / DRAWING, svg(found))
        (folder / FIGURE).write_bytes(pareto_png(found))
        _text(folder / DOCUMENT, _json(document))
        files = [
            {"path": path.name, "bytes": path.stat().st_size, "sha256": provenance.sha256_of_file(path)}
            for path in sorted(folder.iterdir())
        ]
        _text(
            folder / RESULT_MARK,
            _json({"maskfab_version": __version__, "job_hash": document["job_hash"], "files": files}),
        )
    return sorted(place.asked.iterdir())


def _numbers(each: JudgedOpening) -> dict[str, Any]:
    return {
        "shape": each.shape,
        "clear_dots": each.clear_dots,
        "open_ratio": each.open_ratio,
        "footprint": each.footprint,
        "expected_psnr_db": each.value,
        "expected_psnr_by_level_db": {str(level): value for level, value in zip(LEVELS, each.psnr, strict=True)},
    }


def _json(told: Mapping[str, Any]) -> str:
    return json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
