"""Photographs in a report: the protocol's own, of the job's camera and light, and ties told as ties."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from once import leaves, small_scenes

from maskfab.api.photographs import simulate
from maskfab.base.errors import JobError
from maskfab.base.processes import SerialExecutor
from maskfab.camera import scenes as scene_sets
from maskfab.camera.imaging import Isoplanatic
from maskfab.camera.protocol import evaluate
from maskfab.camera.scores import MeanDifference, Score
from maskfab.findings import photographs
from maskfab.findings.photographs import (
    CROP,
    NOISE_DB,
    Conditions,
    Photographs,
    Restored,
    Surroundings,
    middle_level,
    photograph_die,
)
from maskfab.mask.job import load_job
from maskfab.report.documents.die import PhotographsPart, photographs_document
from maskfab.report.pages.tables import best_photographed, photograph_table
from maskfab.runs.stages import begin_photographs

JOB = Path(__file__).parents[2] / "layouts" / "toled_against_ours.toml"
PIXEL = ('pixel = "2 um"', 'pixel = "1 um"')
LIGHT = "\n[exposure]\nsnr = [24, 40]\n"


def job_of(folder: Path, more: str = "", edits: tuple[tuple[str, str], ...] = ()):
    """The job with further sections, on two levels of light."""
    text = JOB.read_text().replace("openings/", f"{JOB.parent}/openings/").replace("maps/", f"{JOB.parent}/maps/")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    path = folder / "job.toml"
    path.write_text(text + more)
    return load_job(path)


def taken(job) -> Photographs:
    with SerialExecutor() as executor:
        return begin_photographs(job, job.plate(), executor).result(lambda *_: None)


def psnrs(found: Photographs) -> dict[tuple[str, float], float]:
    return {
        (name, row.level_db): row.value
        for name in found.dies
        for row in found.quantities(name)
        if row.name == "restored_psnr"
    }


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    return job_of(tmp_path_factory.mktemp("job"), LIGHT)


@pytest.fixture(scope="module")
def found(job):
    return taken(job)


def test_a_report_says_what_simulate_says(job, found, monkeypatch):
    monkeypatch.setattr(scene_sets, "drawn", small_scenes)
    told = simulate(job)
    assert told.table.noise_told[0] in str(told).splitlines()
    scores: dict[tuple[str, float], list[float]] = {}
    for score in told.table.scores:
        scores.setdefault((score.design, score.level_db), []).append(score.psnr)
    assert psnrs(found) == pytest.approx({case: np.mean(each) for case, each in scores.items()}, abs=1e-9)
    gains = {(gain.design, gain.level_db): gain.psnr for gain in told.table.gains("TOLED")}
    rows = {row.level_db: row for row in found.quantities("OURS") if row.name == "restored_gain"}
    for (die, level), gain in gains.items():
        assert (rows[level].value, rows[level].uncertainty) == pytest.approx((gain.mean, gain.half_width)), die


def test_a_draw_of_the_noise_stays_within_the_error(job, found):
    def drawn(*given, expected, **more):
        assert expected
        return evaluate(*given, **more)

    other = tuple(replace(scene, number=scene.number + 100) for scene in small_scenes())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(photographs, "drawn_scenes", lambda highlights: other)
        patch.setattr(photographs, "evaluate", drawn)
        again = psnrs(taken(job))
    differences = [abs(again[case] - value) for case, value in psnrs(found).items()]
    # These scenes are two, and small: of so many fewer pixels noise is averaged less.
    rows, columns = (side - 512 for side in other[0].values.shape[1:])
    fewer = 4 * 512 * 1024 / (len(other) * rows * columns)
    assert 0 < max(differences) < NOISE_DB * fewer**0.5


@pytest.mark.parametrize(
    ("more", "edits", "better"),
    [
        (LIGHT + "[sensor]\nread_noise = 60\n", (), False),
        (LIGHT.replace("24, 40", "28, 40"), (), True),
        (LIGHT, (PIXEL,), False),
    ],
    ids=["more read noise", "more light", "smaller pixels"],
)
def test_sensor_light_and_camera_change_the_report_as_physics_says(job, found, tmp_path, more, edits, better):
    before, after = psnrs(found), psnrs(taken(job_of(tmp_path, more, edits)))
    for die in ("TOLED", "OURS"):
        lowest = min(level for name, level in after if name == die)
        assert (
            (after[die, lowest] > before[die, 24] + NOISE_DB)
            if better
            else (after[die, lowest] < before[die, 24] - NOISE_DB)
        )


def test_brackets_of_a_job_are_taken_of_scenes_with_highlights(tmp_path):
    taken_of = taken(job_of(tmp_path, "\n[exposure]\nsnr = [40]\nbrackets = [1, 16]\n"))
    document = photographs_document(taken_of)
    assert document["scenes"] == [f"{scene.name}_lit" for scene in small_scenes()]
    assert document["brackets"] == [1, 16]
    assert "exposures of 1, 1/16 of it, merged" in taken_of.quantities("OURS")[0].method
    Draft202012Validator(PhotographsPart.schema_document()).validate(document)


def test_rows_say_what_they_assume(found):
    rows = found.quantities("OURS")
    assert [(row.name, row.level_db) for row in rows] == [
        (name, level) for name in ("restored_psnr", "restored_gain") for level in (24, 40)
    ]
    for row in rows:
        for said in ("focal 10000 um", "read noise 4.87 electrons", "linear light", "2 drawn scenes", "Wiener"):
            assert said in row.method
        assert "the mean over the noise, in closed form, of every second row" in row.method
        assert ("error: a draw of the noise, and the rows that are not scored" in row.method) == (
            row.name == "restored_psnr"
        )
    assert "TOLED" in rows[-1].method
    assert [row.name for row in found.quantities("TOLED")] == ["restored_psnr"] * 2


def test_rows_say_which_die_is_scored_in_one_draw(found):
    """As one that passes light up to a full well is, beside one that does not."""
    scores = tuple(replace(score, drawn=True) for score in found.dies["OURS"].scores)
    mixed = replace(found, dies={**found.dies, "OURS": replace(found.dies["OURS"], scores=scores)})
    psnr, gain = (row.method for row in mixed.quantities("OURS")[::2])
    assert "Wiener filter, one draw of the noise; error: another draw of the noise;" in psnr
    assert "of one die the mean over the noise, in closed form" in gain
    assert "of the other one draw of it; error: half" in gain
    assert mixed.table.noise_told == [
        "PSNR is the mean over the noise, in closed form, of every second row of 512 or more; that of OURS at 24 dB, "
        "that of OURS at 40 dB, pictures, all other scores are of one draw of it."
    ]


def test_photographs_are_shown_of_designed_dies_as_they_were_scored(found):
    shown, other = found.dies["OURS"], found.dies["TOLED"]
    assert [shot.score for shot in shown.shots] == [score for score in shown.scores if score.scene == shown.scene]
    assert [shot.score.level_db for shot in other.shots] == [middle_level((24, 40))] == [40]
    assert {shot.picture.shape for shot in shown.shots} == {shown.truth.shape} == {(3, CROP.rows, CROP.columns)}


def test_how_a_blur_errs_is_told_with_the_photographs(job, monkeypatch):
    monkeypatch.setattr(Isoplanatic, "told", ("it errs by so much",))
    seen = photograph_die(Conditions.of(job, "camera"), Surroundings.of(job), "TOLED", job.plate().dies[0].panel, False)
    assert "it errs by so much" in seen.left_out


def test_a_die_that_the_camera_cannot_see_is_told_with_its_reason(job):
    die = job.plate().dies[0]
    small = replace(die.panel, orientations=die.panel.orientations[:5, :5])
    conditions = Conditions.of(job, "camera")
    seen = photograph_die(conditions, Surroundings.of(job), "SMALL", small, False)
    rows = Photographs(conditions, {"SMALL": seen}).quantities("SMALL")
    assert [row.name for row in rows] == ["photographs_refused"]
    assert rows[0].value.startswith("MF114")
    document = photographs_document(Photographs(conditions, {"SMALL": seen}))
    assert document["reference"] is None
    assert {line.name: line.note for line in photograph_table(document).lines} == {"SMALL": seen.refused}


@pytest.mark.parametrize(
    ("section", "code"),
    [("[exposure]\nwhite = 90000\n", "MF141"), ("[exposure]\nsnr = [24]\n\n[sensor]\nfull_well = 100\n", "MF141")],
    ids=["more than a full well", "too small a well"],
)
def test_light_that_cannot_be_is_refused_before_a_die_is_looked_at(tmp_path, section, code):
    job = job_of(tmp_path, "\n" + section)
    with pytest.raises(JobError) as refusal, SerialExecutor() as executor:
        begin_photographs(job, job.plate(), executor)
    assert refusal.value.code == code


def table_of(job, **psnr: tuple[float, ...]) -> dict:
    def die(name: str, values: tuple[float, ...]) -> Restored:
        return Restored(
            tuple(Score(name, 24, f"s{k}", 0.1, value, 0.5, value + 1, 0.5) for k, value in enumerate(values))
        )

    conditions = replace(Conditions.of(job, "camera"), levels=(24,))
    return photographs_document(Photographs(conditions, {name: die(name, values) for name, values in psnr.items()}))


def test_dies_that_cannot_be_told_from_the_best_are_marked_with_it(job):
    """B is .2 dB better than A on average, and worse on one photograph; C is 1 dB below B on each."""
    document = table_of(job, A=(20.0, 25.0, 30.0), B=(20.5, 24.8, 30.3), C=(19.5, 23.8, 29.3), D=(10.0, 12.0, 11.0))
    assert best_photographed(document, 24) == {"A", "B"}
    table = photograph_table(document)
    assert [line.cells[0].best for line in table.lines] == [True, True, False, False]
    width = MeanDifference.of([0.5, -0.2, 0.3]).half_width
    gains = {line.name: line.cells[0].made for line in table.lines}
    assert gains["B"] == f"+0.2 ± {width:.1f} tie"
    assert gains["D"].startswith("-14 ± ")
    assert "tie" not in gains["D"]
    assert best_photographed(table_of(job, A=(20.0, 25.0), B=(20.5, 24.8)), 24) == frozenset()


def test_the_document_is_as_its_schema_says(found):
    document = photographs_document(found)
    Draft202012Validator(PhotographsPart.schema_document()).validate(document)
    assert document["scenes"] == [scene.name for scene in small_scenes()]
    assert leaves(1).name in document["scenes"]


def test_gains_that_light_picks_are_told_and_in_the_schema(found, tmp_path):
    asked = Conditions.of(job_of(tmp_path, LIGHT + "[sensor]\nbits = 10\nmax_gain = 8\nbanding = 0.5\n"), "camera")
    document = photographs_document(replace(found, conditions=asked))
    Draft202012Validator(PhotographsPart.schema_document()).validate(document)
    assert document["analog_gains"] == pytest.approx([8, 1.50], rel=2e-3)
    assert (document["sensor"]["max_gain"], document["sensor"]["banding"]) == (8, 0.5)
    assert any(line.startswith("analog gain: picked") and "8 at 24 dB" in line for line in document["told"])
    assert "analog_gains" not in photographs_document(found)
