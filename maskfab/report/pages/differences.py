"""Two pages held against each other, perhaps made on two machines.

Words must be equal to the letter. A picture may differ by what the last bits of another machine's arithmetic make of a
line or a shade, which nobody can see. Of a photograph they may make another draw of its noise: then means of patches
must be equal, grain as coarse, and words the same but for tenths of a decibel.
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
from numpy.typing import NDArray

_PICTURE = re.compile(r"""<img class="\w+" src='[^']*' alt="[^"]*">""")
_EMBEDDED = re.compile(r"data:image/png;base64,([A-Za-z0-9+/=]+)")
_COORDINATE = re.compile(r"-?\d+\.\d+")
_WORDS = re.compile(r">[^<]+<")
_SHIFT = 0.05
"""Of a line, in points: paths are written to .01."""
_SHADE = 0.05
"""Of a pixel, of 1."""
_PATCH = 24
"""Side in pixels of a photograph's patches."""
_PATCH_SHADE = 0.05
"""Of a patch's mean, of 1."""
_GRAIN_SHARE = 0.05
"""Of the mean step from pixel to pixel, which sharpness and noise make."""
DECIBELS = 0.2
"""Of a restored photograph, from one draw of its noise to another."""
TEXT = "text"
NOISE = "the noise of photographs"
_NOISY = re.compile(r" (design_\d+|front)$")


def differences(then: str, now: str, pictures: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    """Differences between two pages: :data:`TEXT`, the names of pictures as ``die figure``, or :data:`NOISE`."""
    if _PICTURE.split(then) != _PICTURE.split(now):
        yield TEXT
    names = {drawn: f"{place} {name}" for place, images in pictures.items() for name, drawn in images.items()}
    for old, new in zip_longest(_PICTURE.findall(then), _PICTURE.findall(now), fillvalue=""):
        if old == new or _alike(old, new):
            continue
        name = names.get(new, "a picture that does not belong there")
        yield NOISE if _NOISY.search(name) and _alike_but_for_noise(old, new) else name


def _alike(one: str, other: str) -> bool:
    """Whether two pictures of a page show the same: equal words and shapes, and images with equal shades."""
    one, other = (unquote(unescape(picture)) for picture in (one, other))
    images = [_EMBEDDED.findall(picture) for picture in (one, other)]
    if len(images[0]) != len(images[1]):
        return False
    drawn = [_EMBEDDED.sub("", picture) for picture in (one, other)]
    if _WORDS.findall(drawn[0]) != _WORDS.findall(drawn[1]) or len({_COORDINATE.sub("", words) for words in drawn}) > 1:
        return False
    places = [np.array([float(number) for number in _COORDINATE.findall(words)]) for words in drawn]
    if places[0].size and np.abs(places[0] - places[1]).max() > _SHIFT:
        return False
    return all(alike_images(*(base64.b64decode(image) for image in pair)) for pair in zip(*images, strict=True))


def _alike_but_for_noise(one: str, other: str) -> bool:
    """Whether two photographs show the same, each in noise of its own."""
    one, other = (unquote(unescape(picture)) for picture in (one, other))
    images = [_EMBEDDED.findall(picture) for picture in (one, other)]
    words = [_EMBEDDED.sub("", picture) for picture in (one, other)]
    if [len(image) for image in images] != [1, 1] or len({_COORDINATE.sub("", text) for text in words}) > 1:
        return False
    numbers = [np.array([float(number) for number in _COORDINATE.findall(word)]) for word in words]
    if np.abs(numbers[0] - numbers[1]).max(initial=0.0) > DECIBELS:
        return False
    first, second = (_pixels(base64.b64decode(image)) for (image,) in images)
    return first is not None and second is not None and first.shape == second.shape and _one_scene(first, second)


def _one_scene(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """Whether photographs of one size are alike in the means of patches, and in grain."""
    grain = _grain(first), _grain(second)
    if (np.abs(grain[0] - grain[1]) > _GRAIN_SHARE * np.maximum(*grain)).any():
        return False
    rows, columns = (np.arange(0, size, _PATCH) for size in first.shape[:2])
    sums = np.add.reduceat(np.add.reduceat(first - second, rows), columns, axis=1)
    high, wide = np.diff(rows, append=first.shape[0]), np.diff(columns, append=first.shape[1])
    return bool(np.abs(sums / np.outer(high, wide)[..., None]).max(initial=0.0) <= _PATCH_SHADE)


def _grain(pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Root mean square of the step from pixel to pixel, down and across, [2, channels]."""
    return np.stack([np.sqrt((np.diff(pixels, axis=axis) ** 2).mean(axis=(0, 1))) for axis in (0, 1)])


def alike_images(one: bytes, other: bytes) -> bool:
    """Whether two PNG files show the same."""
    if one == other:
        return True
    first, second = (_pixels(image) for image in (one, other))
    if first is None or second is None or first.shape != second.shape:
        return False
    return bool(np.abs(first - second).max(initial=0.0) <= _SHADE)


def _pixels(image: bytes) -> NDArray[np.float64] | None:
    """A PNG file as float64 [rows, columns, channels], 0 to 1; None if it is none."""
    try:
        pixels = np.asarray(imread(io.BytesIO(image), format="png"), dtype=np.float64)
    except (OSError, ValueError, SyntaxError):
        return None
    return pixels.reshape(*pixels.shape[:2], -1)
