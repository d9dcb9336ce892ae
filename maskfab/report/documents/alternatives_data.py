"""Openings of nearly the PSNR of a chosen one, as plain data for documents and pages."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.optimiser.search.alternatives import WITHIN_DB, Alternative, Alternatives


def alternatives_document(found: Alternatives) -> dict[str, Any]:
    """All that is told of them; shares of the pixel, micrometres, dB."""
    return {
        "within_db": WITHIN_DB,
        "bias_um": found.bias_um,
        "of_the_display": found.own_emitters,
        "judged_within": found.within,
        "kinds": found.kinds,
        "unlisted": found.unlisted,
        "untried": found.untried,
        "chosen": _told(found.chosen),
        "others": [
            {
                **_told(each),
                "below_db": found.chosen.value - each.value + 0.0,
                "better_at": list(each.better_at(found.chosen)),
            }
            for each in found.others
        ],
    }


def drawn_rows(unit: NDArray[np.bool_]) -> list[str]:
    """Rows of dots [rows, columns], row 0 the lowest, as text from the top: ``#`` is clear, ``.`` closed."""
    return ["".join(".#"[dot] for dot in row) for row in unit[::-1].astype(int).tolist()]


def _told(each: Alternative) -> dict[str, Any]:
    return {
        "shape": each.name,
        "rows": drawn_rows(each.unit),
        "clear_dots": int(each.unit.sum()),
        "open_ratio": each.open_ratio,
        "expected_psnr_db": each.value,
        "emitters": each.emitters,
        "rim_um": each.rim_um,
        "moved_by_bias_db": each.moved_db,
        "alike": each.alike,
    }
