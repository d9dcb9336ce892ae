"""A report's page and pictures held against the same made again, perhaps on another machine.

Words must be equal to the letter. A picture may differ by what the last bits of another machine's arithmetic make of a
line or a shade, which nobody can see.
"""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterator, Mapping
from html import unescape
from itertools import zip_longest
from urllib.parse import unquote

import numpy as np
from matplotlib.image import imread

_PICTURE = re.compile(r"""<img class="\w+" src='[^']*' alt="[^"]*">""")
_EMBEDDED = re.compile(r"data:image/png;base64,([A-Za-z0-9+/=]+)")
_COORDINATE = re.compile(r"-?\d+\.\d+")
_WORDS = re.compile(r">[^<]+<")
_SHIFT = 0.05
"""Of a line, in points: paths are written to .01."""
_SHADE = 0.05
"""Of a pixel, of 1."""
TEXT = "text"


def differences(then: str, now: str, pictures: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    """What differs between two pages: :data:`TEXT`, or the names of pictures, as ``die figure``.

    Args:
        then: the page that is there.
        now: the page made again.
        pictures: those that ``now`` was made with.
    """
    if _PICTURE.split(then) != _PICTURE.split(now):
        yield TEXT
    names = {drawn: f"{place} {name}" for place, each in pictures.items() for name, drawn in each.items()}
    for old, new in zip_longest(_PICTURE.findall(then), _PICTURE.findall(now), fillvalue=""):
        if old != new and not _alike(old, new):
            yield names.get(new, "a picture that does not belong there")


def _alike(one: str, other: str) -> bool:
    """Whether two pictures of a page show the same: equal words and shapes, and images with equal shades."""
    one, other = (unquote(unescape(each)) for each in (one, other))
    images = [_EMBEDDED.findall(each) for each in (one, other)]
    if len(images[0]) != len(images[1]):
        return False
    drawn = [_EMBEDDED.sub("", each) for each in (one, other)]
    if _WORDS.findall(drawn[0]) != _WORDS.findall(drawn[1]) or len({_COORDINATE.sub("", each) for each in drawn}) > 1:
        return False
    places = [np.array([float(found) for found in _COORDINATE.findall(each)]) for each in drawn]
    if places[0].size and np.abs(places[0] - places[1]).max() > _SHIFT:
        return False
    return all(alike_images(*(base64.b64decode(each) for each in pair)) for pair in zip(*images, strict=True))


def alike_images(one: bytes, other: bytes) -> bool:
    """Whether two PNG files show the same."""
    if one == other:
        return True
    try:
        pixels = [np.asarray(imread(io.BytesIO(each), format="png"), dtype=np.float64) for each in (one, other)]
    except (OSError, ValueError, SyntaxError):
        return False
    return pixels[0].shape == pixels[1].shape and bool(np.abs(pixels[0] - pixels[1]).max(initial=0.0) <= _SHADE)
