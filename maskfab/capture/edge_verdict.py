"""Measured edges in sentences: how fine they show detail, and up to where the design does the same."""

from __future__ import annotations

from maskfab.capture.measured_edges import MeasuredEdge, MeasuredEdges
from maskfab.model import Quantity


def edge_verdict(found: MeasuredEdges) -> tuple[str, ...]:
    """A sentence for each edge, and one for each light that it is held against."""
    return tuple(sentence for each in found.edges for sentence in _sentences(each, found.die))


def _sentences(measured: MeasuredEdge, die: str | None) -> list[str]:
    numbers = {(each.name, each.wavelength_nm): each for each in measured.quantities}
    half = numbers["edge_mtf50_per_pixel", None]
    told = "does not fall below one half" if half.value is None else f"is one half at {_per_pixel(half)}"
    per_mm = numbers.get(("edge_mtf50", None))
    if per_mm is not None and per_mm.value is not None:
        told += f", {float(per_mm):.1f} per mm"
    said = [f"{_capital(measured.title)}: the MTF {told}."]
    differences = [each for each in measured.quantities if each.name == "edge_mtf_difference"]
    partings = [each for each in measured.quantities if each.name == "edge_mtf_parting"]
    for k, difference in enumerate(differences):
        light = measured.designed[k].light
        error = "" if difference.uncertainty is None else f" ± {difference.uncertainty:.3f}"
        largest = f"largest difference {float(difference):.3f}{error}"
        if not partings:
            verdict = f"is held beside it without a band, so nothing tells from where on they part; {largest}"
        elif partings[k].value is None:
            verdict = f"agrees with it up to half a cycle per pixel; {largest}"
        else:
            verdict = f"parts from it at {float(partings[k]):.1f} cycles per mm; {largest}"
        said.append(f"The design of {die} in {light} {verdict}.")
    return said


def _per_pixel(half: Quantity) -> str:
    error = "" if half.uncertainty is None else f" ± {half.uncertainty:.4f}"
    return f"{float(half):.4f}{error} cycles per pixel"


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]
