"""Two parts of the pages of designs: what each rule costs, and openings of nearly the same PSNR."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from jinja2 import Template
from markupsafe import Markup

from maskfab.report.page.environment import page_environment
from maskfab.report.plots.png import data_uri, png
from maskfab.report.plots.sheet import img
from maskfab.resources import template

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
        judged: openings in all.
        among: the best of these, among which rules are priced.
        without: dB that an annealing without a rule gained; None where there was none.
        annealed: the opening was annealed under the rules.
    """
    rows = [
        {
            "rule": each["rule"].replace("_", " "),
            "asked": each["asked"] or "as the job has it",
            "priced": each["rule"] in prices,
            "without": (without or {}).get(each["rule"]),
            **prices.get(each["rule"], {"alone": None, "last": None}),
        }
        for each in rules
    ]
    return Markup(_macros().rules(rows, together, judged, among, annealed, without is not None))


def alternatives_part(near: Mapping[str, Any] | None, absent: str | None) -> Markup:
    """Openings of nearly the PSNR of a chosen one.

    Args:
        near: as :func:`maskfab.report.documents.alternatives_data.alternatives_document` tells them.
        absent: why there are none.
    """
    if near is None:
        return Markup(_macros().alternatives(None, absent))
    shown = {
        **near,
        "chosen": _shown(near["chosen"]),
        "others": [
            {**_shown(each), "against": f"{-each['below_db'] + 0.0:+.3f}", "better": _better(each["better_at"])}
            for each in near["others"]
        ],
    }
    return Markup(_macros().alternatives(shown, None))


def dots_image(rows: Sequence[str], words: str) -> Markup:
    """Dots, drawn row by row from the top, for an ``<img>`` that scales them without blurring."""
    levels = np.array([[dot == "#" for dot in row] for row in reversed(rows)], dtype=np.uint8)
    return Markup(img(data_uri(png(levels, _PALETTE)), words, "small"))


def _shown(each: Mapping[str, Any]) -> dict[str, Any]:
    return {**each, "picture": dots_image(each["rows"], f"the opening {each['shape']}")}


def _better(names: Sequence[str]) -> str:
    return ", ".join(_BETTER[name] for name in names) or "nothing of this"


@cache
def _macros() -> Any:
    made: Template = page_environment().from_string(template("tradeoffs.html.j2"))
    return made.module
