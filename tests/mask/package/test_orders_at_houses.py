"""Every order that is shipped, at every house: what a comparison promises a package keeps."""

from __future__ import annotations

from pathlib import Path

import pytest

import maskfab as mf
from maskfab.base import resources
from maskfab.mask.houses.profiles import load_shop, shop_names
from maskfab.mask.package.pack import Bid, verify_package

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

ORDERS = ("order_chrome", "order_film", "order_through_glass")
SMALLER = (("4.2 mm", "336 um"), ('diameter = "4 mm"', 'diameter = "0.3 mm"'))
"""Two cells by two in a die are of the same kind as 25 by 25; labels on a smaller die of film are too fine for film."""


def small(kind: str, folder: Path) -> Path:
    text = resources.path(f"layouts/{kind}.toml").read_text()
    for old, new in SMALLER if "4.2 mm" in text else ():
        text = text.replace(old, new)
    job = folder / "job.toml"
    job.write_text(text.replace('opening = "openings/', f'opening = "{resources.path("layouts/openings")}/'))
    return job


def broken_promises(job: Path, folder: Path, few: set[str] | None = None) -> tuple[tuple[Bid, ...], list[str]]:
    """The answers of all houses to a job, and those of them, or of a few, of which no package is made that verifies."""
    bids, broken = mf.order.compare(job), []
    for bid in bids:
        if few is not None and bid.shop not in few:
            continue
        target = folder / f"{bid.shop}.zip"
        made = mf.order.pack(job, bid.shop, target)
        if (made.path is None) != (bid.answer == "does not"):
            broken.append(f"{bid.shop}: {bid.answer}, refused by {made.refused_by}")
        elif made.path is not None and any(each.passed is False for each in verify_package(made.path)):
            broken.append(f"{bid.shop}: {bid.answer}, and its package does not verify")
        assert made.answer == bid.answer
    return bids, broken


PECULIAR = {
    "order_through_glass": {"mr_nanotec"},  # holes on a layer of their own, which dark data have everywhere
    "order_film": {"jd_photo_data_film"},  # keyholes
    "order_chrome": {"photomask_portal"},
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", PECULIAR)
def test_a_house_that_takes_a_small_order_gets_a_package_that_verifies(kind, tmp_path):
    bids, broken = broken_promises(small(kind, tmp_path), tmp_path, PECULIAR[kind])
    assert broken == []
    assert {bid.shop for bid in bids} == set(shop_names())
    assert all(bid.blanks == () for bid in bids)
    for bid in bids:
        known = load_shop(bid.shop)
        missing = {
            "format": not (known.accepts.formats or known.accepts.ruled),
            "order_glass": known.offers.glasses is None,
            "order_film": known.offers.films is None,
            "min_feature": known.limits.min_feature_um is None,
        }
        assert {each.rule for each in bid.asked if each.limit is None} == {
            rule for rule, asked in missing.items() if asked
        }
        assert all(each.question in bid.mail for each in bid.asked)
        assert bid.taken == (not bid.refusals and not bid.asked)
    # Houses of which nobody knows whether they have film do not take it, and neither do all have to be asked.
    answers = {bid.shop: bid.answer for bid in bids}
    if kind == "order_film":
        assert {answers[each] for each in ("compugraphics", "pog", "photomask_portal", "mr_nanotec")} == {"ask first"}
    assert "takes it" in answers.values()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ORDERS)
def test_every_house_keeps_its_answer_to_a_small_order(kind, tmp_path):
    assert broken_promises(small(kind, tmp_path), tmp_path)[1] == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*ORDERS, "upc12"])
def test_a_house_that_takes_a_shipped_order_gets_a_package_that_verifies(kind, tmp_path):
    assert broken_promises(resources.path(f"layouts/{kind}.toml"), tmp_path)[1] == []
