"""Designs for a display: restored photographs against emitters, one field for each number of lines.

A curve is drawn as what it says: a design serves for its own footprint and every smaller one, and for its own lines and
fewer, so it is a stair that comes from the left and stands in every field that it serves. A given opening is a star,
hollow where fewer lines pass it than the field asks for. The colours are those of
cividis, whose lightness rises alike for colour-blind readers; every curve also has a mark of its own.

The page of a front: its figure, a table of what is traded, and the job of every design.

The files of a front: its page, its numbers as JSON and CSV, its designs with their jobs, and the figure.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from maskfab.base import __version__
from maskfab.base.folders import Place, staged, write_mark
from maskfab.designs.front import FrontDesign, FrontPoint, JudgedOpening, Pareto
from maskfab.mask.opening_file import opening_text
from maskfab.mask.panels import map_text
from maskfab.report.documents.design import alternatives_document, drawn_rows, prices_document
from maskfab.report.documents.shape import document_text
from maskfab.report.figures.sheet import INK, QUIET, Drawing, bitmap, place, styled
from maskfab.report.pages.design import alternatives_part, dots_image, rules_part
from maskfab.report.pages.template import page_template, style
from maskfab.report.rows.text import by_level

_MARKS = "osD^vphX"
_LEFT, _FOOT, _WIDE, _HIGH, _GAP, _LEGEND = 0.6, 0.5, 3.4, 3.4, 0.2, 2.0
_MOST_FIELDS = 4
_LIGHTEST = 0.85
_MOST_IN_LEGEND = 22


@styled
def pareto_png(found: Pareto) -> bytes:
    """The figure as a PNG file."""
    return bitmap(_drawn(found))


@styled
def pareto_drawing(found: Pareto) -> Drawing:
    """The figure, to be looked at or saved."""
    said = f"Restored PSNR against footprint of emitters, {len(found.curves)} open ratios"
    return Drawing(_drawn(found), f"{said}, {' and '.join(map(str, _fields(found)))} lines")


@styled
def svg(found: Pareto) -> str:
    """The figure as an SVG file; equal sweeps give equal text."""
    buffer = io.StringIO()
    _drawn(found).savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return buffer.getvalue()


def _fields(found: Pareto) -> tuple[int, ...]:
    """Numbers of lines that some design serves, at most so many."""
    most = max(each.lines for each in found.points)
    served = [lines for lines in found.lines if lines <= most]
    return tuple(served[-_MOST_FIELDS:])


def _drawn(found: Pareto) -> Figure:
    fields = _fields(found)
    width = _LEFT + len(fields) * (_WIDE + _GAP) + _LEGEND
    height = _FOOT + _HIGH + 0.4
    figure = Figure(figsize=(width, height), dpi=160)
    figure.set_facecolor("white")
    first: Axes | None = None
    for k, lines in enumerate(fields):
        axes = place(figure, (_LEFT + k * (_WIDE + _GAP), _FOOT, _WIDE, _HIGH))
        if first is not None:
            axes.sharex(first)
            axes.sharey(first)
            axes.tick_params(labelleft=False)
        first = first or axes
        _field(axes, found, lines)
        axes.set_title(f"{lines} lines each way" if lines else "not wired", loc="left")
    assert first is not None
    first.set_ylabel("expected restored PSNR (dB)")
    handles, labels = first.get_legend_handles_labels()
    figure.legend(
        handles[:_MOST_IN_LEGEND],
        labels[:_MOST_IN_LEGEND],
        loc="upper left",
        bbox_to_anchor=((width - _LEGEND) / width, (_FOOT + _HIGH + 0.06) / height),
        fontsize=6.5,
        handlelength=1.6,
        borderaxespad=0,
    )
    return figure


def _field(axes: Axes, found: Pareto, lines: int) -> None:
    curves = [curve for curve in found.curves if curve.front]
    shades = mpl.colormaps["cividis"](np.linspace(0, _LIGHTEST, len(curves)))
    across = [100 * each.footprint for each in found.points]
    across += [100 * each.footprint for each in found.compared]
    room = 0.06 * (max(across) - min(across)) + 0.3
    left = max(0.0, min(across) - room)
    # The most open stands highest in the figure, so it is the first in the legend.
    for k, curve in reversed(list(enumerate(curves))):
        ratio = curve.front[0].judged.open_ratio
        label = f"{ratio:.1%} open, {curve.clear_dots} dots"
        serving = [each for each in curve.front if each.lines >= lines]
        mark = _MARKS[k % len(_MARKS)]
        _curve(axes, serving, left, shades[k], mark, label)
        _denser(axes, [each for each in curve.denser if each.lines >= lines], shades[k], mark)
    for number, each in enumerate(found.compared, start=1):
        label = f"{number}  {each.shape}, {each.open_ratio:.1%}, {each.lines} lines"
        x, y = 100 * each.footprint, each.value
        filled = INK if each.lines >= lines else "white"
        axes.plot(x, y, "*", color=INK, markerfacecolor=filled, markersize=9, zorder=4, label=label)
        axes.annotate(f"{number}", (x, y), (5, 4), textcoords="offset points", fontsize=7.5)
    axes.set_xlabel("area of each colour's emitter (% of the pixel)")
    axes.grid(color=QUIET, alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.set_xlim(left, max(across) + room)
    axes.margins(y=0.08)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _denser(axes: Axes, serving: list[FrontPoint], colour: object, mark: str) -> None:
    """Hollow marks with the clear share of the middle beside them."""
    for each in serving:
        x, y = 100 * each.footprint, each.value
        axes.plot(
            x, y, mark, markerfacecolor="white", markeredgecolor=colour, markeredgewidth=1.4, markersize=7, zorder=3
        )
        axes.annotate(f"{each.densest:.0%}", (x, y), (6, -3), textcoords="offset points", fontsize=6.5, color=INK)


def _curve(axes: Axes, serving: list[FrontPoint], left: float, colour: object, mark: str, label: str) -> None:
    """The stair of those that none betters in this field, and marks for all that serve."""
    across = [100 * each.footprint for each in serving]
    up = [each.value for each in serving]
    widest, stair_x, stair_y = left, [left], []
    for x, y in sorted(zip(across, up, strict=True), key=lambda pair: (-pair[1], -pair[0])):
        if x > widest:
            stair_x.append(x)
            stair_y.append(y)
            widest = x
    if stair_y:
        axes.step(stair_x, [stair_y[0], *stair_y], where="pre", color=colour, linewidth=1.1, zorder=2)
    axes.plot(
        across, up, mark, color=colour, markersize=4.5, markeredgecolor=INK, markeredgewidth=0.4, zorder=3, label=label
    )


_ABSENT = "The budget was over before they were compared."


def pareto_page(found: Pareto, designs: Sequence[FrontDesign], document: Mapping[str, Any]) -> str:
    """The page, with nothing from outside it; equal fronts give equal pages.

    Args:
        found, designs: of a sweep.
        document: what pareto.json says of it.
    """
    best = set(map(id, found.best))
    return page_template("pareto.html.j2").render(
        style=style(),
        version=document["maskfab_version"],
        digest=document["job_hash"],
        figure=Markup(pareto_drawing(found).img()),
        levels=[f"{level:g}" for level in found.levels],
        rows=[(each, id(each.point) in best) for each in sorted(designs, key=lambda each: -each.point.value)],
        drawn={each.name: dots_image(drawn_rows(each.opening.mask), f"the opening {each.name}") for each in designs},
        compared=document["compared"],
        curves=[{**curve, **_tradeoffs(curve)} for curve in document["curves"]],
        notes=document["notes"],
        seed=document["seed"],
        assumes=f"{document['designed_for']}; {document['scenes']}",
        rules_kept=", ".join(rule.replace("_", " ") for rule in document["rules_kept"]),
        uneven=any(each.outer is not None for each in designs),
        mapped=any(each.point.mapped is not None for each in designs),
    )


def _tradeoffs(curve: Mapping[str, Any]) -> dict[str, Markup]:
    """Costs of the display to designs of one size, and openings beside the best of them."""
    rules = rules_part(
        curve["rules"],
        curve["prices_db"],
        curve["rules_cost_db"],
        curve["evaluated"],
        curve["priced_among"],
        annealed=False,
    )
    return {"costs": rules, "near": alternatives_part(curve["alternatives"], _ABSENT)}


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
        OutputError: MF401 or MF404 as :func:`maskfab.base.folders.staged`.
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
        _text(folder / DOCUMENT, document_text(document))
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


def _text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def front_lines(front: Pareto, designs: Sequence[FrontDesign]) -> list[str]:
    """The curves with their designs, and what they are compared with, as lines of text."""
    best = set(map(id, front.best))
    names = {id(design.point): design.name for design in designs}
    lines = []
    for curve in front.curves:
        if curve.refusal is not None:
            lines.append(f"{curve.clear_dots} clear dots: {curve.refusal}")
            continue
        cut = "; the budget ended it" if not curve.complete else ""
        between = f", {curve.left_out} designs between these left out" if curve.left_out else ""
        lines.append(
            f"{curve.clear_dots} clear dots ({curve.front[0].judged.open_ratio:.1%} open): {curve.evaluated} openings "
            f"evaluated, emitters and wires of {curve.measured} measured{between}{cut}"
        )
        lines += [
            f"  {'*' if id(one) in best else ' '} {_judged_text(one.value, one)}, grain {one.grain:.5f}  "
            f"{names[id(one)]}: {one.shape}"
            for one in curve.points
        ]
        lines += [f"    does not fit on a die: {misfit}" for misfit in curve.misfits]
    for given in front.compared:
        gain = front.gain_db(given)
        more = (
            "nothing found has so much of both at no more clear dots"
            if gain is None
            else f"the best design found, neither mapped, is {gain:+.2f} dB better"
        )
        lines.append(f"    {_judged_text(given.value, given)}  {given.shape}, {given.open_ratio:.1%} open; {more}")
    return lines


def _judged_text(value: float, opening: JudgedOpening | FrontPoint) -> str:
    return f"{value:.2f} dB  emitters {opening.footprint:.2%}  {opening.lines} lines"
