"""The files of a study: its page, and its numbers as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from maskfab.base import __version__
from maskfab.files.finished import write_mark
from maskfab.files.staging import Place, staged
from maskfab.measurement.claims import Claim, Finding, Take
from maskfab.measurement.study import Study
from maskfab.optics.numbers.metrics import auc_radial_min
from maskfab.report.page.study_page import study_page
from maskfab.report.plots import study_figures
from maskfab.report.plots.sheet import Drawing

SCHEMA_VERSION = 1
DOCUMENT, PAGE = "study.json", "study.html"


def study_document(study: Study) -> dict[str, Any]:
    """Everything that was found; what study.json and ``--json`` say."""
    plan = study.plan
    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": plan.job.digest,
        "seeds": plan.job.seeds,
        "figure": plan.study.figure,
        "title": plan.study.title,
        "scenes": list(study.scenes),
        "skipped": list(plan.skipped),
        "unused": list(plan.unused),
        "claims": [_claim(claim) for claim in study.claims],
        "optics": [
            {
                "die": name,
                "open_ratio": each.open_ratio,
                "auc_radial_min": {f"{mtf.wavelength_nm:g}": auc_radial_min(mtf, name).value for mtf in each.mtfs},
            }
            for name, each in study.optics.items()
        ],
        "settings": [
            {
                "case": setting.case,
                **setting.conditions.to_dict(),
                "left_out": {
                    name: list(study.left_out[setting.protocol.name, setting.case, name]) for name in plan.panels
                },
            }
            for setting in plan.settings
        ],
        "scores": [
            {"protocol": take.protocol, "case": take.case, **_finite(vars(score))}
            for take, scores in study.scores.items()
            for score in scores
        ],
    }


def write_study(place: Place, study: Study) -> list[Path]:
    """Write page, numbers and figures into a directory that appears whole, and return the paths.

    Raises:
        OutputError: MF401 or MF404 as :func:`maskfab.files.staging.staged`.
    """
    drawn: dict[str, Drawing] = {}
    if study.scores:
        drawn["scores"] = study_figures.scores_figure(study)
    if study.optics:
        drawn["mtf"] = study_figures.optics_figure(study)
    with staged(place) as folder:
        for name, drawing in drawn.items():
            drawing.save(folder / f"{name}.svg")
        (folder / PAGE).write_text(study_page(study), encoding="utf-8")
        (folder / DOCUMENT).write_text(_json(study_document(study)), encoding="utf-8")
        write_mark(folder, study.plan.job.digest)
    return sorted(place.asked.iterdir())


def _claim(claim: Claim) -> dict[str, Any]:
    stated = claim.stated
    return {
        "says": stated.says,
        "measure": stated.measure,
        "at_least": stated.at_least,
        "at_most": stated.at_most,
        "why": stated.why,
        "verdicts": {protocol or "optics": verdict.value for protocol, verdict in claim.verdicts.items()},
        "findings": [_finding(each) for each in claim.findings],
    }


def _finding(each: Finding) -> dict[str, Any]:
    return {
        "of": _take(each.of),
        "over": None if each.over is None else _take(each.over),
        "wavelength_nm": each.wavelength_nm,
        **_finite({"mean": each.found.mean, "half_width_95": each.found.half_width}),
        "photographs": each.found.count,
        "tie": each.over is not None and each.found.tie,
        "verdict": each.verdict.value,
    }


def _take(take: Take) -> dict[str, Any]:
    return vars(take) if take.protocol else {"die": take.die}


def _finite(values: Mapping[str, Any]) -> dict[str, Any]:
    """With None for what is not a number: JSON has none."""
    return {key: None if isinstance(each, float) and math.isnan(each) else each for key, each in values.items()}


def _json(told: Mapping[str, Any]) -> str:
    return json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
