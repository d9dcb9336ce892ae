"""The page of a front: its figure, a table of what is traded, and the job of every design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from jinja2 import Template
from markupsafe import Markup

from maskfab.optimiser.pareto.designs import FrontDesign
from maskfab.optimiser.pareto.front import Pareto
from maskfab.report.documents.alternatives_data import drawn_rows
from maskfab.report.page.environment import page_environment
from maskfab.report.page.html import style
from maskfab.report.page.tradeoffs import alternatives_part, dots_image, rules_part
from maskfab.report.plots.pareto_figure import pareto_drawing
from maskfab.resources import template

_ABSENT = "The budget was over before they were compared."


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


@cache
def _template() -> Template:
    return page_environment().from_string(template("pareto.html.j2"))
