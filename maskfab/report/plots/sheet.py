"""A sheet to draw on, and what becomes of it: an ``<img>`` with its own SVG, or a PNG; equal drawings, equal bytes."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import dataclass
from html import escape
from pathlib import Path
from urllib.parse import quote

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread

from maskfab.errors import OutputError
from maskfab.files.staging import write_bytes
from maskfab.model import Psf
from maskfab.report.plots import png

INK, QUIET = "#1f2328", "#7a828c"

_UNSAFE = re.compile(r"""[^A-Za-z0-9_.\-~ "=/:;,()+*!?@&]+""")
"""Characters that an address of SVG between single quotes cannot hold as they are."""
_PATH = re.compile(r' d="([^"]*)"')
_FINER = re.compile(r"(?<=\.\d\d)\d+")
_TO = re.compile(r"[ML] \S+ \S+|z")
_STRAIGHT = re.compile(r"[\sMLz0-9.\-]*")

styled = mpl.rc_context(
    {
        "font.family": ["DejaVu Sans"],
        "font.size": 8.0,
        "axes.titlesize": 9.0,
        "axes.titley": 1.0,  # where it is by itself without ticks on top, which takes measuring every label to find out
        "axes.linewidth": 0.6,
        "axes.edgecolor": QUIET,
        "axes.labelcolor": INK,
        "text.color": INK,
        "text.parse_math": False,  # a dollar sign in somebody's title is a dollar sign
        "xtick.color": INK,
        "ytick.color": INK,
        "xtick.major.width": 0.6,
        "ytick.major.width": 0.6,
        "legend.frameon": False,
        "image.composite_image": False,
        "svg.fonttype": "none",
        "svg.hashsalt": "maskfab",
    }
)
"""Decorates what draws, so that the reader's own settings of matplotlib do not matter."""


def place(figure: Figure, inches: tuple[float, float, float, float]) -> Axes:
    """Axes at left, bottom, width, height in inches: a layout engine would draw every figure twice to find them."""
    width, height = figure.get_size_inches()
    left, bottom, wide, high = inches
    return figure.add_axes((left / width, bottom / height, wide / width, high / height))


def draw_psf(axes: Axes, psf: Psf, pixels: int, peak: float | None = None) -> None:
    """A PSF as a logarithmic map about its axis, below ``peak``, its own if None; at most ``pixels`` along a side."""
    half = psf.step_um * len(psf.values) / 2
    axes.imshow(
        png.log_intensity(psf, pixels, peak),
        origin="lower",
        interpolation="none",
        cmap="magma",
        vmin=-png.DECADES,
        vmax=0.0,
        extent=(-half, half, -half, half),
    )


def bitmap(figure: Figure) -> bytes:
    """The figure as a PNG file without a date or a program's name."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def vector(figure: Figure) -> str:
    """The figure as an SVG document without a date or a program's name."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    svg = _slim(buffer.getvalue())
    return svg[svg.index("<svg") :]


def image(figure: Figure, words: str) -> str:
    """The figure as an ``<img>`` that holds its own SVG."""
    # Only a namespace, but a page that shows no address at all is seen to need none.
    address = _UNSAFE.sub(_quoted, vector(figure)).replace("//", "%2F%2F")
    return img(f"data:image/svg+xml,{address}", words, "figure")


@dataclass(frozen=True, eq=False)
class Drawing:
    """A figure and the words that say what it shows, to be looked at in a notebook or saved.

    Attributes:
        figure: of matplotlib, to go on with.
        words: what it shows, in one line.
    """

    figure: Figure
    words: str

    @styled
    def svg(self) -> str:
        """An SVG document; equal figures give equal text."""
        return vector(self.figure)

    @styled
    def png(self) -> bytes:
        """A PNG file."""
        return bitmap(self.figure)

    @styled
    def img(self) -> str:
        """An ``<img>`` that holds its own SVG."""
        return image(self.figure, self.words)

    def save(self, path: str | Path) -> Path:
        """Write it as SVG or PNG, by the path's suffix; an earlier file is replaced.

        Raises:
            OutputError: MF430 for another suffix, MF401 if the file cannot be written.
        """
        target = Path(path)
        content = {".svg": lambda: self.svg().encode(), ".png": self.png}.get(target.suffix.lower())
        if content is None:
            raise OutputError(
                "MF430",
                f"no picture is written with the suffix {target.suffix!r}",
                where=str(target),
                cure="Use .svg or .png",
            )
        write_bytes(target, content(), replace=True)
        return target

    def _repr_svg_(self) -> str:
        return self.svg()

    def __repr__(self) -> str:
        return f"<Drawing: {self.words}>"


def _quoted(characters: re.Match[str]) -> str:
    return quote(characters[0])


def img(address: str, words: str, kind: str) -> str:
    """An ``<img>`` of a ``data:`` address, with words for who cannot see it."""
    return f"""<img class="{kind}" src='{escape(address, quote=False)}' alt="{escape(words)}">"""


def _slim(svg: str) -> str:
    """The SVG in fewer bytes: paths to 0.01 pt and by steps, images as palettes, the reader's own sans-serif type."""
    svg = _PATH.sub(lambda path: f' d="{short_path(path[1])}"', svg)
    svg = re.sub(r"data:image/png;base64,[A-Za-z0-9+/=\s]+", lambda uri: _palette(uri[0]), svg)
    svg = re.sub(r"<!--.*?-->", "", re.sub(r'<g id="[^"]*"', "<g", svg), flags=re.DOTALL)
    svg = svg.replace("'DejaVu Sans'", "system-ui, 'Segoe UI', 'Helvetica Neue', Arial, sans-serif")
    return " ".join(svg.split())


def _palette(address: str) -> str:
    """A PNG as matplotlib embeds it, four bytes a pixel, with one byte a pixel if its colours are opaque and few."""
    pixels = (
        (imread(io.BytesIO(base64.b64decode(address.split(",", 1)[1])), format="png") * 255).round().astype(np.uint8)
    )
    if pixels.ndim != 3 or (pixels.shape[2] == 4 and (pixels[..., 3] < 255).any()):
        return address
    packed = pixels[..., :3].astype(np.uint32) @ np.array([65536, 256, 1], dtype=np.uint32)
    colours, levels = np.unique(packed, return_inverse=True)
    if len(colours) > 256:
        return address
    palette = np.stack([colours >> 16, (colours >> 8) & 255, colours & 255], axis=1).astype(np.uint8)
    return png.data_uri(png.png(levels.reshape(packed.shape).astype(np.uint8)[::-1], palette))


def short_path(path: str) -> str:
    """The ``d`` of an SVG path to 0.01 pt; straight lines by their steps from point to point, in half the bytes.

    Steps are those between rounded points, so that errors do not add up. A shape of lines along x and y, such as an
    opening, is told by them alone; in others every step has a decimal point, whatever its last digit.
    """
    if not _STRAIGHT.fullmatch(path):
        return _FINER.sub("", path)
    moves: list[tuple[str, int, int]] = []
    x = y = x0 = y0 = 0
    for each in _TO.findall(path):
        if each == "z":
            moves.append(("z", 0, 0))
            x, y = x0, y0
            continue
        letter, *numbers = each.split(" ")
        x1, y1 = (round(100 * float(number)) for number in numbers)
        if letter == "M":
            moves.append(("M", x1, y1))
            x0, y0 = x1, y1
        else:
            moves.append(("l", x1 - x, y1 - y))
        x, y = x1, y1
    square = all(letter != "l" or not dx or not dy for letter, dx, dy in moves)
    return "".join(_square_move(*move) if square else _move(*move) for move in moves)


def _square_move(letter: str, dx: int, dy: int) -> str:
    if letter != "l":
        return _move(letter, dx, dy)
    return f"v{dy / 100:g}" if dy else f"h{dx / 100:g}"


def _move(letter: str, dx: int, dy: int) -> str:
    return letter if letter == "z" else f"{letter}{dx / 100!r} {dy / 100!r}"
