"""The files of a rendering: emitted light, the image that the eye sees, a comparison, and the results."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from maskfab import provenance
from maskfab.base import __version__
from maskfab.export.images.light_image import write_exr, write_png
from maskfab.eye.display_light import show
from maskfab.eye.side_by_side import SeenPanel
from maskfab.files.staging import check_target, staged
from maskfab.progress import Progress, silent
from maskfab.report.plots.render_figure import comparison
from maskfab.report.quantity_table import quantity_document
from maskfab.units import UM_PER_MM, dpi

SCHEMA_VERSION = 1
DOCUMENT, FIGURE = "render.json", "render.png"


def render_document(
    panels: Sequence[SeenPanel], samples: int, job_hash: str, unused: Sequence[str] = ()
) -> dict[str, Any]:
    """Everything that was measured, and what of the job was not used; what render.json and ``--json`` say."""
    viewing = panels[0].viewing
    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": job_hash,
        "viewing": {"distance_mm": viewing.distance_um / UM_PER_MM, "samples_per_pixel": samples},
        "dies": [
            {
                "name": each.name,
                "pitch_um": each.viewing.pitch_um,
                "dpi": dpi(each.viewing.pitch_um),
                "quantities": [quantity_document(quantity) for quantity in each.quantities],
            }
            for each in panels
        ],
        "unused": list(unused),
    }


def write_rendering(
    target: Path,
    panels: Sequence[SeenPanel],
    samples: int,
    job_hash: str,
    progress: Progress = silent,
    unused: Sequence[str] = (),
) -> list[Path]:
    """Write everything into a new directory, and return the paths.

    For each die and picture: ``DIE_PICTURE.exr`` and ``.png`` are the emitted light, ``samples`` along a pixel (the PNG
    as bright as its brightest sample allows), ``DIE_PICTURE_seen.png`` what the eye takes in.

    Raises:
        OutputError: MF401, MF402 if the directory cannot be written or is not empty.
    """
    total = sum(len(each.images) for each in panels)
    with staged(check_target(target, force=False)) as folder:
        done = 0
        for each in panels:
            for title, image in each.images.items():
                progress("files", done, total)
                light = show(each.panel, image, samples).rgb
                facts: dict[str, str | float] = {
                    "die": each.name,
                    "picture": title,
                    "pitch_um": each.viewing.pitch_um,
                    "dpi": dpi(each.viewing.pitch_um),
                    "distance_mm": each.viewing.distance_um / UM_PER_MM,
                    "samples_per_pixel": float(samples),
                    "job": job_hash,
                    "software": f"maskfab {__version__}",
                }
                stem = f"{each.name}_{title}"
                write_exr(light, folder / f"{stem}.exr", facts)
                write_png(light, folder / f"{stem}.png", white=max(float(light.max()), 1e-12))
                write_png(each.views[title].seen.astype(np.float64), folder / f"{stem}_seen.png")
                done += 1
        progress("files", total, total)
        (folder / FIGURE).write_bytes(comparison(panels))
        files = [
            {"path": path.name, "bytes": path.stat().st_size, "sha256": provenance.sha256_of_file(path)}
            for path in sorted(folder.iterdir())
        ]
        told = {**render_document(panels, samples, job_hash, unused), "files": files}
        text = json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False)
        (folder / DOCUMENT).write_text(text + "\n", encoding="utf-8")
    return sorted(target.iterdir())
