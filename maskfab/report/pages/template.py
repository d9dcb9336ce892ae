"""Parts that pages share: reading of templates, their look, and the glossary of the trade's words.

Quantities have their own glossary in :mod:`maskfab.base.quantities`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup

from maskfab.base.resources import template
from maskfab.report.rows.text import rounded


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


@cache
def page_template(name: str, **filters: Callable[..., Any]) -> Template:
    """A page by its file in export_templates/, compiled once; ``number`` rounds."""
    return page_environment(number=rounded, **filters).from_string(template(name))


@cache
def style() -> Markup:
    """The look of every page."""
    return Markup(template("page.css"))


WORDS: Mapping[str, str] = MappingProxyType(
    {
        "opening": "The clear shape in one display pixel.",
        "open ratio": "Clear fraction of the pixel; not the fill factor, which is the emitting fraction of a subpixel.",
        "dot": "One square element of an opening.",
        "pitch": "Side of one display pixel; DPI = 25 400 µm / pitch.",
        "tiling": "The orientation of each pixel, out of eight rotated and mirrored ones: one for all (periodic), "
        "or drawn from a seed (random; paper4 draws from four).",
        "gutter": "Opaque border around every pixel, reserved for wiring.",
        "die": "One panel on the plate.",
        "PSF": "Point spread function: the image of a distant point of light.",
        "MTF": "Modulation transfer function: contrast of the image of a sine pattern. Presampled: includes the blur "
        "of the sensor pixel, but not its aliasing.",
        "radial minimum": "The lowest MTF over all directions at one frequency.",
        "aliased": "Sampled at one pixel: frequencies above the Nyquist limit fold onto lower ones, in a way that "
        "depends on the sub-pixel offset of the picture.",
        "scene": "What the camera looks at: distances, field, the gap between panel and lens, aberrations, light.",
        "plan": "The cheapest model of a scene whose error, omitted effects included, is within the accuracy.",
        "accuracy": "The admissible relative L2 error of the scene's PSF over its window.",
        "design": "How an opening was found, as stated in its file; not checked.",
        "headroom": "Proven limit of the gain that any other opening with the same number of clear dots can have.",
        "protocol F1": "Photographs of fixed scenes with photon noise, restored by a Wiener filter with the best "
        "constant for the design; compared with the truth over the whole frame and over the inner "
        "one, without 64 pixels at every edge.",
        "surrogate": "A model that predicts the PSNR of restored photographs in two milliseconds.",
        "relative L2": "Root of the sum of squared differences over that of the squared values.",
        "Wiener filter": "The linear restoration with the least mean squared error at a given noise-to-signal ratio.",
        "XOR": "The area in which two layouts differ.",
        "CD": "Critical dimension: a width measured at a named gauge.",
    }
)
