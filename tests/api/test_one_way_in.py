"""Objects where a job is meant: one way in for all verbs, and each the same numbers as through files."""

from __future__ import annotations

import os
import runpy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813 - its customary name
import pytest
from once import leaves
from small_job import finished, write_job

import maskfab as mf
from maskfab.api import asked
from maskfab.api.asked import job_of, panels_of
from maskfab.base.errors import InputError, JobError
from maskfab.base.model import Opening as Bare
from maskfab.camera.frames.frame import frame_of_array
from maskfab.findings.photographs import Restored
from maskfab.job.reference import USES, unused
from maskfab.runs.result import Result as Run

BAR = mf.Opening.bar(dots=7, size=(5, 3), pitch="56 um")
TURNED = mf.Panel.tile(BAR, "random", seed=1, size="560 um")
PLAIN = mf.Panel.tile(BAR, size="560 um", gutter="4 um")
LOOK: dict[str, Any] = {"focal": "5 mm", "stop": "400 um", "pixel": "2 um", "window": "64 um"}
CAMERA = mf.Camera(**LOOK)
GREEN = mf.Camera(**LOOK, wavelengths="530 nm")
THREE = ('["530 nm"]', '["610 nm", "530 nm", "470 nm"]')


@dataclass
class Found:
    """A result that lays an opening out, as a design does."""

    panel: mf.Panel


@pytest.mark.parametrize(
    ("stated", "names"),
    [
        (TURNED, ["PANEL"]),
        ([TURNED], ["bar_5x3"]),
        ((TURNED, PLAIN), ["P1", "P2"]),
        ({"A": TURNED, "B": PLAIN}, ["A", "B"]),
        (Found(TURNED), ["PANEL"]),
        ([BAR, mf.Panel.tile(np.eye(7), pitch="56 um", size="560 um")], ["bar_5x3", "opening"]),
    ],
)
def test_panels_become_the_job_of_a_plate_of_them(stated: Any, names: list[str]) -> None:
    job = job_of(stated, CAMERA)
    assert list(job.panels()) == names
    given = panels_of(stated, CAMERA)
    assert job.digest == mf.Plate.of(given).job(CAMERA).digest
    if isinstance(stated, tuple | mf.Panel):
        assert list(mf.Plate.of(stated).panels) == names
    for name, panel in job.panels().items():
        np.testing.assert_array_equal(panel.opening.mask, given[name].opening.mask)
        np.testing.assert_array_equal(panel.orientations, given[name].orientations)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: mf.design(TURNED), r"Panel does not say for what.*design\(start="),
        (lambda: mf.advise(BAR), "advise finds an opening, and Opening"),
        (lambda: mf.view(TURNED), "view looks into files.*run"),
        (lambda: mf.verify(mf.Plate.of(A=TURNED)), "verify looks into files, and Plate"),
        (lambda: mf.cite(TURNED), "cite looks into files"),
        (lambda: mf.analyse([TURNED, PLAIN]), "list is no opening and no panel.*compare"),
        (lambda: mf.analyse(TURNED, GREEN, seed=3), "seed is not of a panel"),
        (lambda: mf.analyse(BAR.mask, GREEN), "pitch"),
        (lambda: CAMERA.psf(3, 530), r"not a Panel.*Panel\.tile"),
        (lambda: CAMERA.mtf(BAR.mask, 530), r"neither pitch nor tiling.*Panel\.tile"),
        (lambda: mf.Plate.of([TURNED, BAR]), r"not a panel|not a mapping"),
        (lambda: mf.Panel.tile(TURNED, size="1 mm"), r"laid out already.*panel\.held"),
        (lambda: mf.Panel.tile(BAR, size="1 mm", threshold=0.5), "threshold goes with an array"),
        (lambda: mf.study(TURNED), r"no \[study\]"),
    ],
)
def test_an_object_that_a_verb_cannot_take_is_refused_with_the_one_that_it_can(call: Any, told: str) -> None:
    with pytest.raises(JobError, match=told) as refusal:
        call()
    assert refusal.value.cure


def test_only_what_a_caller_states_is_told_as_not_used() -> None:
    uses = USES["check --optics"]
    assert unused(job_of(TURNED, CAMERA).spec, *uses) == ()
    limits = {"limits": {"min_feature": 4}}
    assert unused(job_of(TURNED, CAMERA, limits).spec, *uses) == ("[limits]",)
    stated = unused(mf.Plate.of(TURNED, camera=CAMERA, sections=limits).job().spec, *uses)
    assert {"[limits]", "die_pitch of [plate]"} <= set(stated)


def test_an_opening_alone_is_laid_out_as_its_analysis_lays_it_out() -> None:
    (panel,) = job_of(BAR, CAMERA).panels().values()
    assert panel.tiling == "periodic"
    assert min(panel.size_nm) >= 400_000 > min(panel.size_nm) - 2 * panel.pitch_nm
    ways = [
        mf.analyse(BAR, GREEN),
        mf.analyse(panels_of(BAR, GREEN)["PANEL"], GREEN),
        mf.analyse(BAR.mask, GREEN, pitch="56 um"),
        mf.analyse(BAR.mask.tolist(), GREEN, dot="8 um"),
    ]
    for key in ("mtf50", "auc_radial_min", "psf_energy_in_window"):
        assert len({way[key, 530].value for way in ways}) == 1
    turned = mf.analyse(TURNED, GREEN)
    assert turned["auc_radial_min", 530].value == pytest.approx(float(CAMERA.mtf(TURNED, 530).auc), abs=1e-12)


PERIODIC = "bar_5x3 is tiled periodically"


def test_an_opening_alone_is_seen_periodically_and_the_answer_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maskfab.camera.scenes.bundled", lambda count=4: (leaves(1, 704, 768),))
    laid = panels_of(BAR, CAMERA)["PANEL"]
    psf, again = CAMERA.psf(BAR, 530), CAMERA.psf(laid, 530)
    np.testing.assert_array_equal(psf.samples, again.samples)
    assert PERIODIC in repr(psf)
    assert "Panel.tile(opening, tiling='random', seed=1, size='448 um')" in psf.note
    assert (again.note, CAMERA.mtf(Found(TURNED), 530).note) == ("", "")
    assert repr(CAMERA.mtf(BAR, 530)).endswith("turns them>")
    simulated = mf.simulate([BAR, TURNED], CAMERA, levels=[32], pictures=False)
    assert f"P1: {PERIODIC}" in str(simulated)
    assert "P2:" not in str(simulated)
    assert simulated.to_dict()["notes"] == list(simulated.notes)
    assert PERIODIC not in str(mf.simulate(TURNED, CAMERA, levels=[32], pictures=False))
    rules = {"emitters": {"colour_gap": "8 um", "min_width": "8 um"}}
    assert PERIODIC in str(mf.check(BAR, camera=CAMERA, rules=rules))
    (note,) = job_of({"A": BAR, "B": TURNED}, CAMERA).notes.values()
    assert (note.name, note.value, note.die) == ("assumed_tiling", "periodic", "A")


def test_a_comparison_says_what_it_assumed_and_shows_its_table() -> None:
    found = mf.compare({"A": BAR, "B": TURNED}, camera=CAMERA)
    assert f"A: {PERIODIC}" in str(found)
    assert "B:" not in str(found)
    table = found.table()
    assert list(table.index) == ["B", "A"]
    level = found.to_dict()["levels"][1]["dies"][0]
    assert table["PSNR (dB)"]["B"] == level["psnr"]
    assert table["gain over A (dB)"]["B"] == level["gain"]["mean"]
    assert np.isnan(table["gain over A (dB)"]["A"])
    shown = found._repr_html_()
    assert "<pre>" not in shown
    assert "<th>MTF, worst<br>25 cy/mm</th>" in shown
    assert max(map(len, str(found).splitlines()[:4])) < 120


def test_openings_of_arrays_are_told_apart_though_all_are_called_alike() -> None:
    arrays = np.eye(7), np.eye(7)[::-1], np.eye(7)
    panels = [mf.Panel.tile(array, pitch="56 um", size="560 um") for array in arrays]
    job = job_of(panels, CAMERA)
    assert {name: die.opening.name for name, die in job.panels().items()} == {
        "P1": "opening", "P2": "P2", "P3": "opening",
    }  # fmt: skip
    for array, panel in zip(arrays, job.panels().values(), strict=True):
        np.testing.assert_array_equal(panel.opening.mask, array)
    assert panels[1].held[0].name == "opening"


def test_a_panel_of_an_array_has_an_opening_that_is_a_picture_and_an_array() -> None:
    torch = pytest.importorskip("torch")
    panel = mf.Panel.tile(np.eye(7), pitch="56 um", size="560 um", seed=1, others=[Bare("other", BAR.mask, BAR.dot_nm)])
    for opening in (panel.opening, *panel.others, *panel.held):
        assert isinstance(opening, mf.Opening)
        assert opening._repr_svg_().startswith("<svg")
        assert repr(opening).startswith("<Opening ")
        np.testing.assert_array_equal(np.asarray(opening), opening.mask)
        for dots in (torch.tensor(opening), torch.as_tensor(opening)):
            np.testing.assert_array_equal(dots.numpy(), opening.mask)
            dots[0, 0] = ~dots[0, 0]  # a copy: the opening stays as it is
            assert (dots.numpy() != opening.mask).sum() == 1
    assert panel.opening.pitch_um == 56


@pytest.mark.parametrize(
    ("stated", "told"),
    [
        (3, "int states no job"),
        ([], "there is no panel"),
        ([TURNED, "job.toml"], r"str states no job \(job\[1\]\)"),
        ({"A": np.eye(7)}, r"shape \(7, 7\) .*Panel\.tile\(array"),
        ({"A B": TURNED}, "MF110"),
        (None, "NoneType states no job"),
    ],
)
def test_what_states_no_job_is_refused_with_all_that_do(stated: Any, told: str) -> None:
    with pytest.raises(JobError, match=told) as refusal:
        mf.simulate(stated, CAMERA)
    assert refusal.value.cure


PHOTO = 0.2 + 0.6 * (np.add.outer(10 * np.arange(128), np.arange(128)) > 700)[..., None] * np.ones(3)
PHOTO[::3, ::5] *= 0.97

_NO_DIE = ("MF105", "P1, P2")
VERBS: dict[str, tuple[Callable[[Any], Any], tuple[str, str]]] = {
    "bench": (lambda job: mf.bench(mf.Plate.of(panels_of(job), camera=CAMERA), die="P3"), _NO_DIE),
    "check": (lambda job: mf.check(job, camera=CAMERA, rules=RULES, die="P3"), _NO_DIE),
    "check --look": (lambda job: mf.check(job, look=True, camera=CAMERA, rules=RULES, die="P3"), _NO_DIE),
    "check --optics": (lambda job: mf.check(job, optics=True, camera=CAMERA, die="P3"), _NO_DIE),
    "compare": (lambda job: mf.compare(job, camera=CAMERA, dies=["P3"]), ("MF105", "P1")),
    "edge": (lambda job: mf.edge(PHOTO, job, CAMERA, die="P3"), _NO_DIE),
    "forecast": (lambda job: mf.forecast(job, out="none"), ("MF153", "P1")),
    "learn": (lambda job: mf.learn(job, CAMERA, out="none.npz", die="P3"), _NO_DIE),
    "measure": (lambda job: mf.measure(PHOTO, job, CAMERA, die="P3"), _NO_DIE),
    "order.compare": (lambda job: mf.order.compare(job, "none"), ("MF420", "none")),
    "order.fill": (lambda job: mf.order.fill(job, "none"), ("MF420", "none")),
    "order.pack": (lambda job: mf.order.pack(job, "none"), ("MF420", "none")),
    "pairs": (lambda job: mf.pairs(job, "none", count=1, camera=CAMERA, die="P3"), _NO_DIE),
    "restore": (lambda job: mf.restore(PHOTO, job, CAMERA, die="P3"), _NO_DIE),
    "run": (lambda job: mf.run(job, out="none"), ("MF153", "P1")),
    "simulate": (lambda job: mf.simulate(job, CAMERA, die="P3"), _NO_DIE),
    "study": (mf.study, ("MF146", "study")),
    "sweep": (lambda job: mf.sweep(job, GREEN, over={"die.P3.gutter": [0, 4]}), _NO_DIE),
    "verify": (lambda job: mf.verify("none.gds", against=job), ("MF153", "P1")),
}
"""Calls of every verb that takes panels, each refused for a reason that only who knows the panels can have."""
RULES = {"emitters": {"colour_gap": 8, "min_width": "8 um"}}


@pytest.mark.parametrize("verb", VERBS)
def test_verbs_take_lists_of_panels(verb: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("maskfab.runs.as_designed.photograph_die", lambda *_: Restored(refused="MF000 not now"))
    call, (code, told) = VERBS[verb]
    with pytest.raises(InputError, match=told) as refusal:
        call([TURNED, PLAIN])
    assert refusal.value.code == code
    assert not list(tmp_path.iterdir())


def test_the_table_of_what_verbs_take_is_made_from_their_signatures() -> None:
    pages = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "tables.py"))
    rows = {row.verb: row for row in pages["taken"]()}
    of_panels = {verb for verb, row in rows.items() if any("Plate" in words for words in row.parameters.values())}
    assert of_panels == {verb.partition(" ")[0] for verb in VERBS}
    assert {name for name in vars(asked) if name.startswith("Any") and name != "Any"} <= set(pages["WORDS"])
    assert rows["analyse"].parameters["subject"][0] == "Panel"
    assert "array" in rows["restore"].parameters["photos"]
    assert rows["view"].parameters == {"directory": ("path", "result of run")}
    assert rows["simulate"].camera
    assert "explain" not in rows


def test_rules_are_the_sections_of_a_job_with_lengths_as_python_has_them() -> None:
    by_rules = mf.check([PLAIN], camera=CAMERA, rules=RULES)
    text = {"emitters": {"colour_gap": "8 um", "min_width": "8 um"}}
    by_plate = mf.check(mf.Plate.of({"bar_5x3": PLAIN}, camera=CAMERA, sections=text))
    assert by_rules.to_dict() == by_plate.to_dict()
    shown = by_rules._repr_html_()
    assert shown.index("<img") < shown.index("<pre>")
    plate = mf.Plate.of({"bar_5x3": PLAIN}, camera=CAMERA, sections=text)
    wider = mf.check(plate, rules={"emitters": RULES["emitters"] | {"colour_gap": 16}})
    assert wider.to_dict() != by_plate.to_dict()


@pytest.mark.parametrize(
    ("rules", "told"),
    [
        ({"min_width": "8 um"}, r"MF102 .*a key of \[emitters\].*rules=\{\"emitters\""),
        ({"order": {}}, "MF102 .*'order' is none"),
        ({"emitters": {"colour_gap": 8, "min_wdth": 8}}, r"MF102 .*emitters\.min_wdth"),
        ({"emitters": 3}, "MF105 emitters = 3"),
        (None, r"MF105 .*asks for no emitters.*rules=\{\"emitters\""),
    ],
)
def test_rules_that_are_none_are_refused(rules: Any, told: str) -> None:
    with pytest.raises(JobError, match=f"(?s){told}"):
        mf.check(PLAIN, camera=CAMERA, rules=rules)
    with pytest.raises(JobError, match="MF105 the job states the rules"):
        mf.check("job.toml", rules=RULES)


def test_panels_are_compared_by_their_photographs_and_their_mtf() -> None:
    exposure = {"exposure": {"snr": [32]}}
    plate = mf.Plate.of(A=TURNED, B=PLAIN, camera=CAMERA, sections=exposure)
    found = mf.compare(plate, reference="B")
    (level,) = found.to_dict()["levels"]
    assert level["reference"] == "B"
    (best, other) = level["dies"]
    assert best["psnr"] > other["psnr"]
    gain = next(row["gain"] for row in level["dies"] if row["name"] == "A")
    assert abs(gain["mean"]) == pytest.approx(best["psnr"] - other["psnr"])
    for name, panel in {"A": TURNED, "B": PLAIN}.items():
        assert found[name]["auc_radial_min", 470].value == float(CAMERA.mtf(panel, 470).auc)
    assert [line.get_label() for line in found.plot().figure.axes[0].get_lines()][:2] == ["A", "B"]
    assert "gain over B" in str(found)
    assert found._repr_html_().startswith("<svg")
    with pytest.raises(KeyError, match="A, B"):
        found["C"]


@pytest.mark.slow
def test_panels_are_compared_as_a_run_of_them_is(tmp_path: Path) -> None:
    """The same photographs to the last digit, and MTFs within their error, beside the run under its own conditions."""
    place = finished(tmp_path, THREE)
    job = mf.load_job(tmp_path / "job.toml")
    run = Run(place, None, None)  # type: ignore[arg-type]
    told: list[tuple[str, int, int]] = []
    both = mf.compare(
        run, job.panels() and [_again(panel) for panel in job.panels().values()], progress=lambda *of: told.append(of)
    )
    alone = mf.compare(run)
    level = both.to_dict()["levels"][1]
    means = {row["name"]: row["psnr"] for row in level["dies"]}
    assert means[f"{place.name}:PLAIN"] == means["panels:P1"]
    assert means[f"{place.name}:TURNED"] == means["panels:P2"]
    assert {row["name"]: row["psnr"] for row in alone.to_dict()["levels"][1]["dies"]} == {
        "PLAIN": means["panels:P1"], "TURNED": means["panels:P2"],
    }  # fmt: skip
    numbers = {die["name"]: die["quantities"] for die in both.to_dict()["dies"]}
    for row in numbers["panels:P2"]:
        if row["name"].startswith(("mtf", "auc")):
            (read,) = (
                other for other in numbers[f"{place.name}:TURNED"]
                if (other["name"], other.get("wavelength_nm")) == (row["name"], row["wavelength_nm"])
            )  # fmt: skip
            assert read["value"] == pytest.approx(row["value"], abs=1e-9 + (row["uncertainty"] or 0))
    assert both["panels:P2"]["mtf50", 530].die == "P2"
    assert told[-1] == ("photographs", 2, 2)
    assert both.plot() is not None
    assert (both.save(tmp_path / "page")).is_file()
    assert not [row for row in both.compared.left_out if "another camera" in row or "otherwise" in row]


def _again(panel: Any) -> mf.Panel:
    seed = {} if panel.seed is None else {"seed": panel.seed}
    return mf.Panel.tile(panel.opening, panel.tiling, size="560 um", **seed)


def test_what_cannot_be_compared_is_refused_before_any_photograph(small_result: Path) -> None:
    for call, told in {
        (lambda: mf.compare(TURNED, camera=CAMERA)): "nothing to compare",
        (lambda: mf.compare(small_result, camera=CAMERA)): "cameras of their own",
        (lambda: mf.compare([TURNED, PLAIN])): "MF114",
        (lambda: mf.compare([TURNED, 3], camera=CAMERA)): "int states no job",
    }.items():
        with pytest.raises(InputError, match=told):
            call()


def test_a_sweep_over_objects_finds_what_each_alone_has() -> None:
    swept = mf.sweep(TURNED, GREEN, over={"camera.pixel": [1.5, "2 um"], "die.gutter": np.array([0.0, 4.0])})
    assert swept.directory is None
    found = {(row["camera.pixel"], row["die.*.gutter"]): row["value"] for row in swept.rows() if row["name"] == "mtf50"}
    assert len(found) == 4
    for (pixel, gutter), value in found.items():
        panel = mf.Panel.tile(BAR, "random", seed=1, size="560 um", gutter=gutter)
        camera = mf.Camera(**LOOK | {"pixel": pixel}, wavelengths=530)
        assert camera.mtf(panel).frequency_at(0.5).value == value
    assert swept.plot() is not None


def test_a_sweep_of_objects_is_that_of_a_study_file(tmp_path: Path) -> None:
    job = write_job(tmp_path)
    study = '[sweep]\ntitle = "Sweep"\njob = "job.toml"\nquantities = ["mtf50"]\n'
    study += '[[field]]\nkey = "camera.focal"\nfrom = "4 mm"\nto = "6 mm"\ncount = 3\n'
    (tmp_path / "study.toml").write_text(study)
    by_file = mf.sweep(tmp_path / "study.toml", tmp_path / "file", engine="serial")
    over = {"camera.focal": {"from": "4 mm", "to": "6 mm", "count": 3}}
    by_path = mf.sweep(job, over=over, quantities=["mtf50"], out=tmp_path / "path")
    assert (
        [*by_file.rows()] == [*by_path.rows()] == [*mf.sweep(mf.load_job(job), over=over, quantities=["mtf50"]).rows()]
    )
    assert (tmp_path / "path" / "sweep.csv").read_bytes() == (tmp_path / "file" / "sweep.csv").read_bytes()


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({}, "MF105 Panel does not state which"),
        ({"over": {}}, "MF105 no key varies"),
        ({"over": {"camera.pixl": [1]}}, "MF105 .*camera.pixl.*camera.pixel"),
        ({"over": {"camera.pixel": []}}, "MF10"),
        ({"over": {"camera.pixel": ["1 um"]}, "quantities": ["mtf51"]}, "MF161"),
        ({"over": {"die.seed": {"uniform": [1, 9]}}}, "MF160 .*cases"),
        ({"over": {"die.NONE.seed": [1]}}, "MF105 .*no die 'NONE'"),
    ],
)
def test_a_sweep_that_cannot_be_is_refused(more: Any, told: str) -> None:
    with pytest.raises(InputError, match=told):
        mf.sweep(TURNED, GREEN, **more)


def test_arrays_are_restored_and_measured_as_the_files_of_them(tmp_path: Path) -> None:
    counts = np.round(65535 * PHOTO).astype(np.uint16)
    path = tmp_path / "photo.tif"
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), oiio.ImageSpec(128, 128, 3, "uint16"))
    out.write_image(counts)
    out.close()
    by_file = mf.restore(path, TURNED, CAMERA, restore="wiener", epsilon=0.01)
    by_array = mf.restore(counts, TURNED, CAMERA, restore="wiener", epsilon=0.01)
    np.testing.assert_array_equal(by_array.photos[0].picture, by_file.photos[0].picture)
    assert by_array.photos[0].name == "photo"
    assert by_array._repr_html_().startswith("<img")
    edges = [mf.edge(source, TURNED, CAMERA, line=530).to_dict()["edges"] for source in (path, counts)]
    assert edges[0] == edges[1]
    planes = frame_of_array(counts.transpose(2, 0, 1), "photo")
    np.testing.assert_array_equal(planes.counts, frame_of_array(counts, "photo").counts)


@pytest.mark.parametrize(
    ("array", "told"),
    [
        ((255 * PHOTO).astype(np.uint8), "MF330 .*uint8"),
        (np.where(PHOTO > 0.5, np.nan, PHOTO), "MF333 .*not finite"),
        (PHOTO + 0j, "MF333 .*complex"),
        (PHOTO[..., :2], r"MF331 .*\(128, 128, 2\)"),
        (np.zeros((0, 0)), r"MF331 .*\(0, 0\)"),
        (PHOTO[..., 0], "MF353 .*one colour"),
        (PHOTO[:64], "MF121"),
        (3, "MF105 3 is not text, a path, an array"),
        ([PHOTO, None], "(?s)MF105 .*photos.*Give text, a path, an array"),
    ],
)
def test_an_array_that_is_no_photograph_is_refused(array: Any, told: str) -> None:
    with pytest.raises(InputError, match=told):
        mf.restore(array, TURNED, CAMERA, restore="wiener")


def test_tables_of_mask_houses_show_themselves_as_they_print() -> None:
    assert repr(mf.order.list()) == str(mf.order.list())
    assert "\n" in repr(mf.order.list())


def test_a_finished_run_is_the_path_of_its_directory(small_result: Path, tmp_path: Path) -> None:
    run = Run(small_result, None, None)  # type: ignore[arg-type]
    assert os.fspath(run) == str(small_result)
    assert mf.cite(run).to_dict() == mf.cite(small_result).to_dict()
    assert mf.view(run, tmp_path / "a.html").sha256 == mf.view(small_result, tmp_path / "b.html").sha256
    assert mf.compare(run).to_dict() == mf.compare(small_result).to_dict()
