"""The page of measured edges: the verdict, every MTF beside the design's, and the numbers."""

from __future__ import annotations

from markupsafe import Markup

from maskfab.capture.measured_edges import MeasuredEdges
from maskfab.capture.mtf_file import MtfCurve
from maskfab.quantities import registered
from maskfab.report.documents.schema_terms import Document
from maskfab.report.page.html import style
from maskfab.report.page.measured_template import measured_template
from maskfab.report.plots.edge_figure import edges_drawing


def edge_page(found: MeasuredEdges, document: Document) -> str:
    """The page, with nothing from outside it; equal edges give equal pages.

    Args:
        found: what was measured.
        document: what measure.json says of it.
    """
    return measured_template("edge.html.j2").render(
        style=style(),
        document=document,
        drawing=Markup(edges_drawing(found).img()),
        alone=len(found.edges) == 1,
        elsewhere=any(isinstance(each.edge, MtfCurve) for each in found.edges),
        banded=all(each.edge.low is not None for each in found.edges),
        edges=[(each, [(row, registered(row.name)) for row in each.quantities]) for each in found.edges],
    )
