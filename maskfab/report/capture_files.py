"""The files of a measured die: its page, its numbers, and the merged capture with its standard deviation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from maskfab.base import __version__
from maskfab.capture.files import write_merged
from maskfab.capture.fitted_psf import write_fitted_psf
from maskfab.capture.identify import CERTAIN
from maskfab.capture.measured import Measured
from maskfab.capture.verdict import stands
from maskfab.files.staging import Place
from maskfab.report.measured_files import SCHEMA_VERSION, write_measured
from maskfab.report.page.capture_page import capture_page
from maskfab.report.quantity_table import Quantities

LIGHT, SIGMA, FITTED = "captured.exr", "captured_sigma.exr", "fitted_psf.exr"
_SHOWN = 12


def capture_document(found: Measured, job_hash: str, notes: Sequence[str]) -> dict[str, Any]:
    """Everything that was measured; what measure.json and ``--json`` say."""
    best, fit = found.identified.best, found.fit
    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": job_hash,
        "verdict": list(found.verdict),
        "die": best.die if found.identified.certain else None,
        "stands": stands(best) if found.identified.certain else None,
        "turn_the_plate_over": found.mirrored if found.identified.certain else None,
        "quantities": Quantities(found.quantities).to_dict(),
        "light": {
            colour: {"electrons_per_s": value, "beneath_electrons_per_s": fit.beneath[colour]}
            for colour, value in fit.light.items()
        },
        "steps": fit.steps,
        "hypotheses": {
            "certain": CERTAIN,
            "others": [
                {"die": each.die, "stands": stands(each), "chi2_above": margin}
                for each, margin in found.identified.ahead[:_SHOWN]
            ],
        },
        "mtf": [
            {
                "colour": band.colour,
                "frequency_per_mm": band.frequencies.tolist(),
                "parted_per_mm": band.parted_per_mm,
                **{
                    name: {"mean": values[0].tolist(), "minimum": values[1].tolist()}
                    for name, values in (
                        ("captured", band.measured),
                        ("expected", band.expected),
                        ("low", band.low),
                        ("high", band.high),
                    )
                },
            }
            for band in found.bands
        ],
        "frames": [
            {
                "name": each.name,
                "sha256": each.sha256,
                "exposure_s": each.exposure_s,
                "drift": each.drift.taken_out,
                "full": each.full,
            }
            for each in found.merged.used
        ],
        "pixels_left_out": {name: len(getattr(found.merged, name)) for name in ("hot", "disagreeing", "full", "dust")},
        "notes": list(notes),
    }


def write_capture(place: Place, found: Measured, document: Mapping[str, Any], notes: Sequence[str]) -> list[Path]:
    """Write everything into a directory that appears whole, and return the paths.

    Raises:
        OutputError: MF401 or MF404 as :func:`maskfab.files.staging.staged`.
    """

    def write_light(folder: Path) -> None:
        write_merged(found.merged, folder / LIGHT, folder / SIGMA)
        write_fitted_psf(found, folder / FITTED)

    return write_measured(place, document, capture_page(found, document, notes), write_light)
