"""A sheet to draw on, and what becomes of it: an ``<img>`` with its own SVG, or a PNG; equal drawings, equal bytes.

Pictures of openings, panels and PSFs are arrays of grey or colour levels, and small palette PNGs.
"""

from __future__ import annotations

import base64
import io
import re
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from heapq import heappop, heappush
from html import escape
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import quote

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import TICKDOWN, TICKLEFT, TICKRIGHT, TICKUP
from matplotlib.transforms import ScaledTranslation
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
    return _png(levels, _LEVELS, ((b"PLTE", palette.tobytes()),))


def png_of_colours(colours: NDArray[np.uint8]) -> bytes:
    """An 8-bit colour PNG of ``colours`` [y, x, 3], row 0 the lowest; equal input gives equal bytes."""
    return _png(colours.reshape(len(colours), -1), _COLOURS, ())


def few_colours(colours: NDArray[np.uint8], most: int = 256) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A colour picture [y, x, 3] in at most so many colours of its own: levels [y, x] and the palette [colours, 3].

    The box of colours whose sum of squares is largest is cut at its mean, across its widest channel, until there are
    enough (after Heckbert, Computer Graphics 16, 297, 1982); a third of the bytes then shows the same to the eye.
    """
    pixels = np.ascontiguousarray(colours.reshape(-1, 3).T, dtype=np.float64)
    numbered = np.concatenate([pixels, np.arange(pixels.shape[1], dtype=np.float64)[None]])
    boxes = [_box(numbered, 0)]
    while len(boxes) < most and boxes[0][0] < 0:
        _, number, channel, box = heappop(boxes)
        low = box[channel] <= box[channel].mean()
        heappush(boxes, _box(box.take(np.flatnonzero(low), axis=1), number))
        heappush(boxes, _box(box.take(np.flatnonzero(~low), axis=1), len(boxes)))
    levels = np.empty(pixels.shape[1], dtype=np.uint8)
    palette = np.empty((len(boxes), 3), dtype=np.uint8)
    for _, number, _, box in boxes:
        levels[box[3].astype(np.intp)] = number
        palette[number] = box[:3].mean(axis=1).round()
    return levels.reshape(colours.shape[:2]), palette


def _box(pixels: NDArray[np.float64], number: int) -> tuple[float, int, int, NDArray[np.float64]]:
    """Pixels, [3 channels and the pixel's place, n], behind what puts the widest first: less their largest sum of
    squares about the mean, the box's number, and the channel of that sum."""
    squares = pixels[:3].var(axis=1)
    channel = int(squares.argmax())
    return -float(squares[channel]) * pixels.shape[1], number, channel, pixels


def _png(samples: NDArray[np.uint8], kind: int, before: tuple[tuple[bytes, bytes], ...]) -> bytes:
    """A PNG of rows of bytes, the lowest first, of a kind of :data:`_BYTES`."""
    height, width = samples.shape
    rows = np.zeros((height, width + 1), dtype=np.uint8)  # the leading zero of a row says "unfiltered"
    rows[:, 1:] = samples[::-1]
    header = struct.pack(">IIBBBBB", width // _BYTES[kind], height, 8, kind, 0, 0, 0)
    data = zlib.compress(rows.tobytes(), 9 if kind == _LEVELS else 6)
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
_STRAIGHT = re.compile(r"[\sMLz0-9.\-]*")
_LETTERS = re.compile("[MLz]")
_NO_LETTERS = dict.fromkeys(map(ord, "MLz"), " ")
PICTURE = re.compile(r"data:image/png;base64,[A-Za-z0-9+/=\s]+")
CURVE = "curve"
"""Name of a line in whose place others are put, which a document keeps."""
_NAMED = re.compile(rf'<g id="(?!{CURVE}")[^"]*"')
POINTS = 72
_COLOURS, _LEVELS, _WITH_ALPHA = 2, 3, 6
"""Kinds of PNG, and how many bytes a pixel of each has."""
_BYTES = {_COLOURS: 3, _LEVELS: 1, _WITH_ALPHA: 4}

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


_SIDES: Mapping[str, tuple[int, int, int, Mapping[str, Any]]] = MappingProxyType(
    {
        "bottom": (0, -1, TICKDOWN, {"ha": "center", "va": "top"}),
        "top": (0, 1, TICKUP, {"ha": "center", "va": "bottom"}),
        "left": (-1, 0, TICKLEFT, {"ha": "right", "va": "center_baseline"}),
        "right": (1, 0, TICKRIGHT, {"ha": "left", "va": "center_baseline"}),
    }
)
"""Outwards along x and y, the mark of a tick, and where a text has its place."""


def open_field(axes: Axes) -> None:
    """A faint grid behind what is drawn, and no frame above and on the right."""
    axes.grid(color=QUIET, alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def scale(
    axes: Axes,
    side: str,
    words: str = "",
    named: Mapping[float, str] | None = None,
    *,
    numbers: bool = True,
    grid: bool = False,
) -> None:
    """Ticks, numbers and words along a side, within limits that are set, as one line and a few texts.

    matplotlib's own ticks are five artists each, and took half of the time of a page's plots.

    Args:
        axes: gets them, and loses its own along that side.
        named: what stands at which places; by default the round numbers that matplotlib chooses.
        grid: draw a line across from every tick, too.
    """
    right, up, mark, ends = _SIDES[side]
    axis, along = (axes.xaxis, axes.get_xaxis_transform()) if up else (axes.yaxis, axes.get_yaxis_transform())
    if named is None:
        low, high = axis.get_view_interval()
        places = [place for place in axis.get_majorticklocs() if low <= place <= high]
        named = dict(zip(places, axis.get_major_formatter().format_ticks(places), strict=True))
    axis.set_ticks([])
    edge = float(right + up > 0)

    def at(places: Sequence[float], heights: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
        return (places, heights) if up else (heights, places)

    # Of the figure, and not of the axes, which would give each a way of its own to be cut off.
    figure = axes.figure
    ticks = at([*named], [edge] * len(named))
    shown: dict[str, Any] = {"marker": mark, "markersize": 3.5, "markeredgewidth": 0.6, "linestyle": "none"}
    figure.add_artist(Line2D(*ticks, transform=along, color=QUIET, **shown))
    if grid:
        lines = at([place for place in named for _ in range(3)], [0.0, 1.0, np.nan] * len(named))
        axes.plot(*lines, transform=along, color="#e3e6ea", linewidth=0.5, zorder=0.5)

    def out(points: float) -> ScaledTranslation:
        return ScaledTranslation(right * points / POINTS, up * points / POINTS, figure.dpi_scale_trans)

    if numbers:
        where = along + out(7)
        for x, y, text in zip(*ticks, named.values(), strict=True):
            figure.text(x, y, text, transform=where, **ends)
    if words:
        beyond = 11 + numbers * (8 if up else 5.1 * max(map(len, named.values()), default=0))
        turned = {} if up else {"rotation": 90, "va": "center"}
        ((x, y),) = zip(*at([0.5], [edge]), strict=True)
        figure.text(x, y, words, transform=axes.transAxes + out(beyond), **{**ends, **turned})


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


class _Vector(RendererSVG):
    """SVG whose pictures are left blank, for :func:`vector` to put palettes there: the renderer would write four bytes
    a pixel, which take longer to pack than all else takes to draw."""

    pictures: list[NDArray[np.uint8]]

    def draw_image(self, gc: Any, x: float, y: float, im: Any, transform: Any = None) -> None:
        self.pictures.append(im)
        super().draw_image(gc, x, y, np.zeros_like(im), transform)  # type: ignore[no-untyped-call]


def vector(figure: Figure) -> str:
    """The figure as an SVG document without a date or a program's name."""
    buffer, before = io.StringIO(), figure.dpi
    figure.dpi = POINTS
    try:
        width, height = POINTS * figure.get_size_inches()
        nobody = {"Date": None, "Creator": None, "Format": None, "Type": None}
        renderer = _Vector(width, height, buffer, image_dpi=before, metadata=nobody)  # type: ignore[no-untyped-call]
        renderer.pictures = []
        figure.draw(renderer)
        renderer.finalize()  # type: ignore[no-untyped-call]
    finally:
        figure.dpi = before
    # In fewer bytes: paths to 0.01 pt and by steps, images as palettes, the reader's own sans-serif type.
    pictures = iter(renderer.pictures)
    svg = _PATH.sub(lambda path: f' d="{short_path(path[1])}"', buffer.getvalue())
    svg = PICTURE.sub(lambda _: picture(next(pictures)), svg)
    svg = re.sub(r"<!--.*?-->", "", _NAMED.sub("<g", svg), flags=re.DOTALL)
    svg = svg.replace("'DejaVu Sans'", "system-ui, 'Segoe UI', 'Helvetica Neue', Arial, sans-serif")
    svg = " ".join(svg.split())
    return svg[svg.index("<svg") :]


def image(figure: Figure, words: str) -> str:
    """The figure as an ``<img>`` that holds its own SVG."""
    return image_of(vector(figure), words)


def image_of(svg: str, words: str) -> str:
    """A document as an ``<img>`` that holds it."""
    # Only a namespace, but a page that shows no address at all is seen to need none.
    address = _UNSAFE.sub(lambda characters: _quoted(characters[0]), svg).replace("//", "%2F%2F")
    return img(f"data:image/svg+xml,{address}", words, "figure")


@dataclass(frozen=True, eq=False)
class Drawing:
    """A figure, and in one line of words what it shows, to be looked at in a notebook or saved."""

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
        """Write it as SVG or PNG, by the path's suffix; an earlier file is replaced."""
        target = Path(path)
        check_suffix(target)
        write_bytes(target, self.png() if target.suffix.lower() == ".png" else self.svg().encode(), replace=True)
        return target

    def _repr_svg_(self) -> str:
        return self.svg()

    def __repr__(self) -> str:
        return f"<Drawing: {self.words}>"


def check_suffix(target: Path) -> None:
    """Refuse a file that is no picture a drawing can be. Raises OutputError MF430."""
    if target.suffix.lower() not in (".svg", ".png"):
        what = f"no picture is written with the suffix {target.suffix!r}"
        raise OutputError("MF430", what, where=str(target), cure="Use .svg or .png")


def img(address: str, words: str, kind: str) -> str:
    """An ``<img>`` of a ``data:`` address, with words for who cannot see it."""
    return f"""<img class="{kind}" src='{escape(address, quote=False)}' alt="{escape(words)}">"""


_quoted = lru_cache(maxsize=1024)(quote)


def picture(pixels: NDArray[np.uint8]) -> str:
    """Address of a picture [y, x, 4], row 0 on top: one byte a pixel if its colours are opaque and few."""
    packed = np.ascontiguousarray(pixels).view(np.uint32)[..., 0]
    colours = np.unique(packed)
    if len(colours) > 256 or (pixels[..., 3] < 255).any():
        whole = np.ascontiguousarray(pixels[::-1]).reshape(len(pixels), -1)
        return data_uri(_png(whole, _WITH_ALPHA, ()))
    levels = np.searchsorted(colours, packed).astype(np.uint8)
    return data_uri(png(levels[::-1], colours.view(np.uint8).reshape(-1, 4)[:, :3]))


def short_path(path: str) -> str:
    """The ``d`` of an SVG path to 0.01 pt; straight lines by their steps from point to point, in half the bytes.

    Steps are those between rounded points, so that errors do not add up. A shape of lines along x and y, such as an
    opening, is told by them alone; in others every step has a decimal point, whatever its last digit.
    """
    if not _STRAIGHT.fullmatch(path):
        return _FINER.sub("", path)
    letters = "".join(_LETTERS.findall(path))
    numbers = np.fromstring(path.translate(_NO_LETTERS), dtype=np.float64, sep=" ")
    points = np.rint(100 * numbers).astype(np.int64).reshape(-1, 2)
    kind = np.frombuffer(letters.encode(), dtype=np.uint8)
    drawn, begins = kind != ord("z"), kind == ord("M")
    # Where the pen is after each letter; a line that is closed leads it back to where it began.
    place = np.cumsum(drawn) - 1
    place[~drawn] = np.maximum.accumulate(np.where(begins, place, 0))[~drawn]
    steps = points[place]
    steps[1:] -= np.where(begins[1:, None], 0, steps[:-1])
    lines = steps[drawn & ~begins]
    if lines.all(axis=1).any():
        moves = zip(letters.replace("L", "l"), *(steps / 100).T.tolist(), strict=True)
        return "".join([letter if letter == "z" else f"{letter}{dx!r} {dy!r}" for letter, dx, dy in moves])
    return "".join([_move(*move) for move in zip(letters, *steps.T.tolist(), strict=True)])


@lru_cache(maxsize=4096)
def _move(letter: str, dx: int, dy: int) -> str:
    """A step along x or y; an opening has few that differ."""
    if letter == "L":
        return f"v{dy / 100:g}" if dy else f"h{dx / 100:g}"
    return letter if letter == "z" else f"{letter}{dx / 100!r} {dy / 100!r}"
