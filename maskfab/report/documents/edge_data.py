"""Measured edges as JSON: every curve with its band, what was designed beside it, and the numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.capture.designed_edge import DesignedMtf
from maskfab.capture.edge import EdgeMtf
from maskfab.capture.edge_verdict import edge_verdict
from maskfab.capture.measured_edges import MeasuredEdge, MeasuredEdges
from maskfab.capture.mtf_file import MtfCurve
from maskfab.report.documents.schema_terms import Document
from maskfab.report.measured_files import SCHEMA_VERSION
from maskfab.report.quantity_table import quantity_document


def edge_document(found: MeasuredEdges, name: str, digest: str, job_hash: str | None, notes: Sequence[str]) -> Document:
    """Everything that was measured; what measure.json and ``--json`` say.

    Args:
        found: the edges, or the curve.
        name: of the file that they were read from.
        digest: SHA-256 of that file.
        job_hash: of the job; None without one.
        notes: what a reader should know, as sentences.
    """
    return {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "job_hash": job_hash,
        "verdict": list(edge_verdict(found)),
        "file": {"name": name, "sha256": digest},
        **edges_document(found),
        "notes": list(notes),
    }


def edges_document(found: MeasuredEdges) -> Document:
    """Of plain Python types; a unit stands in every name, rows count from the picture's top.

    What only a picture tells is None of a curve that was measured elsewhere, and cycles per millimetre are where the
    pixel is not known.
    """
    return {"die": found.die, "edges": [_edge(each) for each in found.edges], "left_out": list(found.left_out)}


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
        "designed": [_designed(each) for each in measured.designed],
        "quantities": [quantity_document(each) for each in measured.quantities],
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
