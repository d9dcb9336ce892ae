"""Where every number comes from: what is found about a die, by which function, from what, and at what cost.

Runs, checks of finished folders, sweeps, forecasts and the store of kept findings read this one table. Functions stand
by their names, as the store knows them, so that reading the table loads none of them.

Notes:
    Seconds are those of one thread of the machine of the reference numbers. What another machine takes follows from
    what its earlier tasks took, or, where it has done none, from a probe of it: :class:`maskfab.runs.forecast.Pace`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from importlib import import_module
from types import MappingProxyType
from typing import Any

from maskfab.base.units import NM_PER_UM
from maskfab.runs.recall import words


class Need(Enum):
    """Something that a finding depends on, in words."""

    PANEL = "the panel"
    CAMERA = "the camera"
    WINDOW = "the camera's window"
    PROCESS = "the process"
    BLANK = "the blank"
    FILES = "the files, read back"
    SCENE = "the scene"
    DISPLAY = "the display's rules"
    PHOTOGRAPHS = "photographs"


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that is found about a die.

    Attributes:
        name: of the stage of a run, as progress tells it, or of the work in a sweep.
        needs: what it depends on.
        functions: that a run calls for it, in order; none where it finds it on the way to another.
        sweep: function that finds it from the design alone, of one :class:`maskfab.runs.sweep_cases.SweptDie`; None
            where that cannot be.
        gives: names of the quantities that it finds from the design alone.
        seconds: of a processor that the functions take, each with its arguments.
        bytes: of memory that the first function holds at its most, with its arguments; None for little.
        figures: functions that draw it, and seconds of a processor that each takes.
    """

    name: str
    needs: tuple[Need, ...]
    functions: tuple[str, ...] = ()
    sweep: str | None = None
    gives: tuple[str, ...] = ()
    seconds: tuple[Callable[..., float], ...] = ()
    bytes: Callable[..., float] | None = None
    figures: tuple[tuple[str, float], ...] = ()


def function_of(name: str) -> Callable[..., Any]:
    """The function of a name, whose module is loaded now."""
    module, _, attribute = name.rpartition(".")
    function: Callable[..., Any] = getattr(import_module(f"maskfab.{module}"), attribute)
    return function


def origin_words(quantity: str) -> str | None:
    """The work that finds a quantity from the design alone, and what it needs, in words; None if none does."""
    finding = STAGE_OF_QUANTITY.get(quantity)
    return None if finding is None else f"{finding.name}, from {', '.join(need.value for need in finding.needs)}"


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
    return 4.5 * float(len(conditions.levels)) / _LEVELS if seen == _COLOURS else 0.0


def _optics_s(die: Any, camera: Any, *_: Any) -> float:
    """Dots in the stop set the transform's length, pixels of the window its points."""
    side = camera.window_um / camera.pixel_um / _DRAWN_WINDOW_PX
    dots = camera.stop.diameter_um / (die.panel.dot_nm / NM_PER_UM)
    return float(len(camera.wavelengths_nm) * (0.02 + 0.08 * side**2 + 0.1 * (dots / 500) ** 2))


def _scene_s(_die: Any, camera: Any, scene: Any, _openings: Any, plan: Any, *_: Any) -> float:
    """The plan's price is that of the whole scene; a report shows some of its PSFs, and one by the fullest model."""
    choice, side = plan.choice, camera.window_um / camera.pixel_um / _DRAWN_WINDOW_PX
    depths = len({scene.nearest_um, scene.focus_um, scene.farthest_um}) if choice.defocus else 0
    off_axis = scene.differs_off_axis and (choice.places > 1 or choice.distortion > 0)
    of_bands = plan.wavelengths if scene.bands else 0
    fuller = plan.fullest.samples_per_dot / choice.samples_per_dot if choice.samples_per_dot else 1.0
    shown = 1 + fuller + depths + _VIEWS_OF_FIELD * off_axis + of_bands
    one = float(plan.price.seconds) / (plan.wavelengths * plan.depths * choice.places**2)
    resampled = 0.03 * side**2 * _VIEWS_OF_FIELD * off_axis * choice.distortion**2
    return float(0.2 + _OF_PRICE * shown * one + resampled)


def _scene_bytes(die: Any, camera: Any, scene: Any, _: Any, plan: Any, *__: Any) -> float:
    """Bytes of a process that keeps the memory of photographs; samples of a lens that distorts are finer."""
    from maskfab.report.rows.scene import peak_bytes  # which loads all that scenes need

    side = camera.window_um / camera.pixel_um / _DRAWN_WINDOW_PX
    return float(
        _PHOTOGRAPHS_BYTES + peak_bytes(die, camera, scene, plan) + 9e6 * (side * plan.fullest.distortion) ** 2
    )


_FRACTIONS = ("mtf50", "mtf30", "mtf10")
_READINGS = ("fused", "open")

FINDINGS: tuple[Finding, ...] = (
    Finding("open ratio", (Need.PANEL,), sweep="runs.sweep_cases.open_ratio", gives=("open_ratio",)),
    Finding(
        "mtf",
        (Need.PANEL, Need.CAMERA),
        sweep="runs.sweep_cases.mtfs",
        gives=("auc_radial_min", *_FRACTIONS, *(f"{name}_per_pixel" for name in _FRACTIONS)),
    ),
    Finding(
        "restoration",
        (Need.PANEL, Need.CAMERA),
        sweep="runs.sweep_cases.restoration",
        gives=("wiener_worst30", "wiener_noise_gain"),
    ),
    Finding(
        "features",
        (Need.PANEL, Need.PROCESS),
        sweep="runs.sweep_cases.features",
        gives=("min_feature", "min_space", "written_min_feature", "written_min_space"),
    ),
    Finding(
        "psf as written",
        (Need.PANEL, Need.CAMERA, Need.WINDOW, Need.PROCESS),
        sweep="runs.sweep_cases.written_psf",
        gives=tuple(
            f"written_{name}_{reading}"
            for name in ("open_ratio", "psf_difference", "psf_shape")
            for reading in _READINGS
        ),
    ),
    Finding(
        "mtf as written",
        (Need.PANEL, Need.CAMERA, Need.PROCESS),
        sweep="runs.sweep_cases.written_mtf",
        gives=tuple(f"written_{name}_{reading}" for name in ("auc_radial_min", "mtf50") for reading in _READINGS),
    ),
    Finding(
        "scatter",
        (Need.PANEL, Need.CAMERA, Need.WINDOW, Need.PROCESS),
        sweep="runs.sweep_cases.scatter",
        gives=tuple(f"written_scattered_{reading}" for reading in _READINGS),
    ),
    Finding("surrogate", (Need.PANEL, Need.CAMERA), sweep="runs.sweep_cases.expected", gives=("expected_psnr",)),
    Finding(
        "footprint",
        (Need.PANEL, Need.DISPLAY),
        sweep="runs.sweep_cases.footprint",
        gives=("led_footprint_largest", "led_footprint_bound"),
    ),
    Finding(
        "displays",
        (Need.PANEL, Need.DISPLAY),
        ("display.feasibility.feasibility",),
        sweep="runs.sweep_cases.display",
        gives=("display_fits", "led_footprint", "circuit_room"),
        seconds=(_always(2.0),),
        figures=(("report.figures.display.pictures", 0.3),),
    ),
    Finding(
        "optics",
        (Need.PANEL, Need.CAMERA, Need.WINDOW, Need.FILES, Need.BLANK),
        ("report.rows.optics.measure_with_bar",),
        seconds=(_optics_s,),
        figures=(
            ("report.figures.die.overview", 0.5),
            ("report.figures.die.of_plate", 0.3),
            ("report.figures.die.of_die", 0.4),
        ),
    ),
    Finding(
        "scene",
        (Need.PANEL, Need.CAMERA, Need.WINDOW, Need.FILES, Need.SCENE, Need.BLANK),
        ("report.rows.scene.measure_scene",),
        sweep="runs.sweep_cases.scene",
        gives=("scene_psf_change", "plan_error", "depth_residual", "field_residual", "depth_change"),
        seconds=(_scene_s,),
        bytes=_scene_bytes,
        figures=(("report.figures.scene.pictures", 0.5),),
    ),
    Finding(
        "photographs",
        (Need.PANEL, Need.CAMERA, Need.SCENE),
        ("report.rows.photographs.photograph_die",),
        sweep="runs.sweep_cases.photographs",
        gives=("restored_psnr",),
        seconds=(_photographs_s,),
        bytes=_always(_PHOTOGRAPHS_BYTES),
        figures=(
            ("report.figures.scene.photograph_pictures", 0.3),
            ("report.figures.scene.truth", 0.05),
            ("report.figures.scene.front", 0.05),
        ),
    ),
    Finding(
        "process",
        (Need.PANEL, Need.CAMERA, Need.WINDOW, Need.PROCESS),
        ("report.rows.as_written.measure_written", "report.rows.bands.band_quantities"),
        seconds=(_always(1.5), lambda _written, _camera, spread, *_: 4.0 if spread else 0.0),
        bytes=_always(400e6),
        figures=(("report.figures.die.written_pictures", 0.35),),
    ),
    Finding(
        "tolerance",
        (Need.PANEL, Need.CAMERA, Need.PROCESS, Need.PHOTOGRAPHS),
        ("report.rows.bands.restored_expansion",),
        seconds=(_always(11.0),),
        bytes=_always(500e6),
    ),
)
"""The cheapest first."""

STAGE_OF_QUANTITY: Mapping[str, Finding] = MappingProxyType(
    {name: finding for finding in FINDINGS for name in finding.gives}
)
"""The least work that finds a quantity from the design alone, by the quantity's name, the cheapest first."""
