"""maskfab: photomask plates for under-panel cameras, and the pictures they will make.

    >>> import maskfab as mf
    >>> bar = mf.Opening.bar(dots=21, size=(15, 7), pitch="168 um")
    >>> panel = mf.Panel.tile(bar, "random", seed=1, size="4.4 mm")
    >>> camera = mf.Camera("10 mm", stop="4 mm", pixel="2 um", wavelengths=["610 nm", "530 nm", "470 nm"])
    >>> print(camera.mtf(panel, "530 nm").auc)                                      # doctest: +SKIP

Lengths are text with a unit, or numbers of micrometres (wavelengths: nanometres). What is wrong is refused with an
error whose code ``explain`` knows. The types and functions are in :mod:`maskfab.api`, the vocabulary is in
:mod:`maskfab.base.model`, the chain on one page in :mod:`maskfab.runs.pipeline`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from maskfab.base import __version__

if TYPE_CHECKING:
    from maskfab.api import order as order
    from maskfab.api import torch as torch
    from maskfab.api.about import bench as bench
    from maskfab.api.about import cache as cache
    from maskfab.api.about import cite as cite
    from maskfab.api.about import doctor as doctor
    from maskfab.api.about import explain as explain
    from maskfab.api.advising import advise as advise
    from maskfab.api.analysing import analyse as analyse
    from maskfab.api.beginning import new as new
    from maskfab.api.beginning import shapes as shapes
    from maskfab.api.camera import Camera as Camera
    from maskfab.api.camera import Mtf as Mtf
    from maskfab.api.camera import Psf as Psf
    from maskfab.api.checking import check as check
    from maskfab.api.comparing import compare as compare
    from maskfab.api.designing import Design as Design
    from maskfab.api.designing import design as design
    from maskfab.api.making import forecast as forecast
    from maskfab.api.making import run as run
    from maskfab.api.making import view as view
    from maskfab.api.measuring import edge as edge
    from maskfab.api.measuring import measure as measure
    from maskfab.api.opening import Opening as Opening
    from maskfab.api.opening import read_opening as read_opening
    from maskfab.api.pairs import pairs as pairs
    from maskfab.api.panel import Panel as Panel
    from maskfab.api.photographs import learn as learn
    from maskfab.api.photographs import simulate as simulate
    from maskfab.api.plate import Plate as Plate
    from maskfab.api.restoring import restore as restore
    from maskfab.api.studying import study as study
    from maskfab.api.sweeping import sweep as sweep
    from maskfab.api.verifying import verify as verify
    from maskfab.base.errors import MaskfabError as MaskfabError
    from maskfab.mask.job import load_job as load_job
    from maskfab.mask.panels import read_map as read_map
    from maskfab.report.text import Quantities as Quantities


# The one list of public names: type checkers read it as imports, and everything below reads its text.

with open(__file__, encoding="utf-8") as _text:
    WHERE = {line.split()[3]: line.split()[1] for line in _text if line.startswith("    from ")}
"""Module of every public name."""

__all__ = ["__version__", *WHERE]  # noqa: PLE0604 - names of the list above


def __getattr__(name: str) -> Any:
    """Import a room only when one of its names is asked for."""
    if name in WHERE:
        room = import_module(WHERE[name])
        return vars(room).get(name) or import_module(f"{WHERE[name]}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
