"""The page that shows a plate: the document of a run, and the program that draws it, in one file."""

from __future__ import annotations

import json
from functools import cache

from jinja2 import Template
from markupsafe import Markup

from maskfab.report.page.environment import page_environment
from maskfab.report.viewer.shown_run import ShownRun
from maskfab.resources import template

SCRIPTS = ("geometry.js", "paint.js", "tiles.js", "measure.js", "panel.js", "view.js")
"""The program in the order in which its parts need each other."""
_INERT = {ord("<"): "\\u003c", ord(">"): "\\u003e", ord("&"): "\\u0026"}


def viewer_page(run: ShownRun) -> str:
    """The page, with nothing from outside it; equal runs give equal pages."""
    return _template().render(
        title=run.document["title"],
        style=Markup(template("view/view.css")),
        program=Markup("\n".join(template(f"view/{name}") for name in SCRIPTS)),
        document=Markup(inert_json(run.document)),
    )


def inert_json(document: object) -> str:
    """JSON that ends no element of a page, whatever names it holds."""
    return json.dumps(document, allow_nan=False, separators=(",", ":")).translate(_INERT)


@cache
def _template() -> Template:
    return page_environment().from_string(template("view/view.html.j2"))
