"""Measurement of a made plate: the folder with its page and numbers, and its place in a report beside the job.

A measure.json that lies beside a job is a file from outside. What does not read as a measurement is refused before any
work; one of an edge, or of another job, is left out, the latter with a note.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from maskfab.base import __version__
from maskfab.base.errors import SourceError
from maskfab.base.folders import Place, staged, write_mark
from maskfab.base.model import Quantity
from maskfab.camera.inspection.edge_mtf import DesignedMtf, MeasuredEdge, MeasuredEdges, MtfCurve, edge_verdict
from maskfab.camera.inspection.slanted_edge import EdgeMtf
from maskfab.mask.job import Job
from maskfab.report.documents.shape import Document, Part, document_text
from maskfab.report.rows.text import quantity_document

SCHEMA_VERSION = 1
DOCUMENT, PAGE = "measure.json", "measure.html"


def write_measured(
    place: Place, document: Mapping[str, Any], page: str, more: Callable[[Path], None] | None = None
) -> list[Path]:
    """Write everything into a directory that appears whole, and return the paths.

    Args:
        place: where.
        document: what measure.json says; its ``job_hash`` is None without a job.
        page: HTML.
        more: writes other files into the folder that it is given.

    Raises:
        OutputError: MF401 or MF404 as :func:`maskfab.base.folders.staged`.
    """
    with staged(place) as folder:
        (folder / PAGE).write_text(page, encoding="utf-8")
        (folder / DOCUMENT).write_text(document_text(document), encoding="utf-8")
        if more is not None:
            more(folder)
        write_mark(folder, document["job_hash"])
    return sorted(place.asked.iterdir())


_MOST_BYTES = 50_000_000
_CURVES = ("captured", "expected", "low", "high")
_OF_A_DIE = "hypotheses"
"""Key that measurements of a die have, and those of an edge do not."""


class _MtfRow(Part):
    colour: str
    frequency_cy_per_mm: float
    captured: float
    expected: float
    low: float
    high: float


class MeasuredPart(Part):
    """The measurement of a die in report.json."""

    verdict: list[str]
    mtf: list[_MtfRow]


class _Curve(Part):
    minimum: list[float]


class _Band(Part):
    colour: Annotated[str, Field(max_length=40)]
    frequency_per_mm: Annotated[list[float], Field(min_length=2)]
    captured: _Curve
    expected: _Curve
    low: _Curve
    high: _Curve

    @model_validator(mode="after")
    def _of_one_length(self) -> _Band:
        rings = self.frequency_per_mm
        if any(len(getattr(self, name).minimum) != len(rings) for name in _CURVES) or np.any(np.diff(rings) <= 0):
            raise ValueError("curves and their rising frequencies differ in number")
        return self


class _Measured(Part):
    job_hash: str
    die: str | None
    verdict: list[Annotated[str, Field(max_length=2000)]]
    mtf: list[_Band]


@dataclass(frozen=True)
class Beside:
    """The measurement that lies beside a job.

    Attributes:
        content: of its file.
        job_hash: of the job that it was made for.
        die: that it is of; None if that could not be told.
        verdict: sentences on it.
        rows: by colour and frequency, the MTF in its worst direction as captured and as expected.
    """

    content: bytes
    job_hash: str
    die: str | None
    verdict: tuple[str, ...]
    rows: tuple[Document, ...]

    def of_die(self, name: str, digest: str) -> Document | None:
        """Part of the report of a die; None of any but the one that was measured, and of another job."""
        if name != self.die or digest != self.job_hash:
            return None
        return MeasuredPart.document(self, verdict=list(self.verdict), mtf=list(self.rows))

    def note(self, digest: str) -> tuple[Quantity, ...]:
        """Why it is left out, where it is."""
        if digest == self.job_hash and self.die is not None:
            return ()
        why = "it is of another job" if digest != self.job_hash else "it could not tell which die it is of"
        return (Quantity("measurement_left_out", why, f"{DOCUMENT} beside the job is not shown with a die"),)


def measured_beside(job: Job) -> Beside | None:
    """The measurement of a die beside the job's file; None if there is none.

    Raises:
        SourceError: MF303 for a file of that name that is damaged, or larger than 50 MB.
    """
    path = Path(job.where).parent / DOCUMENT
    if not (Path(job.where).is_file() and path.is_file()):
        return None
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f"it is larger than {_MOST_BYTES / 1e6:g} MB")
        content = path.read_bytes()
        document = json.loads(content)
        if not isinstance(document, dict):
            raise TypeError("it is no table")
        if _OF_A_DIE not in document:
            return None
        measured = _Measured.model_validate(document)
    except (OSError, ValueError, TypeError, RecursionError) as error:
        reason = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
        what = f"{path} cannot be read as a measurement: {reason[:200]}"
        cure = "Measure the plate again with maskfab measure, or move the file out of the job's folder"
        raise SourceError("MF303", what, where=str(path), cure=cure) from error
    rows = [row for band in measured.mtf for row in _rows(band, job.spec.frequencies_cy_per_mm)]
    return Beside(content, measured.job_hash, measured.die, tuple(measured.verdict), tuple(rows))


def _rows(band: _Band, frequencies_cy_per_mm: tuple[float, ...]) -> list[Document]:
    rings = band.frequency_per_mm
    return [
        {
            "colour": band.colour,
            "frequency_cy_per_mm": frequency,
            **{name: float(np.interp(frequency, rings, getattr(band, name).minimum)) for name in _CURVES},
        }
        for frequency in frequencies_cy_per_mm
        if rings[0] <= frequency <= rings[-1]
    ]


def edge_document(
    measured: MeasuredEdges, name: str, digest: str, job_hash: str | None, notes: Sequence[str]
) -> Document:
    """Everything that was measured; what measure.json and ``--json`` say.

    Args:
        measured: the edges, or the curve.
        name: of the file that they were read from.
        digest: SHA-256 of that file.
        job_hash: of the job; None without one.
        notes: what a reader should know, as sentences.
    """
    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": job_hash,
        "verdict": list(edge_verdict(measured)),
        "file": {"name": name, "sha256": digest},
        **edges_document(measured),
        "notes": list(notes),
    }


def edges_document(measured: MeasuredEdges) -> Document:
    """Of plain Python types; a unit stands in every name, rows count from the picture's top.

    What only a picture tells is None of a curve that was measured elsewhere, and cycles per millimetre are where the
    pixel is not known.
    """
    return {"die": measured.die, "edges": [_edge(edge) for edge in measured.edges], "left_out": list(measured.left_out)}


def _edge(measured: MeasuredEdge) -> Document:
    edge = measured.edge
    seen = edge if isinstance(edge, EdgeMtf) else None
    return {
        "title": measured.title,
        "colour": measured.colour,
        "direction": seen and seen.direction,
        "angle_deg": seen and seen.angle_deg,
        "normal_deg": edge.normal_deg,
        "region_px": seen and asdict(seen.region),
        "lines": seen and seen.lines,
        "order": seen and seen.order,
        "window_px": seen and 2 * seen.half_px,
        "pixel_um": edge.pixel_um,
        "method": f"read from {edge.name}" if isinstance(edge, MtfCurve) else edge.method,
        "frequency_cy_per_px": edge.frequency_cy_per_px.tolist(),
        "frequency_cy_per_mm": _list(edge.frequency_cy_per_mm),
        "mtf": edge.mtf.tolist(),
        "low": _list(edge.low),
        "high": _list(edge.high),
        "designed": [_designed(designed) for designed in measured.designed],
        "quantities": [quantity_document(quantity) for quantity in measured.quantities],
    }


def _list(values: NDArray[np.float64] | None) -> list[float] | None:
    return None if values is None else values.tolist()


def _designed(designed: DesignedMtf) -> Document:
    return {
        "light": designed.light,
        "wavelength_nm": designed.wavelength_nm,
        "mtf": designed.mtf.tolist(),
        "seen": designed.seen.tolist(),
        "uncertainty": designed.uncertainty,
        "method": designed.method,
    }
