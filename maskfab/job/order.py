"""[order]: what a mask house is asked for. Every key may be left out; the house's own profile then decides, or it is
asked for before a package is made."""

from __future__ import annotations

from datetime import date
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from maskfab.base.errors import JobError
from maskfab.job.values import Length, Section, parsed

Tone: TypeAlias = Literal["clear", "dark"]
Reading: TypeAlias = Literal["right reading", "wrong reading"]
ChromeSide: TypeAlias = Literal["up", "down"]
Glass: TypeAlias = Literal["soda lime", "quartz", "polyester"]
Film: TypeAlias = Literal["chrome", "low-reflective chrome", "emulsion"]
Protection: TypeAlias = Literal["none", "pellicle", "coat"]
Touches: TypeAlias = Literal["join", "stay apart"]

DATA_KEYS = ("tone", "parity", "chrome")
"""Keys that change the data that are written, as ``bias`` does where it is "data"; the others are for the papers."""
_LONGEST = 200


def _line(text: object) -> object:
    """One line of text for a paper; MF110 for one that no paper has room for, or that a printer would obey."""
    if not isinstance(text, str):
        return text
    if len(text) > _LONGEST:
        what = f"a text of {len(text)} characters is longer than the {_LONGEST} that an order has room for"
        raise JobError("MF110", what, cure="Shorten it; send longer letters beside the package")
    if not text.strip() or not text.isprintable():
        what = f"{text!r} is blank, or holds a new line or another character that cannot be printed"
        raise JobError("MF110", what, cure="Write it in one line, its parts separated by commas")
    return text.strip()


Line = Annotated[str, parsed(_line)]
"""One printable line of at most 200 characters."""


def _email(text: object) -> object:
    """An address of mail: one @ between two words. Whether anybody reads it, the house will find out."""
    line = _line(text)
    if isinstance(line, str):
        name, _, host = line.partition("@")
        if not name or not host or "@" in host or any(letter.isspace() for letter in line):
            what = f"{line!r} is no address of mail: one @ stands between two words without spaces"
            raise JobError("MF105", what, cure='Write it as "ada@example.org"')
    return line


Email = Annotated[str, parsed(_email)]
"""An address of mail, such as ada@example.org."""


def _day(value: object) -> object:
    """A day, also from its text, which JSON has instead. Raises JobError MF105 for a text that is none."""
    if not isinstance(value, str):
        return value
    try:
        return date.fromisoformat(value.strip())
    except ValueError as error:
        raise JobError("MF105", f"{value!r} is no day: {error}", cure="Write it as 2026-09-30") from error


Day = Annotated[date, parsed(_day)]
"""A day, such as 2026-09-30."""


class ContactSection(Section):
    """[order.contact]: who orders."""

    name: Line | None = None
    """Whom the house asks."""
    organisation: Line | None = None
    """Firm or institute that pays."""
    address: Line | None = None
    """To which the plate is sent, in one line."""
    email: Email | None = None
    """Address of mail."""
    telephone: Line | None = None
    """Number, with the code of the country."""


class CdSection(Section):
    """[order.cd]: the width that the house measures and answers for."""

    feature: Line | None = None
    """Name of one of the plate's CD structures, as the order sheet lists them; default: the smallest."""
    tolerance: Length | None = None
    """Most that any measured width may be off."""
    mean_to_target: Length | None = None
    """Most that their mean may be off."""


class DefectsSection(Section):
    """[order.defects]: spots and holes of the chrome that are accepted."""

    size: Length
    """Defects smaller than this do not count."""
    density: float = Field(default=0.0, ge=0, le=1e6, allow_inf_nan=False)
    """Most of them on a square centimetre."""


class OrderSection(Section):
    """[order]: what the mask house is asked for.

    Tone, parity, side and a bias taken out of the data change these; nothing else does.
    """

    tone: Tone | None = None
    """Digitized data: "clear", polygons are openings of the chrome, or "dark", polygons are chrome."""
    parity: Reading | None = None
    """Whether the design is read as drawn, or as in a mirror, by who looks at the plate with its chrome as ``chrome``
    says."""
    chrome: ChromeSide | None = None
    """Side from which the plate is read: "up", towards who reads it, or "down", seen through the glass."""
    glass: Glass | None = None
    """Substrate; polyester is that of film masks."""
    thickness: Length | None = None
    """Of the substrate; default: that of [plate.glass] or of the plate's template."""
    film: Film | None = None
    """Absorber: chrome, chrome under its oxides, or silver in gelatine."""
    optical_density: float | None = Field(default=None, gt=0, le=12, allow_inf_nan=False)
    """Of the film; default: that of [plate]."""
    cd: CdSection | None = None
    """Width that is measured."""
    registration: Length | None = None
    """Most by which a feature may be from its place."""
    defects: DefectsSection | None = None
    """Defects that are accepted."""
    bias: Literal["none", "house", "data"] | None = None
    """"house" asks the house to make good the ``cd_bias`` of [process]; "data" has it taken out of the data, which the
    house then writes as they are; "none" has data as drawn written as they are."""
    protection: Protection | None = None
    """Pellicle or coat over the chrome."""
    corner_touches: Touches | None = None
    """Fate of clear dots that meet at a corner alone."""
    corner_width: Length | None = None
    """Width there: of the clear neck by which they join, or of the chrome between them where they stay apart."""
    revision: Line | None = None
    """Of the plate, on every paper and in the package's name."""
    date: Day | None = None
    """Of the order; rules of a house that were read long before it are told."""
    purchase_number: Line | None = None
    """Number of your own purchase order."""
    quantity: int | None = Field(default=None, ge=1, le=10_000)
    """Plates."""
    delivery: Line | None = None
    """When, and by whom."""
    contact: ContactSection | None = None
    """Who orders."""

    @property
    def mirrored(self) -> bool:
        """Whether the chrome side shows the mirror image of the design, which files then hold.

        Right reading with the chrome down is wrong reading with the chrome up.
        """
        return (self.parity == "wrong reading") != (self.chrome == "down")
