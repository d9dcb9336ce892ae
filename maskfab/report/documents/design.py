"""Openings of nearly the PSNR of a chosen one, as plain data for documents and pages.

The result of ``maskfab design`` as one document for programs: design.json, and what ``--json`` prints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.units import NM_PER_UM
from maskfab.designs.model.appraisal import Robustness, Varied, laid_picture
from maskfab.designs.search.result import WITHIN_DB, Account, Alternative, Alternatives, Prices
from maskfab.mask.panels import shifted
from maskfab.optics.tiling import orientations
from maskfab.report.rows.text import by_level

if TYPE_CHECKING:
    from maskfab.designs.model.limits import Gap
    from maskfab.designs.rules.display_fit import DieFit
    from maskfab.designs.search.result import Designed, SceneDesign


def alternatives_document(alternatives: Alternatives) -> dict[str, Any]:
    """Alternatives as plain data; shares of the pixel, micrometres, dB."""
    return {
        "within_db": WITHIN_DB,
        "bias_um": alternatives.bias_um,
        "of_the_display": alternatives.own_emitters,
        "judged_within": alternatives.within,
        "kinds": alternatives.kinds,
        "unlisted": alternatives.unlisted,
        "untried": alternatives.untried,
        "chosen": _told(alternatives.chosen),
        "others": [
            {
                **_told(other),
                "below_db": alternatives.chosen.value - other.value + 0.0,
                "better_at": list(other.better_at(alternatives.chosen)),
            }
            for other in alternatives.others
        ],
    }


def drawn_rows(unit: NDArray[np.bool_]) -> list[str]:
    """Rows of dots [rows, columns], row 0 the lowest, as text from the top: ``#`` is clear, ``.`` closed."""
    return ["".join(".#"[dot] for dot in row) for row in unit[::-1].astype(int).tolist()]


def _told(alternative: Alternative) -> dict[str, Any]:
    return {
        "shape": alternative.name,
        "rows": drawn_rows(alternative.unit),
        "clear_dots": int(alternative.unit.sum()),
        "open_ratio": alternative.open_ratio,
        "expected_psnr_db": alternative.value,
        "emitters": alternative.emitters,
        "rim_um": alternative.rim_um,
        "moved_by_bias_db": alternative.moved_db,
        "alike": alternative.alike,
    }


SCHEMA_VERSION = 1
_SHOWN_CELLS = 6
"""Cells along a side of the middle of a panel that is drawn."""


@dataclass(frozen=True)
class Made:
    """Origin of a design, beside what was found.

    Attributes:
        job_hash: of the resolved job.
        wall_s, processor_s: seconds that it took.
    """

    job_hash: str
    wall_s: float
    processor_s: float


def designed_document(
    design: Designed, paths: Mapping[str, Path], notes: Sequence[str], made: Made | None = None
) -> dict[str, Any]:
    """The result as plain data; infinite values are null. Equal designs give equal documents but for ``time``.

    Args:
        design: what a search found.
        paths: of its files, by part.
        notes: what a user should know, as sentences.
        made: how it came about; null where that is not known.
    """
    designed, account = design.designed, design.account
    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": None if made is None else made.job_hash,
        "time": None if made is None else _time(made, account),
        "name": design.opening.name,
        "path": str(paths["opening"]),
        "shape": design.shape,
        "clear_dots": design.opening.clear_dots,
        "open_ratio": design.opening.open_ratio,
        "designed_for": design.camera,
        "dot_um": design.opening.dot_nm / NM_PER_UM,
        "pitch_um": design.opening.dots * design.opening.dot_nm / NM_PER_UM,
        "rows": drawn_rows(design.opening.mask),
        "panel": None if account is None else _panel(design, account),
        "expected_psnr_db": by_level(design.levels, design.psnr),
        "head_room_db": None if design.head_room is None else by_level(design.levels, design.head_room),
        "bounds": None if design.gap is None else _bounds(design, design.gap),
        "evaluated": design.evaluated,
        "search": None if account is None else _search(account),
        **prices_document(design.prices),
        "alternatives": None if design.alternatives is None else alternatives_document(design.alternatives),
        "alternatives_absent": _absent(design),
        "map": None
        if designed is None
        else {
            "path": str(paths["map"]),
            "gain_db": by_level(design.levels, designed.gain_db),
            "expected_psnr_db": by_level(design.levels, designed.psnr),
            "head_room_db": None if design.map_head_room is None else by_level(design.levels, design.map_head_room),
            "clear_dots": designed.clear_dots,
            "random_clear_dots": designed.start_clear_dots,
            "positions": max(1, len(designed.shifts)),
        },
        "robust": None if design.robust is None else _robust(design, design.robust),
        "fit": None if design.fit is None else _fit(design.fit),
        "scene": None if design.scene is None else _scene(design, design.scene),
        "outer": None if design.outer is None else str(paths["outer"]),
        "notes": list(notes),
        "provenance": dict(design.opening.provenance),
    }


def _fit(fit: DieFit) -> dict[str, object]:
    return {
        "pixels": [fit.across, fit.across],
        "side_um": fit.side_um,
        "seed": fit.seed,
        "failed": [{"seed": seed, "why": why} for seed, why in fit.failed.items()],
        "seconds": round(fit.seconds, 3),
    }


def _scene(designed: Designed, scene: SceneDesign) -> dict[str, object]:
    """Lengths in micrometres; null for an infinite distance."""
    panel, random = scene.panel, scene.random
    return {
        "accuracy": scene.seen.plan.accuracy,
        "modelled": list(scene.seen.modelled),
        "left_out": list(scene.seen.neglected),
        "mean_psnr_db": by_level(designed.levels, panel.mean),
        "random_mean_psnr_db": None if random is None else by_level(designed.levels, random.mean),
        "conditions": [
            {
                "object_um": _finite(condition.object_um),
                "image_um": list(condition.image_um),
                "weight": condition.weight,
                "psnr_db": by_level(designed.levels, psnr),
                "random_psnr_db": None if random is None else by_level(designed.levels, random.psnr[k]),
            }
            for k, (condition, psnr) in enumerate(zip(panel.conditions, panel.psnr, strict=True))
        ],
    }


def _robust(designed: Designed, robust: Robustness) -> dict[str, object]:
    return {
        "panel_psnr_db": by_level(designed.levels, robust.psnr),
        "tiling_db": None if robust.tiling is None else by_level(designed.levels, robust.tiling),
        "map_gain_off_centre_db": {
            f"{away:g}": by_level(designed.levels, losses) for away, losses in robust.off_centre.items()
        },
        **{name: _varied(designed, getattr(robust, name)) for name in ("bias", "centre")},
    }


def _varied(designed: Designed, varied: Varied | None) -> dict[str, object] | None:
    if varied is None:
        return None
    return {
        "deviation_um": varied.deviation_um,
        "psnr_db": [by_level(designed.levels, losses) for losses in varied.psnr],
        "loss_db": by_level(designed.levels, varied.loss),
    }


def _bounds(designed: Designed, gap: Gap) -> dict[str, object]:
    limit = gap.bounds
    return {
        "interior_psnr_db": by_level(designed.levels, gap.psnr),
        "most_interior_psnr_db": by_level(designed.levels, limit.psnr),
        "most_frame_psnr_db": by_level(designed.levels, limit.frame),
        "grey_psnr_db": by_level(designed.levels, limit.grey),
        "open_stop_psnr_db": by_level(designed.levels, limit.open_stop),
        "auc": gap.auc,
        "most_auc": limit.auc,
        "method": list(limit.method),
    }


def prices_document(prices: Prices | None) -> dict[str, Any]:
    """Costs of rules, dB; null where no opening judged tells it, and of all where nothing is priced."""
    if prices is None:
        return {"rules_cost_db": None, "prices_db": {}}
    rules = {one.rule: {"alone": _finite(one.alone), "last": _finite(one.last)} for one in prices.each}
    return {"rules_cost_db": _finite(prices.together), "prices_db": rules}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _time(made: Made, account: Account | None) -> dict[str, float]:
    """Seconds; of them those of the processor that annealings without a rule took."""
    seconds = {"wall_s": made.wall_s, "processor_s": made.processor_s}
    if account is not None and account.without is not None:
        seconds["annealed_without_s"] = account.without[1]
    return {name: round(value, 1) for name, value in seconds.items()}


def _search(account: Account) -> dict[str, Any]:
    return {
        "method": account.method,
        "seed": account.seed,
        "scenes": account.scenes,
        "stages": [{"what": what, "count": count} for what, count in account.stages],
        "budget_s": account.budget_s,
        "ended_by": account.stopped,
        "value": account.value,
        "bettered": [list(step) for step in account.bettered],
        "rules": [{"rule": rule, "asked": asked} for rule, asked in account.asked.items()],
        "priced_among": account.priced_among,
        "annealed_without_db": None if account.without is None else dict(account.without[0]),
    }


def _panel(design: Designed, account: Account) -> dict[str, Any]:
    """The middle of the panel, its rows from the top."""
    designed, unit = design.designed, design.opening.mask
    units = [unit] if design.outer is None else [unit, design.outer.mask]
    if designed is None:
        kinds = orientations(account.tiling, _SHOWN_CELLS, _SHOWN_CELLS, account.tiling_seed)
    else:
        first = max(0, (len(designed.orientations) - _SHOWN_CELLS) // 2)
        kinds = designed.orientations[first : first + _SHOWN_CELLS, first : first + _SHOWN_CELLS]
        units = [shifted(unit, shift) for shift in designed.shifts] if designed.shifts else units
    return {
        "tiling": account.tiling.value,
        "tiling_seed": account.tiling_seed,
        "rows": drawn_rows(laid_picture(np.stack(units), kinds)),
    }


def _absent(designed: Designed) -> str | None:
    """Why there are no alternatives; None where there are some, or were looked for."""
    if designed.alternatives is not None:
        return None
    if designed.outer is not None:
        return "A panel of two openings is judged as a whole, and no other one was."
    if designed.account is None or designed.prices is None:
        return "No other opening was judged in decibels."
    return "The budget is shorter than what they take."
