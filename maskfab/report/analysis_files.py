"""The files of one analysis: PSFs as EXR, a picture, and the numbers."""

from __future__ import annotations

from pathlib import Path

from maskfab.base import __version__
from maskfab.export.images.exr import Facts
from maskfab.export.images.psf_exr import psf_facts, write_psf
from maskfab.files.staging import check_target, staged
from maskfab.measurement.analysis import Analysis
from maskfab.report.plots import die_figures, scene_figures


def write_analysis(analysis: Analysis, target: Path, facts: Facts) -> list[Path]:
    """Write everything into a new directory, and return the paths; ``facts`` go into the headers of PSFs."""
    signature = f"maskfab {__version__} | {analysis.name}"
    with staged(check_target(target, force=False)) as folder:
        for psf in analysis.psfs:
            name = f"psf_{psf.kind}_{psf.wavelength_nm:.12g}nm.exr"
            write_psf(psf, folder / name, {**psf_facts(psf), **facts}, signature)
        for name, picture in _scene_pictures(analysis).items():
            (folder / f"{name}.png").write_bytes(picture)
        (folder / "optics.png").write_bytes(die_figures.optics(analysis.psfs, analysis.mtfs, analysis.name))
    return sorted(target.iterdir())


def _scene_pictures(analysis: Analysis) -> dict[str, bytes]:
    return {} if analysis.scene is None else scene_figures.bitmaps(analysis.scene)
