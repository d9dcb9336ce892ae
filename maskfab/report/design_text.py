"""The result of ``maskfab design`` as text for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from maskfab.units import UM_PER_MM

if TYPE_CHECKING:
    from maskfab.optimiser.maps.orientation_map import DesignedMap
    from maskfab.optimiser.model.robustness import Robustness, Varied
    from maskfab.optimiser.result import Designed, SceneDesign
    from maskfab.optimiser.rules.die_fit import DieFit


USEFUL_DB = 20.0
"""Headroom above which a bound says nothing: an open stop gains less over any opening."""


def designed_lines(found: Designed, notes: Sequence[str]) -> list[str]:
    """The opening, its bound, what the rules cost, the map, and the notes."""
    told = [
        f"{found.shape}: {found.opening.clear_dots} clear dots, expected restored PSNR {_levels(found, found.psnr)}"
    ]
    told.append(f"for {found.camera}")
    if found.scene is not None:
        told += _scene_lines(found, found.scene)
    focus = "" if found.scene is None else ", in focus"
    if found.head_room is not None:
        told.append(f"proven headroom (frame interior{focus}): {_most(found, found.head_room)}")
    if found.gap is not None:
        limit, part = found.gap.bounds, f"(frame interior{focus})"
        told.append(f"proven headroom (whole frame{focus}): {_most(found, found.gap.head_room_frame)}")
        told.append(f"grey filter of the same transmission: {_levels(found, limit.grey)} {part}")
        told.append(f"unobstructed stop with the same open area: {_levels(found, limit.open_stop)} {part}")
        most = "" if limit.auc is None else f" of at most {limit.auc:.4f}"
        told.append(f"area under the radial minimum of the blue MTF: {found.gap.auc:.4f}{most}")
    if found.prices is not None and found.prices.each:
        told.append(f"all rules together cost {_db(found.prices.together)} ({found.evaluated} openings evaluated)")
        told += [
            f"  {price.rule}: {_db(price.alone)} if it is the only rule, {_db(price.last)} on top of the others"
            for price in found.prices.each
        ]
    else:
        told.append(f"{found.evaluated} openings evaluated")
    if found.designed is not None:
        gains = _levels(found, found.designed.gain_db, "+")
        told.append(f"gain of the designed map over a random one: {gains}; transmission {_light(found.designed):+.2%}")
    if found.map_head_room is not None:
        told.append(f"proven headroom of the map (same dots, same transmission): {_most(found, found.map_head_room)}")
    if found.robust is not None:
        told += _robust_lines(found, found.robust)
    if found.fit is not None:
        told += _fit_lines(found.fit, mapped=found.designed is not None)
    return [*told, *(f"note: {note}" for note in notes)]


def _fit_lines(fit: DieFit, *, mapped: bool) -> list[str]:
    drawn = "beyond its map" if mapped else "of its tiling"
    size = f"{fit.across} x {fit.across} pixels, {fit.side_um / UM_PER_MM:g} mm"
    told = [
        f"the display fits a die of {size}, with seed {fit.seed} {drawn} (checked in {fit.seconds:.1f} s of processor)"
    ]
    if fit.failed:
        tried = ", ".join(map(str, fit.failed))
        told.append(f"  state seed = {fit.seed} in its [[die]]: with seed {tried} it does not fit, {fit.first_failure}")
    return told


def _robust_lines(found: Designed, robust: Robustness) -> list[str]:
    told = []
    if robust.tiling is not None:
        told.append(f"one random tiling differs from another by {_levels(found, robust.tiling)} (standard deviation)")
    for away, gains in robust.off_centre.items():
        where = f"with the stop {away:g} um off its centre" if away else "over the mean of random tilings"
        told.append(f"gain of the designed map {where}: {_levels(found, gains, '+')}")
    if robust.bias is not None:
        bias, (narrow, wide) = robust.bias, robust.bias.psnr
        told.append(f"panel as drawn: {_levels(found, robust.psnr)}")
        told.append(f"clear features narrower by {bias.deviation_um:g} um: {_levels(found, narrow)}")
        told.append(f"clear features wider by {bias.deviation_um:g} um: {_levels(found, wide)}")
        told.append(f"expected loss over that bias: {_losses(found, bias)}")
    if robust.centre is not None:
        away = robust.centre.deviation_um
        told.append(f"expected loss with the stop's centre off by {away:g} um: {_losses(found, robust.centre)}")
    return told


def _scene_lines(found: Designed, scene: SceneDesign) -> list[str]:
    from maskfab.measurement.scene_result import distance
    from maskfab.optics.wavefront.panel_gap import AXIS

    seen, panel = scene.seen, scene.panel
    told = [f"this panel over the scene (modelled: {', '.join(seen.modelled)}): {_levels(found, panel.mean)}, mean"]
    for each, psnr in zip(panel.conditions, panel.psnr, strict=True):
        x, y = each.image_um
        place = "on the axis" if each.image_um == AXIS else f"{x:.0f} um right and {y:.0f} um down from the axis"
        told.append(f"  at {distance(each.object_um)}, {place} ({each.weight:.1%}): {_levels(found, psnr)}")
    if scene.random is not None:
        gains = [ours - random for ours, random in zip(panel.mean, scene.random.mean, strict=True)]
        told.append(f"gain of the designed map over a random one, over the scene: {_levels(found, gains, '+')}")
    return told


def _losses(found: Designed, varied: Varied) -> str:
    """To a thousandth of a decibel: most are smaller than what others are rounded to."""
    return ", ".join(f"{value + 0.0:.3f} dB at {level}" for level, value in by_level(found.levels, varied.loss).items())


def _light(designed: DesignedMap) -> float:
    return designed.clear_dots / designed.start_clear_dots - 1


def by_level(levels: Sequence[float], values: Sequence[float]) -> dict[str, float]:
    """Values by the level of light that they hold at, in dB as text."""
    return {f"{level:g}": value for level, value in zip(levels, values, strict=True)}


def _most(found: Designed, values: Sequence[float]) -> str:
    """Bounds by level; one that no design could come near says nothing, and is told as such."""
    return ", ".join(
        f"at most {value:.2f} dB at {level}" if value <= USEFUL_DB else f"no useful bound at {level}"
        for level, value in by_level(found.levels, values).items()
    )


def _levels(found: Designed, values: Sequence[float], sign: str = "") -> str:
    return ", ".join(f"{value:{sign}.2f} dB at {level}" for level, value in by_level(found.levels, values).items())


def _db(value: float) -> str:
    return f"{value:.3f} dB" if math.isfinite(value) else "everything: no opening evaluated meets it"
