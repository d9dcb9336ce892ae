"""The page of a measured die: the verdict, the pictures side by side, the numbers and what was captured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from maskfab.capture.cost import COST_METHOD
from maskfab.capture.measured import Measured
from maskfab.capture.verdict import cause
from maskfab.quantities import registered
from maskfab.report.page.html import style
from maskfab.report.page.measured_template import measured_template
from maskfab.report.plots.capture_figures import capture_mtf_drawing, captured_drawing

_PRICES = ("captured_cost", "captured_loss")
"""Numbers that have a table of their own."""


def capture_page(found: Measured, document: Mapping[str, Any], notes: Sequence[str]) -> str:
    """The page, with nothing from outside it; equal captures give equal pages.

    Args:
        found: what was measured.
        document: what measure.json says of it.
        notes: what a reader should know, as sentences.
    """
    return measured_template("measure.html.j2").render(
        style=style(),
        version=document["maskfab_version"],
        digest=document["job_hash"],
        verdict=found.verdict,
        captured=Markup(captured_drawing(found).img()),
        mtf=Markup(capture_mtf_drawing(found).img()),
        rows=[(each, registered(each.name)) for each in found.quantities if each.name not in _PRICES],
        costs=[(cause(each.of), each) for each in found.costs],
        cost_method=COST_METHOD,
        rivals=document["hypotheses"],
        frames=document["frames"],
        doubts=document["pixels_left_out"],
        notes=notes,
    )
