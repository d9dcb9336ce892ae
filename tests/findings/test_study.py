"""maskfab study: figures of dies under a study's protocols, and claims that its numbers agree with or not."""

from __future__ import annotations

import base64
import io
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from browser import faults
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.image import imread
from scipy import stats

import maskfab as mf
from maskfab.base.errors import JobError
from maskfab.camera import scenes
from maskfab.camera.imaging import Margin
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scores import MeanDifference, Score
from maskfab.cli.program import run_command_line
from maskfab.findings import study as studies
from maskfab.findings.study import Take, Verdict, planned, verdict, worst
from maskfab.mask.formats.exr import write_png
from maskfab.mask.job import load_job
from maskfab.mask.opening_file import load_opening
from maskfab.report.pages.study import (
    brightening,
    finding_text,
    photograph_tiles,
    scores_figure,
    study_document,
    study_page,
)

ROOT = Path(__file__).parents[2]
SHIPPED = sorted((ROOT / "layouts" / "studies").glob("*.toml"))

JOB = f"""
[job]
name = "OWN"
title = "MY OWN STUDY"
[camera]
focal = "10 mm"
stop = {{ shape = "circle", diameter = "4 mm" }}
wavelengths = ["610 nm", "530 nm", "470 nm"]
pixel = "2 um"
window = "128 um"
[plate]
blank = "5 in"
writable = "100 mm"
die_size = "8.4 mm"
die_pitch = "22 mm"
columns = 2
[[die]]
name = "REPEATED"
label = "T-OLED"
opening = "{(ROOT / "layouts/openings/toled.toml").as_posix()}"
dot = "8 um"
tiling = "periodic"
[[die]]
name = "TURNED"
label = "T-OLED random"
opening = "{(ROOT / "layouts/openings/toled.toml").as_posix()}"
dot = "8 um"
tiling = "random"
seed = 3
[study]
figure = "mine"
title = "Does a random tiling gain?"
protocols = ["f1"]
levels = [40]
scenes = 0
"""
GAINS = """
[[study.claim]]
says = "It gains half a decibel at least."
die = "TURNED"
over = "REPEATED"
at_least = 0.5
[[study.claim]]
says = "It loses half a decibel at least."
die = "TURNED"
over = "REPEATED"
at_most = -0.5
why = "It gains."
"""


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes of large squares in colours of their own."""
    folder = tmp_path_factory.mktemp("photographs")
    for seed in range(2):
        colours = np.random.default_rng(seed).uniform(0, 1, (3, 26, 26))
        write_png(colours.repeat(32, axis=1).repeat(32, axis=2), folder / f"{seed}.png")
    return folder


@pytest.fixture(scope="module")
def made(photographs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    (folder / "own.toml").write_text(JOB + GAINS)
    arguments = ["study", str(folder / "own.toml"), "--images", str(photographs), "-o", str(folder / "out"), "--quiet"]
    assert run_command_line(arguments) == 0
    return folder


@given(
    st.floats(-50, 50),
    st.floats(0, 20),
    st.one_of(st.none(), st.floats(-60, 60)),
    st.one_of(st.none(), st.floats(0, 9)),
)
def test_an_interval_agrees_inside_the_limits_and_disagrees_outside(mean, half, low, width):
    high = None if low is None or width is None else low + width
    found = verdict(MeanDifference(mean, half, 7), low, high)
    ends = [mean - half, mean + half, *np.linspace(mean - half, mean + half, 9)]
    inside = [(low is None or low <= end) and (high is None or end <= high) for end in ends]
    if found is Verdict.AGREES:
        assert all(inside)
    elif found is Verdict.DISAGREES:
        assert not any(inside)
    else:
        assert not all(inside[:2])


def test_without_an_interval_nothing_can_be_told():
    assert verdict(MeanDifference(3.0, math.nan, 1), 0.0, None) is Verdict.OPEN
    assert worst([Verdict.AGREES, Verdict.OPEN, Verdict.AGREES]) is Verdict.OPEN
    assert worst([Verdict.OPEN, Verdict.DISAGREES]) is Verdict.DISAGREES


def test_claims_are_judged_by_the_photographs_that_simulate_takes(made: Path, photographs: Path):
    told = json.loads((made / "out" / "study.json").read_text())
    scores = {(each["design"], each["scene"]): each["psnr"] for each in told["scores"]}
    known = mf.simulate(made / "own.toml", die="TURNED", images=photographs, protocol="f1", levels=[40]).to_dict()
    assert {each["scene"]: each["psnr"] for each in known["scores"]} == {s: scores["TURNED", s] for s in "01"}
    gains = [scores["TURNED", scene] - scores["REPEATED", scene] for scene in "01"]
    for_it, against = told["claims"]
    (finding,) = for_it["findings"]
    assert finding["mean"] == pytest.approx(np.mean(gains))
    assert finding["half_width_95"] == pytest.approx(stats.t.ppf(0.975, 1) * np.std(gains, ddof=1) / np.sqrt(2))
    assert finding["photographs"] == 2
    low, high = (finding["mean"] + sign * finding["half_width_95"] for sign in (-1, 1))
    assert for_it["verdicts"] == {"f1": "agrees" if low >= 0.5 else "cannot be told"}
    assert against["verdicts"] == {"f1": "does not agree" if low > -0.5 else "cannot be told"}
    assert high > 0.5


def test_the_page_opens_anywhere(browser, made: Path):
    assert faults(browser, made / "out" / "study.html") == []


def test_the_page_tells_what_made_it_and_needs_nothing_else(made: Path):
    page = (made / "out" / "study.html").read_text()
    job = load_job(made / "own.toml")
    for part in (job.signature, "protocol f1: focal 10000 um", "full well 15506", "wiener", "0, 1", "TURNED=3"):
        assert part in page
    assert "It gains." in page
    assert "with their 95% interval over 2 scenes.\n" in page
    assert re.search(r"TURNED, 40 dB, wiener: PSNR [0-9.]+ dB", page)
    assert re.findall(r">[+−][0-9.]+ ± [0-9.]+", page)
    assert not re.search(r">-[0-9]", page)
    assert "of 2<small>claims agree" in page
    assert "<script" not in page
    assert not re.search(r"(src|href)=['\"](?!data:|#|%23)|url\((?!#|%23)", page)
    manifest = json.loads((made / "out" / "manifest.json").read_text())
    assert {each["path"] for each in manifest["files"]} == {"study.html", "study.json", "scores.svg"}


@pytest.mark.slow
def test_areas_are_those_of_the_polygons_read_back(tmp_path: Path):
    job = tmp_path / "optics.toml"
    job.write_text(JOB.replace('protocols = ["f1"]', "optics = true").replace("levels = [40]\n", ""))
    (one, _) = mf.study(job).to_dict()["optics"]
    known = mf.analyse(ROOT / "layouts/openings/toled.toml")
    assert one["auc_radial_min"]["530"] == pytest.approx(known["auc_radial_min", 530].value, abs=2e-6)
    assert one["open_ratio"] == known["open_ratio"].value


def test_a_case_is_photographed_as_it_is_and_restored_by_the_blur_of_another(tmp_path: Path):
    job = tmp_path / "near.toml"
    cases = """
    [[study.case]]
    name = "far"
    [[study.case]]
    name = "near"
    scene = { depth = ["0.1 m", "0.1 m"], focus = "0.1 m" }
    restored_by = "far"
    """
    job.write_text(
        JOB.replace('protocols = ["f1"]', 'protocols = ["camera"]').replace("scenes = 0", "scenes = 1") + cases
    )
    plan = planned(load_job(job))
    (far, _), (near, told) = (setting.design("REPEATED", plan.panels["REPEATED"]) for setting in plan.settings)
    shape = 96, 96
    np.testing.assert_array_equal(near.on(shape), far.on(shape))
    assert told == ("restored by the blur of the case 'far'",)
    # Orders are λ f / pitch apart, and a lens focused at 0.1 m is f / 0.9 from its sensor.
    light, margin = np.zeros((3, 704, 704), dtype=np.float32), Margin((704, 704))
    light[:, 352, 352] = 1
    second = [25 + int(design.blurred(light, margin)[1, 96, 96 + 25 : 96 + 45].argmax()) for design in (far, near)]
    order_px = 0.53 * 10_000 / 168 / 2
    assert second == pytest.approx([2 * order_px, 2 * order_px / 0.9], abs=1)


def test_a_die_has_one_colour_whatever_a_protocol_restores_by(tmp_path: Path):
    job = tmp_path / "own.toml"
    job.write_text(JOB.replace('["f1"]', '["paper", "f1"]').replace("scenes = 0", "scenes = 1"))
    scores = {
        Take(protocol, studies.OWN_SCENE, die, 40, restorer): (Score(die, 40, "x", 0.1, psnr, 0.5, psnr, 0.5),)
        for protocol, restorer in (("paper", "published"), ("f1", "wiener"))
        for die, psnr in (("REPEATED", 20.0), ("TURNED", 30.0))
    }
    drawn = scores_figure(studies.Study(planned(load_job(job)), {}, ("x",), scores, {}, None, {})).figure
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == ["REPEATED", "TURNED"]
    paper, _, f1, _ = ([line.get_color() for line in axes.lines] for axes in drawn.axes)
    assert paper == f1
    assert len(set(paper)) == 2


@pytest.mark.parametrize("bright", [0.0, 0.04, 0.5, 1.0])
def test_photographs_of_a_dim_scene_are_shown_bright_and_all_alike(tmp_path: Path, bright: float):
    job = tmp_path / "own.toml"
    job.write_text(JOB.replace("scenes = 0", "scenes = 1"))
    truth = np.full((3, 8, 10), bright, dtype=np.float32)
    truth[:, :4] /= 2
    take = Take("f1", studies.OWN_SCENE, "REPEATED", 40, "wiener")
    score = Score("REPEATED", 40, "x", 0.1, 31.26, 0.5, 20.0, 0.5)
    told = {("f1", studies.OWN_SCENE, die): () for die in ("REPEATED", "TURNED")}
    study = studies.Study(planned(load_job(job)), {}, ("x",), {take: (score,)}, told, truth, {take: truth / 2})
    shown = [
        imread(io.BytesIO(base64.b64decode(re.search("base64,([^']+)'", image)[1])), format="png")[:, :, :3]
        for _, image in photograph_tiles(study)
    ]
    white = float(bright > 0)
    assert [each.max() for each in shown] == pytest.approx([white, white / 2], abs=0.003)
    assert [each.min() for each in shown] == pytest.approx([white / 2, white / 4], abs=0.003)
    assert brightening(study) == pytest.approx(1 / bright if bright else 1)
    page = study_page(study)
    assert ("code values times" in page) == (0 < bright < 1)
    assert "behind the same restorer; one scene has no interval.\n" in page


def test_photographs_without_highlights_do_not_serve_a_study_of_brackets(tmp_path: Path, photographs: Path):
    job = tmp_path / "bright.toml"
    case = '[[study.case]]\nname = "two"\nbrackets = [1, 16]'
    job.write_text(JOB.replace('protocols = ["f1"]', 'protocols = ["camera"]') + case)
    with pytest.raises(JobError, match="MF146"):
        planned(load_job(job), scenes.folder(photographs))
    job.write_text(job.read_text().replace("scenes = 0", "scenes = 1"))
    plan = planned(load_job(job), scenes.folder(photographs))
    assert plan.photographs == ()
    assert plan.skipped == tuple(f"{seed} without highlights" for seed in range(2))
    assert plan.settings[0].protocol.brackets == (1, 16)


def test_a_claim_may_be_about_a_restorer_that_was_trained(tmp_path: Path):
    job = tmp_path / "own.toml"
    claim = CLAIM + 'restorer = "learned"\nover_restorer = "wiener"\nat_least = 0.0'
    job.write_text(JOB.replace("scenes = 0", f"scenes = 1\n{claim}"))
    with pytest.raises(JobError, match="MF145"):
        planned(load_job(job))
    trained = {"TURNED": (Wiener(name="learned"),)}
    (setting,) = planned(load_job(job), learned=lambda _: trained).settings
    assert setting.learned == trained


def test_several_studies_are_made_at_places_of_their_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    optics = JOB.replace('protocols = ["f1"]', "optics = true").replace("levels = [40]\n", "")
    for folder in "ab":
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.toml").write_text(optics)
    jobs = [str(tmp_path / folder / "same.toml") for folder in "ab"]
    assert run_command_line(["study", *jobs, "-o", str(tmp_path / "out"), "--quiet"]) == 2
    assert "MF105" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


CLAIM = '[[study.claim]]\nsays = "x"\ndie = "TURNED"\n'


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("[study]", "[studies]", "MF102"),
        ("\n[study]\n" + JOB.partition("[study]\n")[2], "", "MF146"),
        ('protocols = ["f1"]', 'protocols = ["f2"]', "MF105"),
        ('protocols = ["f1"]', "", "MF146"),
        ("scenes = 0", 'scenes = 0\naxis = "colour"', "MF105"),
        ("scenes = 0", "scenes = 0\nrestore = ['magic']", "MF105"),
        ("scenes = 0", "levels = [40, 60]".replace("levels", "scenes = 1\nlevel"), "MF102"),
        ("levels = [40]", "levels = [60]", "MF141"),
        ("scenes = 0", "scenes = 0\n" + CLAIM, "MF145"),
        ("scenes = 0", "scenes = 0\n" + CLAIM + 'over = "NOBODY"\nat_least = 0.0', "MF145"),
        ("scenes = 0", "scenes = 0\n" + CLAIM + "levels = [32]\nat_least = 0.0", "MF145"),
        ("scenes = 0", "scenes = 0\n" + CLAIM + 'restorer = "tv"\nat_least = 0.0', "MF145"),
        ("scenes = 0", "scenes = 0\n" + CLAIM + 'case = "near"\nat_least = 0.0', "MF145"),
        ("scenes = 0", "scenes = 0\n" + CLAIM + 'protocols = ["paper"]\nat_least = 0.0', "MF145"),
        ("scenes = 0", "scenes = 0\n" + CLAIM + 'measure = "auc_radial_min"\nat_least = 0.0', "MF145"),
        ("scenes = 0", "scenes = 0\n" + CLAIM + "averaged = true\nat_least = 0.0", "MF145"),
        ("scenes = 0", "scenes = 0\n" + CLAIM + 'measure = "beauty"\nat_least = 0.0', "MF105"),
        ("scenes = 0", 'scenes = 0\n[[study.case]]\nname = "near"\nscene = { gap = "1 mm" }', "MF146"),
        ("scenes = 0", 'scenes = 0\n[[study.case]]\nname = "near"\nscene = { gaps = "1 mm" }', "MF102"),
        ("scenes = 0", 'scenes = 0\n[[study.case]]\nname = "near"\nrestored_by = "far"', "MF145"),
        ("scenes = 0", 'scenes = 0\n[[study.case]]\nname = "two"\nbrackets = [1, 16]', "MF143"),
    ],
)
def test_bad_studies_are_refused_before_any_work(tmp_path, monkeypatch, capsys, old, new, code):
    monkeypatch.setattr(studies, "evaluate", None)
    assert old in JOB
    job = tmp_path / "bad.toml"
    job.write_text(JOB.replace(old, new, 1).replace("scenes = 0", "scenes = 1"))
    assert run_command_line(["study", str(job), "-o", str(tmp_path / "out"), "--quiet"]) == 2
    assert code in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_study_without_scenes_or_photographs_that_are_there_is_refused(tmp_path, capsys):
    job = tmp_path / "own.toml"
    job.write_text(JOB)
    nowhere = ["--images", str(tmp_path / "nowhere")]
    for more, code in (([], "MF146"), (nowhere, "MF301"), (["--white", "1"], "MF105")):
        assert run_command_line(["study", str(job), "-o", str(tmp_path / "out"), "--quiet", *more]) == 2
        assert code in capsys.readouterr().err


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_study_can_be_made(path: Path):
    plan = planned(load_job(path))
    assert plan.study.claim
    assert all(claim.why or claim.says.endswith(".") for claim in plan.study.claim)


@pytest.mark.slow
@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_study_is_made_and_every_claim_has_numbers(path: Path, tmp_path: Path):
    found = mf.study(path)
    assert all(claim.findings for claim in found.claims)
    assert (tmp_path / "out" / "study.html") in found.save(tmp_path / "out")


def _folder_of(place: Path, **masks: str) -> Path:
    place.mkdir()
    for name, rows in masks.items():
        (place / f"{name}.txt").write_text(rows)
    return place


SLIT = ("." * 8 + "#" * 5 + "." * 8 + "\n") * 21


def test_masks_of_a_folder_take_the_place_of_the_openings_that_they_are_named_after(tmp_path: Path):
    job = tmp_path / "own.toml"
    job.write_text(JOB.replace('protocols = ["f1"]', "optics = true").replace("levels = [40]\n", ""))
    masks = _folder_of(tmp_path / "masks", Toled=SLIT, heart=SLIT)
    found = mf.study(job, masks=masks)
    told = found.to_dict()
    assert (told["masks"], told["idle_masks"]) == ({"toled": "Toled.txt"}, ["heart.txt"])
    assert [each["open_ratio"] for each in told["optics"]] == [5 / 21] * 2
    assert told["job_hash"] != mf.study(job).to_dict()["job_hash"]
    for text in (str(found), study_page(found.found)):
        assert "In place of openings: toled is Toled.txt." in text
        assert "Masks that no opening is named after: heart.txt." in text


def test_the_job_s_own_opening_as_a_mask_changes_no_number(tmp_path: Path):
    job = tmp_path / "own.toml"
    job.write_text(JOB.replace('protocols = ["f1"]', "optics = true").replace("levels = [40]\n", ""))
    (tmp_path / "masks").mkdir()
    known = load_opening(ROOT / "layouts/openings/toled.toml")
    np.save(tmp_path / "masks" / "toled.npy", known.mask)
    assert mf.study(job, masks=tmp_path / "masks").to_dict()["optics"] == mf.study(job).to_dict()["optics"]


@pytest.mark.parametrize(
    ("masks", "code"),
    [
        ({}, "MF301"),
        ({"heart": SLIT}, "MF147"),
        ({"toled": ".#.\n" * 3}, "MF147"),
        ({"toled": SLIT, "TOLED": SLIT}, "MF109"),
        ({"toled": SLIT.replace("#", ".")}, "MF203"),
    ],
)
def test_masks_that_do_not_fit_are_refused_before_any_work(tmp_path, monkeypatch, capsys, masks, code):
    monkeypatch.setattr(studies, "evaluate", None)
    job = tmp_path / "own.toml"
    job.write_text(JOB.replace("scenes = 0", "scenes = 1"))
    folder = _folder_of(tmp_path / "masks", **masks)
    words = ["study", str(job), "--masks", str(folder), "-o", str(tmp_path / "out"), "--quiet"]
    assert run_command_line(words) == 2
    assert code in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_claim_of_a_mean_over_levels_averages_every_photograph(tmp_path: Path):
    """By hand: gains of 1 and 3 dB of one photograph and 5 and 9 of another are 2 and 7, not four numbers."""
    job = tmp_path / "own.toml"
    claim = CLAIM + 'over = "REPEATED"\naveraged = true\nat_least = 0.0'
    job.write_text(JOB.replace("scenes = 0", f"scenes = 1\n{claim}").replace("[40]", "[32, 40]"))
    gains = {"REPEATED": ((20.0, 20.0), (30.0, 31.0)), "TURNED": ((21.0, 25.0), (33.0, 40.0))}
    scores = {
        Take("f1", studies.OWN_SCENE, die, level, "wiener"): tuple(
            Score(die, level, name, 0.1, psnr, 0.5, psnr, 0.5) for name, psnr in zip("xy", at_level, strict=True)
        )
        for die, levels in gains.items()
        for level, at_level in zip((32, 40), levels, strict=True)
    }
    plan = planned(load_job(job))
    (finding,) = studies.of_photographs(plan.study.claim[0], scores).findings
    assert finding.difference == MeanDifference.of([2.0, 7.0])
    left_out = {("f1", studies.OWN_SCENE, die): () for die in gains}
    study = studies.Study(plan, {}, ("x", "y"), scores, left_out, None, {})
    (told,) = study_document(study)["claims"]
    assert told["findings"][0]["of"]["level_db"] is None
    assert finding_text(study.claims[0], finding)[0] == "TURNED, mean over levels, wiener, over REPEATED"
