"""Restored photographs as a page: whether the PSF explains each, before and after, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from maskfab.base.arrays import Singles
from maskfab.camera.photo import shrunk
from maskfab.optics.colour import code_of_light
from maskfab.report.figures.scene import tile
from maskfab.report.pages.template import page_template, style

PAGE = "restore.html"


def restored_page(
    document: Mapping[str, Any],
    pictures: Sequence[tuple[Singles, Singles]],
    brought: Sequence[tuple[str, Singles]] = (),
    chart: str = "",
    left_out: Sequence[str] = (),
) -> str:
    """The page, with nothing from outside it; equal photographs give equal pages.

    Args:
        pictures: of each photograph as it was taken, and restored: linear sRGB [3, rows, columns], row 0 on top.
        brought: sentences and pictures of those that lie on the first.
        chart: a sentence on the colours of a chart, if there is one.
        left_out: sentences on its patches that were not used.
    """
    photos = [
        (photo, _shown(before, f"{photo['name']} as it was taken"), _shown(after, f"{photo['name']} restored"))
        for photo, (before, after) in zip(document["photos"], pictures, strict=True)
    ]
    return page_template("restore.html.j2").render(
        style=style(),
        version=document["maskfab_version"],
        photos=photos,
        brought=[(words, _shown(picture, words)) for words, picture in brought],
        chart=chart,
        left_out=left_out,
    )


def _shown(picture: Singles, words: str) -> Markup:
    return Markup(tile(code_of_light(shrunk(picture)), words))
