"""The constraints of an opening, whatever is optimised: mask rules, room for the display, and whether they agree.

Rules are judged in order of cost, a microsecond first and a placement of emitters last, so that a search refuses most
of what it tries before anything is computed. A set of rules that no opening keeps is told with a proof where one of
these is found: counting, sums of orbits, area, the bound on emitters of a pixel that is closed everywhere, or a look
at every opening of the count where they are few.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from itertools import islice
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from maskfab.cell_size import CellSize
from maskfab.display.circuit import CircuitRules, pixel_room
from maskfab.display.emitters.across_borders import border_margin
from maskfab.display.emitters.assign import centred
from maskfab.display.emitters.bound import upper_bound
from maskfab.display.emitters.emitter_rules import EmitterGrid, EmitterRules, grid_of
from maskfab.display.emitters.fit import footprint
from maskfab.display.emitters.free_area import free_region
from maskfab.display.emitters.freeform import guillotine
from maskfab.display.emitters.placement import Certificate, Verdict
from maskfab.display.emitters.rectangles import rectangle_footprints
from maskfab.display.wires.flow import DIRECTIONS, Net, most_lines
from maskfab.display.wires.ports import ports
from maskfab.drc.raster_rules import corner_touches, smallest_runs
from maskfab.errors import JobError, OpeningError
from maskfab.model import ORIENTATIONS, Opening, frozen, orient
from maskfab.optics.numbers.centroid import luminance_centroid
from maskfab.optimiser.rules.families import Symmetry, orbits, reachable
from maskfab.units import NM_PER_UM

Mask = NDArray[np.bool_]
Kissing = Literal["allowed", "cell", "neighbours"]

RULES = (
    "keep_out",
    "rim_dots",
    "symmetry",
    "kissing",
    "min_feature_dots",
    "min_space_dots",
    "circuit",
    "wire_flow",
    "ports",
    "footprint",
    "centroid_px",
)
"""Every rule but the count, in the order in which they are judged."""

_FEW, _FEW_IF_SLOW = 1000, 20
_KEEP = 0.9


@dataclass(frozen=True)
class Conflict:
    """Rules that no opening keeps together.

    Attributes:
        rules: their names; without any of them this proof falls.
        statement: why, with the numbers.
        certificate: what the layout's own bound says; None where counting is enough.
    """

    rules: tuple[str, ...]
    statement: str
    certificate: Certificate | None = None


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints that every opening of a design must meet.

    Attributes:
        clear_dots: exact number of clear dots in a cell.
        dots: along the cell's side.
        min_feature_dots: least clear run along a row or column; the cell is taken to be surrounded by chrome.
        min_space_dots: least closed run between clear dots, across the cell's borders too.
        kissing: where clear dots may meet at a corner only: anywhere, only at the borders of cells (``cell`` forbids it
            inside), or nowhere (``neighbours``: beside any neighbours in the orientations used).
        rim_dots: closed dots along every side of the cell.
        gutter_nm: opaque space between cells, outside the dots.
        orientations: elements of D4 in use; any two may be neighbours.
        symmetry: that the opening has; None asks for none.
        keep_out: bool [dots, dots], True must be closed; None keeps nothing out.
        dot_nm: side of a dot.
        emitters: gaps, width and ratio for ``footprint``; its own ``required`` is not looked at.
        footprint: least share of the pixel that each colour's emitter covers (mean over the ratio).
        circuit: room that drive circuits need in the closed area.
        wire_flow: least number of lines through closed dots, vertical and horizontal, one line per dot.
        ports: least number of symmetric ports through which lines run in both directions.
        centroid_px: largest distance of the light's centroid from the pixel's centre, in pixels.

    Raises:
        JobError: MF104 for a number out of range; MF105 for a rule or keep-out of another kind; MF117 or MF118 where
            the rules of emitters or circuits do not suit the pixel.
    """

    clear_dots: int
    _: KW_ONLY
    dots: int = 21
    min_feature_dots: int = 1
    min_space_dots: int = 1
    kissing: Kissing = "allowed"
    rim_dots: int = 0
    gutter_nm: int = 0
    orientations: tuple[int, ...] = tuple(range(ORIENTATIONS))
    symmetry: Symmetry | None = None
    keep_out: Mask | None = None
    dot_nm: int = 8000
    emitters: EmitterRules = EmitterRules(0, 8000, 16000)  # noqa: RUF009 - frozen
    footprint: float | None = None
    circuit: CircuitRules | None = None
    wire_flow: int | None = None
    ports: int | None = None
    centroid_px: float | None = None

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("dots", self.dots, 1, 512),
            ("clear_dots", self.clear_dots, 0, math.inf),
            ("min_feature_dots", self.min_feature_dots, 1, math.inf),
            ("min_space_dots", self.min_space_dots, 1, math.inf),
            ("rim_dots", self.rim_dots, 0, math.inf),
            ("gutter_nm", self.gutter_nm, 0, math.inf),
            ("dot_nm", self.dot_nm, 1, math.inf),
            ("footprint", self.footprint, 0, 1),
            ("wire_flow", self.wire_flow, 0, math.inf),
            ("ports", self.ports, 0, math.inf),
            ("centroid_px", self.centroid_px, 0, 1),
        ):
            if value is not None and not low <= value <= high:
                raise JobError(
                    "MF104",
                    f"{name} = {value} must lie between {low} and {high:g}",
                    where=f"design.{name}",
                    cure=f"Choose {name} in that range",
                )
        if self.kissing not in {"allowed", "cell", "neighbours"}:
            raise JobError(
                "MF105",
                f"kissing = {self.kissing!r} is not a rule",
                where="design.kissing",
                cure="Use allowed, cell or neighbours",
            )
        used = tuple(sorted(set(self.orientations)))
        if not used or not set(used) <= set(range(ORIENTATIONS)):
            raise JobError(
                "MF104",
                f"the orientations {self.orientations} are not elements 0 to 7",
                where="design.orientations",
                cure="List the orientations in use, such as (0, 1, 2, 3)",
            )
        object.__setattr__(self, "orientations", used)
        orbits(1, self.symmetry)
        if self.keep_out is not None:
            kept = np.asarray(self.keep_out, dtype=np.bool_)
            if kept.shape != (self.dots, self.dots):
                raise JobError(
                    "MF105",
                    f"the keep-out is {kept.shape}, the cell {self.dots} x {self.dots} dots",
                    where="design.keep_out",
                    cure="Give one value per dot",
                )
            object.__setattr__(self, "keep_out", frozen(kept))
        if self.footprint is not None or self.centroid_px is not None:
            _ = self.grid
        if self.circuit is not None:
            pixel_room(self._opening(np.zeros((self.dots, self.dots), dtype=np.bool_)), self.dot_nm, self.circuit)

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the rules, beside the count, that ask for something."""
        nothing = Constraints(self.clear_dots, dots=self.dots)
        # Names are compared one by one: an array of dots is not equal or unequal as a whole.
        same = {name for name in RULES if name != "keep_out" and getattr(self, name) == getattr(nothing, name)}
        return tuple(name for name in RULES if name not in same and (name != "keep_out" or self.keep_out is not None))

    @cached_property
    def free(self) -> Mask:
        """Where dots may be clear, bool [dots, dots]."""
        inside = np.zeros((self.dots, self.dots), dtype=np.bool_)
        inside[self.rim_dots : self.dots - self.rim_dots, self.rim_dots : self.dots - self.rim_dots] = True
        return frozen(inside if self.keep_out is None else inside & ~self.keep_out)

    @cached_property
    def grid(self) -> EmitterGrid:
        """Cells on which the emitters' rules are whole numbers.

        Raises:
            JobError: MF117 if a rule is wider than the pixel, MF118 if the cells would be too many.
        """
        return grid_of(self._opening(np.zeros((self.dots, self.dots), dtype=np.bool_)), *self._laid, self.emitters)

    def only(self, *names: str) -> Constraints:
        """The count and just these rules."""
        nothing = Constraints(self.clear_dots, dots=self.dots)
        return replace(self, **{name: getattr(nothing, name) for name in RULES if name not in names})

    def without(self, *names: str) -> Constraints:
        """All but these rules."""
        return self.only(*(name for name in RULES if name not in names))

    def violations(self, unit: Mask) -> tuple[str, ...]:
        """Rules that the opening breaks, each as ``rule: what and how much``; cheap rules first, empty if it meets all.

        An emitter's placement is searched for as long as the layout does; where none was found and none is proved
        impossible, that too is a violation, and says so.

        Args:
            unit: bool [dots, dots].

        Raises:
            JobError: MF105 for another shape.
        """
        return tuple(self._broken(np.asarray(unit, dtype=np.bool_), quick=False))

    def allows(self, unit: Mask) -> bool:
        """Whether the opening keeps everything; stops at the first rule that is broken.

        Quicker than :meth:`violations`, and no laxer: emitters are rectangles or straight cuts, so that an opening is
        refused round which only crooked emitters fit.
        """
        return self.first_broken(unit) is None

    def first_broken(self, unit: Mask) -> str | None:
        """Name of the first rule that the opening breaks, judged as :meth:`allows` does; None if it keeps all."""
        said = next(self._broken(np.asarray(unit, dtype=np.bool_), quick=True), None)
        return None if said is None else said.split(":")[0]

    def broken(self, unit: Mask) -> frozenset[str]:
        """Names of the rules that the opening breaks, judged as :meth:`allows` does; ``clear_dots`` is one."""
        said = self._broken(np.asarray(unit, dtype=np.bool_), quick=True)
        return frozenset(each.split(":")[0] for each in said)

    def broken_beside(self, units: Mask) -> str | None:
        """Name of the first rule that openings which keep it among themselves break beside one another; None if none.

        Args:
            units: bool [units, dots, dots], any of which may be the neighbour of any, in the orientations used.
        """
        active = self.active
        turned = np.concatenate([_turned(unit, self.orientations) for unit in np.asarray(units, dtype=np.bool_)])
        if "kissing" in active and self.kissing == "neighbours" and self.gutter_nm == 0 and _kiss_across(turned):
            return "kissing"
        if "min_space_dots" in active and _space_across(turned, self.gutter_nm / self.dot_nm) < self.min_space_dots:
            return "min_space_dots"
        return None

    def conflict(self) -> Conflict | None:
        """Rules that contradict each other, with the proof; None where no proof was found, so that a search may go."""
        proofs = (
            self._by_counting,
            self._by_orbits,
            self._by_width,
            self._by_wires,
            self._by_circuits,
            self._by_area,
        )
        for find in proofs:
            if (found := find()) is not None:
                return found
        return self._by_looking()

    def require_possible(self) -> None:
        """Refuse rules that contradict each other.

        Raises:
            OpeningError: MF203 for no clear dots, MF204 where the count cannot be reached.
            JobError: MF123 for other contradictions.
        """
        if self.clear_dots == 0:
            raise OpeningError("MF203", "0 dots are to be clear", where="design.clear_dots", cure="Open at least 1 dot")
        found = self.conflict()
        if found is None:
            return
        what = f"no opening keeps {' and '.join(found.rules)} together: {found.statement}"
        counting = {"clear_dots", "symmetry", "keep_out", "rim_dots", "min_feature_dots"}
        kind, code = (OpeningError, "MF204") if set(found.rules) <= counting else (JobError, "MF123")
        raise kind(code, what, where=f"design.{found.rules[0]}", cure=f"Relax {' or '.join(found.rules)}")

    @property
    def _laid(self) -> tuple[int, int]:
        return self.dot_nm, self.gutter_nm

    def _opening(self, unit: Mask) -> Opening:
        return Opening("unit", unit, self.dot_nm)

    def _broken(self, unit: Mask, *, quick: bool) -> Iterator[str]:
        if unit.shape != (self.dots, self.dots):
            raise JobError(
                "MF105",
                f"the opening is {unit.shape}, the cell {self.dots} x {self.dots} dots",
                where="design",
                cure="Give one value per dot",
            )
        if (count := int(unit.sum())) != self.clear_dots:
            yield f"clear_dots: {count} are clear, {self.clear_dots} asked"
        judges: dict[str, Callable[[Mask], str | None]] = {
            "keep_out": self._keep_out,
            "rim_dots": self._rim,
            "symmetry": self._symmetry,
            "kissing": self._kissing,
            "min_feature_dots": self._feature,
            "min_space_dots": self._space,
            "circuit": self._circuit,
            "wire_flow": self._flow_quickly if quick else self._flow,
            "ports": self._ports,
            "footprint": self._footprint_quickly if quick else self._footprint,
            "centroid_px": self._centroid,
        }
        for name in self.active:
            if (said := judges[name](unit)) is not None:
                yield f"{name}: {said}"

    def _keep_out(self, unit: Mask) -> str | None:
        inside = int((unit & self.keep_out).sum()) if self.keep_out is not None else 0
        return f"{inside} clear dots where none may be" if inside else None

    def _rim(self, unit: Mask) -> str | None:
        r, n = self.rim_dots, self.dots
        inside = int(unit.sum() - unit[r : n - r, r : n - r].sum())
        return f"{inside} clear dots within {r} of a side" if inside else None

    def _symmetry(self, unit: Mask) -> str | None:
        flat = unit.ravel()
        uneven = sum(len(set(flat[orbit].tolist())) > 1 for orbit in orbits(self.dots, self.symmetry))
        return f"{uneven} sets of dots differ from their images under {self.symmetry}" if uneven else None

    def _kissing(self, unit: Mask) -> str | None:
        if inside := corner_touches(unit):
            return f"{inside} corners touch inside the cell"
        if self.kissing == "neighbours" and self.gutter_nm == 0 and _kiss_across(_turned(unit, self.orientations)):
            return "corners of neighbouring cells can touch"
        return None

    def _feature(self, unit: Mask) -> str | None:
        least = smallest_runs(unit).clear
        wanted = self.min_feature_dots
        return f"a clear width of {least:g} dots, least {wanted}" if least < wanted else None

    def _space(self, unit: Mask) -> str | None:
        across = _space_across(_turned(unit, self.orientations), self.gutter_nm / self.dot_nm)
        least = min(smallest_runs(unit).opaque, across)
        return f"a space of {least:g} dots, least {self.min_space_dots}" if least < self.min_space_dots else None

    def _circuit(self, unit: Mask) -> str | None:
        if self.circuit is None:
            return None
        room = pixel_room(self._opening(unit), self.dot_nm, self.circuit)
        return None if room.certificate is None else room.certificate.statement

    def _flow_quickly(self, unit: Mask) -> str | None:
        wanted = self.wire_flow or 0
        closed = ~unit
        # Every line crosses every row, or every column.
        if min(int(closed.sum(axis=0).min()), int(closed.sum(axis=1).min())) < wanted:
            return f"a row or column has fewer than {wanted} closed dots"
        kept = all(Net(closed, direction).count() >= wanted for direction in DIRECTIONS)
        return None if kept else f"fewer than {wanted} lines in one direction"

    def _flow(self, unit: Mask) -> str | None:
        wanted = self.wire_flow or 0
        for direction in DIRECTIONS:
            found = most_lines(~unit, direction, dot_nm=self.dot_nm)
            if found.count < wanted:
                return f"{found.count} {direction} lines, least {wanted}; {found.certificate.statement}"
        return None

    def _ports(self, unit: Mask) -> str | None:
        wanted = self.ports or 0
        found = ports(~unit, enough=wanted)
        more = "" if found.exact else " were found"
        return f"{found.count} symmetric ports{more}, least {wanted}" if found.count < wanted else None

    def _footprint_quickly(self, unit: Mask) -> str | None:
        wanted = self.footprint or 0.0
        margin = border_margin(self.grid)
        ratio, aspect = self.emitters.ratio, self.emitters.max_aspect
        found = float(
            rectangle_footprints(
                unit[None], self.grid, ratio, orientations=self.orientations, margin=margin, max_aspect=aspect
            )[0]
        )
        if found < wanted - 1e-9:
            region = free_region(unit, self.grid, self.orientations, margin=margin)
            cells, _ = guillotine(region, self.grid, ratio)
            found = max(found, cells * self._cell_share)
        return None if found >= wanted - 1e-9 else f"{found:.1%} found, least {wanted:.1%}"

    def _footprint(self, unit: Mask) -> str | None:
        wanted = self.footprint or 0.0
        rules = replace(self.emitters, required=wanted)
        found = footprint(self._opening(unit), *self._laid, self.orientations, rules)
        if found.verdict is Verdict.FITS:
            return None
        proved = found.verdict is Verdict.DOES_NOT_FIT and found.certificate is not None
        why = found.certificate.statement if proved and found.certificate else f"at most {found.bound_share:.1%}"
        return f"{found.found_share:.1%} found, least {wanted:.1%}; {why}"

    def _centroid(self, unit: Mask) -> str | None:
        limit = 0.0 if self.centroid_px is None else self.centroid_px
        rules = replace(self.emitters, required=self.footprint or 0.0)
        opening = self._opening(unit)
        found = footprint(opening, *self._laid, self.orientations, rules)
        panel = np.random.default_rng(0).choice(np.array(self.orientations, dtype=np.int8), size=(24, 24))
        placed = centred(found.found, opening, self.grid, panel, rules, keep=_KEEP)
        if placed is None:
            return "no emitters were found whose light has a centroid"
        away = math.hypot(*luminance_centroid(placed, self.grid.pitch_nm))
        return f"the light's centroid is {away:.3f} pixels off, at most {limit:g}" if away > limit else None

    @property
    def _cell_share(self) -> float:
        return (self.grid.cell_nm / self.grid.pitch_nm) ** 2

    def _kept_closed(self) -> tuple[str, ...]:
        return tuple(name for name in ("keep_out", "rim_dots") if name in self.active)

    def _members(self) -> list[NDArray[np.intp]]:
        """Orbits that may be clear."""
        free = self.free.ravel()
        return [orbit for orbit in orbits(self.dots, self.symmetry) if free[orbit].all()]

    def _by_counting(self) -> Conflict | None:
        offered = int(self.free.sum())
        if self.clear_dots <= offered:
            return None
        return Conflict(
            ("clear_dots", *self._kept_closed()),
            f"{offered} of {self.dots} x {self.dots} dots may be clear, {self.clear_dots} must be",
        )

    def _by_orbits(self) -> Conflict | None:
        if self.symmetry is None:
            return None
        sums = reachable([len(orbit) for orbit in self._members()])
        if sums >> self.clear_dots & 1:
            return None
        below = (sums & ((1 << self.clear_dots) - 1)).bit_length() - 1
        above = next((k for k in range(self.clear_dots + 1, self.dots**2 + 1) if sums >> k & 1), None)
        nearest = f"{below}" if above is None else f"{below} and {above}"
        return Conflict(
            ("clear_dots", "symmetry", *self._kept_closed()),
            f"sets of dots that {self.symmetry} maps onto each other never sum to {self.clear_dots}; "
            f"the nearest counts are {nearest}",
        )

    def _by_width(self) -> Conflict | None:
        least, count = self.min_feature_dots, self.clear_dots
        if count and least > self.dots:
            return Conflict(
                ("min_feature_dots",), f"a clear width of {least} dots in a cell of {self.dots} x {self.dots}"
            )
        # A row that is not closed holds a run, hence `least` columns of runs, hence `least` rows of `least` dots; any
        # further row or column adds a run.
        if 0 < count < least**2 or least**2 < count < least * (least + 1):
            return Conflict(
                ("clear_dots", "min_feature_dots"),
                f"openings of no width below {least} dots have {least**2}, or at least {least * (least + 1)} clear "
                f"dots, not {count}",
            )
        return None

    def _by_wires(self) -> Conflict | None:
        for name, wanted in (("wire_flow", self.wire_flow), ("ports", self.ports)):
            most = self.dots * (self.dots - min(wanted or 0, self.dots))
            if wanted is not None and (wanted > self.dots or self.clear_dots > most):
                return Conflict(
                    (name, "clear_dots") if wanted <= self.dots else (name,),
                    f"{wanted} lines close {wanted} dots of every row, so that at most {most} of "
                    f"{self.dots} x {self.dots} are clear",
                )
        return None

    def _by_circuits(self) -> Conflict | None:
        if self.circuit is None:
            return None
        closed = (self.dots**2 - self.clear_dots) * (self.dot_nm / NM_PER_UM) ** 2
        if self.circuit.pixel_need_um2 <= closed * (1 + 1e-9):
            return None
        return Conflict(
            ("circuit", "clear_dots"),
            f"{self.circuit.circuits} circuits of {self.circuit.need_um2:g} um2 need more than the {closed:g} um2 of "
            "the pixel that are closed",
        )

    def _by_area(self) -> Conflict | None:
        if self.footprint is None:
            return None
        pitch_nm = CellSize(self.dots, self.dot_nm, self.gutter_nm).pitch_nm
        closed = 1 - self.clear_dots * (self.dot_nm / pitch_nm) ** 2
        if 3 * self.footprint > closed + 1e-9:
            return Conflict(
                ("footprint", "clear_dots"),
                f"three emitters of {self.footprint:.1%} are more than the {closed:.1%} of the pixel that is closed",
            )
        nothing = np.zeros((self.dots, self.dots), dtype=np.bool_)
        region = free_region(nothing, self.grid, self.orientations)
        cells, certificate = upper_bound(region, self.grid, self.emitters.ratio)
        if cells * self._cell_share < self.footprint - 1e-9:
            return Conflict(
                ("footprint",),
                f"even a pixel without an opening has room for {cells * self._cell_share:.1%} of each colour, not "
                f"{self.footprint:.1%}: {certificate.statement}",
                certificate,
            )
        return None

    def _by_looking(self) -> Conflict | None:
        """A look at every opening of the count, where they are few."""
        slow = {"footprint", "centroid_px", "ports"} & set(self.active)
        few = _FEW_IF_SLOW if slow else _FEW
        members = self._members()
        if self.symmetry is None and math.comb(len(members), self.clear_dots) > few:
            return None
        units = list(islice(_every(members, self.clear_dots, self.dots), few + 1))
        if len(units) > few or any(self.allows(unit) for unit in units):
            return None
        broken = [{said.split(":")[0] for said in self.violations(unit)} for unit in units]
        if not all(broken):
            return None
        needed = [name for name in self.active if any(name in each for each in broken)]
        for name in list(needed):
            rest = set(needed) - {name}
            if all(each & rest for each in broken):
                needed.remove(name)
        how = "the only opening" if len(units) == 1 else f"every one of the {len(units)} openings"
        given = tuple(dict.fromkeys((*self._kept_closed(), *(("symmetry",) if self.symmetry else ()), *needed)))
        return Conflict(("clear_dots", *given), f"{how} of {self.clear_dots} clear dots breaks one of them")


def _every(members: list[NDArray[np.intp]], total: int, dots: int) -> Iterator[Mask]:
    """Every union of orbits with the count."""
    sums = [1]
    for orbit in reversed(members):
        sums.append(sums[-1] | sums[-1] << len(orbit))
    unit = np.zeros(dots * dots, dtype=np.bool_)
    waiting: list[tuple[int, int, tuple[int, ...]]] = [(0, total, ())]
    while waiting:
        k, left, chosen = waiting.pop()
        if left < 0 or not sums[len(members) - k] >> left & 1:
            continue
        if left == 0:
            unit[:] = False
            for j in chosen:
                unit[members[j]] = True
            yield unit.reshape(dots, dots).copy()
            continue
        waiting.append((k + 1, left, chosen))
        waiting.append((k + 1, left - len(members[k]), (*chosen, k)))


def _turned(unit: Mask, orientations: tuple[int, ...]) -> Mask:
    return np.stack([orient(unit, k) for k in orientations])


def _kiss_across(turned: Mask) -> bool:
    """Whether cells [kinds, dots, dots] without a gutter, any beside any, can touch at corners along a border or where
    four meet."""
    for here, there in ((turned[:, :, -1], turned[:, :, 0]), (turned[:, -1], turned[:, 0])):
        low, high = here[:, None, :-1], here[:, None, 1:]
        across_low, across_high = there[None, :, :-1], there[None, :, 1:]
        rising = low & across_high & ~high & ~across_low
        falling = high & across_low & ~low & ~across_high
        if bool((rising | falling).any()):
            return True
    # Around a vertex: lower left, lower right, upper left and upper right cell, with the corner each has there.
    corners = [set(turned[:, y, x].tolist()) for y, x in ((-1, -1), (-1, 0), (0, -1), (0, 0))]
    rising_four = all(value in each for value, each in zip((True, False, False, True), corners, strict=True))
    falling_four = all(value in each for value, each in zip((False, True, True, False), corners, strict=True))
    return rising_four or falling_four


def _space_across(turned: Mask, gutter: float) -> float:
    """Least closed run in dots that crosses a border between cells [kinds, dots, dots]; inf where there is none."""
    least = math.inf
    for cells in (turned, turned.transpose(0, 2, 1)):
        used = cells.any(axis=2)
        first = np.where(used, cells.argmax(axis=2), np.inf)
        last = np.where(used, cells[:, :, ::-1].argmax(axis=2), np.inf)
        runs = last[:, None] + gutter + first[None]
        least = min(least, float(runs[runs > 0].min(initial=np.inf)))
    return least
