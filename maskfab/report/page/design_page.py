"""The page of a design, from its document alone: what was found, how, how far it is from what can be proved, what its
rules cost, and openings of nearly the same PSNR."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from jinja2 import Template
from markupsafe import Markup

from maskfab.optimiser.account import ANNEALING
from maskfab.report.design_text import USEFUL_DB
from maskfab.report.page.environment import page_environment
from maskfab.report.page.html import style
from maskfab.report.page.tradeoffs import alternatives_part, dots_image, rules_part
from maskfab.report.plots.search_figure import search_drawing
from maskfab.resources import template
from maskfab.units import UM_PER_MM

Told = Mapping[str, Any]


def design_page(told: Told) -> str:
    """The page, with nothing from outside it; equal documents give equal pages.

    Args:
        told: design.json, as :func:`maskfab.report.documents.designed_data.designed_document` makes it.
    """
    search, panel = told["search"], told["panel"]
    laid = told["map"]["expected_psnr_db"] if told["map"] else told["expected_psnr_db"]
    levels = list(laid)
    drawing = None
    if search:
        drawing = search_drawing(search["bettered"], told["evaluated"], search["value"], _judged(search))
    return _template().render(
        style=style(),
        told=told,
        search=search,
        levels=levels,
        headline=sum(laid.values()) / len(laid),
        turned=_turned(panel),
        display=_display(told["fit"]),
        room=_room(told, levels),
        rules_line=_rules_line(told, search),
        cell=dots_image(told["rows"], f"the opening {told['name']}"),
        tiles=dots_image(panel["rows"], "the middle of its panel") if panel else None,
        tiles_told=_tiles_told(told, panel),
        restored=_restored(told),
        command=told["provenance"].get("command"),
        steps=None if drawing is None else Markup(drawing.img()),
        steps_told=_steps_told(search),
        bounds=_bounds(told, levels),
        ideals=_ideals(told),
        rules=rules_part(
            search["rules"] if search else [],
            told["prices_db"],
            told["rules_cost_db"],
            told["evaluated"],
            search["priced_among"] if search else 0,
            search["annealed_without_db"] if search else None,
            annealed=_annealed(search),
        ),
        alternatives=alternatives_part(told["alternatives"], told["alternatives_absent"]),
    )


def _judged(search: Told) -> str:
    return "steps of descent" if "descent" in search["method"] else "openings judged"


def _steps_told(search: Told | None) -> str:
    if not search:
        return ""
    if "descent" in search["method"]:
        return "Steps of all starts, one after the other; a descent that went on from a checkpoint, from there on."
    told = "The best of all openings judged"
    told += ", whether or not it keeps the rules" if search["rules"] else ""
    return told + ("; then of the annealing, which keeps them." if search["rules"] and _annealed(search) else ".")


def _annealed(search: Told | None) -> bool:
    return search is not None and any(stage["what"] == ANNEALING for stage in search["stages"])


def _turned(panel: Told | None) -> str:
    return "all alike" if panel and panel["tiling"] == "periodic" else "turned at random"


def _tiles_told(told: Told, panel: Told | None) -> str:
    if not panel:
        return ""
    return f"The middle of its {'map' if told['map'] else 'panel: ' + panel['tiling']}."


def _display(fit: Told | None) -> str:
    if fit is None:
        return "not judged: the design has to hold none"
    across = fit["pixels"][0]
    size = f"{across} x {across} pixels, {fit['side_um'] / UM_PER_MM:g} mm"
    return f"FITS: emitters, circuits and wires, on a die of {size}, with seed {fit['seed']}"


def _useful(values: Mapping[str, float]) -> Mapping[str, float]:
    return {level: value for level, value in values.items() if value <= USEFUL_DB}


def _room(told: Told, levels: Sequence[str]) -> str:
    """In one line, of the opening in the picture's interior."""
    if not told["head_room_db"]:
        return "not proved"
    useful = _useful(told["head_room_db"])
    parts = [f"{useful[level]:.2f} dB at {level}" for level in levels if level in useful]
    where = "far from the frame's edge, no opening of as many dots gains more than "
    return where + ", ".join(parts) if parts else "no useful bound"


def _rules_line(told: Told, search: Told | None) -> str:
    rules = search["rules"] if search else []
    if not rules:
        return "none but the number of clear dots"
    cost = told["rules_cost_db"]
    named = ", ".join(each["rule"].replace("_", " ") for each in rules)
    return named if cost is None else f"{named}: {cost:.3f} dB together"


def _restored(told: Told) -> list[tuple[str, Mapping[str, str]]]:
    """Rows of decibels by level."""
    rows: list[tuple[str, Mapping[str, float]]] = []
    if not (told["map"] and told["outer"]):
        rows.append((f"Cells {_turned(told['panel'])}", told["expected_psnr_db"]))
    if told["map"]:
        rows += [("With its map", told["map"]["expected_psnr_db"])]
    if told["scene"]:
        rows.append(("Over the scene, mean", told["scene"]["mean_psnr_db"]))
    plain: list[tuple[str, Mapping[str, str]]] = [
        (name, {level: f"{value:.2f}" for level, value in values.items()}) for name, values in rows
    ]
    if told["map"]:
        gains = told["map"]["gain_db"]
        plain.append(
            (
                "Gain of the map over the random one that it began from",
                {level: f"{gain:+.2f}" for level, gain in gains.items()},
            )
        )
    robust = told["robust"]
    if robust and robust["tiling_db"]:
        spread = {level: f"±{value:.2f}" for level, value in robust["tiling_db"].items()}
        plain.append(("One random tiling from another, standard deviation", spread))
    for key, name in (("bias", "bias"), ("centre", "the stop's centre")):
        varied = robust[key] if robust else None
        if varied:
            lost = {level: f"{-value + 0.0:+.3f}" for level, value in varied["loss_db"].items()}
            plain.append((f"Expected over {name}, standard deviation {varied['deviation_um']:g} µm", lost))
    return plain


def _bounds(told: Told, levels: Sequence[str]) -> list[dict[str, Any]]:
    """Head rooms, what they hold for, and which is the least at each level."""
    bounds, cells = told["bounds"], told["map"]
    rows: list[tuple[str, Mapping[str, float], str]] = []
    if told["head_room_db"]:
        rows.append(("Opening, far from the frame's edge", told["head_room_db"], "any opening of as many clear dots"))
    if bounds:
        whole = {level: bounds["most_frame_psnr_db"][level] - told["expected_psnr_db"][level] for level in levels}
        if not told["scene"]:
            whole = {level: max(0.0, value) for level, value in whole.items()}
            rows.append(("Opening, the whole frame", whole, "the same, the edge's leak counted as nothing at least"))
    if cells and cells["head_room_db"]:
        rows.append(("Map", cells["head_room_db"], "any layout of as many clear dots and as much light"))
    least = {level: min((values[level] for _, values, _ in rows), default=0.0) for level in levels}
    return [
        {
            "name": name,
            "holds": holds,
            "cells": [
                {
                    "text": f"{values[level]:.2f}" if level in _useful(values) else "no useful bound",
                    "tightest": values[level] == least[level] and level in _useful(values),
                }
                for level in levels
            ],
        }
        for name, values, holds in rows
    ]


def _ideals(told: Told) -> list[tuple[str, Mapping[str, float]]]:
    bounds = told["bounds"]
    if not bounds:
        return []
    return [
        ("a grey filter of the same transmission", bounds["grey_psnr_db"]),
        ("an unobstructed stop with the same open area", bounds["open_stop_psnr_db"]),
    ]


@cache
def _template() -> Template:
    return page_environment().from_string(template("design.html.j2"))
