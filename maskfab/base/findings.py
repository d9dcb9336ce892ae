"""Where every number comes from: what is found, by which function, from what, at what cost, and how surely again.

Runs, checks of finished folders, runs made again, sweeps, the claims of studies, forecasts, the store of kept findings
and explanations read this one table. Functions stand by their names, as the store knows them, so that reading the table
loads none of them; what a number is called and means stands in :mod:`maskfab.base.quantities`.

Notes:
    Seconds are those of one thread of the machine of the reference numbers. What another machine takes follows from
    what its earlier tasks took, or, where it has done none, from a probe of it: :class:`maskfab.runs.forecast.Pace`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from fnmatch import fnmatchcase
from functools import cache, lru_cache, partial
from importlib import import_module
from types import MappingProxyType
from typing import Any

from maskfab.base.folders import APPENDIX, NUMBERS, OVERVIEW, PAGE, PRINT, REPORT, RESULT_MARK, VIEW
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
    return 1.5 * float(len(conditions.levels)) / _LEVELS if seen == _COLOURS else 0.0


def _optics_s(die: Any, camera: Any, *_: Any) -> float:
    """Dots in the stop set the transform's length, pixels of the window its points."""
    side = camera.window_um / camera.pixel_um / _DRAWN_WINDOW_PX
    dots = camera.stop.diameter_um / (die.panel.dot_nm / NM_PER_UM)
    return float(len(camera.wavelengths_nm) * (0.02 + 0.08 * side**2 + 0.1 * (dots / 500) ** 2))


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
        rows="corner_touches",
        limits=(
            ("corner_touches", "corner_touches"),
            ("min_feature", "min_feature"),
            ("min_space", "min_space"),
            ("written_min_feature", "min_feature"),
            ("written_min_space", "min_space"),
        ),
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
        ("display.feasibility.feasibility", "display.eye_and_life.judgement"),
        sweep="runs.sweep_cases.display",
        gives=(
            *("display_fits", "led_footprint", "circuit_room", "flat_delta_e_mean", "grain_slow", "edge_fringe"),
            *("reference_luminance", "reference_life", "reference_power"),
        ),
        rows=(
            "local_resolution "
            "led_footprint_rectangles circuit_room_* circuit_boxes_placed circuit_rules_broken emitter* "
            "luminance_centroid flat_delta_e_95 grain_fine reference_footprint "
            "current_density_* relative_life_* wire_lines_* wired_*"
        ),
        seconds=(_always(2.0), _always(0.1)),
        figures=(("report.figures.display.pictures", 0.3),),
    ),
    Finding(
        "optics",
        (Need.PANEL, Need.CAMERA, Need.WINDOW, Need.FILES, Need.BLANK),
        ("findings.optics.measure_with_bar",),
        rows=(
            "open_ratio stop_open_ratio auc_radial_min mtf[0-9{]* mtf_worst_* mtf_aliasing mtf_phase_range "
            "wiener_* psf_energy_in_window ensquared_energy halo_energy *side_lobe streak_index "
            "*strehl order* *colour_distance edge_colour_difference *_invariant_error model_* fast_lens "
            "readback_psf_difference"
        ),
        files=("*.exr",),
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
        ("findings.scene.measure_scene",),
        sweep="runs.sweep_cases.scene",
        gives=("scene_psf_change", "plan_error", "depth_residual", "field_residual", "depth_change"),
        rows="plan_error_measured field_mtf_* field_restored_loss nearest_object",
        seconds=(_scene_s,),
        bytes=_scene_bytes,
        figures=(("report.figures.scene.pictures", 0.5),),
    ),
    Finding(
        "photographs",
        (Need.PANEL, Need.CAMERA, Need.SCENE),
        ("findings.photographs.photograph_die",),
        sweep="runs.sweep_cases.photographs",
        gives=("restored_psnr",),
        rows="restored_* photograph* predicted_psnr",
        noisy=True,
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
        ("findings.as_written.measure_written", "findings.bands.band_quantities"),
        rows=(
            "written_* band_stop_open_ratio band_auc_radial_min band_mtf* band_psf_shape band_halo_energy "
            "band_led_footprint sensitivity_psf_shape"
        ),
        seconds=(_always(1.5), lambda _written, _camera, spread, *_: 4.0 if spread else 0.0),
        bytes=_always(400e6),
        figures=(("report.figures.die.written_pictures", 0.35),),
    ),
    Finding(
        "tolerance",
        (Need.PANEL, Need.CAMERA, Need.PROCESS, Need.PHOTOGRAPHS),
        ("findings.bands.restored_expansion",),
        rows="band_restored_* sensitivity_restored_psnr",
        noisy=True,
        seconds=(_always(6.0),),
        bytes=_always(500e6),
    ),
    Finding(
        "read back",
        (Need.PANEL, Need.FILES),
        rows=(
            "drawn_holes drawn_parted drawn_snapped drawn_split polygons cd_* readback_xor_area "
            "readback_wrong_dots data_* judged_* *bitmap_* dot_edge_error* solid_* psf_file_*"
        ),
    ),
    Finding("house", (Need.FILES, Need.HOUSE), rows="shop_*"),
    Finding("notes", (Need.JOB,), rows="designed_for unused_keys display_seed assumed_tiling lens_view"),
    Finding(
        "look",
        (Need.PANEL, Need.DISPLAY),
        rows="pixels_per_degree centroid_offset grain_rms grain_predicted grain_[sf{]* *_delta_e_* *_jod edge_fringe",
    ),
    Finding(
        "file of any maker",
        (Need.FILES, Need.PANEL, Need.CAMERA, Need.HOUSE),
        rows=(
            "lies layer* other_layers passed_over rounding empty_polygons repeated_vertices approximated_curves "
            "drawing_unit entities_* largest_gap *_by_parity array_drift "
            "texts grey_pixels xor_area sliver_area optics mtf_difference raster_psf_difference rule_*"
        ),
    ),
    Finding("captures", (Need.PANEL, Need.CAMERA, Need.CAPTURES), rows="captured_* measurement_left_out"),
    Finding(
        "edge",
        (Need.CAMERA, Need.CAPTURES),
        rows="edge_angle edge_mtf* edge_overshoot edge_asymmetry edge_light_change",
    ),
    Finding("study of optics", (Need.PANEL, Need.CAMERA, Need.WINDOW), rows="psf_difference"),
    Finding(
        "study of photographs",
        (Need.PANEL, Need.CAMERA, Need.SCENE, Need.PHOTOGRAPHS),
        rows="psnr psnr_inner ssim delta_e",
        noisy=True,
    ),
    Finding(
        "verification",
        (Need.RESULT,),
        rows=(
            "sha256 unlisted readable job job_hash made_again report report_* reported* drawn_again foreign_bytes "
            "package_folder mask_files extent paper profile files manifest_*"
        ),
    ),
    Finding("self-test", (), rows="clear_stop_psf_error part_works"),
    Finding("numbers", (Need.JOB, Need.FILES), files=(REPORT, NUMBERS)),
    Finding("figures", (Need.JOB, Need.FILES), files=(PAGE, APPENDIX, VIEW, OVERVIEW, PRINT)),
    Finding("hashes of the others", (Need.RESULT,), files=(RESULT_MARK,)),
    Finding("drawing and writing", (Need.PANEL,), files=("*",)),
)
"""Of the works about a die, the cheapest first; then what other verbs find, and what makes the files of a run."""

STAGE_OF_QUANTITY: Mapping[str, Finding] = MappingProxyType(
    {name: finding for finding in FINDINGS for name in finding.gives}
)
"""The least work that finds a quantity from the design alone, by the quantity's name, the cheapest first."""

LIMITS: Mapping[str, str] = MappingProxyType({name: key for finding in FINDINGS for name, key in finding.limits})
"""Keys of [limits] by the quantities that they judge: the least that a width may be, the most that a number may."""
