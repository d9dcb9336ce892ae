"""Plates that a house takes or refuses, by what its profile publishes, and a plate judged as a package draws it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

from maskfab.base.model import Plate
from maskfab.job.shop import Shop
from maskfab.job.values import SHOP_FORMATS
from maskfab.mask.houses.adaptation import fitted
from maskfab.mask.houses.findings import Finding, check_shop

Edits: TypeAlias = tuple[tuple[str, str], ...]

FIVE_INCH = (('blank = "27 mm"', 'blank = "5 in"'), ('writable = "22 mm"', 'writable = "100 mm"'))
FILM = (
    *(("8 um", "32 um"), ("8 um", "32 um"), ("56 um", "224 um"), ("56 um", "224 um")),
    *FIVE_INCH,
    ('die_size = "560 um"', 'die_size = "8960 um"'),
    ('die_pitch = "2 mm"', 'die_pitch = "12 mm"'),
)
"""Coarse enough for film, dots of 32 um, with labels as large as they get."""
DARK = (("[plate]", '[order]\ntone = "dark"\n\n[plate]'),)
LARGEST_MM = 2000
"""Side of the largest plate that a job may ask for."""
DOT_UM = 8
"""Of the small job as it is, with its corners that touch."""
SQUARE = (
    'name = "square"\npitch = "56 um"\ndots = 7\ngrid = """\n'
    + (".......\n" * 2)
    + ("..###..\n" * 3)
    + (".......\n" * 2)
    + '"""\n'
)
DOTS = tuple(
    edit for _ in range(2) for edit in (('dot = "8 um"', 'dot = "0.8 um"'), ('pitch = "56 um"', 'pitch = "5.6 um"'))
)
# Dies are no larger than it takes to have nothing finer on their labels.
FINE = (*DOTS, ('diameter = "400 um"', 'diameter = "150 um"'), ('die_size = "560 um"', 'die_size = "168 um"'))
LARGE = (('die_size = "560 um"', 'die_size = "8.4 mm"'), ('die_pitch = "2 mm"', 'die_pitch = "10 mm"'))


def taken_as(shop: Shop) -> Edits:
    """Edits that make the small job a plate which a house takes."""
    coarse = FILM if (shop.limits.min_feature_um or 0) > DOT_UM else ()
    return (*coarse, *on_blank(shop, coarse), *(() if "clear" in shop.order.tones else DARK))


def on_blank(shop: Shop, edits: Edits = ()) -> Edits:
    """Edits that put a plate on the first blank that the house has in stock; of others nothing has to change."""
    if not shop.plate.blanks_in:
        return ()
    size = f'blank = "{shop.plate.blanks_in[0]:g} in"'
    return ((FIVE_INCH[0][1], size),) if FIVE_INCH[0] in edits else ((FIVE_INCH[0][0], size), *FIVE_INCH[1:])


def opening_for(shop: Shop) -> str | None:
    """An opening whose dots meet by no corner, for houses that could not draw the small job's; else that of the job."""
    return SQUARE if False in (shop.polygons.shared_boundaries, shop.polygons.corner_touches) else None


def refusals(shop: Shop) -> Iterator[tuple[str, tuple[str, ...], Edits]]:
    """Rules that a profile publishes, each with formats and edits of the small job that break it and no other rule."""
    taken = taken_as(shop)
    if shop.accepts.formats is not None:
        yield "format", (next(each for each in SHOP_FORMATS if each not in shop.accepts.formats),), taken
    if shop.limits.min_feature_um is not None:
        yield "min_feature min_space", (), (*FINE, *on_blank(shop))
    if shop.plate.blanks_in:
        yield "blank", (), (*FILM, (FIVE_INCH[0][1], 'blank = "141 mm"')) if FIVE_INCH[0] in taken else ()
    elif shop.plate.largest_mm is not None and max(shop.plate.largest_mm) < LARGEST_MM:
        side = FIVE_INCH[0][1] if FIVE_INCH[0] in taken else FIVE_INCH[0][0]
        yield "blank", (), (*taken, (side, f'blank = "{max(shop.plate.largest_mm) + 1} mm"'))
    if shop.limits.max_flashes is not None:
        yield "flashes", (), (*taken, *LARGE)
    if shop.names.block_equals_layer is False:
        yield "block_name", ("dxf_r12",), (*taken, ('name = "PLAIN"', 'name = "CLEAR"'))


def checked(plate: Plate, shop: Shop, *given: Any) -> tuple[Finding, ...]:
    """A plate by the rules of a house, as its package would draw it."""
    return check_shop(fitted(plate, shop), shop, *given)
