"""Measured edges as JSON: every curve with its band, what was designed beside it, and the numbers."""

from __future__ import annotations

from dataclasses import asdict

from maskfab.capture.designed_edge import DesignedMtf
from maskfab.capture.measured_edges import MeasuredEdge, MeasuredEdges
from maskfab.report.documents.schema_terms import Document
from maskfab.report.quantity_table import quantity_document


def edges_document(found: MeasuredEdges) -> Document:
    """Of plain Python types; a unit stands in every name, rows count from the picture's top."""
    return {"die": found.die, "edges": [_edge(each) for each in found.edges], "left_out": list(found.left_out)}


def _edge(measured: MeasuredEdge) -> Document:
    edge = measured.edge
    return {
        "direction": edge.direction,
        "angle_deg": edge.angle_deg,
        "normal_deg": edge.normal_deg,
        "region_px": asdict(edge.region),
        "lines": edge.lines,
        "order": edge.order,
        "window_px": 2 * edge.half_px,
        "pixel_um": edge.pixel_um,
        "method": edge.method,
        "frequency_cy_per_px": edge.frequency_cy_per_px.tolist(),
        "frequency_cy_per_mm": edge.frequency_cy_per_mm.tolist(),
        "mtf": edge.mtf.tolist(),
        "low": edge.low.tolist(),
        "high": edge.high.tolist(),
        "designed": [_designed(each) for each in measured.designed],
        "quantities": [quantity_document(each) for each in measured.quantities],
    }


def _designed(designed: DesignedMtf) -> Document:
    return {
        "light": designed.light,
        "wavelength_nm": designed.wavelength_nm,
        "mtf": designed.mtf.tolist(),
        "seen": designed.seen.tolist(),
        "uncertainty": designed.uncertainty,
        "method": designed.method,
    }
