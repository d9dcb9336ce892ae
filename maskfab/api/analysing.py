"""The optics of one opening or of any mask file, as written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from maskfab.api.asked import AnyPanel, AnyPath, panels_of
from maskfab.api.camera import Camera, protocol_f1
from maskfab.api.lengths import Length, drawing_unit_um, length_text, lengths_as_text
from maskfab.api.opening import mask_of
from maskfab.api.panel import Panel
from maskfab.api.results import Asked, InPython, Result, Told, answers
from maskfab.base import __version__
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.folders import check_target
from maskfab.base.model import Opening, Quantity, Tiling
from maskfab.base.provenance import sha256_of_file
from maskfab.base.units import parse_length_um, parse_pitch_um
from maskfab.base.work import Progress, silent
from maskfab.findings import analysis
from maskfab.findings.analysis import Request, described_scene
from maskfab.job.camera import Camera as Lens
from maskfab.job.faults import parse_section
from maskfab.job.process import MaskBlank
from maskfab.job.sections import SceneSection
from maskfab.mask.opening_file import checked
from maskfab.optics.metrics import fast_lens
from maskfab.optics.scene.model_bar import MODEL_BAR
from maskfab.report.text import Quantities, note_lines, table_lines


class Analysis(Result, analysis.Analysis):
    """PSF, MTF and invariants of one opening or file; ``analysis["mtf50", 530]`` is a number."""

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return self.numbers.passed

    @property
    def numbers(self) -> Quantities:
        """Every number; those of a scene last."""
        return Quantities(self.quantities)

    def __getitem__(self, key: str | tuple[str, float]) -> Quantity:
        return self.numbers[key]

    def to_dict(self) -> dict[str, Any]:
        """Name and numbers."""
        return {"name": self.name, "quantities": self.numbers.to_dict()}

    def picture(self) -> bytes:
        """A PNG: a PSF over an MTF for each wavelength."""
        from maskfab.report.figures.die import optics

        return optics(self.psfs, self.mtfs, self.name)

    def save(
        self, out: Annotated[str | Path, "FOLDER"], facts: InPython[Mapping[str, Any] | None] = None
    ) -> list[Path]:
        """Write the PSFs, as EXR and PNG, into a new directory.

        Args:
            out: new folder for the PSFs, as EXR and PNG.
            facts: for the headers of the pictures.
        """
        from maskfab.report.pages.pictures import write_analysis

        return write_analysis(self, Path(out), dict(facts or {}))

    def __str__(self) -> str:
        return str(self.numbers)

    def _repr_png_(self) -> bytes:
        return self.picture()


@checked_arguments
def analyse(
    subject: Annotated[AnyPanel | ArrayLike | AnyPath, "FILE"],
    camera: Annotated[Camera | Mapping[str, Any] | None, "--camera TABLE"] = None,
    *,
    pitch: Length | None = None,
    dot: Length | None = None,
    gutter: Length = 0.0,
    tiling: str | None = None,
    seed: int | None = None,
    layer: str | None = None,
    cell: str | None = None,
    unit_um: Annotated[str | float | None, "--unit nm|um|mm|mil|in"] = None,
    scene: Annotated[Mapping[str, Any] | None, "TABLE"] = None,
    plate: Annotated[Mapping[str, Any] | None, "TABLE"] = None,
    progress: Progress = silent,
) -> Analysis:
    """Compute PSF, MTF and invariants of an opening or a mask file, from polygons that were written and read back.

    Camera, scene and plate are tables as a job file has them; keys that are left out are those of protocol F1.

    Examples:
        $ maskfab analyse layouts/openings/toled.toml --tiling random --seed 1
        $ maskfab analyse plate.gds --cell TOLED_P150 --json
        $ maskfab analyse photo.png --pitch '168 um'
        $ maskfab analyse bar.toml --camera '{ stop = { diameter = "1 mm" } }' --scene '{ gap = "0.5 mm" }'

    Args:
        subject: an opening (.toml .txt .csv .png .tif .exr .npy) or a mask (.gds .oas .dxf). In Python also an Opening,
            a Panel, or an array of an opening with its pitch.
        camera: table of the camera that looks through it, such as ``{ focal = "5 mm", stop = { diameter = "3 mm" } }``;
            by default that of protocol F1.
        pitch: side of a cell, such as ``"168 um"`` or ``"150 dpi"``, where the file does not state it.
        dot: side of a dot, such as ``"8 um"``, likewise.
        gutter: opaque border around each cell.
        tiling: layout of cells: periodic, random or paper4; of a mask file: tile its one opening.
        seed: seed of a random tiling.
        layer: layer of a mask file, such as 1/0 or CLEAR.
        cell: cell of a mask file; by default its only top cell.
        unit_um: drawing unit of a DXF, by its name or in micrometres; overrides the one in the file.
        scene: table as [scene] of a job, such as ``{ gap = "0.5 mm", field = "1 mm", aberrations = [[4, 0.05]] }``.
        plate: chrome and glass as in [plate] of a job, such as ``{ optical_density = 4, glass = { index = 1.46 } }``.
        progress: told where the work stands.

    Raises:
        SourceError, OpeningError, JobError: if the subject or what is asked is at fault.
    """
    if tiling is not None and tiling not in set(Tiling):
        raise JobError("MF105", f"there is no tiling {tiling!r}", where="tiling", cure=f"Use {', '.join(Tiling)}")
    lens = _camera(camera)
    section = parse_section(SceneSection, lengths_as_text(scene or {}, SceneSection), where="scene")
    request = Request(
        camera=lens.model,
        pitch_um=None if pitch is None else parse_pitch_um(length_text(pitch, "pitch"), where="pitch"),
        dot_um=None if dot is None else parse_length_um(length_text(dot, "dot"), where="dot"),
        gutter_um=parse_length_um(length_text(gutter), where="gutter", zero_allowed=True),
        tiling=None if tiling is None else Tiling(tiling),
        seed=seed,
        layer=layer,
        cell=cell,
        unit_um=drawing_unit_um(unit_um),
        scene=described_scene(section, lens.model, "scene") if scene else None,
        accuracy=section.accuracy,
        blank=parse_section(MaskBlank, dict(plate or {}), where="plate"),
    )
    if isinstance(subject, str | PathLike):
        return Analysis(**vars(analysis.analyse(Path(subject), request, progress)))
    if isinstance(subject, Opening):
        return Analysis(**vars(analysis.analyse_opening(subject, request, progress)))
    if isinstance(subject, np.ndarray) or (isinstance(subject, Sequence) and not any(map(_lays_out, subject))):
        where = "analyse: subject"
        drawn = analysis.sized(checked("opening", mask_of(subject, where), 1, {}, where), request)
        return Analysis(**vars(analysis.analyse_opening(drawn, request, progress)))
    if not _lays_out(subject):
        what = f"{type(subject).__name__} is no opening and no panel"
        cure = "Give a file, an Opening, a Panel, or an array with its pitch; compare takes several"
        raise JobError("MF105", what, where="analyse: subject", cure=cure)
    stated = {"pitch": pitch, "dot": dot, "tiling": tiling, "seed": seed, "layer": layer, "cell": cell}
    for name, value in {**stated, "unit_um": unit_um, "gutter": gutter or None}.items():
        if value is not None:
            what = f"{name} is not of a panel, which has its own"
            raise JobError("MF105", what, where=name, cure=f"Leave {name} out, or give the opening: panel.held[0]")
    (panel,) = panels_of(subject).values()
    return Analysis(**vars(analysis.analyse_panel(panel, panel.held[0].name, request, progress)))


def _lays_out(subject: object) -> bool:
    return isinstance(subject, Panel) or hasattr(subject, "panel")


def _camera(stated: Camera | Mapping[str, Any] | None) -> Camera:
    """The camera that is stated; keys that a table leaves out are those of protocol F1."""
    if isinstance(stated, Camera):
        return stated
    given = protocol_f1().section.model_dump(mode="json", exclude_none=True) | lengths_as_text(stated or {}, Lens)
    stop = given["stop"]
    given["stop"] = stop if isinstance(stop, Mapping) else {"diameter": stop}
    return Camera.of_section(parse_section(Lens, given, where="camera"))


@answers(analyse)
def _analyse(asked: Asked) -> Told:
    """Numbers, then what is not modelled; PSFs name the file and its camera."""
    if asked.out is not None:
        check_target(asked.out, force=False)
    lens, file = _camera(asked.stated.get("camera")).model, Path(asked.stated["subject"])
    answer: Analysis = asked.found()
    paths: list[Path] = []
    if asked.out is not None:
        from maskfab.mask.formats.exr import camera_header

        keys = ("pitch", "dot", "gutter", "tiling", "layer", "cell", "seed")
        stated = {"gutter": "0 um"} | asked.stated
        laid_out = {key: str(stated[key]) for key in keys if key in stated}
        source = {"source": file.name, "source_sha256": sha256_of_file(file), "maskfab_version": __version__}
        paths = answer.save(asked.out, {**camera_header(lens), **source, **laid_out})
    numbers = [row for row in answer.quantities if not row.name.startswith(MODEL_BAR)]
    left_out = [row for row in answer.quantities if row.name.startswith(MODEL_BAR)]
    lines = [*table_lines(numbers), *_methods(sorted(left_out, key=lambda row: -float(row.value or 0)))]
    return Told(answer.to_dict(), [*lines, *map(str, paths)], answer.passed, remarks=note_lines(fast_lens(lens)))


def _methods(left_out: Sequence[Quantity]) -> list[str]:
    """A title, and one line for each effect that is not modelled: name, size, how it was found."""
    rows = [(q.name, f"{q.value:.2g}" if isinstance(q.value, float) else str(q.value), q.method) for q in left_out]
    widths = [max((len(row[k]) for row in rows), default=0) for k in (0, 1)]
    title = ["not modelled, by size:"] if rows else []
    return [*title, *(f"{name.ljust(widths[0])}  {size.rjust(widths[1])}  {method}" for name, size, method in rows)]
