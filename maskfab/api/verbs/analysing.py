"""The optics of one opening or of any mask file, as written."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maskfab.api.camera import F1, Camera
from maskfab.api.lengths import Length, length_text, lengths_as_text
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.model import Opening, Quantity, Tiling
from maskfab.base.units import parse_length_um, parse_pitch_um
from maskfab.base.work import Progress, silent
from maskfab.job.read import parse_section
from maskfab.job.sections import BlankSection, SceneSection
from maskfab.report.rows import analysis
from maskfab.report.rows.analysis import Request, described_scene
from maskfab.report.rows.text import Quantities

if TYPE_CHECKING:
    from pandas import DataFrame


class Analysis(analysis.Analysis):
    """PSF, MTF and invariants of one opening or file; ``analysis["mtf50", 530]`` is a number."""

    @property
    def numbers(self) -> Quantities:
        """Every number; those of a scene last."""
        return Quantities(self.quantities)

    def __getitem__(self, key: str | tuple[str, float]) -> Quantity:
        return self.numbers[key]

    def to_dict(self) -> dict[str, Any]:
        """Name and numbers."""
        return {"name": self.name, "quantities": self.numbers.to_dict()}

    def to_dataframe(self) -> DataFrame:
        """One row for each number; MF431 without pandas."""
        return self.numbers.to_dataframe()

    def picture(self) -> bytes:
        """A PNG: a PSF over an MTF for each wavelength."""
        from maskfab.report.figures.die import optics

        return optics(self.psfs, self.mtfs, self.name)

    def __str__(self) -> str:
        return str(self.numbers)

    def _repr_html_(self) -> str:
        return self.numbers._repr_html_()

    def _repr_png_(self) -> bytes:
        return self.picture()


@checked_arguments
def analyse(
    subject: Opening | str | Path,
    camera: Camera | None = None,
    *,
    pitch: Length | None = None,
    dot: Length | None = None,
    gutter: Length = 0.0,
    tiling: str | None = None,
    seed: int | None = None,
    layer: str | None = None,
    cell: str | None = None,
    unit_um: float | None = None,
    scene: Mapping[str, Any] | None = None,
    plate: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> Analysis:
    """Compute PSF, MTF and invariants of an opening or a mask file, from polygons that were written and read back.

    Args:
        subject: an opening, or the path of one or of a mask file.
        camera: that looks through it; by default that of protocol F1.
        pitch: side of the cell, where the subject does not state it.
        dot: side of a dot, likewise.
        gutter: opaque space round every cell.
        tiling: how an opening is laid out over the stop; for a layout, that it holds one opening.
        seed: of a random tiling.
        layer, cell: of a layout.
        unit_um: micrometres of a DXF's unit.
        scene: [scene] of a job file, such as ``{"gap": "0.5 mm"}``.
        plate: chrome and glass as in [plate] of a job file, such as ``{"optical_density": 4}``.
        progress: told where the work stands.

    Raises:
        SourceError, OpeningError, JobError: if the subject or what is asked is at fault.
    """
    if tiling is not None and tiling not in set(Tiling):
        raise JobError("MF105", f"there is no tiling {tiling!r}", where="tiling", cure=f"Use {', '.join(Tiling)}")
    section = parse_section(SceneSection, lengths_as_text(scene or {}, SceneSection), where="scene")
    request = Request(
        camera=(camera or F1).model,
        pitch_um=None if pitch is None else parse_pitch_um(length_text(pitch), where="pitch"),
        dot_um=None if dot is None else parse_length_um(length_text(dot), where="dot"),
        gutter_um=parse_length_um(length_text(gutter), where="gutter", zero_allowed=True),
        tiling=None if tiling is None else Tiling(tiling),
        seed=seed,
        layer=layer,
        cell=cell,
        unit_um=unit_um,
        scene=described_scene(section, "scene") if scene else None,
        accuracy=section.accuracy,
        blank=parse_section(BlankSection, dict(plate or {}), where="plate").mask_blank(),
    )
    if isinstance(subject, Opening):
        found = analysis.analyse_opening(subject, request, progress)
    else:
        found = analysis.analyse(subject, request, progress)
    return Analysis(**vars(found))
