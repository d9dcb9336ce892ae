"""The result of a study as a page, a document and text: figures, tables of scores, and what they say of claims.

Scores stand along the study's axis; every die has its optics and its restored photographs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from operator import methodcaller
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from maskfab.base import __version__
from maskfab.base.arrays import Floats
from maskfab.base.folders import Place
from maskfab.base.model import Die, DieOptics
from maskfab.base.quantities import columns
from maskfab.base.units import dpi
from maskfab.camera.die_transfer import by_sentence
from maskfab.camera.scores import CONFIDENCE, Score, ScoreTable
from maskfab.findings.study import OWN_SCENE, Claim, Finding, Setting, Study, Take, Verdict
from maskfab.optics.metrics import auc_radial_min
from maskfab.report.documents.shape import Record, document_text
from maskfab.report.figures import sheet
from maskfab.report.figures.die import MARKS, OKABE_ITO, mtf_comparison, panel_thumbnail
from maskfab.report.figures.scene import tile
from maskfab.report.figures.sheet import Drawing, img, open_field, place, styled
from maskfab.report.pages.tables import Line, Table
from maskfab.report.pages.template import page_template, style, write_folder
from maskfab.report.text import short

_LINES = ("-", (0, (5, 1.5)), (0, (3, 1, 1, 1)), (0, (1, 1)))
_WIDE, _HIGH, _LEFT, _FOOT, _TOP, _GAP, _LEGEND = 3.0, 2.1, 0.55, 0.62, 0.3, 0.62, 2.0
_ROWS = (("psnr", "PSNR (dB)"), ("ssim", "SSIM"))
_MODULATION_DECADES = 3
_MINUS = methodcaller("replace", "-", "−")


@styled
def scores_figure(study: Study) -> Drawing:
    """Mean scores along the study's axis: a column for each protocol, PSNR over SSIM, a curve for each die."""
    axis = study.plan.study.axis
    curves = _curves(study)
    columns = list(dict.fromkeys(key[0] for key in curves))
    labels = list(dict.fromkeys(key[1] for key in curves))
    ticks = list(dict.fromkeys(x for points in curves.values() for x, _ in points))
    words = all(isinstance(tick, str) for tick in ticks)
    # One protocol has its scores side by side, several have them one above the other.
    across, rows = (2, 1) if len(columns) == 1 else (len(columns), 2)
    figure = Figure(
        figsize=(_LEFT + across * (_WIDE + _GAP) + _LEGEND, _TOP + rows * _HIGH + (rows - 1) * _GAP / 2 + _FOOT)
    )
    for (column, protocol), (row, (measure, title)) in product(enumerate(columns), enumerate(_ROWS)):
        right, down = (row, 0) if rows == 1 else (column, row)
        bottom = _FOOT + (rows - 1 - down) * (_HIGH + _GAP / 2)
        axes = place(figure, (_LEFT + right * (_WIDE + _GAP), bottom, _WIDE, _HIGH))
        for number, label in enumerate(labels):
            points = curves.get((protocol, label))
            if points:
                at = [float(ticks.index(x) if words else x) for x, _ in points]
                _curve(axes, at, [_mean(study, of, measure) for _, of in points], number, label, joined=not words)
        lowest = down == rows - 1
        _dress(axes, ticks if words else None, lowest=lowest, title=title if right == row * (rows == 1) else "")
        if down == 0:
            axes.set_title(f"protocol {protocol}", loc="left")
        if lowest:
            axes.set_xlabel(_AXES[axis])
    handles, texts = figure.axes[0].get_legend_handles_labels()
    beside = (1 - _LEGEND / figure.get_size_inches()[0], 0.5)
    figure.legend(handles, texts, loc="center left", bbox_to_anchor=beside, borderaxespad=0, fontsize=7.5)
    return Drawing(figure, f"{study.plan.study.figure}: mean PSNR and SSIM of {len(study.scenes)} scenes, by {axis}")


_AXES: Mapping[str, str] = {
    "level": "signal-to-noise ratio of white (dB)",
    "dpi": "pixels per inch of the display (DPI)",
    "restorer": "",
    "case": "",
}


def _curves(study: Study) -> dict[tuple[str, str], list[tuple[float | str, Take]]]:
    """Points of every curve, by protocol and label; several restorers, levels or cases off the axis part curves."""
    axis, panels = study.plan.study.axis, study.plan.panels
    kinds: dict[tuple[str, str], bool] = {
        (protocol, key): len({getattr(take, key) for take in study.scores if take.protocol == protocol}) > 1
        for protocol in study.plan.study.protocols
        for key in ("case", "level_db", "restorer")
    }
    curves: dict[tuple[str, str], list[tuple[float | str, Take]]] = {}
    for take in study.scores:
        along: Mapping[str, float | str] = {
            "level": take.level_db,
            "dpi": round(dpi(panels[take.die].cell_size.pitch_um), 1),
            "restorer": take.restorer,
            "case": take.case,
        }
        panel = panels[take.die]
        label = f"{panel.opening.name}, {panel.tiling.value}" if axis == "dpi" else take.die
        more = [take.case] if kinds[take.protocol, "case"] and axis != "case" else []
        more += [f"{take.level_db:g} dB"] if kinds[take.protocol, "level_db"] and axis != "level" else []
        more += [take.restorer] if kinds[take.protocol, "restorer"] and axis != "restorer" else []
        curves.setdefault((take.protocol, ", ".join([label, *more])), []).append((along[axis], take))
    return {
        key: points if any(isinstance(x, str) for x, _ in points) else sorted(points, key=lambda point: point[0])
        for key, points in curves.items()
    }


def _mean(study: Study, of: Take, measure: str) -> float:
    return float(np.mean([getattr(score, measure) for score in study.scores[of]]))


def _curve(axes: Axes, x: Sequence[float], y: Sequence[float], number: int, label: str, *, joined: bool) -> None:
    axes.plot(
        x,
        y,
        color=OKABE_ITO[number % len(OKABE_ITO)],
        linestyle=_LINES[number // len(OKABE_ITO) % len(_LINES)] if joined else (0, (1, 3)),
        marker=MARKS[number % len(MARKS)],
        markersize=4.5,
        linewidth=1.2 if joined else 0.7,
        label=label,
    )


def _dress(axes: Axes, words: Sequence[object] | None, *, lowest: bool, title: str) -> None:
    axes.set_ylabel(title)
    open_field(axes)
    axes.margins(x=0.06, y=0.1)
    if words is not None:
        axes.set_xticks(range(len(words)), [str(word) for word in words], rotation=20, ha="right")
    axes.tick_params(labelbottom=lowest)


def optics_figure(study: Study) -> Drawing:
    """Radial-minimum MTF of every die at the longest wavelength."""
    dies = []
    for name, optics in study.optics.items():
        panel = study.plan.panels[name]
        die = Die(name, name, panel, (0, 0), max(panel.size_nm))
        dies.append(DieOptics(die, (optics.psf,), optics.mtfs[:1], ()))
    return mtf_comparison(dies)


def optics_tiles(study: Study) -> dict[str, dict[str, str]]:
    """``<img>`` elements of cells, PSF and autocorrelation, by die: cells on one scale, PSFs below their own peaks."""
    side = 3 * max(panel.pitch_nm for panel in study.plan.panels.values())
    return {
        name: {
            "cells": panel_thumbnail(study.plan.panels[name], side, 240, "photograph"),
            "psf": _tile(
                sheet.log_intensity(optics.psf, 161) / sheet.DECADES, "magma", f"PSF at {optics.psf.wavelength_nm:g} nm"
            ),
            "autocorrelation": _tile(
                np.log10(np.clip(optics.autocorrelation, 10.0**-_MODULATION_DECADES, 1)) / _MODULATION_DECADES,
                "cividis",
                f"autocorrelation behind {name}",
            ),
        }
        for name, optics in study.optics.items()
    }


def _tile(decades: Floats, colours: str, words: str) -> str:
    """An image of values from -1 to 0, the lowest to the highest colour."""
    levels = np.rint((decades + 1) * 255).astype(np.uint8)
    palette = (mpl.colormaps[colours](np.arange(256))[:, :3] * 255).round().astype(np.uint8)
    return img(sheet.data_uri(sheet.png(levels, palette)), words, "photograph")


def brightening(study: Study) -> float:
    """Factor of 1 or more on code values of photographs that are shown: with it a hundredth of the scene's is white."""
    if study.truth is None:
        return 1.0
    bright = float(np.quantile(study.truth, 0.99))
    return 1 / bright if 0 < bright < 1 else 1.0


def photograph_tiles(study: Study) -> list[tuple[Take | None, str]]:
    """Part of the first scene, and of what every die, case and restorer made of it under the first protocol, at the
    middle level; each as an ``<img>`` element, brightened by :func:`brightening`."""
    if study.truth is None:
        return []
    protocol = next(iter(study.shown)).protocol
    levels = sorted({take.level_db for take in study.shown if take.protocol == protocol})
    middle = levels[len(levels) // 2]
    factor = np.float32(brightening(study))
    scene = tile(factor * study.truth, f"part of the scene {study.scenes[0]}")
    tiles: list[tuple[Take | None, str]] = [(None, scene)]
    for take, picture in study.shown.items():
        if take.protocol == protocol and take.level_db == middle:
            words = f"the same through {take.die}, {take.case}, restored by {take.restorer}"
            tiles.append((take, tile(factor * picture, words)))
    return tiles


_MEASURES: Mapping[str, tuple[str, str, int]] = {
    "psnr": ("PSNR", "dB", 2),
    "psnr_inner": ("PSNR of the inner frame", "dB", 2),
    "ssim": ("SSIM", "", 3),
    "delta_e": ("S-CIELAB", "", 2),
    "auc_radial_min": ("area under the radial-minimum MTF", "", 4),
    "open_ratio": ("open ratio", "", 4),
    "psf_difference": ("relative difference of the PSFs", "", 3),
}
"""Name of a claim's number in words, its unit and decimals."""


def study_page(study: Study) -> str:
    """The page, with nothing from outside it; equal studies give equal pages."""
    plan = study.plan
    drawn = {name: Markup(drawing.img()) for name, drawing in _drawings(study).items()}
    tiles = optics_tiles(study) if study.optics else {}
    return page_template("study.html.j2", short=short, minus=_MINUS, measure=lambda name: _MEASURES[name][0]).render(
        style=style(),
        study=plan.study,
        job=plan.job,
        version=plan.job.signature,
        tally=_tally(study),
        claims=study.claims,
        finding=finding_text,
        limits=limits_text,
        drawn={"scores": None, "mtf": None, **drawn},
        dies=[_die(name, study) for name in plan.panels],
        tiles={name: {key: Markup(image) for key, image in images.items()} for name, images in tiles.items()},
        photographs=[(take, Markup(image)) for take, image in photograph_tiles(study)],
        brightening=brightening(study),
        captioned=lambda take: _captioned(study, take),
        blocks=blocks(study),
        scenes=study.scenes,
        skipped=plan.skipped,
        masks_told=plan.masks_told,
        confidence=f"{CONFIDENCE:.0%}",
        lines=sorted(plan.job.camera.wavelengths_nm, reverse=True),
    )


def _drawings(study: Study) -> dict[str, Drawing]:
    drawn = {"scores": scores_figure(study)} if study.scores else {}
    return drawn | ({"mtf": optics_figure(study)} if study.optics else {})


def blocks(study: Study) -> list[tuple[Setting, Table[Line]]]:
    """Tables of scores, one for each protocol in each case.

    Columns are levels of light in dB. A cell is the mean PSNR and SSIM of one die, and its gain over the first; the
    note of a line is its restorer.
    """
    return [(setting, _block(study, setting)) for setting in study.plan.settings]


def limits_text(claim: Claim) -> str:
    """The limits of a claim, in words."""
    stated = claim.stated
    _, unit, _ = _MEASURES[stated.measure]
    low, high = (
        None if bound is None else f"{short(float(bound))} {unit}".rstrip()
        for bound in (stated.at_least, stated.at_most)
    )
    if low is not None and high is not None:
        return f"from {low} to {high}"
    return f"at least {low}" if low is not None else f"at most {high}"


def finding_text(claim: Claim, finding: Finding) -> tuple[str, str, str]:
    """The thing measured, its value with its interval, and of how many photographs."""
    _, unit, digits = _MEASURES[claim.stated.measure]
    of, over, difference = finding.of, finding.over, finding.difference
    said = [of.die]
    if of.protocol:
        level = "mean over levels" if math.isnan(of.level_db) else f"{of.level_db:g} dB"
        said += [part for part in (of.case if of.case != OWN_SCENE else "", level) if part]
        said += [of.restorer] if of.restorer else []
    elif finding.wavelength_nm is not None:
        said.append(f"{finding.wavelength_nm:g} nm")
    words = ", ".join(said)
    if over is not None:
        other = [getattr(over, key) for key in ("die", "case", "restorer") if getattr(over, key) != getattr(of, key)]
        words += f", over {', '.join(other)}"
    many = f"{difference.count} photograph{'s' * (difference.count != 1)}" if difference.count else "computed"
    if not difference.count:
        sign = "+" if over is not None and claim.stated.measure != "psf_difference" else ""
        return words, f"{difference.mean:{sign}z.{digits}f} {unit}".rstrip(), many
    if over is None:
        half = "" if math.isnan(difference.half_width) else f" ± {difference.half_width:.{digits}f}"
        return words, f"{difference.mean:z.{digits}f}{half} {unit}".rstrip(), many
    return words, difference.told(unit, digits), many


def _tally(study: Study) -> tuple[int, int] | None:
    """Number of claims that agree under the first protocol, or of the optics, and of all claims."""
    first = [next(iter(claim.verdicts.values())) for claim in study.claims if claim.findings]
    return (first.count(Verdict.AGREES), len(first)) if first else None


def _block(study: Study, setting: Setting) -> Table[Line]:
    takes = [t for t in study.scores if (t.protocol, t.case) == (setting.protocol.name, setting.case)]
    levels = tuple(sorted({take.level_db for take in takes}))
    table = ScoreTable(tuple(score for take in takes for score in study.scores[take]))
    reference = next(iter(study.plan.panels))
    gains = {(gain.design, gain.level_db, gain.restorer): gain for gain in table.gains(reference)}
    lines = []
    for die, restorer in dict.fromkeys((take.die, take.restorer) for take in takes):
        of = [study.scores[Take(setting.protocol.name, setting.case, die, level, restorer)] for level in levels]
        cells = tuple(
            (_study_mean(scores, "psnr"), _study_mean(scores, "ssim"), gains.get((die, level, restorer)))
            for level, scores in zip(levels, of, strict=True)
        )
        lines.append(Line(die, cells, note=table.winners([score for scores in of for score in scores])))
    left_out = {name: study.left_out[setting.protocol.name, setting.case, name] for name in study.plan.panels}
    return Table(levels, tuple(lines), reference=reference, notes=(*by_sentence(left_out), *table.noise_told))


def _study_mean(scores: Sequence[Score], key: str) -> float:
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
        "masks": {name: path.name for name, path in plan.masks.items()},
        "idle_masks": list(plan.idle_masks),
        "unused": list(plan.unused),
        "claims": [_claim(claim) for claim in study.claims],
        "optics": [
            {
                "die": name,
                "open_ratio": optics.open_ratio,
                "auc_radial_min": {f"{mtf.wavelength_nm:g}": auc_radial_min(mtf, name).value for mtf in optics.mtfs},
            }
            for name, optics in study.optics.items()
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
    """Write page, numbers and figures into a directory that appears whole, and return the paths."""

    def write_drawings(folder: Path) -> None:
        for name, drawing in _drawings(study).items():
            drawing.save(folder / f"{name}.svg")

    texts = {PAGE: study_page(study), DOCUMENT: document_text(study_document(study))}
    return write_folder(place, texts, study.plan.job.digest, write_drawings)


def _claim(claim: Claim) -> dict[str, Any]:
    stated = claim.stated
    return {
        "says": stated.says,
        "measure": stated.measure,
        "at_least": stated.at_least,
        "at_most": stated.at_most,
        "why": stated.why,
        "verdicts": {protocol or "optics": verdict.value for protocol, verdict in claim.verdicts.items()},
        "findings": [
            {
                "of": _take(finding.of),
                "over": None if finding.over is None else _take(finding.over),
                "wavelength_nm": finding.wavelength_nm,
                **_finite({"mean": finding.difference.mean, "half_width_95": finding.difference.half_width}),
                "photographs": finding.difference.count,
                "tie": finding.over is not None and finding.difference.tie,
                "verdict": finding.verdict.value,
            }
            for finding in claim.findings
        ],
    }


def _take(take: Take) -> dict[str, Any]:
    return _finite(vars(take)) if take.protocol else {"die": take.die}


def _finite(values: Record) -> dict[str, Any]:
    """With None for what is not a number: JSON has none."""
    return {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in values.items()}


def study_lines(study: Study) -> Iterator[str]:
    """Tables of scores by protocol and case, and claims with their verdicts, as lines of text."""
    yield f"{study.plan.study.figure}: {study.plan.study.title}"
    yield from study.plan.masks_told
    for setting, table in blocks(study):
        yield from ("", setting.case, *setting.conditions.lines)
        rows = [("die", "restorer", *(f"{level:.4g} dB" for level in table.columns))]
        for line in table.lines:
            scores = (f"{psnr:.2f}" + (f" ({gain.psnr.told('')})" if gain else "") for psnr, _, gain in line.cells)
            rows.append((line.name, line.note, *scores))
        yield from columns(rows)
    for claim in study.claims:
        yield from ("", f"{claim.stated.says} ({claim.stated.measure}, {limits_text(claim)})")
        for finding in claim.findings:
            text, value, many = finding_text(claim, finding)
            yield f"  {finding.of.protocol or 'optics'}: {text}: {value}, {many}: {finding.verdict}"
        yield from (f"  {protocol or 'optics'}: {verdict.upper()}" for protocol, verdict in claim.verdicts.items())
