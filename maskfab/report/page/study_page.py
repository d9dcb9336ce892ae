"""The page of a study: its figures, the tables under them, and what they say of its claims."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from jinja2 import Template
from markupsafe import Markup

from maskfab.camera.intervals import CONFIDENCE
from maskfab.camera.scores import Gain, Score, ScoreTable
from maskfab.measurement.claims import Claim, Finding, Take, Verdict
from maskfab.measurement.study import OWN_SCENE, Setting, Study
from maskfab.optics.numbers.metrics import auc_radial_min
from maskfab.report.page.environment import page_environment
from maskfab.report.page.html import style
from maskfab.report.plots import study_figures
from maskfab.report.plots.number_text import rounded, short
from maskfab.resources import template
from maskfab.units import dpi

_UNITS: Mapping[str, tuple[str, int]] = {
    "psnr": ("dB", 2),
    "psnr_inner": ("dB", 2),
    "ssim": ("", 3),
    "delta_e": ("", 2),
    "auc_radial_min": ("", 4),
    "open_ratio": ("", 4),
    "psf_difference": ("", 3),
}
"""Unit and decimals of a claim's number."""
MEASURES: Mapping[str, str] = {
    "psnr": "PSNR",
    "psnr_inner": "PSNR of the inner frame",
    "ssim": "SSIM",
    "delta_e": "S-CIELAB",
    "auc_radial_min": "area under the radial-minimum MTF",
    "open_ratio": "open ratio",
    "psf_difference": "relative difference of the PSFs",
}


@dataclass(frozen=True)
class Cell:
    """Mean scores of one die at one level: PSNR, SSIM, and the gain in PSNR over the first die."""

    psnr: float
    ssim: float
    gain: Gain | None


@dataclass(frozen=True, eq=False)
class Block:
    """The table of one protocol in one case.

    Attributes:
        setting: protocol and case.
        levels: columns.
        rows: die, restorer, and a cell for each level.
        reference: die that gains are over.
        left_out: sentences, with the dies that they are about.
    """

    setting: Setting
    levels: tuple[float, ...]
    rows: tuple[tuple[str, str, tuple[Cell, ...]], ...]
    reference: str
    left_out: tuple[str, ...]


def study_page(study: Study) -> str:
    """The page, with nothing from outside it; equal studies give equal pages."""
    plan = study.plan
    drawn: dict[str, Any] = {"scores": None, "mtf": None}
    if study.scores:
        drawn["scores"] = Markup(study_figures.scores_figure(study).img())
    if study.optics:
        drawn["mtf"] = Markup(study_figures.optics_figure(study).img())
    tiles = {name: _safe(each) for name, each in study_figures.optics_tiles(study).items()} if study.optics else {}
    return _template().render(
        style=style(),
        study=plan.study,
        job=plan.job,
        version=plan.job.signature,
        tally=_tally(study),
        claims=study.claims,
        finding=finding_text,
        limits=limits_text,
        drawn=drawn,
        dies=[_die(name, study) for name in plan.panels],
        tiles=tiles,
        photographs=[(take, Markup(image)) for take, image in study_figures.photograph_tiles(study)],
        brightening=study_figures.brightening(study),
        captioned=lambda take: _captioned(study, take),
        blocks=blocks(study),
        scenes=study.scenes,
        skipped=plan.skipped,
        confidence=f"{CONFIDENCE:.0%}",
        lines=sorted(plan.job.camera.wavelengths_nm, reverse=True),
    )


def blocks(study: Study) -> list[Block]:
    """Tables of scores, one for each protocol in each case."""
    return [_block(study, setting) for setting in study.plan.settings]


def limits_text(claim: Claim) -> str:
    """The limits of a claim, in words."""
    stated = claim.stated
    unit, _ = _UNITS[stated.measure]
    low, high = (
        None if bound is None else f"{short(float(bound))} {unit}".rstrip()
        for bound in (stated.at_least, stated.at_most)
    )
    if low is not None and high is not None:
        return f"from {low} to {high}"
    return f"at least {low}" if low is not None else f"at most {high}"


def finding_text(claim: Claim, finding: Finding) -> tuple[str, str, str]:
    """The thing measured, its value with its interval, and of how many photographs."""
    unit, digits = _UNITS[claim.stated.measure]
    of, over, found = finding.of, finding.over, finding.found
    said = [of.die]
    if of.protocol:
        said += [each for each in (of.case if of.case != OWN_SCENE else "", f"{of.level_db:g} dB") if each]
        said += [of.restorer] if of.restorer else []
    elif finding.wavelength_nm is not None:
        said.append(f"{finding.wavelength_nm:g} nm")
    told = ", ".join(said)
    if over is not None:
        other = [getattr(over, key) for key in ("die", "case", "restorer") if getattr(over, key) != getattr(of, key)]
        told += f", over {', '.join(other)}"
    many = f"{found.count} photograph{'s' * (found.count != 1)}" if found.count else "computed"
    if not found.count:
        sign = "+" if over is not None and claim.stated.measure != "psf_difference" else ""
        return told, f"{found.mean:{sign}z.{digits}f} {unit}".rstrip(), many
    if over is None:
        half = "" if math.isnan(found.half_width) else f" ± {found.half_width:.{digits}f}"
        return told, f"{found.mean:z.{digits}f}{half} {unit}".rstrip(), many
    return told, found.told(unit, digits), many


def _tally(study: Study) -> tuple[int, int] | None:
    """Number of claims that agree under the first protocol, or of the optics, and of all claims."""
    first = [next(iter(claim.verdicts.values())) for claim in study.claims if claim.findings]
    return (first.count(Verdict.AGREES), len(first)) if first else None


def _block(study: Study, setting: Setting) -> Block:
    takes = [t for t in study.scores if (t.protocol, t.case) == (setting.protocol.name, setting.case)]
    levels = tuple(sorted({take.level_db for take in takes}))
    table = ScoreTable(tuple(score for take in takes for score in study.scores[take]))
    reference = next(iter(study.plan.panels))
    gains = {(gain.design, gain.level_db, gain.restorer): gain for gain in table.gains(reference)}
    rows = []
    for die, restorer in dict.fromkeys((take.die, take.restorer) for take in takes):
        of = [study.scores[Take(setting.protocol.name, setting.case, die, level, restorer)] for level in levels]
        cells = tuple(
            Cell(_mean(scores, "psnr"), _mean(scores, "ssim"), gains.get((die, level, restorer)))
            for level, scores in zip(levels, of, strict=True)
        )
        rows.append((die, table.winners([score for scores in of for score in scores]), cells))
    return Block(setting, levels, tuple(rows), reference, _left_out(study, setting))


def _left_out(study: Study, setting: Setting) -> tuple[str, ...]:
    """A sentence once, with the dies that it is about where they are not all."""
    dies: dict[str, list[str]] = {}
    for name in study.plan.panels:
        for sentence in study.left_out[setting.protocol.name, setting.case, name]:
            dies.setdefault(sentence, []).append(name)
    every = len(study.plan.panels)
    return tuple(f"{'' if len(n) == every else ', '.join(n) + ': '}{sentence}" for sentence, n in dies.items())


def _mean(scores: Sequence[Score], key: str) -> float:
    return math.fsum(getattr(score, key) for score in scores) / len(scores)


def _die(name: str, study: Study) -> dict[str, Any]:
    panel, optics = study.plan.panels[name], study.optics.get(name)
    return {
        "name": name,
        "opening": panel.opening.name,
        "tiling": panel.tiling.value,
        "seed": panel.seed,
        "pitch_um": panel.cell_size.pitch_um,
        "gutter_um": panel.gutter_nm / 1000,
        "dpi": dpi(panel.cell_size.pitch_um),
        "open_ratio": panel.open_ratio,
        "auc": [] if optics is None else [auc_radial_min(mtf, name) for mtf in optics.mtfs],
    }


def _captioned(study: Study, take: Take | None) -> str:
    if take is None:
        return "The scene itself"
    said = [take.die, *([take.case] if take.case != OWN_SCENE else []), f"{take.level_db:g} dB", take.restorer]
    return f"{', '.join(said)}: PSNR {study.scores[take][0].psnr:.1f} dB"


def _minus(words: str) -> str:
    """A number's words with a minus for its hyphen."""
    return words.replace("-", "−")


def _safe(images: Mapping[str, str]) -> dict[str, Markup]:
    return {name: Markup(image) for name, image in images.items()}


@cache
def _template() -> Template:
    environment = page_environment(number=rounded, short=short, minus=_minus, measure=MEASURES.__getitem__)
    return environment.from_string(template("study.html.j2"))
