"""Edits of the small job that make it a plate which a house takes, and a plate judged as a house's package draws it."""

from __future__ import annotations

from typing import Any

from maskfab.base.model import Plate
from maskfab.job.shop import Shop
from maskfab.mask.houses.adaptation import fitted
from maskfab.mask.houses.findings import Finding, check_shop

FIVE_INCH = (('blank = "27 mm"', 'blank = "5 in"'), ('writable = "22 mm"', 'writable = "100 mm"'))
FILM = (
    *(("8 um", "32 um"), ("8 um", "32 um"), ("56 um", "224 um"), ("56 um", "224 um")),
    *FIVE_INCH,
    ('die_size = "560 um"', 'die_size = "8960 um"'),
    ('die_pitch = "2 mm"', 'die_pitch = "12 mm"'),
)
"""Coarse enough for film, dots of 32 um, with labels as large as they get."""
DARK = (("[plate]", '[order]\ntone = "dark"\n\n[plate]'),)
TAKEN_AS = {
    "gesim": FIVE_INCH,
    "jd_photo_data_film": FILM,
    "mems_exchange_gca3600": (*FIVE_INCH, *DARK),
    "topro_emulsion": FILM,
    "topro_film": FILM,
    "ualberta_dwl200": FIVE_INCH,
}
"""By the names of profiles that do not take it as it is."""


def checked(plate: Plate, shop: Shop, *given: Any) -> tuple[Finding, ...]:
    """A plate by the rules of a house, as its package would draw it."""
    return check_shop(fitted(plate, shop), shop, *given)
