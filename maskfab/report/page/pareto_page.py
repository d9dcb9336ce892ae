"""The page of a front: its figure, a table of what is traded, and the job of every design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from jinja2 import Template
from markupsafe import Markup

from maskfab.optimiser.pareto.designs import FrontDesign
from maskfab.optimiser.pareto.front import Pareto
from maskfab.report.page.environment import page_environment
from maskfab.report.page.html import style
from maskfab.report.plots.pareto_figure import pareto_drawing
from maskfab.report.plots.png import data_uri, png
from maskfab.report.plots.sheet import img
from maskfab.resources import template

_PALETTE = np.array([[74, 82, 92], [255, 255, 255]], dtype=np.uint8)
"""Closed and clear."""


def pareto_page(found: Pareto, designs: Sequence[FrontDesign], document: Mapping[str, Any]) -> str:
    """The page, with nothing from outside it; equal fronts give equal pages.

    Args:
        found, designs: of a sweep.
        document: what pareto.json says of it.
    """
    best = set(map(id, found.best))
    return _template().render(
        style=style(),
        version=document["maskfab_version"],
        digest=document["job_hash"],
        figure=Markup(pareto_drawing(found).img()),
        levels=[f"{level:g}" for level in found.levels],
        rows=[(each, id(each.point) in best) for each in sorted(designs, key=lambda each: -each.point.value)],
        drawn={each.name: _drawing(each) for each in designs},
        compared=document["compared"],
        curves=document["curves"],
        notes=document["notes"],
        uneven=any(each.outer is not None for each in designs),
        mapped=any(each.point.mapped is not None for each in designs),
    )


def _drawing(each: FrontDesign) -> Markup:
    """The opening's dots, for an ``<img>`` that scales them without blurring."""
    dots = png(each.opening.mask.astype(np.uint8), _PALETTE)
    return Markup(img(data_uri(dots), f"the opening {each.name}", "small"))


@cache
def _template() -> Template:
    return page_environment().from_string(template("pareto.html.j2"))
