"""report.json, the machine's twin of the report: its types, how a run's is made, how finished ones are read back.

The page that a person reads is rendered from this document alone. A file that is read back is one from outside: what
was edited is refused before any work.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import Field, ValidationError, model_validator

from maskfab.base import __version__, provenance
from maskfab.base.errors import InternalError, JobError, OutputError
from maskfab.base.folders import JOB_COPY, REPORT, TIMES, read_manifest
from maskfab.base.model import Die, Plate, Quantity, Report, Tiling
from maskfab.base.units import NM_PER_UM
from maskfab.display.emitter_rules import Verdict
from maskfab.display.feasibility import Feasibility
from maskfab.findings.bands import ProcessSpread
from maskfab.findings.scene import PointView, SceneOptics
from maskfab.job.camera import Camera, StopShape
from maskfab.job.process import Process
from maskfab.mask.formats.exr import stop_facts
from maskfab.optics.scene.plan import AT_MOST, plan_document
from maskfab.report.documents.die import DesignPart, MeasuredPart, PhotographsPart
from maskfab.report.documents.display import DisplayPart, display_document
from maskfab.report.documents.shape import (
    DieName,
    Document,
    OneOf,
    Pair,
    Part,
    QuantityPart,
    Text,
    WholePair,
    document_text,
    optional,
    titled_schema,
    written,
)
from maskfab.report.text import quantity_document
from maskfab.report.verdicts import BROKEN, KEPT, Verdicts

SCHEMA_VERSION = 6
_READ = (5, SCHEMA_VERSION)
"""Schemas that are read back; of the first, displays have no limits of the eye and of life."""

NO_DISPLAYS: Mapping[str, Feasibility] = MappingProxyType({})
NO_DESIGNS: Mapping[str, Document] = MappingProxyType({})
NO_SPREAD = ProcessSpread()

_DISTANCE = "from the lens; null is infinity"


class _Stop(Part):
    shape: Annotated[str, OneOf(get_args(StopShape))] = written()
    diameter_um: float = written("side of the square about the axis that holds it")
    stop_width_um: float = optional()
    stop_height_um: float = optional()
    stop_inner_um: float = optional()
    stop_corners_um: str = optional("x and y of every corner")


class _Camera(Part):
    focal_um: float = written()
    stop: _Stop = written()
    wavelengths_nm: Annotated[list[float], Field(min_length=1)]
    pixel_um: float = written()
    window_um: float = written()


class _Tally(Part):
    checks: int
    failed: int
    passed: bool | None


class _Displays(Part):
    dies: int
    fits: int
    does_not_fit: int
    unknown: int
    verdict: Annotated[str | None, OneOf((*(verdict.value for verdict in Verdict), None))]
    circuits: str = optional()


class _Limits(Part):
    dies: int
    kept: int
    broken: int
    verdict: Annotated[str | None, OneOf((KEPT, BROKEN, None))]
    stated: bool = Field(description="whether the job states any of the limits, which are else defaults")


class _Verdicts(Part):
    files: _Tally = Field(description="null: nothing was checked")
    optics: _Tally = Field(description="null: nothing was checked")
    display: _Displays = Field(description="the worst answer of all dies; null: the job asks for no display")
    looks: _Limits = written("limits of the eye; null: there is no display to look at")
    lives: _Limits = written("limits of life and power; null: there is no reference display")


class _Roughness(Part):
    sigma_um: float
    correlation_um: float


class _Process(Part):
    corner_radius_um: float
    cd_bias_um: float
    roughness: _Roughness | None


class _Spread(Part):
    bias_um: float
    radius_um: float


class _Band(Part):
    name: str
    low_nm: float
    high_nm: float


class _Distortion(Part):
    ratio: float
    height_um: float


class _Asked(Part):
    accuracy: float
    nearest_um: float | None = written(_DISTANCE)
    farthest_um: float | None = written(_DISTANCE)
    focus_um: float | None = written(_DISTANCE)
    field_um: float
    gap_um: float
    aberrations: list[Pair]
    distortion: _Distortion = optional()
    projection: str = optional()
    tilt_deg: float = optional()
    saturation: bool
    bands: list[_Band]


class _Ingredient(Part):
    name: str
    modelled: bool
    error_if_left_out: float
    counted: float
    method: str
    safety: float


class _Plan(Part):
    path: str
    precision: str
    grey_rim: bool
    step_um: float
    samples: int
    pixel_margin: int
    wavelengths: int
    depths: int
    places: int
    phase_tolerance: float
    samples_per_dot: int
    predicted_flops: float
    predicted_seconds: float
    predicted_bytes: float
    error: float
    errors: Annotated[str, OneOf((AT_MOST,))] = written("what `error` and those of `ingredients` are")
    nearest_object_um: float | None = written(_DISTANCE)
    ingredients: list[_Ingredient]


class _View(Part):
    image_um: Pair
    object_um: float | None = written(_DISTANCE)
    wavelength_nm: float
    change: float
    residual: float
    angle_deg: float
    illumination: float
    mtf_tangential: float
    mtf_sagittal: float
    restored_loss_db: float


class _Scene(Part):
    asked: _Asked
    plan: _Plan
    field: list[list[_View]]
    depth: list[_View]
    quantities: list[QuantityPart]


class _Seconds(Part):
    """Models whose time is told with a die; that of its scene is told with the scene's plan."""

    optics: float = optional()
    written: float = optional()
    photographs: float = optional()


class _Die(Part):
    name: DieName
    label: str = written()
    opening: str = written()
    dot_um: float = written()
    pitch_um: float = written()
    dpi: float = written()
    gutter_um: float = written()
    tiling: Annotated[str, OneOf(tuple(tiling.value for tiling in Tiling))] = written()
    seed: int | None = written()
    cells: WholePair = written("columns, rows")
    centre_um: Pair = written("x, y from the plate's centre, y upwards")
    quantities: list[QuantityPart] = Field(
        description="of the plate's own standard: on the axis, in focus at infinity, without a gap"
    )
    scene: _Scene = optional()
    display: DisplayPart = optional()
    design: DesignPart = optional()
    measured: MeasuredPart = optional(
        "MTF in its worst direction as captured, and as expected of the die as drawn with its noise"
    )
    expected_seconds: _Seconds = optional(
        "of one thread of the machine of the reference numbers, for each model of the die"
    )


class _File(Part):
    path: str
    format: str
    bytes: int
    sha256: str


class ReportPart(Part):
    """report.json."""

    schema_version: Annotated[int, OneOf((SCHEMA_VERSION,))]
    maskfab_version: Text
    title: Text
    job_hash: Text
    provenance: str = optional("file that tells which findings earlier runs had kept")
    verdict: Literal["pass", "fail"] = written("whether no check failed")
    verdicts: _Verdicts = written()
    texts: dict[str, str] = optional("of the plate's title after its maker, by their keys in [plate]")
    seeds: dict[str, int] = written()
    camera: _Camera
    process: _Process = optional("of the mask writer, as stated: numbers as written are of it, and bands about it")
    spread: _Spread = optional("standard deviations over the displays made, that bands are over")
    photographs: PhotographsPart = optional()
    dies: Annotated[list[_Die], Field(max_length=10_000)]
    plate: list[QuantityPart] = written()
    checks: list[QuantityPart] = written()
    files: list[_File] = written()

    @model_validator(mode="after")
    def _of_dies_that_there_are(self) -> ReportPart:
        names = [die.name for die in self.dies]
        if len(set(names)) < len(names):
            raise ValueError("two dies have one name")
        taken = [] if self.photographs is None else [die.name for die in self.photographs.dies]
        if set(taken) - set(names) or len(set(taken)) < len(taken):
            raise ValueError("photographs are not of the dies that there are")
        return self


def schema() -> Document:
    """The JSON Schema (draft 2020-12) of report.json."""
    return titled_schema("maskfab report", ReportPart)


def to_document(
    report: Report,
    plate: Plate,
    camera: Camera,
    scenes: Sequence[SceneOptics] = (),
    displays: Mapping[str, Feasibility] = NO_DISPLAYS,
    designs: Mapping[str, Document] = NO_DESIGNS,
    photographs: Document | None = None,
    measured: Mapping[str, Document] = NO_DESIGNS,
    expected_s: Mapping[str, Mapping[str, float]] = NO_DESIGNS,
    spread: ProcessSpread = NO_SPREAD,
    process: Process | None = None,
    reference: str | None = None,
) -> Document:
    """The report.json of one run, of plain Python types throughout.

    ``scenes``, ``displays``, ``designs`` and ``measured`` are those of dies that have one; a design is a document of
    :func:`maskfab.report.documents.die.stated_design`, ``photographs`` one of
    :func:`maskfab.report.documents.die.photographs_document`, and a measurement one of
    :meth:`maskfab.report.documents.die.Beside.of_die`. ``expected_s`` is the time that models of a die are
    expected to take, by die and model. ``process`` is that of the mask writer, as stated,
    ``spread`` what bands are over, and ``reference`` the die that others are compared with.

    Two runs of one job make equal documents; the times that they took are told beside it.
    """
    drawn, reported = [die.name for die in plate.dies], list(report.dies)
    if sorted(drawn) != sorted(reported):
        raise InternalError("MF901", f"the report has the dies {reported}, the plate {drawn}")
    of_die = {scene.die.name: scene for scene in scenes}
    document = ReportPart.document(
        report,
        schema_version=SCHEMA_VERSION,
        maskfab_version=__version__,
        # Which findings a run made itself differs between equal runs, as their times do.
        provenance=TIMES,
        verdict="pass" if report.passed else "fail",
        verdicts=Verdicts.of(report.checks, displays, len(plate.dies), reference).to_dict(),
        texts=dict(plate.texts) or None,
        seeds=dict(report.seeds),
        camera=_Camera.document(camera, stop={**_Stop.document(camera.stop), **stop_facts(camera.stop)}),
        process=None if process is None else asdict(process),
        spread=asdict(spread) if spread else None,
        photographs=photographs,
        dies=[
            _die(
                die,
                report.dies[die.name],
                scene=_scene(of_die[die.name]) if die.name in of_die else None,
                display=display_document(displays[die.name]) if die.name in displays else None,
                design=designs.get(die.name),
                measured=measured.get(die.name),
                expected_seconds=expected_s.get(die.name),
            )
            for die in plate.dies
        ],
        plate=[quantity_document(quantity) for quantity in report.plate],
        checks=[quantity_document(quantity) for quantity in report.checks],
        files=[_File.document(file) for file in report.files],
    )
    plain: Document = _plain(document, "report")
    return plain


def designed_document(
    digest: str,
    dies: Sequence[Die],
    quantities: Mapping[str, Sequence[Quantity]],
    camera: Camera,
    photographs: Document,
) -> Document:
    """Dies as designed, of which no file was written, as far as reports are compared: camera, numbers, photographs.

    Args:
        dies: alone, each about the origin.
        photographs: of :func:`maskfab.report.documents.die.photographs_document`.
    """
    plain: Document = _plain(
        {
            "schema_version": SCHEMA_VERSION,
            "maskfab_version": __version__,
            "title": "as designed",
            "job_hash": digest,
            "camera": _Camera.document(camera, stop={**_Stop.document(camera.stop), **stop_facts(camera.stop)}),
            "photographs": photographs,
            "dies": [_die(die, quantities[die.name]) for die in dies],
        },
        "report",
    )
    return plain


def report_text(document: Mapping[str, Any]) -> str:
    """The document as JSON text: equal documents give equal bytes, keys in the contract's order."""
    return document_text(_plain(document, "report"))


def _die(die: Die, quantities: Sequence[Quantity], **parts: Document | Mapping[str, float] | None) -> Document:
    panel = die.panel
    rows, columns = panel.orientations.shape
    return _Die.document(
        die,
        opening=panel.opening.name,
        dot_um=panel.dot_nm / NM_PER_UM,
        pitch_um=panel.cell_size.pitch_um,
        dpi=panel.cell_size.dpi,
        gutter_um=panel.gutter_nm / NM_PER_UM,
        tiling=panel.tiling.value,
        seed=panel.seed,
        cells=(columns, rows),
        centre_um=tuple(coordinate / NM_PER_UM for coordinate in die.centre_nm),
        quantities=[quantity_document(quantity) for quantity in quantities],
        **parts,
    )


def _scene(optics: SceneOptics) -> Document:
    scene, distortion = optics.scene, optics.scene.distortion
    asked = _Asked.document(
        scene,
        accuracy=optics.plan.accuracy,
        **{key: _distance(getattr(scene, key)) for key in ("nearest_um", "farthest_um", "focus_um")},
        distortion=None if distortion is None else asdict(distortion),
        projection=scene.projection and scene.projection.name,
        tilt_deg=math.degrees(scene.tilt_rad) or None,
        bands=[{"name": band.name, "low_nm": band.range_nm[0], "high_nm": band.range_nm[1]} for band in scene.bands],
    )
    return _Scene.document(
        asked=asked,
        plan={key: value for key, value in plan_document(optics.die.name, optics.plan).items() if key != "die"},
        field=[[_view(view) for view in row] for row in optics.field],
        depth=[_view(view) for view in optics.depth],
        quantities=[quantity_document(quantity) for quantity in optics.quantities],
    )


def _view(view: PointView) -> Document:
    return _View.document(view, object_um=_distance(view.object_um), wavelength_nm=view.psf.wavelength_nm)


def _distance(length_um: float) -> float | None:
    return None if math.isinf(length_um) else length_um


def _plain(value: Any, where: str) -> Any:
    """The value in the types JSON knows; a number it has no word for is refused with its place."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        raise InternalError("MF901", f"{where} is {value}, not a finite number")
    if isinstance(value, Mapping):
        return {str(key): _plain(item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{where}[{index}]") for index, item in enumerate(value)]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise InternalError("MF901", f"{where} is a {type(value).__name__}, which JSON has no word for")


_MOST_BYTES = 200_000_000
_AGAIN = "Name the --out of a finished maskfab run, or its report.json; of another version, run its job again"


@dataclass(frozen=True)
class FinishedReport:
    """One report, with the resolved job beside it; None for a report that stands alone."""

    name: str
    document: Mapping[str, Any]
    job: Mapping[str, Any] | None
    proved: bool


def read_reports(paths: list[Path]) -> tuple[FinishedReport, ...]:
    """Reports by their folders, or by their own paths; of equal names, each with a number.

    Raises:
        OutputError: MF403 for a place without a report, MF407 for one that was edited, is damaged, or of another
            version.
        JobError: MF105 for a report that is named twice, or is equal to another in all that it says.
    """
    reports = [_read(path) for path in paths]
    for number, report in enumerate(reports):
        earlier = next((n for n, other in enumerate(reports[:number]) if other.document == report.document), None)
        if earlier is not None:
            what = f"report {number + 1}, {report.name}, is the same as report {earlier + 1}, {reports[earlier].name}"
            cure = "Name each report once; two dies of one report are compared by naming it alone"
            raise JobError("MF105", what, where="reports", cure=cure)
    return named_apart(reports)


def named_apart(reports: Sequence[FinishedReport]) -> tuple[FinishedReport, ...]:
    """Reports of names of their own: of equal names, each gets a number."""
    names = [report.name for report in reports]
    return tuple(
        report if names.count(name) == 1 else replace(report, name=f"{name}#{names[:number].count(name) + 1}")
        for number, (name, report) in enumerate(zip(names, reports, strict=True))
    )


def _read(path: Path) -> FinishedReport:
    file = path / REPORT if os.path.isdir(path) else path
    try:
        if file.stat().st_size > _MOST_BYTES:
            raise OutputError("MF407", f"{file} is longer than {_MOST_BYTES / 1e6:g} MB", cure=_AGAIN)
        document = json.loads(file.read_bytes())
    except OSError as error:
        raise OutputError("MF403", f"{file} cannot be read: {error.strerror or error}", cure=_AGAIN) from error
    except (ValueError, RecursionError) as error:
        raise OutputError("MF407", f"{file} is truncated or damaged: {error}", cure=_AGAIN) from error
    version = document.get("schema_version") if isinstance(document, dict) else None
    if type(version) is not int or version not in _READ:
        what = f"{file} is of schema {version!r}; this version compares {' and '.join(map(str, _READ))}"
        raise OutputError("MF407", what, cure=_AGAIN)
    proved = _proved(file)
    try:
        ReportPart.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "report"
        reason = f"{place}: {first['msg']}"[:300]
        what = f"{file} is no report that can be compared: {reason}"
        raise OutputError("MF407", what, cure=_AGAIN) from error
    # A name holds nothing that moves a terminal's cursor, or that no text can hold.
    folder = file.resolve().parent.name
    name = "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in folder)
    return FinishedReport(name, document, _job(file) if proved else None, proved)


def _proved(file: Path) -> bool:
    """Whether the manifest beside a report knows its hash; False without a manifest."""
    try:
        rows = read_manifest(file.parent)["files"]
    except OutputError:
        return False
    stated = next((row["sha256"] for row in rows if row["path"] == file.name), None)
    if stated != provenance.sha256_of_file(file):
        raise OutputError("MF407", f"{file} was changed since its run finished", cure=_AGAIN)
    return True


def _job(file: Path) -> Mapping[str, Any] | None:
    try:
        job = json.loads((file.parent / JOB_COPY).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return job if isinstance(job, dict) else None
