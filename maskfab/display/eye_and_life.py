"""Limits of the eye and of life: numbers of a display beside those of its reference, and which of them it keeps.

A limit that a job states is a check. Where none is stated a default is held against the display, whose source is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from types import MappingProxyType

from maskfab.base.errors import JobError
from maskfab.base.model import Panel
from maskfab.base.units import NM_PER_UM, UM_PER_MM, parse_pitch_um
from maskfab.display.camera_zone import CameraZone
from maskfab.display.drive import LightDemand, Triple, lives
from maskfab.display.emitted_light import MOST_SEEN, Tiled, Viewing
from maskfab.display.emitter_rules import EmitterRules
from maskfab.display.evenness import Evenness
from maskfab.display.eye import DEFAULT_GRAIN, HIGHEST_CPD, carrying
from maskfab.display.looks import Looks, field_of, looks, looks_of_reference
from maskfab.display.reference import Reference
from maskfab.job.sections import LivesSection, LooksSection
from maskfab.optics.colour import JUST_NOTICEABLE

DEFAULT_LIFE = 1 / 3

_STATED = "stated by the job"
_DELTA_E = f"default: ΔE {JUST_NOTICEABLE:g} is just noticeable (Mahy, Van Eycken and Oosterlinck, 1994)"
_GRAIN = (
    "default: contrast that is just noticeable of a spot of 16 mm², about a camera's window, (0.72 + 1.97 / S^0.33) %, "
    "S in mm² (SEMI D31)"
)
_LIFE = (
    "default: panels sold today, of which 28 % emits, live a third of those of 60 % (a vendor's claim, from which the "
    "ageing exponent is derived)"
)
_NO_LIMIT = "no published limit was found: judged where the job states one"

TITLES = MappingProxyType(
    {
        "delta_e": "ΔE of even white",
        "delta_e_95": "ΔE of even white, 95 %",
        "grain": "slow grain",
        "fine_grain": "fine grain",
        "fringe": "colour fringe at an edge",
        "luminance": "luminance at equal current density",
        "life": "life at equal luminance",
        "power": "power at equal luminance",
    }
)
"""Numbers in words, by their names."""

AT_LEAST = frozenset({"life"})
"""Numbers whose limit is the least; of the others it is the most."""


@dataclass(frozen=True)
class Limited:
    """A number of a display, its reference (None if none, or relative to it) and its limit, stated or default."""

    name: str
    value: float
    reference: float | None
    limit: float | None
    stated: bool
    source: str

    @property
    def least(self) -> bool:
        """Whether the limit is the least that is allowed."""
        return self.name in AT_LEAST

    @property
    def passed(self) -> bool | None:
        """Whether the limit is kept; None without one."""
        if self.limit is None:
            return None
        return self.value >= self.limit if self.least else self.value <= self.limit

    @property
    def title(self) -> str:
        """Its name in words."""
        return TITLES[self.name]

    @property
    def sign(self) -> str:
        """Before the limit, in words."""
        return "≥" if self.least else "≤"


def kept(numbers: Sequence[Limited]) -> bool:
    """Whether every limit is."""
    return all(number.passed is not False for number in numbers)


@dataclass(frozen=True, eq=False)
class Judgement:
    """Numbers of one display held against limits of eye and life, and a reference if the rules leave it room."""

    layout: str
    reference: Reference | None
    looks: tuple[Limited, ...]
    lives: tuple[Limited, ...]
    field: tuple[int, int]
    of_map: bool
    distance_um: float
    seen_pitch_um: float

    @property
    def passed(self) -> bool:
        """Whether every limit that the job states is kept."""
        return not any(number.stated and number.passed is False for number in (*self.looks, *self.lives))

    @property
    def reference_shares(self) -> Triple | None:
        """Of a pixel that red, green and blue of the reference cover."""
        return None if self.reference is None else self.reference.shares

    @property
    def viewing(self) -> Viewing:
        """Where the eye is."""
        return Viewing(self.seen_pitch_um, self.distance_um)

    @property
    def where(self) -> str:
        """The field and the eye, in words."""
        rows, columns = self.field
        whose = "of the die's map" if self.of_map else "in the middle of the die"
        return (
            f"{columns} x {rows} pixels {whose}, repeated beyond, from {self.distance_um / UM_PER_MM:g} mm at a pitch "
            f"of {self.seen_pitch_um:g} µm"
        )


@dataclass(frozen=True, eq=False)
class EyeAndLife:
    """Looks and lives of a job's displays; where ``stated``, a reference that cannot be drawn is refused."""

    looks: LooksSection
    lives: LivesSection
    stated: bool
    zone: CameraZone = field(default_factory=CameraZone)

    @classmethod
    def of(cls, looks: LooksSection | None, lives: LivesSection | None, zone: CameraZone | None = None) -> EyeAndLife:
        """By the sections of a job."""
        stated = not (looks is None and lives is None)
        return cls(looks or LooksSection(), lives or LivesSection(), stated, zone or CameraZone())

    @property
    def limits(self) -> Evenness:
        """Most that an even field may show, stated or by default."""
        return Evenness(self.looks.delta_e or JUST_NOTICEABLE, self.looks.grain or DEFAULT_GRAIN)

    @property
    def asks_evenness(self) -> bool:
        """Whether the job states any of these."""
        return self.looks.delta_e is not None or self.looks.grain is not None

    def viewed(self, *, distance_um: float | None = None, dpi: float | None = None) -> EyeAndLife:
        """Limits as they are, looked at from elsewhere or at another scale."""
        other = {"distance": distance_um, "dpi": dpi}
        stated = {key: value for key, value in other.items() if value is not None}
        return replace(self, looks=self.looks.model_copy(update=stated))

    def viewing(self, pitch_um: float) -> Viewing:
        """Where a display of a pitch is looked at, and at which scale."""
        dpi = self.looks.dpi
        return Viewing(pitch_um if dpi is None else parse_pitch_um(f"{dpi!r} dpi"), self.looks.distance)

    def refuse(self, pitch_nm: int, rules: EmitterRules) -> None:
        """Refuse what a display of a pitch cannot be held against, before anything is searched."""
        self.reference(pitch_nm, rules)
        samples = carrying(HIGHEST_CPD, self.viewing(pitch_nm / NM_PER_UM))
        if samples**2 > MOST_SEEN:
            what = (
                f"from {self.looks.distance / UM_PER_MM:g} mm the eye resolves {samples} x {samples} parts of a pixel"
            )
            cure = "Look from farther away, or at more dots per inch"
            raise JobError("MF115", what, where="looks.distance", cure=cure)

    def reference(self, pitch_nm: int, rules: EmitterRules) -> Reference | None:
        """The reference display; None where the rules leave no room for it and nothing was stated of it."""
        around_nm, across = self.zone.around_nm(pitch_nm), self.zone.across(pitch_nm)
        try:
            return Reference.of(self.looks.reference, around_nm, rules).beside(across)
        except JobError:
            if self.stated:
                raise
            return None


def judgement(
    panel: Panel, asked: EyeAndLife, rules: EmitterRules, light: LightDemand, of_map: tuple[int, int] | None = None
) -> Judgement:
    """Look at a display, and hold its emitters against those of its reference."""
    viewing = asked.viewing(panel.cell_size.pitch_um)
    field = field_of(panel.orientations.shape, viewing, of_map)
    shown = Tiled.of(panel, *field)
    reference = asked.reference(panel.pitch_nm, rules)
    usual = None if reference is None else looks_of_reference(reference, field[1], viewing)
    own: tuple[Limited, ...] = ()
    if reference is not None:
        own = _lives(shown.shares, reference.shares, light, asked.lives)
    return Judgement(
        asked.looks.reference,
        reference,
        _looks(looks(shown, viewing), usual, asked.looks),
        own,
        field,
        of_map is not None,
        viewing.distance_um,
        viewing.pitch_um,
    )


def _looks(own: Looks, usual: Looks | None, section: LooksSection) -> tuple[Limited, ...]:
    limits = {
        "delta_e": _limit(section.delta_e, JUST_NOTICEABLE, _DELTA_E),
        "grain": _limit(section.grain, DEFAULT_GRAIN, _GRAIN),
        "fringe": _limit(section.fringe, None, _NO_LIMIT),
    }
    return tuple(
        Limited(name, value, None if usual is None else getattr(usual, name), *limits.get(name, (None, False, "")))
        for name, value in asdict(own).items()
    )


def _lives(shares: Triple, reference: Triple, light: LightDemand, section: LivesSection) -> tuple[Limited, ...]:
    found = lives(light, shares, reference)
    life, power = _limit(section.life, DEFAULT_LIFE, _LIFE), _limit(section.power, None, _NO_LIMIT)
    return (
        Limited("luminance", found.luminance, 1.0, None, False, ""),
        Limited("life", found.life, 1.0, *life),
        Limited("power", found.power, 1.0, *power),
    )


def _limit(stated: float | None, default: float | None, source: str) -> tuple[float | None, bool, str]:
    return (default, False, source) if stated is None else (stated, True, _STATED)
