"""The result of a measurement as a page and a document: a die's capture beside what is expected, or MTFs across edges.

A capture's page goes in the order of a day in the laboratory: the verdict, the picture with what was found in it, what
to do next, the numbers, and an appendix; the merged capture and its standard deviation are files beside it. Edges have
one field each: the MTF with its band, beside what was designed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.arrays import Floats
from maskfab.base.folders import Place
from maskfab.base.model import Quantity
from maskfab.base.quantities import Entry, registered
from maskfab.camera.frames.frame import PIXELS_OF
from maskfab.camera.frames.merge import write_merged
from maskfab.camera.inspection.costs import COST_METHOD, disagreement
from maskfab.camera.inspection.die_verdict import Answer, stands, strength
from maskfab.camera.inspection.edge_mtf import DesignedMtf, MeasuredEdge, MeasuredEdges, MtfCurve, edge_verdict
from maskfab.camera.inspection.fit import MtfBand
from maskfab.camera.inspection.identity import CERTAIN
from maskfab.camera.inspection.measurement import Measured, write_fitted_psf
from maskfab.camera.inspection.photo_bench import SIDE as SQUARE_PX
from maskfab.camera.inspection.photo_bench import PhotoBench
from maskfab.camera.inspection.slanted_edge import EdgeMtf
from maskfab.report.documents.die import DOCUMENT
from maskfab.report.documents.shape import Document, Record, document_text
from maskfab.report.figures.die import OKABE_ITO
from maskfab.report.figures.sheet import INK, QUIET, Drawing, place, styled
from maskfab.report.pages.template import page_template, style, write_folder
from maskfab.report.text import Quantities, quantity_document, short

SCHEMA_VERSION, CAPTURE_SCHEMA_VERSION = 1, 2
PAGE = "measure.html"
_SIDE, _LEFT, _TOP, _GAP, _FOOT, _BAR = 2.35, 0.7, 0.3, 0.25, 0.22, 0.7
_DECADES = 5
_MOST_SIGMA = 4.0
_FOUND = "#00B4D8"
_COLOURS = {"R": "#D55E00", "G": "#009E73", "B": "#0072B2", "-": INK}


@styled
def captured_drawing(measured: Measured) -> Drawing:
    """Captured, expected, and their difference in standard deviations, a row for each colour."""
    colours = [capture.pixels.colour for capture in measured.taken]
    chosen = [colours.index(colour) for colour in dict.fromkeys(colours)]
    width = _LEFT + 3 * (_SIDE + _GAP) + _BAR
    height = _TOP + len(chosen) * (_SIDE + _GAP) + _FOOT
    figure = Figure(figsize=(width, height), dpi=120)
    for row, k in enumerate(chosen):
        taken, expected = measured.taken[k], measured.fit.predicted[k]
        beneath = measured.fit.beneath[taken.pixels.colour]
        peak = float((expected - beneath).max())
        bottom = height - _TOP - (row + 1) * _SIDE - row * _GAP
        shown = (
            _logarithm(np.where(taken.valid, taken.light, np.nan) - beneath, peak),
            _logarithm(expected - beneath, peak),
        )
        ends = _ends(taken.pixels.x_um, taken.pixels.y_um)
        for column, values in enumerate(shown):
            axes = _axes(figure, column, bottom)
            axes.imshow(values, cmap="magma", vmin=-_DECADES, vmax=0, extent=ends, interpolation="none")
            _named(
                axes, ("captured", "expected of the fitted die")[column] if row == 0 else "", column, row, len(chosen)
            )
            if column == 0:
                axes.set_ylabel(f"{PIXELS_OF[taken.pixels.colour]}, y (µm)")
        axes = _axes(figure, 2, bottom)
        residual = np.where(taken.valid, measured.fit.residuals[k], np.nan)
        drawn = axes.imshow(
            residual, cmap="PuOr", vmin=-_MOST_SIGMA, vmax=_MOST_SIGMA, extent=ends, interpolation="none"
        )
        _named(axes, "difference, in standard deviations" if row == 0 else "", 2, row, len(chosen))
        _draw_found(figure.axes[-3], measured, k)
        _draw_found(axes, measured, k)
        bar = place(figure, (_LEFT + 3 * (_SIDE + _GAP) - _GAP + 0.08, bottom, 0.1, _SIDE))
        figure.colorbar(drawn, cax=bar)
    words = ", ".join([f"captured, expected and their difference, {len(chosen)} colours", *_found(measured)])
    return Drawing(figure, words)


def _found(measured: Measured) -> list[str]:
    left_out = measured.holds and any(measured.explained.left_out.counts.values())
    there = {"a second lamp": _lamp_um(measured), "pixels that were left out": left_out}
    return [name for name, found in there.items() if found]


def _lamp_um(measured: Measured) -> tuple[float, float] | None:
    setting = measured.fit.setting
    lamp = setting.lamp if measured.holds else None
    return None if lamp is None else (setting.x_um + lamp.x_um, setting.y_um + lamp.y_um)


def _draw_found(axes: Axes, measured: Measured, k: int) -> None:
    """A ring about a second lamp, and a line about pixels that were left out."""
    lamp, left_out, pixels = _lamp_um(measured), measured.explained.left_out.together[k], measured.taken[k].pixels
    if lamp is not None:
        axes.plot(*lamp, "o", markersize=16, markerfacecolor="none", markeredgecolor=_FOUND, markeredgewidth=1.4)
        axes.annotate("lamp", lamp, (0, 10), textcoords="offset points", ha="center", color=_FOUND, fontsize=7)
    if measured.holds and left_out.any():
        axes.contour(pixels.x_um, pixels.y_um, left_out.astype(float), levels=[0.5], colors=[_FOUND], linewidths=1.0)


_STRUCTURED = 3
"""Decades of a photograph's structure that are shown."""


@styled
def structure_drawing(found: PhotoBench) -> Drawing:
    """Power of green light over that of smooth scenes, and |H|², in decades of its most, over cycles per pixel."""
    figure = Figure(figsize=(_LEFT + 2 * (_SIDE + _GAP), 2 * _TOP + _SIDE + _FOOT), dpi=120)
    seen, fitted = found.structure()
    # Both by one measure: single powers scatter as much as they are.
    most, ends = float(np.nanmax(fitted)), (0.0, 0.5, -0.5, 0.5)
    for column, (values, name) in enumerate(((seen, "seen"), (fitted, "fitted"))):
        axes = _axes(figure, column, _TOP + _FOOT)
        axes.imshow(_logarithm(values, most), cmap="magma", vmin=-_STRUCTURED, vmax=0, extent=ends, aspect="auto")
        axes.set_title(name, loc="left")
        axes.set_xlabel("cycles per pixel")
        if column:
            axes.tick_params(labelleft=False)
    return Drawing(
        figure, f"power of {found.squares} squares of {SQUARE_PX} pixels over their scenes', and |H|² fitted"
    )


@styled
def capture_mtf_drawing(measured: Measured) -> Drawing:
    """MTF of what was captured over the band that noise allows the fitted die, for each grid of pixels."""
    figure = Figure(figsize=(9.0, 3.6), dpi=120)
    axes = place(figure, (0.75, 0.5, 5.6, 2.9))
    seen: set[str] = set()
    for band in measured.bands:
        if band.colour in seen:
            continue
        seen.add(band.colour)
        _curves(axes, band)
    axes.set_xlabel("frequency on the sensor (cycles per mm)")
    axes.set_ylabel("modulation, window and noise included")
    axes.set_yscale("log")
    # Powers in the formulas' notation would show as their source, for no text is a formula here.
    axes.yaxis.set_major_formatter(lambda value, _: short(value))
    axes.grid(color=QUIET, alpha=0.25, linewidth=0.5)
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=7)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return Drawing(figure, "MTF of the captured picture and of the fitted die")


def _curves(axes: Axes, band: MtfBand) -> None:
    colour, name = _COLOURS[band.colour], PIXELS_OF[band.colour]
    for row, (dashes, kind) in enumerate((("-", "mean"), (":", "minimum"))):
        axes.fill_between(band.frequencies, band.low[row], band.high[row], color=colour, alpha=0.22, linewidth=0)
        label = f"{name}, {kind} over directions"
        axes.plot(band.frequencies, band.measured[row], dashes, color=colour, linewidth=1.2, label=label)
    if band.parted_per_mm is not None:
        axes.axvline(band.parted_per_mm, color=colour, linewidth=0.8, dashes=(2, 2))


def _logarithm(values: Floats, peak: float) -> Floats:
    return np.asarray(np.log10(np.clip(values / peak, 10.0**-_DECADES, 1.0)))


def _ends(x_um: Floats, y_um: Floats) -> tuple[float, float, float, float]:
    half = abs(x_um[1] - x_um[0]) / 2
    return float(x_um[0] - half), float(x_um[-1] + half), float(y_um[-1] - half), float(y_um[0] + half)


def _axes(figure: Figure, column: int, bottom: float) -> Axes:
    return place(figure, (_LEFT + column * (_SIDE + _GAP), bottom, _SIDE, _SIDE))


def _named(axes: Any, title: str, column: int, row: int, rows: int) -> None:
    axes.set_title(title, loc="left")
    if column:
        axes.tick_params(labelleft=False)
    if row == rows - 1:
        axes.set_xlabel("x (µm)")
    else:
        axes.tick_params(labelbottom=False)


_PRICES = ("captured_cost", "captured_loss")
"""Numbers that have a table of their own."""


def capture_page(measured: Measured, document: Record, notes: Sequence[str]) -> str:
    """The page, with nothing from outside it; equal captures give equal pages."""
    return page_template("measure.html.j2").render(
        style=style(),
        version=document["maskfab_version"],
        digest=document["job_hash"],
        verdict=measured.verdict,
        held=measured.verdict.answer is not Answer.CANNOT_TELL,
        sentences=measured.sentences,
        if_it_held=measured.if_words,
        if_sentences=measured.if_sentences,
        captured=Markup(captured_drawing(measured).img()),
        found=" and ".join(_found(measured)),
        left_out=measured.explained.left_out.counts,
        suspects=[(each, strength(each)) for each in measured.suspects],
        mtf=Markup(capture_mtf_drawing(measured).img()),
        rows=_rows(measured.quantities),
        if_rows=_rows(measured.if_numbers),
        zero=_zero_words(measured.quantities),
        if_zero=_zero_words(measured.if_numbers),
        costs=[(disagreement(cost.of), cost) for cost in measured.costs],
        cost_method=COST_METHOD,
        rivals=document["hypotheses"],
        frames=document["frames"],
        doubts=document["pixels_left_out"],
        notes=notes,
    )


_TERM = "captured_term"


def _rows(quantities: Sequence[Quantity]) -> list[tuple[Quantity, Entry]]:
    """Numbers of a table with their meanings, without the lens's terms that cannot be told from zero."""
    shown = [each for each in quantities if each.name not in _PRICES and each not in _zero(quantities)]
    return [(each, registered(each.name)) for each in shown]


def _zero(quantities: Sequence[Quantity]) -> list[Quantity]:
    terms = [each for each in quantities if each.name == _TERM]
    return [each for each in terms if abs(float(each.value or 0.0)) <= (each.uncertainty or 0.0)]


def _zero_words(quantities: Sequence[Quantity]) -> str:
    """One line for all of those; empty without any."""
    terms = _zero(quantities)
    if not terms:
        return ""
    most = max(each.uncertainty or 0.0 for each in terms)
    named = "; ".join(str(each.detail) for each in terms)
    return f"Cannot be told from zero, within ±{short(most)} waves: Zernike {named}."


LIGHT, SIGMA, FITTED = "captured.exr", "captured_sigma.exr", "fitted_psf.exr"
_SHOWN = 12


def capture_document(measured: Measured, job_hash: str, notes: Sequence[str]) -> dict[str, Any]:
    """Everything that was measured; what measure.json and ``--json`` say."""
    best, fit, verdict = measured.identified.best, measured.fit, measured.verdict
    lamp = fit.setting.lamp if measured.holds else None
    return {
        "schema_version": CAPTURE_SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": job_hash,
        "verdict": {
            "answer": verdict.answer.value,
            "reason": verdict.reason,
            "cause": verdict.cause,
            "factor": verdict.factor,
            "next_step": verdict.next_step,
        },
        "sentences": list(measured.sentences),
        "die": best.die if measured.identified.certain else None,
        "stands": stands(best) if measured.identified.certain else None,
        "turn_the_plate_over": measured.mirrored if measured.identified.certain else None,
        "quantities": Quantities(measured.quantities).to_dict(),
        "if": {
            "sentences": list(measured.if_sentences),
            "quantities": Quantities(measured.if_numbers).to_dict(),
        },
        "lamp": lamp and {"x_um": lamp.x_um, "y_um": lamp.y_um, "share": lamp.share},
        "left_out_px": measured.explained.left_out.counts,
        "suspects": [
            {"cause": each.cause.value, "strength": strength(each), "log_likelihood": each.gain / 2}
            for each in measured.suspects
        ],
        "light": {
            colour: {"electrons_per_s": value, "beneath_electrons_per_s": fit.beneath[colour]}
            for colour, value in fit.light.items()
        },
        "steps": fit.steps,
        "hypotheses": {
            "certain": CERTAIN,
            "others": [
                {"die": candidate.die, "stands": stands(candidate), "chi2_above": margin}
                for candidate, margin in measured.identified.ahead[:_SHOWN]
            ],
        },
        "mtf": [
            {
                "colour": band.colour,
                "frequency_per_mm": band.frequencies.tolist(),
                "parted_per_mm": band.parted_per_mm,
                **{
                    name: {"mean": values[0].tolist(), "minimum": values[1].tolist()}
                    for name, values in (
                        ("captured", band.measured),
                        ("expected", band.expected),
                        ("low", band.low),
                        ("high", band.high),
                    )
                },
            }
            for band in measured.bands
        ],
        "frames": [
            {
                "name": capture.name,
                "sha256": capture.sha256,
                "exposure_s": capture.exposure_s,
                "drift": drift,
                "full": capture.full,
            }
            for capture, drift in zip(measured.merged.used, measured.drifts, strict=True)
        ],
        "pixels_left_out": {
            name: len(getattr(measured.merged, name)) for name in ("hot", "disagreeing", "full", "dust")
        },
        "notes": list(notes),
    }


def write_capture(place: Place, measured: Measured, document: Record, notes: Sequence[str]) -> list[Path]:
    """Write everything into a directory that appears whole, and return the paths."""

    def write_light(folder: Path) -> None:
        write_merged(measured.merged, folder / LIGHT, folder / SIGMA)
        write_fitted_psf(measured.image, measured.fit.setting, measured.identified.best.die, folder / FITTED)

    texts = {PAGE: capture_page(measured, document, notes), DOCUMENT: document_text(document)}
    return write_folder(place, texts, document["job_hash"], write_light)


_EDGE_LEFT, _EDGE_FOOT, _WIDE, _HIGH, _ACROSS, _UP, _LEGEND = 0.55, 0.85, 3.2, 2.4, 0.35, 0.35, 0.35
_MOST_ACROSS = 3
_MOST_IN_LEGEND = 5
_STYLES = ((0, (5, 1.5)), (0, (1, 1)), (0, (3, 1, 1, 1)), (0, (6, 1, 1, 1, 1, 1)))
_LIMIT_CY_PER_PX = 0.5


@styled
def edges_drawing(measured: MeasuredEdges, title: str = "") -> Drawing:
    """Every edge's MTF with its band, and the designed ones through the same window, up to one cycle per pixel."""
    columns = min(len(measured.edges), _MOST_ACROSS)
    rows = -(-len(measured.edges) // columns)
    width = _EDGE_LEFT + columns * (_WIDE + _ACROSS)
    height = _LEGEND + rows * (_EDGE_FOOT + _HIGH) + _UP
    figure = Figure(figsize=(width, height), dpi=160)
    figure.set_facecolor("white")
    lights = list(dict.fromkeys(designed.light for edge in measured.edges for designed in edge.designed))
    for k, curve in enumerate(measured.edges):
        left = _EDGE_LEFT + (k % columns) * (_WIDE + _ACROSS)
        bottom = _LEGEND + (rows - 1 - k // columns) * (_EDGE_FOOT + _HIGH) + _EDGE_FOOT - 0.3
        axes = place(figure, (left, bottom, _WIDE, _HIGH))
        _draw(axes, curve, lights)
        if k % columns == 0:
            axes.set_ylabel("MTF")
    named = {}
    for axes in figure.axes:
        named.update({label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)})
    across = min(len(named), _MOST_IN_LEGEND if columns > 1 else 2)
    figure.legend(named.values(), named, loc="lower center", ncols=across, fontsize=7.5)
    if title:
        figure.text(_EDGE_LEFT / width, 1 - 0.08 / height, title, va="top", fontsize=10)
    return Drawing(figure, _words(measured.edges, measured.die))


def _draw(axes: Axes, measured: MeasuredEdge, lights: Sequence[str]) -> None:
    edge = measured.edge
    frequency = edge.frequency_cy_per_px
    if edge.low is not None and edge.high is not None:
        axes.fill_between(frequency, edge.low, edge.high, color="#bcc3cb", linewidth=0, label="95 % band")
    for designed in measured.designed:
        k = lights.index(designed.light)
        axes.plot(
            frequency,
            designed.seen,
            color=OKABE_ITO[k % (len(OKABE_ITO) - 1)],
            linestyle=_STYLES[k % len(_STYLES)],
            linewidth=1.2,
            label=f"designed, {designed.light}",
        )
    axes.plot(frequency, edge.mtf, color=INK, linewidth=1.1, label="measured")
    axes.axvline(_LIMIT_CY_PER_PX, color="#9aa3ad", linewidth=0.6)
    axes.set(xlim=(0, float(frequency[-1])), ylim=(0, max(1.05, float(edge.mtf.max()))))
    axes.set(xlabel="frequency (cycles/pixel)")
    axes.grid(color="#e3e6ea", linewidth=0.5)
    axes.set_axisbelow(True)
    title, per_mm = measured.title, edge.frequency_cy_per_mm
    if per_mm is not None:
        title += " (top: cy/mm)"
        most_per_px = float(frequency[-1])
        most_per_mm = float(per_mm[-1])
        top = axes.get_xaxis_transform()
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            place, text = (share * most_per_px, 1), f"{share * most_per_mm:.4g}"
            axes.annotate(text, place, (0, 3), xycoords=top, textcoords="offset points", ha="center", va="bottom")
    axes.set_title(title, loc="left", pad=14, fontsize=7.5)


def _words(edges: Sequence[MeasuredEdge], die: str | None) -> str:
    beside = f" beside the design of {die}" if die else ""
    if isinstance(edges[0].edge, MtfCurve):
        return f"MTF of {edges[0].edge.name}{beside}"
    return f"MTF across {len(edges)} slanted edge{'s' if len(edges) > 1 else ''} with 95 % bands{beside}"


def edge_document(
    measured: MeasuredEdges, name: str, digest: str, job_hash: str | None, notes: Sequence[str]
) -> Document:
    """Everything that was measured; what measure.json and ``--json`` say."""
    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": job_hash,
        "verdict": list(edge_verdict(measured)),
        "file": {"name": name, "sha256": digest},
        **edges_document(measured),
        "notes": list(notes),
    }


def edges_document(measured: MeasuredEdges) -> Document:
    """Of plain Python types; a unit stands in every name, rows count from the picture's top.

    What only a picture tells is None of a curve that was measured elsewhere, and cycles per millimetre are where the
    pixel is not known.
    """
    return {"die": measured.die, "edges": [_edge(edge) for edge in measured.edges], "left_out": list(measured.left_out)}


def _edge(measured: MeasuredEdge) -> Document:
    edge = measured.edge
    seen = edge if isinstance(edge, EdgeMtf) else None
    return {
        "title": measured.title,
        "colour": measured.colour,
        "direction": seen and seen.direction,
        "angle_deg": seen and seen.angle_deg,
        "normal_deg": edge.normal_deg,
        "region_px": seen and asdict(seen.region),
        "lines": seen and seen.lines,
        "order": seen and seen.order,
        "window_px": seen and 2 * seen.half_px,
        "pixel_um": edge.pixel_um,
        "method": f"read from {edge.name}" if isinstance(edge, MtfCurve) else edge.method,
        "frequency_cy_per_px": edge.frequency_cy_per_px.tolist(),
        "frequency_cy_per_mm": _list(edge.frequency_cy_per_mm),
        "mtf": edge.mtf.tolist(),
        "low": _list(edge.low),
        "high": _list(edge.high),
        "designed": [_designed(designed) for designed in measured.designed],
        "quantities": [quantity_document(quantity) for quantity in measured.quantities],
    }


def _list(values: NDArray[np.float64] | None) -> list[float] | None:
    return None if values is None else values.tolist()


def _designed(designed: DesignedMtf) -> Document:
    return {
        "light": designed.light,
        "wavelength_nm": designed.wavelength_nm,
        "mtf": designed.mtf.tolist(),
        "seen": designed.seen.tolist(),
        "uncertainty": designed.uncertainty,
        "method": designed.method,
    }


def edge_page(measured: MeasuredEdges, document: Document) -> str:
    """The page, with nothing from outside it; equal edges give equal pages."""
    return page_template("edge.html.j2").render(
        style=style(),
        document=document,
        drawing=Markup(edges_drawing(measured).img()),
        alone=len(measured.edges) == 1,
        elsewhere=any(isinstance(edge.edge, MtfCurve) for edge in measured.edges),
        banded=all(edge.edge.low is not None for edge in measured.edges),
        edges=[(edge, [(row, registered(row.name)) for row in edge.quantities]) for edge in measured.edges],
    )


def write_edges(place: Place, measured: MeasuredEdges, document: Document) -> list[Path]:
    """Write page and numbers into a directory that appears whole, and return the paths."""
    texts = {PAGE: edge_page(measured, document), DOCUMENT: document_text(document)}
    return write_folder(place, texts, document["job_hash"])
