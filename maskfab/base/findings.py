"""Where every number comes from: what is found, by which function, from what, at what cost, and how surely again.

Runs, checks of finished folders, runs made again, sweeps, the claims of studies, forecasts, the store of kept findings
and explanations read this one table, ``findings.json`` beside this file. Functions stand by their names, as the store
knows them, so that reading the table loads none of them; what a number is called and means stands in
:mod:`maskfab.base.quantities`.

Notes:
    Seconds are those of one thread of the machine of the reference numbers. What another machine takes follows from
    what its earlier tasks took, or, where it has done none, from a probe of it: :class:`maskfab.runs.forecast.Pace`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from fnmatch import fnmatchcase
from functools import cache, lru_cache, partial
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

from maskfab.base import folders
from maskfab.base.units import NM_PER_UM


class Need(Enum):
    """Something that a finding depends on, in words."""

    PANEL = "the panel"
    CAMERA = "the camera"
    WINDOW = "the camera's window"
    PROCESS = "the process"
    BLANK = "the blank"
    FILES = "the files read back"
    SCENE = "the scene"
    DISPLAY = "the display's rules"
    PHOTOGRAPHS = "photographs"
    CAPTURES = "pictures that a camera took"
    HOUSE = "the rules of the mask house"
    RESULT = "a finished folder"
    JOB = "the job"


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that is found.

    Attributes:
        name: of the stage of a run, as progress tells it, or of the work in a sweep.
        needs: what it depends on.
        functions: that a run calls for it about a die, in order; none where it finds it on the way to another.
        sweep: function that finds it from the design alone, of one :class:`maskfab.runs.sweep_cases.SweptDie`; None
            where that cannot be.
        gives: names of the quantities that it finds from the design alone.
        rows: names of the other rows that it finds, and of places in reports, parted by spaces; ``*`` stands for any
            letters.
        limits: of its quantities, the key of [limits] that judges each.
        noisy: whether another last bit of light may draw another photon, so that its rows repeat within noise only.
        files: of a finished folder that it makes.
        seconds: of a processor that the functions take, each with its arguments.
        bytes: of memory that the first function holds at its most, with its arguments; None for little.
        figures: functions that draw it, and seconds of a processor that each takes.
    """

    name: str
    needs: tuple[Need, ...]
    functions: tuple[str, ...] = ()
    sweep: str | None = None
    gives: tuple[str, ...] = ()
    rows: str = ""
    limits: tuple[tuple[str, str], ...] = ()
    noisy: bool = False
    files: tuple[str, ...] = ()
    seconds: tuple[Callable[..., float], ...] = ()
    bytes: Callable[..., float] | None = None
    figures: tuple[tuple[str, float], ...] = ()


def function_of(name: str) -> Callable[..., Any]:
    """The function of a name, whose module is loaded now."""
    module, _, attribute = name.rpartition(".")
    function: Callable[..., Any] = getattr(import_module(f"maskfab.{module}"), attribute)
    return function


def words(function: Callable[..., Any]) -> str:
    """Name of a function of a module in the table, and in the store."""
    named = function.func if isinstance(function, partial) else function
    return f"{named.__module__.removeprefix('maskfab.')}.{named.__qualname__}"


@lru_cache(maxsize=4096)
def origins(name: str) -> tuple[Finding, ...]:
    """Works that find a quantity, or a place in a report, the cheapest first."""
    return tuple(
        finding
        for finding in FINDINGS
        if any(fnmatchcase(name, row) for row in (*finding.gives, *finding.rows.split()))
    )


def maker(file: str) -> Finding:
    """The work that makes a file of a finished folder."""
    return next(finding for finding in FINDINGS if any(fnmatchcase(file, name) for name in finding.files))


def expected(function: Callable[..., Any], given: tuple[Any, ...]) -> float | None:
    """Seconds that a function of a module is expected to take; None for one of which nothing is known."""
    model = _costs().get(words(function))
    return None if model is None else float(model(*given))


def task_bytes(function: Callable[..., Any], given: tuple[Any, ...]) -> float:
    """Bytes of memory that a task holds at its most."""
    name = words(function)
    held = next((finding.bytes for finding in FINDINGS if finding.functions[:1] == (name,)), None)
    return 0.0 if held is None else float(held(*given))


@cache
def _costs() -> Mapping[str, Callable[..., float]]:
    """Seconds of every function of the table, by its name."""
    costs: dict[str, Callable[..., float]] = {}
    for finding in FINDINGS:
        costs |= dict(zip(finding.functions, finding.seconds, strict=True))
        costs |= {name: _always(seconds) for name, seconds in finding.figures}
    return costs


def _always(amount: float) -> Callable[..., float]:
    return lambda *_, **__: amount


# Costs of the findings, by the arguments of their functions.

_COLOURS = _LEVELS = 3
"""Colours and levels of light in the time of a photographed die; one of other colours is not photographed."""
_OF_PRICE = 0.75
"""Time of the PSFs of scenes over that which plans foretell."""
_VIEWS_OF_FIELD = 25
"""Places on the sensor whose PSFs a report shows, where they differ."""
_DRAWN_WINDOW_PX = 128.0
"""Side of the window in what the optics of a die take for each wavelength."""
_PHOTOGRAPHS_BYTES = 200e6


def _photographs_s(conditions: Any, around: Any, *_: Any) -> float:
    bands = () if around.scene is None else around.scene.bands
    seen = len(bands or conditions.camera.wavelengths_nm)
    return 1.1 * float(len(conditions.levels)) / _LEVELS if seen == _COLOURS else 0.0


def _optics_s(die: Any, camera: Any, *_: Any) -> float:
    """Dots in the stop set the transform's length, pixels of the window its points."""
    side = camera.window_um / camera.pixel_um / _DRAWN_WINDOW_PX
    dots = camera.stop.diameter_um / (die.panel.dot_nm / NM_PER_UM)
    return float(len(camera.wavelengths_nm) * (0.015 + 0.05 * side**2 + 0.065 * (dots / 500) ** 2))


def _scene_s(_die: Any, _camera: Any, scene: Any, _openings: Any, plan: Any, *_: Any) -> float:
    """The plan's price is that of the whole scene; a report shows some of its PSFs, and one by the fullest model."""
    choice = plan.choice
    depths = len({scene.nearest_um, scene.focus_um, scene.farthest_um}) if choice.defocus else 0
    off_axis = scene.field_um > 0 and (choice.places > 1 or choice.oblique)
    of_bands = plan.wavelengths if scene.bands else 0
    fuller = plan.fullest.samples_per_dot / choice.samples_per_dot if choice.samples_per_dot else 1.0
    shown = 1 + fuller + depths + _VIEWS_OF_FIELD * off_axis + of_bands
    one = float(plan.price.seconds) / (plan.wavelengths * plan.depths * choice.places**2)
    return float(0.2 + _OF_PRICE * shown * one)


def _scene_bytes(die: Any, camera: Any, scene: Any, _: Any, plan: Any, *__: Any) -> float:
    """Bytes of a process that keeps the memory of photographs; those of a series take more."""
    peak_bytes = function_of("findings.scene.peak_bytes")  # which loads all that scenes need
    side = camera.window_um / camera.pixel_um / _DRAWN_WINDOW_PX
    return float(
        _PHOTOGRAPHS_BYTES + peak_bytes(die, camera, scene, plan) + 9e6 * (2 * side * plan.fullest.oblique) ** 2
    )


_COSTS: Mapping[str, Callable[..., float]] = MappingProxyType(
    {
        "photographs": _photographs_s,
        "optics": _optics_s,
        "scene": _scene_s,
        "scene bytes": _scene_bytes,
        "bands": lambda _written, _camera, spread, *_: 4.0 if spread else 0.0,
    }
)
"""By the names in ``findings.json``, where a number is always the same."""


def _cost(stated: str | float) -> Callable[..., float]:
    return _COSTS[stated] if isinstance(stated, str) else _always(stated)


def _finding(name: str, stated: dict[str, Any]) -> Finding:
    """One finding of the file; files of a folder stand by the names of :mod:`maskfab.base.folders`."""
    more: dict[str, Any] = {key: stated[key] for key in ("sweep", "rows", "noisy") if key in stated}
    more |= {key: tuple(stated[key]) for key in ("functions", "gives") if key in stated}
    more |= {key: tuple(stated[key].items()) for key in ("limits", "figures") if key in stated}
    return Finding(
        name,
        tuple(Need[need] for need in stated["needs"]),
        files=tuple(getattr(folders, file, file) for file in stated.get("files", ())),
        seconds=tuple(map(_cost, stated.get("seconds", ()))),
        bytes=_cost(stated["bytes"]) if "bytes" in stated else None,
        **more,
    )


FINDINGS: tuple[Finding, ...] = tuple(
    _finding(name, stated)
    for name, stated in json.loads(Path(__file__).with_name("findings.json").read_text(encoding="utf-8")).items()
)
"""Of the works about a die, the cheapest first; then what other verbs find, and what makes the files of a run."""

STAGE_OF_QUANTITY: Mapping[str, Finding] = MappingProxyType(
    {name: finding for finding in FINDINGS for name in finding.gives}
)
"""The least work that finds a quantity from the design alone, by the quantity's name, the cheapest first."""

LIMITS: Mapping[str, str] = MappingProxyType({name: key for finding in FINDINGS for name, key in finding.limits})
"""Keys of [limits] by the quantities that they judge: the least that a width may be, the most that a number may."""
