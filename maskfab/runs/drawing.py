"""A run's report as files: pictures of plate, dies and displays, and the pages that show them.

Apart from the result, for what draws is slow to load, and a run that is taken from the cache draws nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from klayout import db

from maskfab.base.folders import APPENDIX, NUMBERS, PAGE, REPORT, VIEW
from maskfab.base.processes import Call, SerialExecutor
from maskfab.base.work import Progress, silent
from maskfab.display.feasibility import display_rules
from maskfab.findings.photographs import Photographs
from maskfab.optics.mtf import area_under_radial_min
from maskfab.report.documents import report as report_data
from maskfab.report.documents.numbers import numbers_text
from maskfab.report.documents.shape import Document
from maskfab.report.figures import die as die_figures
from maskfab.report.figures import display
from maskfab.report.figures import report as report_figures
from maskfab.report.figures import scene as scene_figures
from maskfab.report.pages import front
from maskfab.report.pages.appendix import appendix_page
from maskfab.report.pages.page import html_page
from maskfab.report.pages.viewer import MOST_BYTES, mask_file, shown_plate, viewer_page
from maskfab.runs.result import PlateFindings

LEAST_SEEN = 12
"""Pixels along a side of a die below which no text is shown on it."""


def draw_pictures(
    findings: PlateFindings, document: Document, executor: SerialExecutor, progress: Progress = silent
) -> tuple[bytes, Mapping[str, Mapping[str, str]]]:
    """The picture of the whole plate, as PNG, and every figure, by die and figure, of dies that the report shows."""
    progress("figures", 0, 1)
    Figures, built = report_figures.Figures, findings.built
    designs, drawn = {die["name"]: die for die in document["dies"]}, frozenset(front.shown_dies(document))
    more = [
        Figures(scene.die.name, scene_figures.pictures, (scene,))
        for scene in findings.scenes
        if scene.die.name in drawn
    ]
    more += [*_front_figures(findings.restored, document), *_eye_figures(findings, document)]
    for die in findings.plate.dies:
        name = die.name
        if name not in drawn:
            continue
        if name in built.displays:
            more.append(Figures(name, display.pictures, (die.panel, built.displays[name])))
        if "design" in designs[name]:
            more.append(Figures(name, scene_figures.photograph_pictures, (findings.restored.dies[name],)))
        if name in findings.written:
            more.append(Figures(name, die_figures.written_pictures, (findings.written[name],)))
    # The die whose radial-minimum MTF is highest on average over the wavelengths.
    shown = max(findings.optics, key=lambda item: sum(area_under_radial_min(mtf) for mtf in item.mtfs))
    best = front.best(document)
    overview = executor.submit(Call(die_figures.overview, lambda: (findings.plate, document, shown)))
    stressed = () if isinstance(best, str) else best.shown
    optics = [item for item in findings.optics if item.die.name in drawn]
    pictures = report_figures.pictures(findings.plate, optics, document, more, executor, stressed)
    whole = overview.result()
    progress("figures", 1, 1)
    return whole, pictures


def _eye_figures(findings: PlateFindings, document: Document) -> Iterator[report_figures.Figures]:
    """Even light and text to the eye, of the best die's display and of its reference display."""
    best, rules = front.best(document), display_rules(findings.job)
    if isinstance(best, str) or rules is None:
        return
    die = next(die for die in findings.plate.dies if die.name == best.name)
    answer = findings.built.displays.get(best.name)
    if answer is not None and answer.judged is not None and min(die.panel.orientations.shape) >= LEAST_SEEN:
        yield report_figures.Figures(best.name, display.eye, (die.panel, answer.judged))


def report_texts(
    document: Document, pictures: Mapping[str, Mapping[str, str]], folder: Path, read: Mapping[str, db.Layout]
) -> dict[str, str]:
    """The report as files, by their names: numbers, the page that is signed, its appendix, the table, and the plate to
    look into, unless no file of the folder has polygons, or too many; ``read`` are those that are read already."""
    shown = mask_file(document["files"])
    view = shown is not None and shown["bytes"] <= MOST_BYTES
    text = report_data.report_text(document)
    page = html_page(document, pictures, view=view, text=text)
    more = {VIEW: viewer_page(shown_plate(folder, document["files"], document, page, read=read))} if view else {}
    return {
        REPORT: text,
        PAGE: page,
        APPENDIX: appendix_page(document, pictures, view=view),
        NUMBERS: numbers_text(document),
        **more,
    }


def _front_figures(restored: Photographs, document: Document) -> Iterator[report_figures.Figures]:
    """The truth, and what each die that the report shows makes of it."""
    best = front.best(document)
    if isinstance(best, str):
        return
    yield report_figures.Figures(die_figures.PLATE, scene_figures.truth, (restored.dies[best.name],))
    for name in front.shown_dies(document):
        if restored.dies[name].shots:
            yield report_figures.Figures(name, scene_figures.front, (restored.dies[name], best.level_db))
