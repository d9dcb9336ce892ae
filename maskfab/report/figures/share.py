"""Figure of shares of the pixel: gains of restored photographs, and what the display pays, by pixels to a circuit."""

from __future__ import annotations

from itertools import groupby

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from maskfab.designs.search.share import ShareCurve, SharePoint
from maskfab.report.figures.sheet import INK, image, open_field, styled

_SIZE = (5.4, 3.6)
_LOOKS = (("#0072b2", "o"), ("#d55e00", "s"), ("#009e73", "D"), ("#cc79a7", "^"))
"""Colours and marks of levels, told apart by those who see fewer colours, too."""


@styled
def curve(found: ShareCurve) -> str:
    """Gain and life over the share of the pixel that is clear, as an ``<img>``; a ring is round the chosen point."""
    figure = Figure(figsize=_SIZE)
    gains, lives = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.4))
    levels = groupby(found.fitting, key=lambda point: point.zone)
    for (words, own), (colour, mark) in zip(levels, _LOOKS, strict=False):
        points = list(own)
        for axes, value in ((gains, found.gain_db), (lives, _life)):
            at = [100 * point.share for point in points], [value(point) for point in points]
            axes.plot(*at, color=colour, lw=1.2, label=words)
            for point, x, y in zip(points, *at, strict=True):
                size = 3 if found.photographed and point.error_db is None else 6
                axes.plot(x, y, mark, ms=size, mec=colour, mfc=colour if point.holds else "none")
    if found.best is not None:
        for axes, height in ((gains, found.gain_db(found.best)), (lives, _life(found.best))):
            axes.plot(100 * found.best.share, height, "o", ms=13, mfc="none", mec=INK, mew=1.4)
    _named(gains, "gain, dB")
    _named(lives, "life")
    lives.set_xlabel("clear share of the pixel, %")
    gains.legend(loc="upper left", frameon=False, fontsize=8)
    figure.subplots_adjust(left=0.11, right=0.98, top=0.97, bottom=0.13, hspace=0.12)
    return image(figure, "gain of restored photographs and life of emitters over the clear share of the pixel")


def _named(axes: Axes, name: str) -> None:
    open_field(axes)
    axes.set_ylabel(name)
    axes.margins(0.06, 0.14)


def _life(point: SharePoint) -> float:
    """Life over that of the display around; 0 where none is told."""
    return next((number.value for number in point.numbers if number.name == "life"), 0.0)
