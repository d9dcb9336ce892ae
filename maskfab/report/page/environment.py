"""Reading of page templates: one environment for all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from jinja2 import Environment, StrictUndefined


def page_environment(**filters: Callable[..., Any]) -> Environment:
    """Texts are escaped, a name that nobody gives is an error, and lines that only steer leave nothing behind.

    Args:
        filters: by the names that templates call them by.
    """
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    environment.filters.update(filters)
    return environment
