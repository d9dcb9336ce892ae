"""A sheet to draw on, and what becomes of it: an ``<img>`` with its own SVG, or a PNG; equal drawings, equal bytes.

Pictures of openings, panels and PSFs are arrays of grey or colour levels, and small palette PNGs.
"""

from __future__ import annotations

import base64
import io
import re
import struct
import zlib
from dataclasses import dataclass
from html import escape
from pathlib import Path
from urllib.parse import quote

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread
from numpy.typing import NDArray

from maskfab.base.errors import OutputError
from maskfab.base.folders import write_bytes
from maskfab.base.model import Panel, Psf

_STEPS = 10
"""Shades of a decade: more are not told apart, and a picture of fewer is smaller."""
DECADES = 6
"""Decades below the peak that every picture of a PSF shows; equal for all, so that pictures can be compared."""


def panel_coverage(panel: Panel, side_nm: int, pixels: int) -> NDArray[np.float64]:
    """Clear share of each pixel of a square view into the middle of a panel, [y, x], row 0 the lowest.

    Areas are exact: a gutter narrower than a pixel darkens it by its share and cannot vanish or beat with the grid.
    """
    rows, columns = panel.orientations.shape
    wanted = -(-side_nm // panel.pitch_nm)
    high, wide = min(rows, wanted), min(columns, wanted)
    bottom, left = (rows - high) // 2, (columns - wide) // 2
    dots = panel.opening.dots
    cells = np.zeros((high, dots + 2, wide, dots + 2))
    for row in range(high):
        for column in range(wide):
            orientation = int(panel.orientations[bottom + row, left + column])
            cells[row, 1:-1, column, 1:-1] = panel.pattern(orientation)
    clear = cells.reshape(high * (dots + 2), wide * (dots + 2))
    return _shares(panel, high, side_nm, pixels) @ clear @ _shares(panel, wide, side_nm, pixels).T


def log_intensity(psf: Psf, pixels: int, peak: float | None = None) -> NDArray[np.float64]:
    """log10 of intensity over a peak, its own if none is given, from -DECADES to 0; at most ``pixels`` samples a side.

    Notes:
        A PSF with more samples is averaged over areas, never thinned out: thinning drops whole orders. Averaging
        lowers a peak narrower than the new sample, so a reduced picture is for the eye and not for reading values.
    """
    values = psf.values
    peak = float(values.max()) if peak is None else peak
    samples = len(values)
    if samples > pixels:
        odd = pixels if pixels % 2 else pixels - 1  # odd, so that the optical axis stays in the middle of a sample
        edges = np.linspace(0.0, samples, odd + 1)
        mean = _overlap(edges, np.arange(samples + 1.0)) * (odd / samples)
        values = mean @ values @ mean.T
    if peak <= 0:
        return np.full(values.shape, -float(DECADES))
    return np.round(np.log10(np.clip(values / peak, 10.0**-DECADES, 1.0)) * _STEPS) / _STEPS


def png(levels: NDArray[np.uint8], palette: NDArray[np.uint8]) -> bytes:
    """An 8-bit palette PNG of ``levels`` [y, x], row 0 the lowest; ``palette`` is [colours, 3].

    Equal input gives equal bytes: there is no date and no name of a program in it.
    """
    return _png(levels, 3, ((b"PLTE", palette.tobytes()),))


def png_of_colours(colours: NDArray[np.uint8]) -> bytes:
    """An 8-bit colour PNG of ``colours`` [y, x, 3], row 0 the lowest; equal input gives equal bytes."""
    return _png(colours.reshape(len(colours), -1), 2, ())


def few_colours(colours: NDArray[np.uint8], most: int = 256) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A colour picture [y, x, 3] in at most so many colours of its own: levels [y, x] and the palette [colours, 3].

    The box of colours whose sum of squares is largest is cut at its mean, across its widest channel, until there are
    enough (after Heckbert, Computer Graphics 16, 297, 1982); a third of the bytes then shows the same to the eye.
    """
    pixels = colours.reshape(-1, 3).astype(np.float64)
    boxes = [np.arange(len(pixels))]
    spread = [_spread(pixels)]
    while len(boxes) < most and max(spread)[0] > 0:
        widest = spread.index(max(spread))
        box, (_, channel) = boxes[widest], spread[widest]
        values = pixels[box, channel]
        low = values <= values.mean()
        boxes[widest], spread[widest] = box[low], _spread(pixels[box[low]])
        boxes.append(box[~low])
        spread.append(_spread(pixels[box[~low]]))
    levels = np.empty(len(pixels), dtype=np.uint8)
    for number, box in enumerate(boxes):
        levels[box] = number
    palette = np.array([pixels[box].mean(axis=0) for box in boxes]).round().astype(np.uint8)
    return levels.reshape(colours.shape[:2]), palette


def _spread(pixels: NDArray[np.float64]) -> tuple[float, int]:
    """Largest sum of squares about the mean over the channels, and that channel."""
    squares = pixels.var(axis=0) * len(pixels)
    channel = int(squares.argmax())
    return float(squares[channel]), channel


def _png(samples: NDArray[np.uint8], kind: int, before: tuple[tuple[bytes, bytes], ...]) -> bytes:
    """A PNG of rows of bytes, the lowest first; ``kind`` 2 has three bytes a pixel, 3 one."""
    height, width = samples.shape
    rows = np.zeros((height, width + 1), dtype=np.uint8)  # the leading zero of a row says "unfiltered"
    rows[:, 1:] = samples[::-1]
    header = struct.pack(">IIBBBBB", width // 3 if kind == 2 else width, height, 8, kind, 0, 0, 0)
    data = zlib.compress(rows.tobytes(), 9 if kind == 3 else 6)
    parts = ((b"IHDR", header), *before, (b"IDAT", data), (b"IEND", b""))
    chunks = (
        struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data)) for tag, data in parts
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def data_uri(image: bytes) -> str:
    """A PNG as a ``data:`` address."""
    return "data:image/png;base64," + base64.b64encode(image).decode("ascii")


def _shares(panel: Panel, cells: int, side_nm: int, pixels: int) -> NDArray[np.float64]:
    """Share of each pixel that each interval covers: half a gutter, the dots, half a gutter, cell after cell."""
    dots, half = panel.opening.dots, panel.gutter_nm // 2
    cell = np.concatenate([[0], half + panel.dot_nm * np.arange(dots + 1)])
    starts = (np.arange(cells)[:, None] * panel.pitch_nm + cell).ravel()
    edges = np.append(starts, cells * panel.pitch_nm).astype(np.float64)
    return _overlap(np.linspace(0.0, side_nm, pixels + 1), edges) * (pixels / side_nm)


def _overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Length of the overlap of every interval between neighbours of ``a`` with every interval of ``b``."""
    high = np.minimum(a[1:, None], b[1:])
    low = np.maximum(a[:-1, None], b[:-1])
    shared: NDArray[np.float64] = np.maximum(high - low, 0.0)
    return shared


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
        log_intensity(psf, pixels, peak),
        origin="lower",
        interpolation="none",
        cmap="magma",
        vmin=-DECADES,
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
    # In fewer bytes: paths to 0.01 pt and by steps, images as palettes, the reader's own sans-serif type.
    svg = _PATH.sub(lambda path: f' d="{short_path(path[1])}"', buffer.getvalue())
    svg = re.sub(r"data:image/png;base64,[A-Za-z0-9+/=\s]+", lambda uri: _palette(uri[0]), svg)
    svg = re.sub(r"<!--.*?-->", "", re.sub(r'<g id="[^"]*"', "<g", svg), flags=re.DOTALL)
    svg = svg.replace("'DejaVu Sans'", "system-ui, 'Segoe UI', 'Helvetica Neue', Arial, sans-serif")
    svg = " ".join(svg.split())
    return svg[svg.index("<svg") :]


def image(figure: Figure, words: str) -> str:
    """The figure as an ``<img>`` that holds its own SVG."""
    # Only a namespace, but a page that shows no address at all is seen to need none.
    address = _UNSAFE.sub(lambda characters: quote(characters[0]), vector(figure)).replace("//", "%2F%2F")
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
            what = f"no picture is written with the suffix {target.suffix!r}"
            raise OutputError("MF430", what, where=str(target), cure="Use .svg or .png")
        write_bytes(target, content(), replace=True)
        return target

    def _repr_svg_(self) -> str:
        return self.svg()

    def __repr__(self) -> str:
        return f"<Drawing: {self.words}>"


def img(address: str, words: str, kind: str) -> str:
    """An ``<img>`` of a ``data:`` address, with words for who cannot see it."""
    return f"""<img class="{kind}" src='{escape(address, quote=False)}' alt="{escape(words)}">"""


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
    return data_uri(png(levels.reshape(packed.shape).astype(np.uint8)[::-1], palette))


def short_path(path: str) -> str:
    """The ``d`` of an SVG path to 0.01 pt; straight lines by their steps from point to point, in half the bytes.

    Steps are those between rounded points, so that errors do not add up. A shape of lines along x and y, such as an
    opening, is told by them alone; in others every step has a decimal point, whatever its last digit.
    """
    if not _STRAIGHT.fullmatch(path):
        return _FINER.sub("", path)
    moves: list[tuple[str, int, int]] = []
    x = y = x0 = y0 = 0
    for step in _TO.findall(path):
        if step == "z":
            moves.append(("z", 0, 0))
            x, y = x0, y0
            continue
        letter, *numbers = step.split(" ")
        x1, y1 = (round(100 * float(number)) for number in numbers)
        if letter == "M":
            moves.append(("M", x1, y1))
            x0, y0 = x1, y1
        else:
            moves.append(("l", x1 - x, y1 - y))
        x, y = x1, y1
    square = all(letter != "l" or not dx or not dy for letter, dx, dy in moves)
    return "".join(_move(*move, square) for move in moves)


def _move(letter: str, dx: int, dy: int, square: bool) -> str:
    if letter == "l" and square:
        return f"v{dy / 100:g}" if dy else f"h{dx / 100:g}"
    return letter if letter == "z" else f"{letter}{dx / 100!r} {dy / 100!r}"
