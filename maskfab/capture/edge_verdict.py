"""Measured edges in sentences: how fine they show detail, and up to where the design does the same."""

from __future__ import annotations

from maskfab.capture.measured_edges import MeasuredEdge, MeasuredEdges
from maskfab.model import Quantity

_TOLD = ("edge_mtf50_per_pixel", "edge_mtf50", "edge_mtf_difference", "edge_mtf_parting")


def edge_verdict(found: MeasuredEdges) -> tuple[str, ...]:
    """A sentence for each edge, and one for each light that it is held against."""
    return tuple(sentence for each in found.edges for sentence in _sentences(each, found.die))


def _sentences(measured: MeasuredEdge, die: str | None) -> list[str]:
    of = {name: [each for each in measured.quantities if each.name == name] for name in _TOLD}
    half = [str(each) for name in ("edge_mtf50_per_pixel", "edge_mtf50") for each in of[name] if each.value is not None]
    told = f"is one half at {', '.join(half)}" if half else "does not fall below one half"
    said = [f"{measured.title[0].upper()}{measured.title[1:]}: the MTF {told}."]
    partings: list[Quantity | None] = [*of["edge_mtf_parting"]] or [None] * len(measured.designed)
    for designed, difference, parting in zip(measured.designed, of["edge_mtf_difference"], partings, strict=True):
        said.append(f"{_beside(f'the design of {die} in {designed.light}', parting)}; largest difference {difference}.")
    return said


def _beside(design: str, parting: Quantity | None) -> str:
    if parting is None:
        return f"Without a band nothing tells from where on it parts from {design}"
    if parting.value is None:
        return f"It agrees with {design} up to half a cycle per pixel"
    return f"It parts from {design} at {float(parting):.1f} cycles per mm"
