"""Constraints: each rule on openings whose answer is known, and sets of rules that nothing keeps."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from asked_displays import asked_display

from maskfab.base.errors import JobError, OpeningError
from maskfab.base.model import ORIENTATIONS, orient
from maskfab.designs.rules.constraints import RULES, Constraints
from maskfab.mask.dots import corner_touches, smallest_runs


def rows(*text):
    """Bottom row last, as one draws it."""
    return np.array([[c == "#" for c in row] for row in text])[::-1].copy()


def bar(y=0, x=0, height=6, width=17, dots=21):
    unit = np.zeros((dots, dots), dtype=np.bool_)
    unit[y : y + height, x : x + width] = True
    return unit


def names(constraints, unit):
    return {each.split(":")[0] for each in constraints.violations(unit)}


ODD = rows("#....", ".#...", ".....", "..##.", ".....")


@pytest.mark.parametrize(
    ("rule", "broken"),
    [
        ({}, set()),
        ({"clear_dots": 5}, {"clear_dots"}),
        ({"kissing": "cell"}, {"kissing"}),
        ({"min_feature_dots": 2}, {"min_feature_dots"}),
        ({"min_space_dots": 4}, {"min_space_dots"}),
        ({"rim_dots": 1}, {"rim_dots"}),
        ({"symmetry": "mirror"}, {"symmetry"}),
        ({"keep_out": ODD}, {"keep_out"}),
        ({"keep_out": ~ODD}, set()),
        ({"wires": asked_display(lines=20)}, {"wires"}),
        ({"circuits": asked_display(circuit_um2=5000.0)}, {"circuits"}),
        ({"circuits": asked_display()}, set()),
        ({"ports": 5}, {"ports"}),
        ({"emitters": asked_display(required=0.32)}, {"emitters"}),
    ],
    ids=str,
)
def test_each_rule_tells_what_it_is_about(rule, broken):
    constraints = Constraints(**{"clear_dots": 4, "dots": 5, **rule})
    assert names(constraints, ODD) == broken == constraints.broken(ODD)
    assert constraints.allows(ODD) is (not broken)


@pytest.mark.parametrize("symmetry", ["d4", "mirror", "rot180"])
def test_symmetry_is_that_of_the_model(symmetry):
    rng = np.random.default_rng(1)
    elements = {"d4": range(8), "mirror": (0, 4), "rot180": (0, 2)}[symmetry]
    for _ in range(20):
        unit = rng.random((6, 6)) < 0.3
        even = np.any([orient(unit, k) for k in elements], axis=0)
        assert Constraints(int(even.sum()), dots=6, symmetry=symmetry).allows(even)


@pytest.mark.parametrize("gutter", [0, 8000])
def test_neighbours_are_judged_as_if_they_were_drawn(gutter):
    """A corner is only where two by two cells meet: draw all of them and count."""
    rng = np.random.default_rng(7)
    used = (0, 3, 4)
    wide = gutter // 8000
    told = set()
    for _ in range(25):
        unit = rng.random((4, 4)) < rng.choice([0.15, 0.8])
        if corner_touches(unit):
            continue
        kisses, least = False, np.inf
        for cells in itertools.product(used, repeat=4):
            drawn = np.zeros((8 + wide, 8 + wide), dtype=np.bool_)
            places = itertools.product((0, 4 + wide), repeat=2)
            for (y, x), k in zip(places, cells, strict=True):
                drawn[y : y + 4, x : x + 4] = orient(unit, k)
            kisses |= corner_touches(drawn) > 0
            least = min(least, smallest_runs(drawn).opaque)
        constraints = Constraints(
            int(unit.sum()), dots=4, kissing="neighbours", min_space_dots=3, gutter_nm=gutter, orientations=used
        )
        broken = constraints.broken(unit)
        assert ("kissing" in broken) is kisses
        assert ("min_space_dots" in broken) is (least < 3)
        told |= {kisses}
    assert told == ({True, False} if gutter == 0 else {False})


def test_a_corner_dot_kisses_its_image_unless_cells_are_parted():
    held = Constraints(102, kissing="neighbours")
    assert names(held, bar()) == {"kissing"}
    assert held.allows(bar(x=2))
    assert Constraints(102, kissing="neighbours", gutter_nm=8000).allows(bar())
    assert Constraints(102, kissing="neighbours", orientations=(0,)).allows(bar())


def test_what_quick_judgement_allows_is_allowed():
    rng = np.random.default_rng(3)
    for _ in range(4):
        unit = np.zeros((9, 9), dtype=np.bool_)
        y, x = rng.integers(0, 6, 2)
        unit[y : y + 3, x : x + 4] = True
        shown = asked_display(required=0.15, lines=3)
        held = Constraints(int(unit.sum()), dots=9, emitters=shown, wires=shown, min_feature_dots=3)
        assert held.allows(unit) <= (not held.violations(unit))


def test_the_lights_centroid():
    shown = asked_display(required=0.129, keep=0.9)
    near, far = (Constraints(102, emitters=shown, centroid_px=limit) for limit in (0.05, 0.0))
    assert near.violations(bar()) == ()
    (said,) = far.violations(bar())
    assert said.startswith("centroid_px: ")


def test_a_footprint_that_cannot_be_is_proved():
    said = Constraints(102, emitters=asked_display(required=0.24)).violations(bar())
    assert len(said) == 1
    assert said[0].startswith("emitters: emitters above")
    assert "of the pixel) times their ratio do not fit" in said[0]


def test_rules_can_be_taken_off_and_kept():
    shown = asked_display(required=0.1, lines=4)
    held = Constraints(100, kissing="cell", rim_dots=2, wires=shown, keep_out=bar(), emitters=shown)
    assert set(held.active) == {"kissing", "rim_dots", "wires", "keep_out", "emitters"}
    assert held.without("kissing", "keep_out").active == ("rim_dots", "emitters", "wires")
    assert held.only("rim_dots").active == ("rim_dots",)
    assert held.without(*(rule.name for rule in RULES)).active == ()


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        ({"clear_dots": 26}, {"clear_dots"}),
        ({"clear_dots": 10, "rim_dots": 1}, {"clear_dots", "rim_dots"}),
        ({"clear_dots": 1, "rim_dots": 3}, {"clear_dots", "rim_dots"}),
        ({"clear_dots": 10, "keep_out": np.eye(5, k=0) == 0}, {"clear_dots", "keep_out"}),
        ({"clear_dots": 6, "symmetry": "d4"}, {"clear_dots", "symmetry"}),
        ({"clear_dots": 1, "dots": 6, "symmetry": "rot180"}, {"clear_dots", "symmetry"}),
        ({"clear_dots": 3, "min_feature_dots": 2}, {"clear_dots", "min_feature_dots"}),
        ({"clear_dots": 5, "min_feature_dots": 2}, {"clear_dots", "min_feature_dots"}),
        ({"clear_dots": 24, "min_feature_dots": 6}, {"min_feature_dots"}),
        ({"clear_dots": 24, "min_space_dots": 2}, {"clear_dots", "min_space_dots"}),
        ({"clear_dots": 24, "kissing": "neighbours", "ports": 2}, {"ports", "clear_dots"}),
        ({"clear_dots": 1, "ports": 6}, {"ports"}),
        ({"clear_dots": 1, "wires": asked_display(lines=20)}, {"wires"}),
        ({"clear_dots": 20, "circuits": asked_display(circuit_um2=120.0)}, {"circuits", "clear_dots"}),
        ({"clear_dots": 15, "emitters": asked_display(required=0.2)}, {"emitters", "clear_dots"}),
        ({"clear_dots": 1, "emitters": asked_display(required=0.33)}, {"emitters", "clear_dots"}),
        ({"clear_dots": 1, "emitters": asked_display(required=0.3)}, {"emitters"}),
    ],
    ids=lambda given: " ".join(sorted(map(str, given))),
)
def test_contradictions_name_their_rules(rules, expected):
    held = Constraints(**{"dots": 5, **rules})
    found = held.conflict()
    assert found is not None
    assert set(found.rules) == expected
    with pytest.raises((OpeningError, JobError), match=r"MF204|MF123"):
        held.require_possible()


def test_emitters_too_large_for_any_pixel_have_a_certificate():
    found = Constraints(1, dots=5, emitters=asked_display(required=0.3)).conflict()
    assert found is not None
    assert found.certificate is not None


@pytest.mark.parametrize(
    "held",
    [
        Constraints(1),
        Constraints(1, dots=1),
        Constraints(440),
        Constraints(441),
        Constraints(3, dots=2),
        Constraints(100, symmetry="d4", min_feature_dots=2),
        Constraints(6, dots=5, min_feature_dots=2),
        Constraints(7, dots=3, min_feature_dots=2),
        Constraints(1000, dots=64, ports=10, kissing="neighbours"),
        Constraints(50, dots=23, symmetry="rot180"),
    ],
    ids=lambda held: f"{held.clear_dots} of {held.dots}",
)
def test_what_can_be_is_let_through(held):
    assert held.conflict() is None
    held.require_possible()


def test_widths_that_cannot_be_are_just_those_that_no_opening_has():
    """All openings within 3 x 4 dots, against the formula."""
    counts = set()
    for bits in range(1, 1 << 12):
        unit = (bits >> np.arange(12) & 1).astype(np.bool_).reshape(3, 4)
        count = int(unit.sum())
        if count <= 7 and count not in counts and smallest_runs(unit).clear >= 2:
            counts.add(count)
    assert counts == {4, 6, 7}
    possible = {k for k in range(1, 8) if Constraints(k, dots=4, min_feature_dots=2).conflict() is None}
    assert possible == counts


def test_no_clear_dots():
    with pytest.raises(OpeningError, match="MF203"):
        Constraints(0).require_possible()
    assert names(Constraints(0), bar()) == {"clear_dots"}


@pytest.mark.parametrize(
    ("rules", "code"),
    [
        ({"clear_dots": -1}, "MF104"),
        ({"dots": 0}, "MF104"),
        ({"min_feature_dots": 0}, "MF104"),
        ({"centroid_px": float("nan")}, "MF104"),
        ({"centroid_px": 1.5}, "MF104"),
        ({"orientations": (8,)}, "MF104"),
        ({"orientations": ()}, "MF104"),
        ({"kissing": "never"}, "MF105"),
        ({"symmetry": "hexagonal"}, "MF105"),
        ({"keep_out": np.zeros((3, 3))}, "MF105"),
        ({"emitters": asked_display(min_width_nm=900_000)}, "MF117"),
        ({"emitters": asked_display(colour_gap_nm=8001)}, "MF118"),
        ({"circuits": asked_display(min_width_nm=13_001)}, "MF118"),
    ],
    ids=str,
)
def test_rules_of_no_sense(rules, code):
    with pytest.raises(JobError, match=code):
        Constraints(**{"clear_dots": 100, **rules})


def test_an_opening_of_another_size():
    with pytest.raises(JobError, match="MF105"):
        Constraints(4).allows(ODD)


def test_all_orientations_are_the_default():
    assert Constraints(1).orientations == tuple(range(ORIENTATIONS))
