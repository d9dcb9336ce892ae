"""The result of a design: its document, which ``--json`` prints, and the page that is made from the document alone.

Both tell what was found, how, how far it is from what can be proved, what each rule costs, and openings of nearly the
same PSNR.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.folders import Place
from maskfab.base.units import NM_PER_UM, UM_PER_MM
from maskfab.designs.model.appraisal import Robustness, Varied, laid_picture
from maskfab.designs.rules.families import explained
from maskfab.designs.search.result import ANNEALING, WITHIN_DB, Account, Alternative, Alternatives, Prices
from maskfab.mask.panels import shifted
from maskfab.optics.tiling import orientations
from maskfab.report.documents.shape import Record, document_text
from maskfab.report.figures.sheet import INK, Drawing, data_uri, img, open_field, place, png, styled
from maskfab.report.pages.template import page_template, style, write_folder
from maskfab.report.text import QUICK, USEFUL_DB, by_level, told_gains

if TYPE_CHECKING:
    from maskfab.designs.model.limits import Gap
    from maskfab.designs.rules.display_fit import DieFit
    from maskfab.designs.search.result import Designed, SceneDesign


def alternatives_document(alternatives: Alternatives) -> dict[str, Any]:
    """Alternatives as plain data; shares of the pixel, micrometres, dB."""
    return {
        "within_db": WITHIN_DB,
        "bias_um": alternatives.bias_um,
        "of_the_display": alternatives.own_emitters,
        "judged_within": alternatives.within,
        "kinds": alternatives.kinds,
        "unlisted": alternatives.unlisted,
        "untried": alternatives.untried,
        "chosen": _told(alternatives.chosen),
        "others": [
            {
                **_told(other),
                "below_db": alternatives.chosen.value - other.value + 0.0,
                "better_at": list(other.better_at(alternatives.chosen)),
            }
            for other in alternatives.others
        ],
    }


def drawn_rows(unit: NDArray[np.bool_]) -> list[str]:
    """Rows of dots [rows, columns], row 0 the lowest, as text from the top: ``#`` is clear, ``.`` closed."""
    return ["".join(".#"[dot] for dot in row) for row in unit[::-1].astype(int).tolist()]


def _told(alternative: Alternative) -> dict[str, Any]:
    return {
        "shape": alternative.name,
        "rows": drawn_rows(alternative.unit),
        "clear_dots": int(alternative.unit.sum()),
        "open_ratio": alternative.open_ratio,
        "expected_psnr_db": alternative.value,
        "emitters": alternative.emitters,
        "rim_um": alternative.rim_um,
        "moved_by_bias_db": alternative.moved_db,
        "alike": alternative.alike,
    }


SCHEMA_VERSION = 1
_SHOWN_CELLS = 6
"""Cells along a side of the middle of a panel that is drawn."""


@dataclass(frozen=True)
class Made:
    """Origin of a design, beside what was found."""

    job_hash: str
    wall_s: float
    processor_s: float


def designed_document(
    design: Designed, paths: Mapping[str, Path], notes: Sequence[str], made: Made | None = None
) -> dict[str, Any]:
    """The result as plain data; infinite values are null. Equal designs give equal documents but for ``time``."""
    designed, account = design.designed, design.account
    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": None if made is None else made.job_hash,
        "time": None if made is None else _time(made, account),
        "name": design.opening.name,
        "path": str(paths["opening"]),
        "shape": design.shape,
        "clear_dots": design.opening.clear_dots,
        "shortfall": None if design.shortfall is None else {**asdict(design.shortfall), "told": design.shortfall.told},
        "open_ratio": design.opening.open_ratio,
        "designed_for": design.camera,
        "dot_um": design.opening.dot_nm / NM_PER_UM,
        "pitch_um": design.opening.dots * design.opening.dot_nm / NM_PER_UM,
        "rows": drawn_rows(design.opening.mask),
        "panel": None if account is None else _panel(design, account),
        "expected_psnr_db": by_level(design.levels, design.psnr),
        "head_room_db": None if design.head_room is None else by_level(design.levels, design.head_room),
        "bounds": None if design.gap is None else _bounds_document(design, design.gap),
        "evaluated": design.evaluated,
        "search": None if account is None else _search(account),
        **prices_document(design.prices),
        "alternatives": None if design.alternatives is None else alternatives_document(design.alternatives),
        "alternatives_absent": _absent(design),
        "map": None
        if designed is None
        else {
            "path": str(paths["map"]),
            "gain_db": by_level(design.levels, designed.gain_db),
            "expected_psnr_db": by_level(design.levels, designed.psnr),
            "random_psnr_db": by_level(design.levels, designed.start_psnr),
            "head_room_db": None if design.map_head_room is None else by_level(design.levels, design.map_head_room),
            "clear_dots": designed.clear_dots,
            "random_clear_dots": designed.start_clear_dots,
            "positions": max(1, len(designed.shifts)),
        },
        "robust": None if design.robust is None else _robust(design, design.robust),
        "fit": None if design.fit is None else _fit(design, design.fit),
        "scene": None if design.scene is None else _scene(design, design.scene),
        "outer": None if design.outer is None else str(paths["outer"]),
        "notes": list(notes),
        "provenance": dict(design.opening.provenance),
    }


def _fit(design: Designed, fit: DieFit) -> dict[str, object]:
    return {
        "pixels": [fit.across, fit.across],
        # Whether nothing round the map is drawn from a seed.
        "regular_beyond": design.cells is not None and design.cells.beyond is not None,
        "side_um": fit.side_um,
        "seed": fit.seed,
        "failed": [{"seed": seed, "why": why} for seed, why in fit.failed.items()],
        "seconds": round(fit.seconds, 3),
    }


def _scene(designed: Designed, scene: SceneDesign) -> dict[str, object]:
    """Lengths in micrometres; null for an infinite distance."""
    panel, random = scene.panel, scene.random
    return {
        "accuracy": scene.seen.plan.accuracy,
        "modelled": list(scene.seen.modelled),
        "left_out": list(scene.seen.neglected),
        "mean_psnr_db": by_level(designed.levels, panel.mean),
        "random_mean_psnr_db": None if random is None else by_level(designed.levels, random.mean),
        "conditions": [
            {
                "object_um": _finite(condition.object_um),
                "image_um": list(condition.image_um),
                "weight": condition.weight,
                "psnr_db": by_level(designed.levels, psnr),
                "random_psnr_db": None if random is None else by_level(designed.levels, random.psnr[k]),
            }
            for k, (condition, psnr) in enumerate(zip(panel.conditions, panel.psnr, strict=True))
        ],
    }


def _robust(designed: Designed, robust: Robustness) -> dict[str, object]:
    return {
        "panel_psnr_db": by_level(designed.levels, robust.psnr),
        "tiling_db": None if robust.tiling is None else by_level(designed.levels, robust.tiling),
        "map_gain_off_centre_db": {
            f"{away:g}": by_level(designed.levels, losses) for away, losses in robust.off_centre.items()
        },
        **{name: _varied(designed, getattr(robust, name)) for name in ("bias", "centre")},
    }


def _varied(designed: Designed, varied: Varied | None) -> dict[str, object] | None:
    if varied is None:
        return None
    return {
        "deviation_um": varied.deviation_um,
        "psnr_db": [by_level(designed.levels, losses) for losses in varied.psnr],
        "loss_db": by_level(designed.levels, varied.loss),
    }


def _bounds_document(designed: Designed, gap: Gap) -> dict[str, object]:
    limit = gap.bounds
    return {
        "interior_psnr_db": by_level(designed.levels, gap.psnr),
        "most_interior_psnr_db": by_level(designed.levels, limit.psnr),
        "grey_psnr_db": by_level(designed.levels, limit.grey),
        "open_stop_psnr_db": by_level(designed.levels, limit.open_stop),
        "auc": gap.auc,
        "most_auc": limit.auc,
        "method": list(limit.method),
    }


def prices_document(prices: Prices | None) -> dict[str, Any]:
    """Costs of rules, dB; null where no opening judged tells it, and of all where nothing is priced."""
    if prices is None:
        return {"rules_cost_db": None, "prices_db": {}}
    rules = {one.rule: {"alone": _finite(one.alone), "last": _finite(one.last)} for one in prices.each}
    return {"rules_cost_db": _finite(prices.together), "prices_db": rules}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _time(made: Made, account: Account | None) -> dict[str, float]:
    """Seconds; of them those of the processor that annealings without a rule took."""
    seconds = {"wall_s": made.wall_s, "processor_s": made.processor_s}
    if account is not None and account.without is not None:
        seconds["annealed_without_s"] = account.without[1]
    return {name: round(value, 1) for name, value in seconds.items()}


def _search(account: Account) -> dict[str, Any]:
    return {
        "method": account.method,
        "seed": account.seed,
        "scenes": account.scenes,
        "stages": [{"what": what, "count": count} for what, count in account.stages],
        "budget_s": account.budget_s,
        "ended_by": account.stopped,
        "value": account.value,
        "bettered": [list(step) for step in account.bettered],
        "rules": [{"rule": rule, "asked": asked} for rule, asked in account.asked.items()],
        "priced_among": account.priced_among,
        "annealed_without_db": None if account.without is None else dict(account.without[0]),
    }


def _panel(design: Designed, account: Account) -> dict[str, Any]:
    designed, unit = design.designed, design.opening.mask
    units = [unit] if design.outer is None else [unit, design.outer.mask]
    if designed is None:
        kinds = orientations(account.tiling, _SHOWN_CELLS, _SHOWN_CELLS, account.tiling_seed)
    else:
        first = max(0, (len(designed.orientations) - _SHOWN_CELLS) // 2)
        kinds = designed.orientations[first : first + _SHOWN_CELLS, first : first + _SHOWN_CELLS]
        units = [shifted(unit, shift) for shift in designed.shifts] if designed.shifts else units
    return {
        "tiling": account.tiling.value,
        "tiling_seed": account.tiling_seed,
        "rows": drawn_rows(laid_picture(np.stack(units), kinds)),
    }


def _absent(designed: Designed) -> str | None:
    """Why there are no alternatives; None where there are some, or were looked for."""
    if designed.alternatives is not None:
        return None
    if designed.outer is not None:
        return "A panel of two openings is judged as a whole, and no other one was."
    if designed.account is None or designed.prices is None:
        return "No other opening was judged in decibels."
    return "The budget is shorter than what they take."


_PALETTE = np.array([[74, 82, 92], [255, 255, 255]], dtype=np.uint8)
"""Closed and clear."""
_BETTER = {
    "psnr": "PSNR without a map",
    "emitters": "room for emitters",
    "rim": "margin to its neighbours",
    "bias": "steadier under bias",
}


def rules_part(
    rules: Sequence[Mapping[str, str]],
    prices: Mapping[str, Mapping[str, float | None]],
    together: float | None,
    judged: int,
    among: int,
    without: Mapping[str, float] | None = None,
    *,
    annealed: bool,
) -> Markup:
    """Cost of each rule.

    Args:
        rules: that were asked for, each with what it asks in words.
        prices: dB by rule: ``alone``, and ``last``, on top of the others; null where no opening judged tells it.
        together: of all rules, dB; None where that is not known.
        among: the best of these, among which rules are priced.
        without: dB that an annealing without a rule gained; None where there was none.
    """
    rows = [
        {
            "rule": rule["rule"].replace("_", " "),
            "asked": rule["asked"] or "as the job has it",
            "priced": rule["rule"] in prices,
            "without": (without or {}).get(rule["rule"]),
            **prices.get(rule["rule"], {"alone": None, "last": None}),
        }
        for rule in rules
    ]
    return Markup(_macros().rules(rows, together, judged, among, annealed, without is not None))


def alternatives_part(near: Record | None, absent: str | None) -> Markup:
    """Openings of nearly the PSNR of a chosen one, as told by :func:`alternatives_document`, or why none."""
    if near is None:
        return Markup(_macros().alternatives(None, absent))
    shown = {
        **near,
        "chosen": _shown(near["chosen"]),
        "others": [
            {
                **_shown(other),
                "against": f"{-other['below_db'] + 0.0:+.3f}",
                "better": ", ".join(_BETTER[name] for name in other["better_at"]) or "nothing of this",
            }
            for other in near["others"]
        ],
    }
    return Markup(_macros().alternatives(shown, None))


def dots_image(rows: Sequence[str], words: str) -> Markup:
    """Dots, drawn row by row from the top, for an ``<img>`` that scales them without blurring."""
    levels = np.array([[dot == "#" for dot in row] for row in reversed(rows)], dtype=np.uint8)
    return Markup(img(data_uri(png(levels, _PALETTE)), words, "small"))


def _shown(opening: Record) -> dict[str, Any]:
    return {**opening, "picture": dots_image(opening["rows"], f"the opening {opening['shape']}")}


def _macros() -> Any:
    return page_template("tradeoffs.html.j2").module


_WIDE, _HIGH, _LEFT, _FOOT, _TOP = 5.6, 1.9, 0.75, 0.5, 0.15


@styled
def search_drawing(bettered: Sequence[Sequence[float]], last: int, value: str, judged: str) -> Drawing | None:
    """A stair of the best values for each stage that began anew; None where the best was bettered less than twice.

    Args:
        bettered: how many were judged when the best was bettered, and its value.
        last: how many were judged in all.
        value: what the values are, with their unit.
    """
    if len(bettered) < 2:
        return None
    figure = Figure(figsize=(_LEFT + _WIDE + 0.15, _TOP + _HIGH + _FOOT))
    figure.set_facecolor("white")
    axes = place(figure, (_LEFT, _FOOT, _WIDE, _HIGH))
    runs = stages(bettered)
    ends = [*(run[0][0] for run in runs[1:]), last]
    for run, end in zip(runs, ends, strict=True):
        numbers, values = zip(*run, strict=True)
        axes.step([*numbers, max(end, numbers[-1])], [*values, values[-1]], where="post", color=INK, linewidth=1.1)
        axes.plot(numbers, values, "o", color=INK, markersize=3)
    axes.set_xlabel(judged)
    axes.set_ylabel(value.split(", ", maxsplit=1)[0] + (" (dB)" if ", dB" in value else ""))
    open_field(axes)
    numbers, values = zip(*bettered, strict=True)
    return Drawing(figure, f"{value}: {values[0]:.4g} at {numbers[0]}, {values[-1]:.4g} from {numbers[-1]} on")


def stages(bettered: Sequence[Sequence[float]]) -> list[list[Sequence[float]]]:
    """Parts in which the values go one way, that of the first two: an annealing under rules may begin below a scan."""
    upwards = bettered[1][1] > bettered[0][1]
    stretches = [[bettered[0]]]
    for before, step in pairwise(bettered):
        if (step[1] > before[1]) is upwards:
            stretches[-1].append(step)
        else:
            stretches.append([step])
    return stretches


def design_page(document: Record) -> str:
    """The page, with nothing from outside it; equal documents give equal pages."""
    search, panel, bounds = document["search"], document["panel"], document["bounds"]
    laid = document["map"]["expected_psnr_db"] if document["map"] else document["expected_psnr_db"]
    levels = list(laid)
    drawing = None
    if search:
        drawing = search_drawing(search["bettered"], document["evaluated"], search["value"], _judged(search))
    ideals = []
    if bounds:
        ideals.append(("a grey filter of the same transmission", bounds["grey_psnr_db"]))
        ideals.append(("an unobstructed stop with the same open area", bounds["open_stop_psnr_db"]))
    return page_template("design.html.j2").render(
        style=style(),
        told=document,
        search=search,
        levels=levels,
        headline=sum(laid.values()) / len(laid),
        turned=_turned(panel),
        named=explained(document["dot_um"], document["shape"]),
        display=_display(document["fit"], document["shortfall"]),
        room=_room(document, levels),
        rules_line=_rules_line(document, search),
        cell=dots_image(document["rows"], f"the opening {document['name']}"),
        tiles=dots_image(panel["rows"], "the middle of its panel") if panel else None,
        tiles_told=f"The middle of its {'map' if document['map'] else 'panel: ' + panel['tiling']}." if panel else "",
        restored=_restored(document),
        quick=QUICK if document["map"] and not document["outer"] else None,
        command=document["provenance"].get("command"),
        steps=None if drawing is None else Markup(drawing.img()),
        steps_told=_steps_told(search),
        bounds=_bounds(document, levels),
        useful=USEFUL_DB,
        ideals=ideals,
        rules=rules_part(
            search["rules"] if search else [],
            document["prices_db"],
            document["rules_cost_db"],
            document["evaluated"],
            search["priced_among"] if search else 0,
            search["annealed_without_db"] if search else None,
            annealed=_annealed(search),
        ),
        alternatives=alternatives_part(document["alternatives"], document["alternatives_absent"]),
    )


def _judged(search: Record) -> str:
    return "steps of descent" if "descent" in search["method"] else "openings judged"


def _steps_told(search: Record | None) -> str:
    if not search:
        return ""
    if "descent" in search["method"]:
        return "Steps of all starts, one after the other; a descent that went on from a checkpoint, from there on."
    words = "The best of all openings judged"
    words += ", whether or not it keeps the rules" if search["rules"] else ""
    return words + ("; then of the annealing, which keeps them." if search["rules"] and _annealed(search) else ".")


def _annealed(search: Record | None) -> bool:
    return search is not None and any(stage["what"] == ANNEALING for stage in search["stages"])


def _turned(panel: Record | None) -> str:
    return "all alike" if panel and panel["tiling"] == "periodic" else "turned at random"


def _display(fit: Record | None, shortfall: Record | None) -> str:
    if fit is None:
        return "not judged: the design has to hold none"
    across = fit["pixels"][0]
    size = f"{across} x {across} pixels, {fit['side_um'] / UM_PER_MM:g} mm"
    drawn = "whatever its seed" if fit["regular_beyond"] else f"with seed {fit['seed']}"
    fits = f"FITS: emitters, circuits and wires, on a die of {size}, {drawn}"
    return fits if shortfall is None else f"{fits}; {shortfall['told']}"


def _useful(values: Mapping[str, float]) -> Mapping[str, float]:
    return {level: value for level, value in values.items() if value <= USEFUL_DB}


def _room(document: Record, levels: Sequence[str]) -> str:
    if not document["head_room_db"]:
        return "not proved"
    useful = _useful(document["head_room_db"])
    parts = [f"{useful[level]:.2f} dB at {level}" for level in levels if level in useful]
    where = "far from the frame's edge, no opening of as many dots gains more than "
    return where + ", ".join(parts) if parts else f"not proved to {USEFUL_DB:g} dB"


def _rules_line(document: Record, search: Record | None) -> str:
    rules = search["rules"] if search else []
    if not rules:
        return "none but the number of clear dots"
    cost = document["rules_cost_db"]
    named = ", ".join(rule["rule"].replace("_", " ") for rule in rules)
    return named if cost is None else f"{named}: {cost:.3f} dB together"


def _restored(document: Record) -> list[tuple[str, Mapping[str, str]]]:
    cells, gained = document["map"], dict[str, float]()
    if cells:
        rows = [("Cells turned at random, once", cells["random_psnr_db"]), ("With its map", cells["expected_psnr_db"])]
        gained = told_gains(cells["expected_psnr_db"], cells["random_psnr_db"])
    else:
        rows = [(f"Cells {_turned(document['panel'])}", document["expected_psnr_db"])]
    if document["scene"]:
        rows.append(("Over the scene, mean", document["scene"]["mean_psnr_db"]))
    plain: list[tuple[str, Mapping[str, str]]] = [
        (name, {level: f"{value:.2f}" for level, value in values.items()}) for name, values in rows
    ]
    if gained:
        plain.insert(2, ("Gain of the map over that", {level: f"{gain:+.2f}" for level, gain in gained.items()}))
    robust = document["robust"]
    if robust and robust["tiling_db"]:
        spread = {level: f"±{value:.2f}" for level, value in robust["tiling_db"].items()}
        plain.append(("Spread between random seeds, 1 σ", spread))
    for key, name in (("bias", "bias"), ("centre", "the stop's centre")):
        varied = robust[key] if robust else None
        if varied:
            lost = {level: f"{-value + 0.0:+.3f}" for level, value in varied["loss_db"].items()}
            plain.append((f"Expected over {name}, standard deviation {varied['deviation_um']:g} µm", lost))
    return plain


def _bounds(document: Record, levels: Sequence[str]) -> list[dict[str, Any]]:
    cells = document["map"]
    proved = [("Opening", document["head_room_db"], "any opening of as many clear dots")]
    if cells:
        proved.append(("Map", cells["head_room_db"], "any layout of as much light in every cell"))
    rows = [(name, useful, holds) for name, values, holds in proved if values and (useful := _useful(values))]
    return [
        {
            "name": name,
            "holds": holds,
            "cells": [f"{values[level]:.2f}" if level in values else "–" for level in levels],
        }
        for name, values, holds in rows
    ]


DOCUMENT, PAGE = "design.json", "design.html"


def write_design(place: Place, document: Record, files: Mapping[str, str]) -> list[Path]:
    """Write everything into a directory that appears whole, and return the paths."""
    text = document_text(document)
    texts = {**files, DOCUMENT: text, PAGE: design_page(json.loads(text))}
    return write_folder(place, texts, document["job_hash"])
