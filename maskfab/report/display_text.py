"""The answer about one display as lines of text: a title, then one line for each thing that was asked."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from maskfab.display.circuit import BY_AREA, NOT_PLACED
from maskfab.display.emitters.fit import LargestGap
from maskfab.display.emitters.measure import Violation
from maskfab.display.feasibility import Feasibility
from maskfab.model import Quantity
from maskfab.units import NM_PER_UM

Line = tuple[str, str]


def display_lines(
    name: str, found: Feasibility | None, gap: LargestGap | None, seed: Quantity | None = None
) -> Iterator[str]:
    """The lines for one die; None stands for a sheet that has no pixels, ``seed`` is a note on the die's."""
    if found is None:
        yield f"{name}: no pixels to place emitters in"
        return
    yield f"{name}: {found.verdict}; {BY_AREA}"
    for part in (_footprint, _placement, _circuits, _wires, _light, _proofs):
        for label, text in part(found):
            yield f"  {label:<16} {text}"
    if seed is not None:
        yield f"  {'note':<16} {seed.method}"
    if gap is not None:
        yield f"  {'widest gap':<16} {_gap(gap)}"


def _footprint(found: Feasibility) -> Iterator[Line]:
    footprint = found.footprint
    required = f"; required {_percent(found.required)}" if found.required else ""
    method = f" ({footprint.method})" if footprint.found is not None else ""
    yield "footprint", f"{_percent(footprint.found_share)}{method}, at most {_percent(footprint.bound_share)}{required}"
    yield "rectangles", _percent(footprint.rectangles_share)


def _placement(found: Feasibility) -> Iterator[Line]:
    if found.emitters is None:
        return
    yield (
        "areas",
        ", ".join(f"{letter} {area:.10g}" for letter, area in zip("RGB", found.emitters.areas_um2, strict=True))
        + " um^2",
    )
    borders = found.borders
    if borders is not None:
        yield (
            "borders",
            f"{borders.side_violations} of {borders.side_pairs} pairs at sides and {borders.diagonal_violations} of "
            f"{borders.diagonal_pairs} at corners are too close; {borders.margin_nm / NM_PER_UM:g} um of clearance "
            "along all sides would suit any neighbour",
        )
    if not found.broken:
        yield "rules broken", "none, measured from the polygons"
    for each in found.broken:
        yield "rules broken", _broken(each)


def _broken(each: Violation) -> str:
    x, y = (along / NM_PER_UM for along in each.place_nm)
    return f"{each.rule}: {each.area_um2:g} um^2 near ({x:g}, {y:g}) um"


def _circuits(found: Feasibility) -> Iterator[Line]:
    room = found.room
    yield "circuits", f"{_round(room.area_um2)} um^2 available, {_round(room.need_um2)} um^2 needed"
    yield "not modelled", NOT_PLACED


def _wires(found: Feasibility) -> Iterator[Line]:
    wires = found.wiring
    if wires is None:
        return
    if wires.laid is not None:
        drawn = f"{wires.wanted - wires.transparent} laid across the panel each way"
    else:
        along_x, along_y = wires.through
        drawn = f"{wires.in_gutter} in the gutter, {along_x} along x and {along_y} along y through closed area"
    yield "wires", f"{wires.verdict}: of {wires.wanted} lines {wires.transparent} transparent, {drawn}"
    for each in wires.broken:
        yield "rules broken", _broken(each)


def _light(found: Feasibility) -> Iterator[Line]:
    if found.emitters is None:
        return
    x, y = found.centroid_px
    yield "light", f"centroid at ({x:.4f}, {y:.4f}) px; shifts by {found.wander_px:.4f} px RMS between orientations"
    if found.density_ma_per_cm2 is not None:
        yield "current density", f"{_colours(found.density_ma_per_cm2)} mA/cm2"
    if found.life is not None:
        yield "relative life", _colours(found.life)


def _proofs(found: Feasibility) -> Iterator[Line]:
    for certificate in found.certificates:
        yield "proof", certificate.statement
    bound = found.footprint.certificate
    if bound is not None and bound not in found.certificates:
        yield "bound", bound.statement


def _gap(gap: LargestGap) -> str:
    fits = "no placement was found at any gap" if gap.found_nm is None else f"{gap.found_nm / NM_PER_UM:g} um fits"
    if gap.excluded_nm is None:
        return f"{fits}; no gap within the pixel is proven impossible"
    return f"{fits}; {gap.excluded_nm / NM_PER_UM:g} um is proven impossible"


def _percent(share: float) -> str:
    return f"{100 * share:.2f} %"


def _colours(values: Iterable[float]) -> str:
    return ", ".join(f"{letter} {value:.4g}" for letter, value in zip("RGB", values, strict=True))


def _round(area_um2: float) -> str:
    return f"{area_um2:.0f}"
