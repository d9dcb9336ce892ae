"""Panels with a denser middle: equal light, and what the display pays."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, Emitters, Opening, Panel, Tiling, orient
from maskfab.camera.stop_cells import CELLS, lay
from maskfab.designs.design import require_cap
from maskfab.designs.maps.light import _climb, display_price, graded, middles
from maskfab.designs.maps.orientation_map import LIGHT_TOLERANCE
from maskfab.designs.maps.shares import Denser, beside, central, covered, nearest, stated
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import Display
from maskfab.display.emitted_light import Viewing, series, show
from maskfab.display.eye import SLOW_CPD, measured_rms
from maskfab.display.feasibility import DisplayRules
from maskfab.display.placement import footprint
from maskfab.display.turned_grain import turned_grain
from maskfab.job.camera import Stop
from maskfab.job.faults import parse_section
from maskfab.job.sections import EmittersSection, SearchSection
from maskfab.mask.panels import CellMap, check_map

DOTS = 7


def block(count):
    """So many dots, column by column from the corner."""
    mask = np.zeros(DOTS * DOTS, dtype=np.bool_)
    mask[:count] = True
    return mask.reshape(DOTS, DOTS).T


def blocks(count):
    """The same lying on its side, the only good one there is."""
    return [block(count) if count > 12 else block(count).T]


EMITTERS = parse_section(
    EmittersSection,
    {"required": 0.11, "gap_to_opening": "8 um", "colour_gap": "8 um", "min_width": "24 um"},
    where="test",
)
RULES = Constraints(12, dots=DOTS, dot_nm=24000)


@pytest.fixture(scope="module")
def found(error):
    return graded(block(12), error, Denser(0.45), blocks, constraints=RULES)


def test_the_middle_is_half_of_the_stop(error):
    middle = central(error)
    area = error.inside.reshape(CELLS, DOTS, CELLS, DOTS).sum(axis=(1, 3))
    assert area[middle].sum() / area.sum() == pytest.approx(0.5, abs=0.03)
    assert np.array_equal(middle, middle[::-1].T)


@pytest.mark.parametrize("share", [0.27, 0.35, 0.45])
def test_two_units_pass_the_light_of_one(error, share):
    shares = stated(block(12), error, Denser(share))
    dense, sparse = shares.dense, shares.sparse
    assert dense == round(share * DOTS**2) > 12 > sparse >= 1
    area = error.inside.reshape(CELLS, DOTS, CELLS, DOTS).sum(axis=(1, 3)) / DOTS**2
    light = np.where(central(error), dense, sparse) * area
    assert light.sum() == pytest.approx(12 * area.sum(), rel=0.5 / 12)


def test_the_light_is_that_of_the_uniform_panel(found):
    assert found.uniform_clear_dots == lay("uniform", block(12)).pupil.sum()
    assert abs(found.designed.clear_dots / found.uniform_clear_dots - 1) <= 10 * LIGHT_TOLERANCE


def test_every_cell_holds_the_unit_of_its_place(error, found):
    held = found.designed.orientations // ORIENTATIONS
    inside = error.inside.reshape(CELLS, DOTS, CELLS, DOTS).any(axis=(1, 3))
    assert np.array_equal(held[inside] == 0, central(error)[inside])


def test_a_denser_middle_restores_better(found):
    assert min(found.gain_db) > 0.5


def test_the_price_follows_from_the_areas(found):
    assert 0 < found.share < found.uniform_share < 1 / 3
    assert found.life_ratio == pytest.approx((found.uniform_share / found.share) ** -1.44)
    assert found.lines is None


def test_the_sparser_unit_lies_behind_the_denser_where_it_takes_no_room(found):
    dense, sparse = found.units
    assert not (sparse & ~dense).any()
    assert any(np.array_equal(sparse, orient(blocks(int(sparse.sum()))[0], k)) for k in range(ORIENTATIONS))
    alone = footprint(RULES.opening(dense), 24000, 0, range(ORIENTATIONS), RULES.emitters, largest=True)
    assert found.share == alone.found_share


def test_emitters_alike_in_all_cells_keep_clear_of_both_units():
    """What counts is what is clear in either unit, whichever is told first and wherever it lies."""
    dense, beyond = block(21), block(4)[:, ::-1]
    shares = [
        display_price(block(12), np.stack(pair), RULES)[1]
        for pair in ([dense, block(4)], [dense, beyond], [beyond, dense])
    ]
    both = footprint(RULES.opening(dense | beyond), 24000, 0, range(ORIENTATIONS), RULES.emitters, largest=True)
    assert shares[0] > shares[1] == shares[2] == both.found_share


def test_a_panel_that_is_no_denser_anywhere_costs_nothing():
    uniform_share, share, life_ratio = display_price(block(12), np.stack([block(12), block(4)]), RULES)
    assert (uniform_share / share, life_ratio) == (1, 1)


def test_a_cell_without_room_has_no_life():
    _, share, life_ratio = display_price(block(12), np.stack([block(49), block(4)]), RULES)
    assert (share, life_ratio) == (0, 0)


def test_both_units_keep_the_rules_and_beside_one_another(error):
    rules = Constraints(12, dots=DOTS, dot_nm=24000, min_feature_dots=2)
    with pytest.raises(JobError, match=r"MF123.*denser.*min_feature_dots"):
        graded(block(12), error, Denser(0.45), blocks, constraints=rules)


def test_emitters_that_fit_either_opening_may_fit_none_of_their_pairs(error):
    """Halves of the cell: the denser one lies below, the sparser one, if it may not turn, above."""
    asked = Display.of(DisplayRules.of(EMITTERS, None, None), Tiling.PERIODIC, 0, 4, 4)
    rules = Constraints(12, dots=DOTS, dot_nm=24000, orientations=(0,), emitters=asked)

    def halves(count):
        return [block(count).T if count > 12 else block(count).T[::-1]]

    shares = stated(block(12), error, Denser(0.45))
    for count in (shares.dense, shares.sparse):
        assert replace(rules, clear_dots=count).allows(halves(count)[0])
    with pytest.raises(JobError, match=r"MF123.*22 and 3 clear dots break emitters where they meet.*density"):
        graded(block(12), error, Denser(0.45), halves, constraints=rules)


@pytest.mark.parametrize("rule", [{"kissing": "neighbours"}, {"min_space_dots": 2}])
def test_units_that_keep_a_rule_may_break_it_beside_one_another(rule):
    """An open cell beside one with a closed rim: their corners meet at vertices, one dot lies between them."""
    whole, middle = np.ones((DOTS, DOTS), dtype=np.bool_), np.zeros((DOTS, DOTS), dtype=np.bool_)
    middle[1:-1, 1:-1] = True
    rules = Constraints(25, dots=DOTS, **rule)
    for unit in (whole, middle):
        assert replace(rules, clear_dots=int(unit.sum())).allows(unit)
        assert rules.broken_beside(unit[None]) is None
    assert rules.broken_beside(np.stack([whole, middle])) == next(iter(rule))
    assert Constraints(25, dots=DOTS).broken_beside(np.stack([whole, middle])) is None
    apart = replace(rules, gutter_nm=2 * rules.dot_nm)
    assert apart.broken_beside(np.stack([whole, middle])) is None


@pytest.mark.parametrize("share", [0.1, 12 / 49, 0.9, 1.1, math.nan])
def test_shares_that_cannot_be_are_told(error, share):
    with pytest.raises(JobError, match="MF104"):
        stated(block(12), error, Denser(share))


@pytest.mark.parametrize(("dense", "outer"), [(16, 1), (24, 1), (24, 6), (36, 3)])
def test_where_the_rest_is_stated_the_radius_follows_from_the_light(error, dense, outer):
    """To half a cell of the denser unit; denser cells are those nearest to the axis, and fewer the denser they are."""
    shares = stated(block(12), error, Denser(dense / DOTS**2, outer))
    area = covered(error)
    light = (np.where(shares.denser, dense, outer) * area).sum()
    assert abs(light - 12 * area.sum()) <= (dense - outer) / 2
    middles_of = np.hypot(*np.indices((CELLS, CELLS)) - (CELLS - 1) / 2)
    assert middles_of[shares.denser].max() <= middles_of[~shares.denser].min()
    assert np.array_equal(shares.denser, nearest(error, int(shares.denser.sum())))
    assert beside(dense + 1, (outer,), 12, error).denser.sum() <= shares.denser.sum()


@pytest.mark.parametrize("outer", [0, 12, 13])
def test_outer_dots_that_cannot_be_are_told(error, outer):
    with pytest.raises(JobError, match=r"MF104.*outer_dots = \d+ is not 1 or more and below the 12.*Choose 1 to 11"):
        stated(block(12), error, Denser(0.45, outer))


def test_all_light_in_the_middle_restores_best(error):
    """At a given cap, the less lies beyond the denser cells, the better."""
    at_cap = []
    for outer in (1, 4, 8):
        shares = stated(block(12), error, Denser(24 / DOTS**2, outer))
        drawn = np.random.default_rng(0).integers(ORIENTATIONS, size=(CELLS, CELLS))
        kinds = (drawn + ORIENTATIONS * ~shares.denser).astype(np.int8)
        at_cap.append(np.mean(error.psnr(error.laid(np.stack([block(24), block(outer)]), kinds))))
    assert at_cap[0] > at_cap[1] > at_cap[2]


def test_a_search_takes_the_most_that_rules_leave(coarse):
    """No unit of more than 20 dots keeps the rules: of those that do, the densest is the best, with 1 to 3 beyond."""

    def find(count):
        if count > 20:
            raise JobError("MF123", "none keeps the rules", where="test", cure="none")
        return [block(count)]

    looked = middles(block(12), coarse, Denser("search"), find, constraints=RULES)
    assert looked[0].shares.dense == 20
    assert looked[0].shares.sparse in {1, 2, 3}
    assert [one.value for one in looked] == sorted((one.value for one in looked), reverse=True)
    assert all(not (one.units[1] & ~one.units[0]).any() for one in looked)
    found = graded(block(12), coarse, Denser("search"), find, constraints=RULES)
    assert int(found.units[0].sum()) == 20
    assert abs(found.designed.clear_dots / found.uniform_clear_dots - 1) <= 10 * LIGHT_TOLERANCE
    assert found.denser_cells == (looked[0].shares.denser & (covered(coarse) > 0)).sum()


def test_rules_that_no_denser_opening_keeps_are_told(error):
    def none(count):
        raise JobError("MF123", "none keeps the rules", where="test", cure="none")

    with pytest.raises(JobError, match=r"MF123.*no denser opening than 12 dots.*slow_grain"):
        middles(block(12), error, Denser("search"), none, constraints=RULES)


@pytest.mark.parametrize("top", [3, 17, 40, 64])
def test_a_climb_finds_the_top_of_a_hill_and_looks_at_few(top):
    seen = {}

    def value(count):
        seen[count] = -abs(count - top) if count <= 80 else -math.inf
        return seen[count]

    _climb(value, 1, 128)
    assert max(seen, key=seen.get) == top
    assert len(seen) < 40


def test_a_map_that_shares_light_covers_the_stop():
    """Of 24 cells of 168 um, 4032 um; one opening's map may be smaller, for its light is the same beyond."""
    panel = Panel(Opening("a", block(12), 24000), 24000, 0, np.zeros((30, 30), dtype=np.int8), Tiling.MAP, 0)
    given = CellMap("m", np.zeros((24, 24), dtype=np.int8))
    check_map(given, panel, Stop("circle", 4000.0), "die 'A'", where="die[0].map")
    with pytest.raises(JobError, match=r"MF114.*4032 um wide, less than the stop of 5000 um.*Design the map"):
        check_map(given, panel, Stop("circle", 5000.0), "die 'A'", where="die[0].map")


def test_a_share_above_the_cap_is_refused_before_any_work():
    """Emitters of a fifth of the pixel leave 40 % for openings, and gaps round them less."""
    asked = Display.of(
        DisplayRules.of(EMITTERS.model_copy(update={"required": 0.2}), None, None), Tiling.RANDOM, 0, 4, 4
    )
    rules = Constraints(12, dots=DOTS, dot_nm=24000, emitters=asked)
    plain = {"name": "a", "dots": DOTS, "pitch": "168 um", "clear_dots": 5, "map": "equal_light", "fit": True}
    require_cap(parse_section(SearchSection, {**plain, "density": 0.11}, where="test"), rules, where="design")
    with pytest.raises(JobError, match=r"MF123 density = 0.39 is above the cap: .* 20.0% is asked.*Use at most 0\.\d+"):
        require_cap(parse_section(SearchSection, {**plain, "density": 0.39}, where="test"), rules, where="design")


def test_grain_of_every_order_is_what_a_random_field_is_measured_to_have():
    """Against the Fourier series of a panel of 64 x 64 pixels that draw their orientations."""
    labels = np.zeros((DOTS, DOTS), dtype=np.uint8)
    labels[0, :5], labels[1:3, 0:2], labels[5:, 4:] = 1, 2, 3
    emitters, viewing = Emitters(labels, 24000), Viewing(168.0, 300_000.0)
    drawn = np.random.default_rng(0).integers(ORIENTATIONS, size=(64, 64)).astype(np.int8)
    panel = Panel(Opening("a", block(1)[::-1], 24000), 24000, 0, drawn, Tiling.RANDOM, 0, emitters=emitters)
    seen = series(show(panel, np.ones((64, 64, 3)), DOTS), viewing, SLOW_CPD)
    assert turned_grain(emitters, viewing) == pytest.approx(measured_rms(seen, 0.0, SLOW_CPD), rel=0.06)
    assert turned_grain(emitters, viewing, elements=[3]) == pytest.approx(0, abs=1e-9)
