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
    from maskfab.api.camera import Camera
    from maskfab.api.curves import Mtf, Psf
    from maskfab.api.opening import Opening, read_opening
    from maskfab.api.panel import Panel
    from maskfab.api.plate import Plate
    from maskfab.api.verbs.analysing import analyse
    from maskfab.api.verbs.beginning import new, schema
    from maskfab.api.verbs.benchmarking import bench
    from maskfab.api.verbs.citing import cite
    from maskfab.api.verbs.comparing import compare
    from maskfab.api.verbs.designing import Design, design
    from maskfab.api.verbs.displays import check, render
    from maskfab.api.verbs.examining import doctor
    from maskfab.api.verbs.explaining import explain
    from maskfab.api.verbs.forecasting import forecast
    from maskfab.api.verbs.job_sweeps import sweep
    from maskfab.api.verbs.keeping import cache
    from maskfab.api.verbs.learning import learn
    from maskfab.api.verbs.measuring import measure
    from maskfab.api.verbs.measuring_edges import measure_edge, measure_mtf
    from maskfab.api.verbs.photographs import simulate
    from maskfab.api.verbs.planning import plan
    from maskfab.api.verbs.plates import run, verify
    from maskfab.api.verbs.restoring import restore
    from maskfab.api.verbs.shapes import shape, shapes
    from maskfab.api.verbs.shops import order, package, shops
    from maskfab.api.verbs.studying import study
    from maskfab.api.verbs.sweeping import pareto
    from maskfab.api.verbs.viewing import view
    from maskfab.base.errors import MaskfabError
    from maskfab.mask.job import load_job
    from maskfab.mask.panels import read_map
    from maskfab.report.rows.text import Quantities
    from maskfab.runs.verification import reproduce


_WHERE = {
    "Camera": "maskfab.api.camera",
    "Design": "maskfab.api.verbs.designing",
    "MaskfabError": "maskfab.base.errors",
    "Mtf": "maskfab.api.curves",
    "Opening": "maskfab.api.opening",
    "Panel": "maskfab.api.panel",
    "Plate": "maskfab.api.plate",
    "Psf": "maskfab.api.curves",
    "Quantities": "maskfab.report.rows.text",
    "analyse": "maskfab.api.verbs.analysing",
    "bench": "maskfab.api.verbs.benchmarking",
    "cache": "maskfab.api.verbs.keeping",
    "forecast": "maskfab.api.verbs.forecasting",
    "check": "maskfab.api.verbs.displays",
    "cite": "maskfab.api.verbs.citing",
    "compare": "maskfab.api.verbs.comparing",
    "design": "maskfab.api.verbs.designing",
    "doctor": "maskfab.api.verbs.examining",
    "explain": "maskfab.api.verbs.explaining",
    "learn": "maskfab.api.verbs.learning",
    "load_job": "maskfab.mask.job",
    "measure": "maskfab.api.verbs.measuring",
    "measure_edge": "maskfab.api.verbs.measuring_edges",
    "measure_mtf": "maskfab.api.verbs.measuring_edges",
    "new": "maskfab.api.verbs.beginning",
    "order": "maskfab.api.verbs.shops",
    "package": "maskfab.api.verbs.shops",
    "pareto": "maskfab.api.verbs.sweeping",
    "plan": "maskfab.api.verbs.planning",
    "read_map": "maskfab.mask.panels",
    "read_opening": "maskfab.api.opening",
    "render": "maskfab.api.verbs.displays",
    "reproduce": "maskfab.runs.verification",
    "restore": "maskfab.api.verbs.restoring",
    "run": "maskfab.api.verbs.plates",
    "schema": "maskfab.api.verbs.beginning",
    "shape": "maskfab.api.verbs.shapes",
    "shapes": "maskfab.api.verbs.shapes",
    "shops": "maskfab.api.verbs.shops",
    "simulate": "maskfab.api.verbs.photographs",
    "study": "maskfab.api.verbs.studying",
    "sweep": "maskfab.api.verbs.job_sweeps",
    "verify": "maskfab.api.verbs.plates",
    "view": "maskfab.api.verbs.viewing",
}
"""Module of every public name."""

__all__ = [
    "Camera",
    "Design",
    "MaskfabError",
    "Mtf",
    "Opening",
    "Panel",
    "Plate",
    "Psf",
    "Quantities",
    "__version__",
    "analyse",
    "bench",
    "cache",
    "check",
    "cite",
    "compare",
    "design",
    "doctor",
    "explain",
    "forecast",
    "learn",
    "load_job",
    "measure",
    "measure_edge",
    "measure_mtf",
    "new",
    "order",
    "package",
    "pareto",
    "plan",
    "read_map",
    "read_opening",
    "render",
    "reproduce",
    "restore",
    "run",
    "schema",
    "shape",
    "shapes",
    "shops",
    "simulate",
    "study",
    "sweep",
    "verify",
    "view",
]


def __getattr__(name: str) -> Any:
    """Import a room only when one of its names is asked for."""
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_WHERE[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
