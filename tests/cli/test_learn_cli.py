"""maskfab learn, and maskfab simulate with what it leaves."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from once import leaves

from maskfab.api import photographs as verb
from maskfab.api.photographs import learn, simulate
from maskfab.base.errors import JobError
from maskfab.base.work import Clock, silent
from maskfab.camera import learning
from maskfab.camera.learning import Checkpoint, Course, Run, Training
from maskfab.camera.record import Blur, Record
from maskfab.camera.restorers.network import View, shown
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scenes import Photograph
from maskfab.cli.program import run_command_line
from maskfab.findings.photographs import Conditions, Surroundings, learned_restorers, trade_of
from maskfab.mask.formats.exr import write_png
from maskfab.mask.job import load_job

ROOT = Path(__file__).parents[2]
JOB = ROOT / "layouts" / "toled_against_ours.toml"
EPSILON = 0.2


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    write_png(leaves(3, 832, 832).values, folder / "leaves.png", white=1.0)
    return folder


@pytest.fixture(scope="module")
def untrained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint of T-OLED at 32 dB, of no steps."""
    job = load_job(JOB)
    asked = Conditions.of(job, "camera", [32])
    design, _ = asked.design("TOLED", job.panels()["TOLED"], Surroundings.of(job))
    course = Course(widths=(8, 12))
    state = Training(course, lambda _: pytest.fail("nothing is taught")).state()
    path = tmp_path_factory.mktemp("trained") / "toled.npz"
    Checkpoint(trade_of(job, asked, design), course, View({4000.0: EPSILON}), 0.0, (), state).write(path)
    return path


@pytest.fixture
def filtered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Records are shown as the Wiener filter restores them, for total variation takes seconds."""

    def planes(_: View, record: Record, blur: Blur) -> np.ndarray:
        picture = Wiener().prepare(record, blur)(EPSILON)
        return shown(np.concatenate([picture, picture, picture[:1]]))

    monkeypatch.setattr(View, "planes", planes)


def without_photographs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verb, "evaluate", lambda *_, **__: pytest.fail("a photograph was taken"))


@pytest.mark.usefixtures("filtered")
def test_an_untrained_network_restores_what_it_is_shown_whatever_the_strength(
    untrained: Path, photographs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fixed = replace(Conditions.of(load_job(JOB), "camera").protocol, strengths=(EPSILON,))
    monkeypatch.setattr("maskfab.findings.photographs.Protocol", lambda *_, **__: fixed)
    found = simulate(
        JOB, die="TOLED", images=photographs, levels=[32], restore=["wiener", "auto"], checkpoints=[untrained]
    )
    by = {score.restorer: score for score in found.table.scores}
    assert list(by) == ["wiener", "learned", "auto"]
    assert by["learned"].psnr == pytest.approx(by["wiener"].psnr, abs=1e-3)
    assert by["auto"].chosen in ("wiener", "learned")


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--die", "TOLED", "--die", "OURS", "--level", "32"], "OURS"),
        (["--die", "OURS", "--level", "32"], "die TOLED"),
        (["--die", "TOLED", "--level", "24"], "light of 32 dB"),
        (["--die", "TOLED", "--level", "32", "--light", "code"], "light linear light"),
        (["--die", "TOLED", "--level", "32", "--protocol", "f1"], "light linear light"),
    ],
)
def test_a_checkpoint_is_refused_before_any_photograph(
    untrained: Path,
    options: list[str],
    told: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    without_photographs(monkeypatch)
    assert run_command_line(["simulate", str(JOB), *options, "--checkpoint", str(untrained), "--json", "--quiet"]) == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["code"] == "MF148"
    assert told in error["what"]


@pytest.mark.parametrize(
    "change",
    [
        ('focal = "10 mm"', 'focal = "9 mm"'),
        ('opening = "openings/toled.toml"', 'opening = "openings/bar.toml"'),
        ("[plate]", "[sensor]\nread_noise = 3\n\n[plate]"),
        ("[plate]", "[exposure]\nsnr = [32]\nbrackets = [1, 4]\n\n[plate]"),
    ],
)
def test_a_checkpoint_is_refused_for_a_job_that_changed(
    untrained: Path, tmp_path: Path, change: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    without_photographs(monkeypatch)
    text = JOB.read_text().replace(*change)
    for folder in ("openings", "maps"):
        text = text.replace(f'= "{folder}/', f'= "{JOB.parent / folder}/')
    (tmp_path / "job.toml").write_text(text)
    with pytest.raises(JobError, match="MF148"):
        simulate(tmp_path / "job.toml", die="TOLED", levels=[32], checkpoints=[untrained])


def test_a_die_has_one_checkpoint(untrained: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without_photographs(monkeypatch)
    with pytest.raises(JobError, match=r"MF105 .*both of die TOLED"):
        simulate(JOB, die="TOLED", levels=[32], checkpoints=[untrained, untrained])


def test_photographs_without_a_network_do_not_load_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "maskfab.camera.learning", None)
    job = load_job(JOB)
    assert learned_restorers([], job, Conditions.of(job, "camera"), []) == {}


def test_learned_needs_a_checkpoint(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["simulate", str(JOB), "--die", "TOLED", "--restore", "learned"]) == 2
    assert "--checkpoint" in capsys.readouterr().err


@pytest.mark.usefixtures("filtered")
def test_a_network_is_trained_and_trained_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def drawn(seed: int, turn: int, shape: tuple[int, int] = (0, 0), *, lamps: bool) -> Photograph:
        return replace(leaves(1, 832, 832), name=f"leaves{seed}", number=seed)

    monkeypatch.setattr(learning, "drawn", drawn)
    monkeypatch.setattr(learning, "Course", lambda seed, **_: replace(SMALL, seed=seed))
    # A training of one step, which no budget of the command line allows.
    monkeypatch.setattr(verb, "Clock", lambda budget_s, refuses: Clock(budget_s))
    path = tmp_path / "toled.npz"
    arguments = ["learn", str(JOB), "--die", "TOLED", "--level", "32", "--minutes", "1e-6", "-o", str(path)]
    told = []
    for _ in range(2):
        assert run_command_line([*arguments, "--json"]) == 0
        out = capsys.readouterr()
        told.append(json.loads(out.out))
        assert "dB over tv" in out.err
    assert [each["step"] for each in told[1]["history"]] == [1, 2]
    assert told[1]["history"][0] == told[0]["history"][0]
    assert told[1]["seconds"] > told[0]["seconds"]
    assert Checkpoint.read(path).state["step"] == 2
    with pytest.raises(JobError, match="MF148"):
        learn(JOB, die="TOLED", levels=[24], minutes=1e-6, out=path)


SMALL = Course(widths=(8, 12), patch=(32, 64), first=1, known=1)


@pytest.mark.slow
def test_the_fewest_steps_that_are_taught_are_worth_more_than_a_tenth_of_a_decibel(tmp_path: Path) -> None:
    job = load_job(JOB)
    asked = Conditions.of(job, "camera", [32])
    design, _ = asked.design("TOLED", job.panels()["TOLED"], Surroundings.of(job))
    run = Run.of(
        tmp_path / "toled.npz",
        trade_of(job, asked, design),
        asked.protocol,
        design,
        (),
        course=Course(),
        device="cpu",
        before=None,
        clock=Clock(),
        progress=silent,
    )
    for _ in range(learning.FEWEST):
        run.training.advance()
    gains = run.gains()
    assert gains["gain"] > 0.1
    assert gains["gain_over_filter"] > 0.3
