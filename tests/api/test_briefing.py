"""Questions to a display engineer on a terminal."""

from __future__ import annotations

import pytest

import maskfab as mf
from maskfab.api.advising import ask_brief
from maskfab.api.results import Asked
from maskfab.base.errors import JobError
from maskfab.job.brief import Brief, job_text, modules, questions, snapped


def _asked(lines, **more):
    """A terminal at which these lines are typed, and what it showed."""
    told, typed = [], iter(lines)

    def prompt(question):
        told.append(question)
        return next(typed)

    return Asked(Brief.of, {}, attended=True, tell=told.append, prompt=prompt, **more), told


def test_enter_takes_every_default_that_is_shown():
    asked, told = _asked([""] * len(questions()))
    assert ask_brief(asked, {}) == Brief.of({"pitch": "400 dpi", "camera": "phone_main"})
    assert len(told) == 1 + len(questions()) + len(modules())
    assert "  laptop: laptop, webcam of 5 MP: OmniVision OV5647" in told
    assert told[1].endswith("[400 dpi: a phone]")
    assert any(line.startswith("least gap between colours [6 um: ") for line in told)


def test_defaults_follow_the_pitch_that_was_typed():
    asked, told = _asked(["150 dpi", *[""] * (len(questions()) - 1)])
    brief = ask_brief(asked, {})
    assert (brief.colour_gap, brief.lines, brief.distance) == (8.0, 4, 700e3)
    assert any("[8 um: " in line for line in told)


def test_a_bad_answer_is_asked_again_with_the_cure():
    answers = ["63", "63.5 um", *["", "", "", "120 %", "60 %"], *[""] * (len(questions()) - 5)]
    asked, told = _asked(answers)
    brief = ask_brief(asked, {})
    assert (brief.pitch, brief.emitters) == (63.5, 0.6)
    refused = [line for line in told if ". Write it as" in line]
    assert len(refused) == 2
    assert 'Write it as "168 um"' in refused[0]
    assert '"28 %"' in refused[1]


def test_what_contradicts_an_earlier_answer_is_asked_again():
    given = {"dpi": "400", "lines": "2", "line": "2 um"}
    keys = [question.key for question in questions() if question.key not in {"pitch", "lines", "line"}]
    lines = [{"space": "60 um"}.get(key, "") for key in keys]
    lines.insert(keys.index("space") + 1, "3 um")
    asked, told = _asked(lines)
    assert ask_brief(asked, given).space == 3.0
    assert sum("lines = 2 take" in line for line in told) == 1


@pytest.mark.parametrize("more", [{"as_json": True}, {"attended": False}])
def test_nobody_is_asked_elsewhere(more):
    asked = Asked(Brief.of, {}, **{"attended": True, "prompt": pytest.fail, **more})
    with pytest.raises(JobError, match="MF105 no answer says camera"):
        ask_brief(asked, {"dpi": "400"})
    assert ask_brief(asked, {"dpi": "400", "camera": "laptop"}).pitch == 63.5


@pytest.mark.slow
@pytest.mark.parametrize(
    "answers",
    [
        {"dpi": "400", "camera": "phone_main"},
        {"dpi": "220", "camera": "laptop", "lux": "300 lux"},
        {"dpi": "150", "camera": "car_cabin", "lux": "100 lux"},
    ],
    ids=("phone", "laptop", "car"),
)
def test_displays_of_answers_are_designed_and_fit(answers, tmp_path):
    job = tmp_path / "job.toml"
    job.write_text(job_text(snapped(Brief.of(answers))), encoding="utf-8")
    design = mf.design(job, budget="15 s")
    assert design.passed
    for key, text in design.texts().items():
        (tmp_path / f"{key}.toml").write_text(text, encoding="utf-8")
    found = mf.check(job)
    assert found.passed
    assert str(found).count(": FITS") >= 2
