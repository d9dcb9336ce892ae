"""Rules are objects of one registry: what one of them states holds everywhere, and a new one needs nothing else."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from asked_displays import asked_display
from pydantic import Field

from maskfab.api.about import explain
from maskfab.base.arrays import Mask
from maskfab.base.errors import InputError, JobError
from maskfab.base.model import Opening
from maskfab.designs.maps.alternation import require_places
from maskfab.designs.rules import constraints as registry
from maskfab.designs.rules.constraints import RULES, Constraints
from maskfab.designs.rules.families import bars
from maskfab.designs.rules.rule import Conflict, Rule, price_key, priced_rule
from maskfab.designs.search.annealing import anneal, nearest, scan
from maskfab.designs.search.result import Designed, constraints_of, of_prices, prices
from maskfab.job.faults import parse_section
from maskfab.job.reference import keys_of
from maskfab.job.sections import RulesSection, SearchSection
from maskfab.mask.opening_file import opening_text, parse_opening
from maskfab.report.documents.die import Stated, stated_design
from maskfab.report.text import designed_lines

CELL = 3


class MoreRules(RulesSection):
    """The rules of a job with one more."""

    open_rows: int | None = Field(default=None, ge=1)
    """Most rows of the cell that hold clear dots."""


class MoreSearch(SearchSection):
    """A search with one more rule."""

    rules: MoreRules = MoreRules()


def many_rows(constraints: Constraints, unit: Mask) -> str | None:
    used = int(unit.any(axis=1).sum())
    return f"{used} rows, most {constraints['open_rows']}" if used > constraints["open_rows"] else None


def full_rows(constraints: Constraints) -> Conflict | None:
    """So many rows have fewer dots than the count."""
    most = constraints["open_rows"] * constraints.dots
    return Conflict(("open_rows", "clear_dots"), f"at most {most}") if constraints.clear_dots > most else None


OPEN_ROWS = Rule("open_rows", "rows", many_rows, proof=full_rows, section=MoreRules)


@pytest.fixture
def more(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that is done to add a rule, beside its key."""
    monkeypatch.setattr(registry, "RULES", (*RULES, OPEN_ROWS))


def section(**changed: object) -> MoreSearch:
    return parse_section(MoreSearch, {"name": "x", "dots": 6, "pitch": "168 um", "clear_dots": 9, **changed}, where="t")


@pytest.mark.usefixtures("more")
def test_a_rule_that_is_registered_is_checked() -> None:
    column = np.zeros((6, 6), dtype=np.bool_)
    column[:5, 0] = True
    rules = Constraints(5, dots=6, open_rows=2)
    assert rules.violations(column) == ("open_rows: 5 rows, most 2",)
    assert rules.broken(column) == {"open_rows"}
    assert rules.first_broken(column) == "open_rows"
    assert rules.allows(column.T)
    assert rules.active == ("open_rows",)
    assert nearest(column, rules).any(axis=1).sum() <= 2
    assert Constraints(5, dots=6, open_rows=None).active == ()


@pytest.mark.usefixtures("more")
def test_a_rule_that_is_registered_is_refused_in_conflict_and_out_of_range() -> None:
    with pytest.raises(
        JobError, match=r"MF123.*open_rows and clear_dots together: at most 12.*design\.rules\.open_rows"
    ):
        constraints_of(section(clear_dots=13, rules={"open_rows": 2})).require_possible()
    constraints_of(section(clear_dots=12, rules={"open_rows": 2})).require_possible()
    with pytest.raises(JobError, match=r"MF104.*open_rows = 0 must lie between 1 and inf.*design\.rules\.open_rows"):
        Constraints(5, dots=6, open_rows=0)


@pytest.mark.usefixtures("more")
def test_a_rule_that_is_registered_is_searched_for_priced_and_reported() -> None:
    rules = constraints_of(section(rules={"open_rows": 2, "rim_dots": 1}, clear_dots=8))
    tall = np.arange(36).reshape(6, 6) // 6

    def height(unit: Mask) -> float:
        return float(tall[unit].max() - tall[unit].min())

    best = scan(bars(6, 8), height, rules).best
    walked = anneal(best.unit, height, rules, evaluations=50)
    assert max(best.unit.any(axis=1).sum(), walked.unit.any(axis=1).sum()) <= 2
    paid = prices(bars(6, 8), height, rules)
    # Rows of a bar of 2 x 4 dots are one apart, those of 4 x 2 three.
    assert [(each.rule, each.alone, each.last) for each in paid.each] == [("rim_dots", 0, 0), ("open_rows", 2, 2)]
    facts = {"shape": best.name, **of_prices(paid)}
    found = Designed(Opening("x", best.unit, 28_000, facts), best.name, (20.0, 21.0, 22.0), None, 9, paid)
    stated = stated_design(Stated(parse_opening(opening_text(found.opening)).provenance, 28.0), (24, 32, 40))
    assert stated["prices"] == [{"rule": "rim dots", "price": 0}, {"rule": "open rows", "price": 2}]
    assert "  open_rows: 2.000 dB if it is the only rule, 2.000 dB on top of the others" in designed_lines(found, ())
    bounded = designed_lines(replace(found, head_room=(0.5, 3.0, 287.0)), ())
    assert "proven headroom (frame interior): at most 0.50 dB at 24" in bounded
    # What no design could come near is not told, nor a line of nothing else.
    assert not any("headroom" in line for line in designed_lines(replace(found, head_room=(1.5, 3.0, 287.0)), ()))


def test_a_rule_that_is_not_registered_is_refused_by_name() -> None:
    with pytest.raises(JobError, match=r"MF105.*open_rows"):
        Constraints(5, dots=6, open_rows=2)


def test_every_key_of_the_rules_is_a_rule() -> None:
    stated = {rule.name for rule in RULES if rule.section is RulesSection}
    assert stated == set(RulesSection.model_fields)
    assert len({rule.name for rule in RULES}) == len(RULES)
    for rule in RULES:
        (key,) = keys_of(rule.where)
        assert key.name == (rule.key or rule.name)
        assert not rule.asks(rule.default)
    assert Constraints(9, **{rule.name: rule.default for rule in RULES if not rule.key}).active == ()


def test_explaining_a_rule_says_when_it_is_refused() -> None:
    told = explain("design.rules.ports").text
    assert "Refused if:  A line through every port closes a dot of each row" in told
    assert "Refused if" not in explain("design.rules.rim_dots").text


def test_words_are_those_of_the_key() -> None:
    for name, words in (("symmetry", "d4, mirror, rot180"), ("kissing", "allowed, cell, neighbours")):
        with pytest.raises(JobError, match=rf"MF105.*{name} = 'x'.*design\.rules\.{name}.*Use {words}"):
            Constraints(9, **{name: "x"})


def test_a_price_is_found_under_the_key_that_it_was_stated_by() -> None:
    assert [priced_rule(price_key(rule.name)) for rule in RULES] == [rule.name for rule in RULES]
    assert priced_rule("rules_cost_db") is None


EVERY = [
    np.array(bits, dtype=np.bool_).reshape(CELL, CELL) for bits in itertools.product((False, True), repeat=CELL**2)
]
SLOW = {rule.name for rule in RULES if rule.slow}
VALUES = {
    "keep_out": [np.eye(CELL, dtype=np.bool_)],
    "rim_dots": [1],
    "symmetry": ["d4", "mirror", "rot180"],
    "kissing": ["cell", "neighbours"],
    "min_feature_dots": [2, 4],
    "min_space_dots": [2],
    "circuits": [asked_display(circuit_um2=70.0), asked_display(circuit_um2=150.0)],
    "wires": [asked_display(lines=5), asked_display(lines=2)],
    "ports": [1, 4],
    "emitters": [asked_display(required=0.12), asked_display(required=0.3)],
}


@pytest.mark.parametrize(
    ("rule", "value"),
    [
        # Wires that most openings leave room for are laid hundreds of times.
        pytest.param(rule, value, marks=[pytest.mark.slow] if rule == "wires" and number else [])
        for rule, values in VALUES.items()
        for number, value in enumerate(values)
    ],
)
def test_no_opening_keeps_what_is_proved_to_contradict(rule: str, value: object) -> None:
    """Every opening of 3 x 3 dots, judged one by one, beside the proofs for its count."""
    kept = dict.fromkeys(range(1, CELL**2 + 1), False)
    every = {count: Constraints(count, dots=CELL, **{rule: value}) for count in kept}
    for unit in EVERY[1:]:
        count = int(unit.sum())
        kept[count] = kept[count] or every[count].allows(unit)
    for count, constraints in every.items():
        found = constraints.conflict()
        assert (found is not None) >= (not kept[count]) or rule in SLOW, (rule, value, count)
        assert found is None or not kept[count], (rule, value, count, found)
        assert found is None or set(found.rules) <= {"clear_dots", rule}


@pytest.mark.parametrize(
    ("rule", "value"),
    [(name, values[-1]) for name, values in VALUES.items()] + [("centroid_px", 0.2)],
    ids=lambda each: each if isinstance(each, str) else "",
)
def test_what_holds_for_one_place_only_is_not_moved(rule: str, value: object) -> None:
    """Light comes from emitters that are laid round one place of the opening, as footprints are."""
    constraints = Constraints(4, dots=CELL, **{rule: value})
    if rule in {"keep_out", "rim_dots", "symmetry", "min_feature_dots"}:
        require_places(constraints)
        return
    with pytest.raises(InputError, match=rf"MF123.*{rule}"):
        require_places(constraints)
