"""Numbers and sentences on all that was found of the bench."""

from __future__ import annotations

import math
from collections.abc import Iterator

from maskfab.base.model import Quantity, Tiling
from maskfab.base.units import decimals_of
from maskfab.camera.inspection.bench import (
    AXIAL,
    AXIAL_BEND,
    BAND_BELL,
    BAND_FLAT,
    BANDS,
    CUT_BEND,
    CUT_X,
    CUT_Y,
    DIE_X,
    DIE_Y,
    FULL,
    LATERAL_X,
    LATERAL_Y,
    LIGHT_BELL,
    LIGHT_DISC,
    LIGHTS,
    STOP,
    edge_inside_um,
)
from maskfab.camera.inspection.causes import Explanation
from maskfab.camera.inspection.die_image import LAMP
from maskfab.camera.scores import NORMAL_95

_LEAST_PX = 0.5
"""Least full width of a light that is told: the charge of a pixel spreads as far."""
_NAMES = {
    DIE_X: "captured_die_x",
    DIE_Y: "captured_die_y",
    CUT_X: "captured_vignetting_x",
    CUT_Y: "captured_vignetting_y",
    CUT_BEND: "captured_vignetting_bend",
    AXIAL: "captured_axial_colour",
    AXIAL_BEND: "captured_axial_bend",
    LATERAL_X: "captured_lateral_x",
    LATERAL_Y: "captured_lateral_y",
    **dict(zip(LAMP, ("captured_lamp_x", "captured_lamp_y", "captured_lamp"), strict=True)),
}
_HOW = "weighted least squares beside all that the fit holds; 95 % by Fisher's information"


def bench_quantities(told: Explanation, die: str) -> Iterator[Quantity]:
    """Values of another lamp, and of the bench, that residuals asked for."""
    half = {name: NORMAL_95 * error for name, error in told.fit.errors.items()}
    for name, value in zip(told.fit.setting.names, told.fit.setting.values.tolist(), strict=True):
        if name in _NAMES:
            yield Quantity(_NAMES[name], value, _HOW, half[name], die=die)
        elif name == STOP:
            diameter_um = told.image.camera.stop.diameter_um + value
            yield Quantity("captured_stop_diameter", diameter_um, _HOW, half[name], die=die)
    for number, width in (("captured_light_width", _light(told)), ("captured_bandwidth", told.width(*BANDS))):
        if width is not None:
            method = f"steps of the variance of {_SHAPES[width[0]][0]} in {_HOW}"
            yield Quantity(number, width[1], method, NORMAL_95 * width[2], die=die)


_SHAPES = {
    LIGHT_DISC: ("a disc", "full width of a disc"),
    LIGHT_BELL: ("a bell", "full width at half maximum of a Gaussian"),
    BAND_FLAT: ("a flat band", "as a flat band"),
    BAND_BELL: ("a bell", "at half its height, as a Gaussian"),
    "": ("a disc or a bell, the error reaching over both,", "too narrow to tell a disc from a Gaussian"),
}
"""Of widths that are told: the shape, and the shape in words of a sentence."""


def _light(told: Explanation) -> tuple[str, float, float] | None:
    """Shape, full width and standard error of the light; of less than a pixel the shape is not told."""
    width, pixel_um = told.width(*LIGHTS), told.image.camera.pixel_um
    if width is None:
        return None
    low, high = (FULL[each] / FULL[width[0]] for each in reversed(LIGHTS))
    between = width[1] * (low + high) / 2
    if between >= pixel_um:
        return width
    both = "", between, width[1] * (high - low) / 2 / NORMAL_95 + high * width[2]
    return None if between < _LEAST_PX * pixel_um else both


def bench_sentences(told: Explanation) -> Iterator[str]:
    """A sentence on each fault of the bench that the fit allows for."""
    bench, fit = dict(told.fit.setting.bench), told.fit
    half = {name: NORMAL_95 * error for name, error in fit.errors.items()}
    if DIE_X in bench:
        right, up = (by_error(bench[name], half[name]) for name in (DIE_X, DIE_Y))
        panel = told.image.panel
        period = (
            f", or so and whole cells of {panel.cell_size.pitch_um:g} um" if panel.tiling is Tiling.PERIODIC else ""
        )
        yield (
            f"The die's middle lies {right} um to the right of the middle of the stop and {up} um up, as the sensor "
            f"sees it{period}; the fit allows for it."
        )
    beyond = edge_inside_um(told.image.panel, told.image.way_round, told.image.camera.stop, bench)
    if beyond > 0:
        yield (
            f"The die's edge lies within the stop, by {beyond:.0f} um: beyond it the fit takes the plate for dark. "
            "Move the die towards the axis, or use a smaller stop."
        )
    if STOP in bench:
        diameter = told.image.camera.stop.diameter_um
        yield (
            f"The stop is {by_error(diameter + bench[STOP], half[STOP], sign=False)} um wide where the job states "
            f"{diameter:g} um; the fit allows for it."
        )
    depth = math.hypot(bench.get(CUT_X, 0.0), bench.get(CUT_Y, 0.0))
    if depth:
        yield (
            f"Something cuts the light beside the stop, a barrel or a mount, by up to {depth:.0f} um "
            f"({bench[CUT_X]:+.0f} um to the right, {bench[CUT_Y]:+.0f} um up); the fit allows for it."
        )
    yield from _light_sentences(told)
    if AXIAL in bench:
        yield (
            f"Colours focus apart, by {by_error(bench[AXIAL], half[AXIAL])} waves of defocus for each 100 nm; the fit "
            "allows for it."
        )
    if LATERAL_X in bench:
        right, up = (by_error(bench[name], half[name]) for name in (LATERAL_X, LATERAL_Y))
        yield f"Colours lie apart, by {right} um to the right and {up} um up for each 100 nm; the fit allows for it."


def _light_sentences(told: Explanation) -> Iterator[str]:
    light, band = _light(told), told.width(*BANDS)
    if light is not None:
        width = by_error(light[1], NORMAL_95 * light[2], sign=False)
        yield (
            f"The light is no point: on the sensor it is {width} um wide ({_SHAPES[light[0]][1]}), or the pixels "
            "spread what they take. The fit allows for it; a smaller pinhole, or one farther away, tells more."
        )
    if band is not None:
        width = by_error(band[1], NORMAL_95 * band[2], sign=False)
        yield f"The light is no line: it is {width} nm wide {_SHAPES[band[0]][1]}; the fit allows for it."


def by_error(value: float, error: float, *, sign: bool = True) -> str:
    """A number with its error, to the decimals that this allows, five at most."""
    decimals = max(0, min(5, decimals_of(error))) if error else 4
    return f"{value:{'+' if sign else ''}.{decimals}f} ± {error:.{decimals}f}"
