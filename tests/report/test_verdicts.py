"""Five verdicts, each of its own checks: none is said for another."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from maskfab.base.model import Quantity
from maskfab.display.drive import BY_AREA, BY_BOXES
from maskfab.display.emitter_rules import Verdict
from maskfab.report.verdicts import Verdicts


def check(name: str, passed: bool | None = True) -> Quantity:
    return Quantity(name, 1.0, "measured", limit=2.0, passed=passed)


def displays(*verdicts: Verdict, how: str = BY_AREA) -> dict[str, SimpleNamespace]:
    answers = (SimpleNamespace(verdict=verdict, circuits_by=how, judged=None) for verdict in verdicts)
    return {f"DIE{number}": answer for number, answer in enumerate(answers)}


@pytest.mark.parametrize(
    ("failed", "files", "optics"),
    [
        (None, True, True),
        ("readback_xor_area", False, True),
        ("strehl_invariant_error", True, False),
        ("emitter_rules_broken", True, True),
    ],
)
def test_a_failed_check_counts_for_its_own_subject_alone(failed, files, optics):
    names = ("readback_xor_area", "strehl_invariant_error", "emitter_rules_broken")
    found = Verdicts.of([check(name, name != failed) for name in names], {}, 1)
    assert (found.files.passed, found.optics.passed) == (files, optics)
    assert (found.files.checks, found.optics.checks) == (1, 1)


def test_what_was_not_judged_neither_passes_nor_fails():
    found = Verdicts.of([check("polygons", None)], {}, 3)
    assert (found.files.passed, found.optics.passed, found.display.verdict) == (None, None, None)
    assert [line.split(": ")[1] for line in found.lines] == ["NOT CHECKED", "NOT CHECKED", "NOT JUDGED"]


@pytest.mark.parametrize(
    ("answers", "verdict", "told"),
    [
        ((Verdict.FITS, Verdict.FITS), Verdict.FITS, "2 of 3 fit"),
        ((Verdict.FITS, Verdict.UNKNOWN), Verdict.UNKNOWN, "1 of 3 fits, 1 unknown"),
        ((Verdict.UNKNOWN, Verdict.DOES_NOT_FIT), Verdict.DOES_NOT_FIT, "0 of 3 fit, 1 does not, 1 unknown"),
        ((Verdict.DOES_NOT_FIT, Verdict.DOES_NOT_FIT), Verdict.DOES_NOT_FIT, "0 of 3 fit, 2 do not"),
    ],
)
def test_the_worst_answer_on_displays_stands_for_all_and_each_is_counted(answers, verdict, told):
    found = Verdicts.of([check("polygons")], displays(*answers), 3)
    assert found.display.verdict is verdict
    assert found.lines[:3] == (
        "FILES: PASS, files check; no mask house chosen: 1 of 1 checks pass",
        "OPTICS: NOT CHECKED",
        f"FITS: {verdict.value}: {told}; {BY_AREA}",
    )


def test_the_words_tell_how_circuits_were_judged():
    found = Verdicts.of([], displays(Verdict.FITS, how=BY_BOXES), 1)
    assert found.lines[2] == f"FITS: FITS: 1 of 1 fits; {BY_BOXES}"
    assert found.to_dict()["display"]["circuits"] == BY_BOXES
    assert list(found.to_dict()["display"]) == ["dies", "fits", "does_not_fit", "unknown", "verdict", "circuits"]
