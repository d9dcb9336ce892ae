"""Templates of pages of what was measured."""

from __future__ import annotations

from functools import cache

from jinja2 import Template

from maskfab.report.page.environment import page_environment
from maskfab.report.plots.number_text import rounded
from maskfab.resources import template


@cache
def measured_template(name: str) -> Template:
    """A page by its file in export_templates/; ``number`` rounds."""
    return page_environment(number=rounded).from_string(template(name))
