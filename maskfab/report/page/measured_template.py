"""Templates of pages of what was measured."""

from __future__ import annotations

from functools import cache

from jinja2 import Environment, StrictUndefined, Template

from maskfab.report.plots.number_text import rounded
from maskfab.resources import template


@cache
def measured_template(name: str) -> Template:
    """A page by its file in export_templates/; ``number`` rounds."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    environment.filters.update(number=rounded)
    return environment.from_string(template(name))
