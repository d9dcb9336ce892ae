"""Designs for a display: restored photographs against emitters, as a figure, a table, a page and a job for each design.

The figure has one field for each number of lines. A curve is drawn as what it says: a design serves for its own
footprint and every smaller one, and for its own lines and fewer, so it is a stair that comes from the left and stands
in every field that it serves. A given opening is a star, hollow where fewer lines pass it than the field asks for.
Where middles were sought, two more fields have what they gain over the best design of one opening, against grain and
against the light's centroid, with the limits of the job's rules as lines. The
colours are those of cividis, whose lightness rises alike for colour-blind readers; every curve also has a mark.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from maskfab.base import __version__
from maskfab.base.folders import Place
from maskfab.base.units import NM_PER_UM
from maskfab.designs.front import FrontPoint, JudgedOpening, Pareto, sought
from maskfab.designs.front_designs import FrontDesign
from maskfab.designs.rules.families import explained
from maskfab.mask.opening_file import opening_text
from maskfab.mask.panels import map_text
from maskfab.report.documents.shape import Record, document_text
from maskfab.report.figures.die import MARKS
from maskfab.report.figures.sheet import INK, Drawing, bitmap, open_field, place, styled
from maskfab.report.pages.design import (
    alternatives_document,
    alternatives_part,
    dots_image,
    drawn_rows,
    prices_document,
    rules_part,
)
from maskfab.report.pages.template import page_template, style, write_folder
from maskfab.report.text import by_level

_LEFT, _FOOT, _WIDE, _HIGH, _GAP, _LEGEND = 0.6, 0.5, 3.4, 3.4, 0.2, 2.0
_MOST_FIELDS = 4
_LIGHTEST = 0.85
_MOST_IN_LEGEND = 22


@styled
def pareto_png(pareto: Pareto) -> bytes:
    """The figure as a PNG file."""
    return bitmap(_drawn(pareto))


@styled
def pareto_drawing(pareto: Pareto) -> Drawing:
    """The figure, to be looked at or saved."""
    said = f"Restored PSNR against footprint of emitters, {len(pareto.curves)} open ratios"
    more = "; gain of denser middles against grain and centroid" if _sought(pareto) else ""
    return Drawing(_drawn(pareto), f"{said}, {' and '.join(map(str, _fields(pareto)))} lines{more}")


@styled
def svg(pareto: Pareto) -> str:
    """The figure as an SVG file; equal sweeps give equal text."""
    buffer = io.StringIO()
    _drawn(pareto).savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return buffer.getvalue()


def _fields(pareto: Pareto) -> tuple[int, ...]:
    """Numbers of lines that some design serves, at most so many."""
    most = max(point.lines for point in pareto.points)
    served = [lines for lines in pareto.lines if lines <= most]
    return tuple(served[-_MOST_FIELDS:])


def _drawn(pareto: Pareto) -> Figure:
    fields = _fields(pareto)
    eye = _SEEN if _sought(pareto) else ()
    plain = _LEFT + len(fields) * (_WIDE + _GAP)
    width = plain + len(eye) * (_LEFT + _WIDE + _GAP) + _LEGEND
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
        _field(axes, pareto, lines)
        axes.set_title(f"{lines} lines each way" if lines else "not wired", loc="left")
    for k, (rule, value, label) in enumerate(eye):
        left = plain + k * (_LEFT + _WIDE + _GAP) + _LEFT
        _seen(place(figure, (left, _FOOT, _WIDE, _HIGH)), pareto, rule, value, label)
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


def _field(axes: Axes, pareto: Pareto, lines: int) -> None:
    curves = [curve for curve in pareto.curves if curve.front]
    shades = mpl.colormaps["cividis"](np.linspace(0, _LIGHTEST, len(curves)))
    across = [100 * point.footprint for point in pareto.points]
    across += [100 * other.footprint for other in pareto.compared]
    room = 0.06 * (max(across) - min(across)) + 0.3
    left = max(0.0, min(across) - room)
    # The most open stands highest in the figure, so it is the first in the legend.
    for k, curve in reversed(list(enumerate(curves))):
        ratio = curve.front[0].judged.open_ratio
        label = f"{ratio:.1%} open, {curve.clear_dots} dots"
        serving = [point for point in curve.front if point.lines >= lines]
        mark = MARKS[k % len(MARKS)]
        _curve(axes, serving, left, shades[k], mark, label)
        _denser(axes, [point for point in curve.denser if point.lines >= lines], shades[k], mark)
    for number, other in enumerate(pareto.compared, start=1):
        label = f"{number}  {other.shape}, {other.open_ratio:.1%}, {other.lines} lines"
        x, y = 100 * other.footprint, other.value
        filled = INK if other.lines >= lines else "white"
        axes.plot(x, y, "*", color=INK, markerfacecolor=filled, markersize=9, zorder=4, label=label)
        axes.annotate(f"{number}", (x, y), (5, 4), textcoords="offset points", fontsize=7.5)
    axes.set_xlabel("area of each colour's emitter (% of the pixel)")
    open_field(axes)
    axes.set_xlim(left, max(across) + room)
    axes.margins(y=0.08)


def _denser(axes: Axes, serving: list[FrontPoint], colour: object, mark: str) -> None:
    for point in serving:
        x, y = 100 * point.footprint, point.value
        axes.plot(
            x, y, mark, markerfacecolor="white", markeredgecolor=colour, markeredgewidth=1.4, markersize=7, zorder=3
        )
        axes.annotate(f"{point.densest:.0%}", (x, y), (6, -3), textcoords="offset points", fontsize=6.5, color=INK)


_SEEN: tuple[tuple[str, str, str], ...] = (
    ("slow_grain", "grain", "slow grain of an even field (rms contrast)"),
    ("centroid_px", "centroid_px", "centroid of the light off the pixel's middle (pixels)"),
)
"""Fields of what the eye sees: the rule that limits it, the number of a design, and its words."""


def _sought(pareto: Pareto) -> bool:
    return any(sought(point.uneven) for curve in pareto.curves for point in curve.denser)


def _seen(axes: Axes, pareto: Pareto, rule: str, value: str, label: str) -> None:
    """Gain of the middles of each curve over its best design of one opening, which is drawn at none."""
    curves = [curve for curve in pareto.curves if curve.front]
    shades = mpl.colormaps["cividis"](np.linspace(0, _LIGHTEST, len(curves)))
    limit = pareto.limits.get(rule)
    for k, curve in enumerate(curves):
        one, mark = curve.front[0], MARKS[k % len(MARKS)]
        points = sorted((point for point in curve.denser if sought(point.uneven)), key=lambda point: point.value)
        across = [getattr(point, value) for point in points]
        axes.plot(across, [point.value - one.value for point in points], color=shades[k], linewidth=0.8, zorder=2)
        for point in (one, *points):
            x, y = getattr(point, value), point.value - one.value
            kept = limit is None or x <= limit
            axes.plot(
                x, y, mark, markerfacecolor=shades[k] if kept else "white", markeredgecolor=shades[k], markersize=6
            )
            if point is not one:
                dots = int(point.units[0].sum())
                axes.annotate(f"{dots}", (x, y), (5, -3), textcoords="offset points", fontsize=6.5, color=INK)
    if limit is not None:
        axes.axvline(limit, color=INK, linewidth=1, linestyle=(0, (4, 2)))
        axes.set_title(f"{rule}, at most {limit:g}", loc="left")
    axes.set_xlabel(label)
    axes.set_ylabel("gain over one opening (dB)")
    axes.set_xlim(left=0)
    open_field(axes)


def _curve(axes: Axes, serving: list[FrontPoint], left: float, colour: object, mark: str, label: str) -> None:
    across = [100 * point.footprint for point in serving]
    up = [point.value for point in serving]
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


def pareto_page(pareto: Pareto, designs: Sequence[FrontDesign], document: Record) -> str:
    """The page, with nothing from outside it; equal fronts give equal pages."""
    best = set(map(id, pareto.best))
    return page_template("pareto.html.j2").render(
        style=style(),
        named=_named(designs),
        version=document["maskfab_version"],
        digest=document["job_hash"],
        figure=Markup(pareto_drawing(pareto).img()),
        levels=[f"{level:g}" for level in pareto.levels],
        rows=[(design, id(design.point) in best) for design in sorted(designs, key=lambda design: -design.point.value)],
        drawn={
            design.name: dots_image(drawn_rows(design.opening.mask), f"the opening {design.name}") for design in designs
        },
        compared=document["compared"],
        curves=[{**curve, **_tradeoffs(curve)} for curve in document["curves"]],
        notes=document["notes"],
        seed=document["seed"],
        assumes=f"{document['designed_for']}; {document['scenes']}",
        rules_kept=", ".join(rule.replace("_", " ") for rule in document["rules_kept"]),
        sought=_sought(pareto),
        limits={rule.replace("_", " "): limit for rule, limit in pareto.limits.items()},
        uneven=any(design.outer is not None for design in designs),
        mapped=any(design.point.mapped is not None for design in designs),
    )


def _tradeoffs(curve: Record) -> dict[str, Markup]:
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


SCHEMA_VERSION = 4
DOCUMENT, TABLE, PAGE, FIGURE, DRAWING = "pareto.json", "pareto.csv", "pareto.html", "pareto.png", "pareto.svg"

Designs = Sequence[FrontDesign]


def pareto_document(
    pareto: Pareto, designs: Designs, job_hash: str, notes: Sequence[str], scenes: str
) -> dict[str, Any]:
    """Everything that was found, and notes for a user; what pareto.json and ``--json`` say."""
    best = set(map(id, pareto.best))
    by_point = {id(design.point): design for design in designs}

    def point_document(design: FrontDesign) -> dict[str, Any]:
        point = design.point
        return {
            "name": design.name,
            **_numbers(point.judged, pareto.levels),
            "shape": point.shape,
            "density": point.densest,
            "footprint": point.footprint,
            "lines": point.lines,
            "mapped": point.mapped is not None,
            "panel_psnr_db": point.value,
            "panel_psnr_by_level_db": by_level(pareto.levels, point.psnr),
            "grain_rms": point.grain,
            "centroid_px": point.centroid_px,
            "best": id(point) in best,
            **_files(design),
        }

    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": job_hash,
        "seed": pareto.seed,
        "designed_for": pareto.designed_for,
        "scenes": scenes,
        "rules_kept": list(pareto.kept),
        "limits_of_the_eye": dict(pareto.limits),
        "lines": list(pareto.lines),
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
                "designs": [point_document(by_point[id(point)]) for point in curve.points],
            }
            for curve in pareto.curves
        ],
        "compared": [
            {"name": other.shape, **_numbers(other, pareto.levels), "best_gain_db": pareto.gain_db(other)}
            for other in pareto.compared
        ],
        "notes": list(notes),
    }


def table(pareto: Pareto, designs: Designs) -> str:
    """One line for each opening, of curves and given ones, as CSV."""
    buffer = io.StringIO()
    rows = csv.writer(buffer, lineterminator="\n")
    psnr = [f"panel_psnr_{level:g}_db" for level in pareto.levels]
    columns = [
        "open_ratio",
        "density",
        "expected_psnr_db",
        "panel_psnr_db",
        *psnr,
        "footprint",
        "lines",
        "grain_rms",
        "centroid_px",
        "best",
    ]
    rows.writerow(["kind", "name", "shape", "clear_dots", *columns])
    best = set(map(id, pareto.best))
    for design in designs:
        point, judged = design.point, design.point.judged
        numbers = [judged.open_ratio, point.densest, judged.value, point.value, *point.psnr, point.footprint]
        eye = [f"{point.grain:.6f}", f"{point.centroid_px:.6f}"]
        row = [*(f"{number:.6f}" for number in numbers), point.lines, *eye, int(id(point) in best)]
        rows.writerow(["design", design.name, point.shape, judged.clear_dots, *row])
    for other in pareto.compared:
        alone = [f"{number:.6f}" for number in (other.open_ratio, other.open_ratio, other.value)]
        unlaid = [""] * (1 + len(pareto.levels))
        row = [*alone, *unlaid, f"{other.footprint:.6f}", other.lines, "", "", 0]
        rows.writerow(["given", other.shape, other.shape, other.clear_dots, *row])
    return buffer.getvalue()


def write_pareto(place: Place, pareto: Pareto, document: Record, designs: Designs) -> list[Path]:
    """Write everything, and its document, into a directory that appears whole, and return the paths."""
    texts = {
        TABLE: table(pareto, designs),
        DRAWING: svg(pareto),
        PAGE: pareto_page(pareto, designs, document),
        DOCUMENT: document_text(document),
    }
    for design in designs:
        names = _files(design)
        texts |= {names["opening"]: opening_text(design.opening), names["job"]: design.job}
        if design.outer is not None:
            texts[names["outer"]] = opening_text(design.outer)
        if design.map is not None:
            texts[names["map"]] = map_text(design.map)

    def write_figure(folder: Path) -> None:
        (folder / FIGURE).write_bytes(pareto_png(pareto))

    return write_folder(place, texts, document["job_hash"], write_figure)


def _files(design: FrontDesign) -> dict[str, str]:
    named = {"opening": f"{design.name}.toml", "job": f"{design.name}_job.toml"}
    if design.outer is not None:
        named["outer"] = f"{design.name}_outer.toml"
    return named if design.map is None else {**named, "map": f"{design.name}_map.toml"}


def _numbers(judged: JudgedOpening, levels: Sequence[float]) -> dict[str, Any]:
    return {
        "shape": judged.shape,
        "clear_dots": judged.clear_dots,
        "open_ratio": judged.open_ratio,
        "footprint": judged.footprint,
        "lines": judged.lines,
        "expected_psnr_db": judged.value,
        "expected_psnr_by_level_db": by_level(levels, judged.psnr),
    }


def _named(designs: Sequence[FrontDesign]) -> str:
    dot_um = designs[0].opening.dot_nm / NM_PER_UM if designs else 0.0
    return explained(dot_um, *(design.point.shape for design in designs))


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
            f"  {'*' if id(one) in best else ' '} {_judged_text(one.value, one)}, grain {one.grain:.5f}, "
            f"centroid {one.centroid_px:.3f} px  "
            f"{names[id(one)]}: {one.shape}"
            for one in curve.points
        ]
        lines += [f"    does not fit on a die: {misfit}" for misfit in curve.misfits]
    lines += filter(None, [_named(designs)])
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
