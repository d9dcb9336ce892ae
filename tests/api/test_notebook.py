"""The Python door: what is typed in a notebook, and what is refused there."""

from __future__ import annotations

import inspect
import pkgutil
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from klayout import db
from once import figures_in_words
from small_job import write_job

import maskfab as mf
from maskfab.base import resources
from maskfab.base.errors import JobError, MissingPackageError, OpeningError, OutputError, UnknownNameError
from maskfab.base.model import Tiling
from maskfab.findings.analysis import Request, analyse_opening
from maskfab.mask.opening_file import load_opening

README = Path(mf.__file__).parents[1] / "README.md"
LOOK = {"stop": "400 um", "pixel": "2 um", "wavelengths": ["530 nm", "470 nm"], "window": "64 um"}


SMALL = {
    '"10 mm"': '"5 mm", window="64 um"',
    '"4 mm"': '"400 um"',
    '["610 nm", "530 nm", "470 nm"]': '["530 nm", "470 nm"]',
    '"4.4 mm"': '"560 um"',
    "(15, 7)": "(5, 3)",
    "dots=21": "dots=7",
    '"168 um"': '"56 um"',
    ", found.map": ', "flips", seed=2, size="500 um"',
    'template="5in"': 'blank="27 mm", writable="22 mm", camera=camera',
}
"""Edits that make the ten lines small enough for every run of the tests."""


@pytest.fixture(scope="module")
def typed(tmp_path_factory) -> dict[str, Any]:
    """The names after the ten lines in small, run in a folder of their own; the design is one found before."""
    lines, found = ten_lines(), mf.Opening.bar(dots=7, size=(3, 3), pitch="56 um")
    for old, new in SMALL.items():
        assert old in lines, old
        lines = lines.replace(old, new)
    asked, known = {}, inspect.signature(mf.design)

    def designed(**keys):
        asked.update(known.bind(**keys).arguments)
        return SimpleNamespace(opening=found)

    names: dict[str, Any] = {"asked": asked}
    with pytest.MonkeyPatch.context() as patch, figures_in_words():
        patch.chdir(tmp_path_factory.mktemp("notebook"))
        patch.setattr(mf, "design", designed)
        exec(lines, names)
        names["folder"] = Path.cwd()
    return names


@pytest.fixture(scope="module")
def camera(typed) -> mf.Camera:
    return typed["camera"]


@pytest.fixture(scope="module")
def bar(typed) -> mf.Opening:
    return typed["bar"]


@pytest.fixture(scope="module")
def panel(typed) -> mf.Panel:
    return typed["panel"]


@pytest.fixture(scope="module")
def plate(typed) -> mf.Plate:
    return typed["plate"]


@pytest.fixture(scope="module")
def report(typed):
    return replace(typed["report"], directory=typed["folder"] / typed["report"].directory)


def ten_lines() -> str:
    return next(block for block in re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL) if "mf." in block)


@pytest.mark.slow
def test_the_ten_lines_of_the_readme_run_in_an_empty_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(ten_lines(), names)
    assert "cy/mm" in capsys.readouterr().out
    assert names["report"].passed
    assert names["found"].opening.clear_dots == 88
    assert (tmp_path / "demo.oas").read_bytes() == (tmp_path / "build/demo/PLATE.oas").read_bytes()


def test_the_ten_lines_in_small_make_a_plate_that_passes(typed):
    assert typed["asked"]["clear_dots"] == 88
    assert typed["report"].passed
    written, run = typed["folder"] / "demo.oas", typed["folder"] / "build/demo/PLATE.oas"
    assert written.read_bytes() == run.read_bytes()


def test_a_plate_of_python_is_the_job_of_a_file(tmp_path, bar, camera):
    """Equal text, equal hash; and the panels are those of the job."""
    bar.save(tmp_path / "bar.toml")
    edits = [
        ("ring.toml", "bar.toml"),
        ("ring.toml", "bar.toml"),
        ('wavelengths = ["530 nm"]', 'wavelengths = ["530 nm", "470 nm"]'),
        ('pitch = "56 um"\n', ""),
        ('pitch = "56 um"\n', ""),
    ]
    job = mf.load_job(write_job(tmp_path, *edits))
    panels = {
        "PLAIN": mf.Panel.tile(bar, size="560 um"),
        "TURNED": mf.Panel.tile(bar, "random", seed=3, size=560),
    }
    made = mf.Plate.of(
        panels,
        blank="27 mm",
        writable=22_000,
        die_pitch="2 mm",
        columns=2,
        name="SMALL",
        title="SMALL PLATE",
        labels={"PLAIN": "periodic", "TURNED": "random"},
    )
    assert made.job(camera).spec == job.spec
    assert made.job(camera).digest == job.digest
    for die in made.layout(camera).dies:
        np.testing.assert_array_equal(die.panel.orientations, panels[die.name].orientations)


def test_dies_of_one_plate_have_their_own_sizes(plate, camera):
    """A die's size is its own: as many whole pixels as fit, in the middle of its slot."""
    sizes = {die.name: (die.panel.size_nm, die.slot_nm) for die in plate.layout(camera).dies}
    assert sizes == {"BAR": ((560_000, 560_000), 560_000), "OURS": ((448_000, 448_000), 560_000)}
    with pytest.raises(JobError, match="MF108 die 'BAR' is 560 um wide, more than its slot of 500 um"):
        replace(plate, section=replace(plate.section, die_size=500.0)).layout(camera)


def test_a_panel_keeps_its_lags_for_its_next_mtf(camera, bar):
    panel = mf.Panel.tile(bar, "random", seed=1, size="560 um")
    assert camera.mtf(panel, "530 nm").table is camera.mtf(panel, "530 nm").table


def test_psf_and_mtf_are_those_of_the_analysis_of_the_written_file(camera, bar):
    """Computed from the design here, and from polygons that were written and read back there."""
    panel = mf.Panel.tile(bar, size="448 um")
    found = analyse_opening(bar, Request(camera.model))
    for read in found.psfs:
        own = camera.psf(panel, read.wavelength_nm, pixels=read.kind == "pixel")
        np.testing.assert_allclose(own.samples, read.values, atol=1e-7 * read.values.max())
        assert own.x_um[len(own.x_um) // 2] == 0
        assert own.y_um[1] - own.y_um[0] == own.step_um
    numbers = mf.Quantities(found.quantities)
    for line in (530, "470 nm"):
        own = camera.mtf(panel, line)
        at = own.wavelength_nm
        assert float(own.auc) == pytest.approx(float(numbers["auc_radial_min", at]), abs=1e-12)
        assert own.frequency_at(0.5).value == numbers["mtf50", at].value


def test_any_level_is_found_as_exactly_as_the_usual_ones(camera, panel):
    """Modulation falls: so does the frequency with a rising level, each within the ring in which the mean crosses."""
    mtf = camera.mtf(panel, "530 nm")
    found = [mtf.frequency_at(level) for level in (0.6, 0.5, 0.45, 0.3, 0.2)]
    assert [float(each) for each in found] == sorted(map(float, found))
    axis, mean = mtf.frequency_cy_per_mm, mtf.cuts["radial_mean"]
    for level, each in zip((0.6, 0.5, 0.45, 0.3, 0.2), found, strict=True):
        rough = axis[np.flatnonzero(mean < level)[0]]
        assert abs(float(each) - rough) < 2 * axis[1]
        assert 0 < each.uncertainty < axis[1]
    cutoff = 1e3 * 400 / (0.53 * 5000)  # D / (λf), cycles per millimetre
    last = mtf.frequency_at(1e-9)
    assert abs(float(last) - cutoff) < last.uncertainty


def test_results_are_looked_up_by_die_name_and_wavelength(report, camera, plate):
    mtf50 = report["BAR"]["mtf50", 530]
    assert (mtf50.die, mtf50.wavelength_nm, mtf50.unit) == ("BAR", 530.0, "cy/mm")
    assert float(mtf50) == pytest.approx(float(camera.mtf(plate["BAR"], 530).frequency_at(0.5)), rel=1e-9)
    assert str(mtf50).endswith("cy/mm")
    assert "±" in str(mtf50)
    assert list(report) == ["BAR", "OURS"]
    assert report["BAR"]["open_ratio"].value == pytest.approx(15 / 49)
    assert report.passed
    assert not report.checks.failed
    assert report.to_dict()["dies"][0]["quantities"] == report["BAR"].to_dict()
    assert "mtf50" in str(report)
    assert report._repr_html_().count("<tr") == 1 + sum(len(report[die]) for die in report) + len(report.plate)


@pytest.mark.parametrize(
    ("key", "said"),
    [(("mtf50", 531), "one of 530, 470"), ("mtf50", "stands 2 times"), ("nonsense", "open_ratio")],
)
def test_a_number_that_is_not_there_is_a_key_error_that_names_those_that_are(report, key, said):
    with pytest.raises(KeyError, match=said) as refusal:
        report["BAR"][key]
    assert isinstance(refusal.value, UnknownNameError)
    with pytest.raises(UnknownNameError, match=r"MF432 there is no die 'THEIRS'\. Use one of BAR, OURS"):
        report["THEIRS"]


def test_a_dataframe_has_a_row_for_each_number_and_needs_pandas(report, monkeypatch):
    rows = []
    monkeypatch.setitem(sys.modules, "pandas", type("pandas", (), {"DataFrame": rows.extend}))
    report.to_dataframe()
    assert [row["name"] for row in rows[:3]] == [each.name for each in report["BAR"][:3]]
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingPackageError, match=r"MF152 .*pip install .*\[pandas\]'"):
        report["BAR"].to_dataframe()


@pytest.mark.parametrize("name", ["demo.oas", "demo.gds", "demo.dxf", "demo_R12.dxf", "DEMO.GBR", "demo.svg"])
def test_a_plate_is_written_in_the_format_of_its_suffix(plate, camera, tmp_path, name):
    file = plate.write(tmp_path / name, camera)
    starts = {".oas": b"%SEMI-OASIS", ".gds": b"\0\x06\0\x02", ".dxf": b"999", ".gbr": b"G04", ".svg": b"<?xml"}
    assert file.read_bytes().startswith(starts[file.suffix.lower()])
    if file.suffix == ".oas":
        checks = mf.verify(file, against=replace(plate, camera=camera))
        assert checks.passed
        assert "PASS: " in str(checks)


def test_a_file_in_which_a_polygon_moved_fails_against_the_plate(plate, camera, tmp_path):
    file = plate.write(tmp_path / "demo.oas", camera)
    layout = db.Layout()
    layout.read(str(file))
    layout.top_cell().shapes(layout.layer(1, 0)).insert(db.Box(0, 0, 1000, 1000))
    layout.write(str(file))
    checks = mf.verify(file, against=replace(plate, camera=camera))
    assert not checks.passed
    assert checks.failed


def test_main_types_show_themselves_as_pictures(bar, panel, plate, camera, tmp_path):
    with_camera = replace(plate, camera=camera)
    for shown in (bar, panel, with_camera, camera.psf(panel, 530), camera.mtf(panel, 530)):
        picture = shown._repr_svg_()
        assert picture.startswith("<svg")
        assert picture == shown.plot().svg()
    assert bar.plot().save(tmp_path / "bar.png").read_bytes().startswith(b"\x89PNG")
    assert bar.plot().save(tmp_path / "bar.svg").read_text() == bar._repr_svg_()
    with pytest.raises(OutputError, match="MF430"):
        bar.plot().save(tmp_path / "bar.bmp")


def test_openings_come_from_arrays_and_files(bar, tmp_path):
    assert np.array_equal(mf.read_opening(bar.save(tmp_path / "bar.toml")).mask, bar.mask)
    np.save(tmp_path / "bar.npy", bar.mask)
    for source in (bar.mask, bar.mask.astype(float), tmp_path / "bar.npy"):
        found = mf.read_opening(source, pitch="56 um")
        assert np.array_equal(found.mask, bar.mask)
        assert found.dot_nm == 8000
    assert mf.read_opening(tmp_path / "bar.toml", pitch=112).dot_nm == 16_000


def test_every_tiling_is_laid_out_as_a_job_lays_it_out(bar, camera):
    for tiling in set(Tiling) - {Tiling.MAP}:
        panel = mf.Panel.tile(bar, tiling, seed=5 if tiling.seeded else None, size="560 um")
        (die,) = mf.Plate.of(A=panel, blank="27 mm", writable="22 mm").layout(camera).dies
        np.testing.assert_array_equal(die.panel.orientations, panel.orientations)
        np.testing.assert_array_equal(die.panel.opening.mask, panel.opening.mask)


def test_a_map_gives_its_own_size_and_needs_a_seed_only_beyond_itself():
    found = mf.read_map(resources.path("layouts/maps/fits_88.toml"))
    opening = load_opening(resources.path("layouts/openings/fits_88.toml"))
    panel = mf.Panel.tile(opening, found)
    np.testing.assert_array_equal(panel.orientations, found.cells)
    with pytest.raises(JobError, match="MF111"):
        mf.Panel.tile(opening, found, size="8.4 mm")
    wider = mf.Panel.tile(opening, found, size="8.4 mm", seed=1)
    assert min(wider.orientations.shape) > min(found.cells.shape)


BAR = {"dots": 7, "size": (5, 3), "pitch": "56 um"}
TILE = {"tiling": "random", "seed": 1, "size": "560 um"}


@pytest.mark.parametrize(
    ("error", "code", "call"),
    [
        (JobError, "MF103", lambda bar: mf.Opening.bar(**BAR | {"pitch": "56"})),
        (JobError, "MF103", lambda bar: mf.Opening.bar(**BAR | {"pitch": "56 ms"})),
        (JobError, "MF106", lambda bar: mf.Opening.bar(**BAR | {"pitch": "56.001 um"})),
        (JobError, "MF105", lambda bar: mf.Opening.bar(**BAR | {"dots": "seven"})),
        (JobError, "MF105", lambda bar: mf.Opening.bar(**BAR | {"size": "5x3"})),
        (JobError, "MF104", lambda bar: mf.Opening.bar(**BAR | {"size": (9, 3)})),
        (JobError, "MF110", lambda bar: mf.Opening.bar(**BAR, name="2nd bar")),
        (OpeningError, "MF202", lambda bar: mf.Opening.of(np.full((7, 7), 0.5), pitch="56 um")),
        (OpeningError, "MF202", lambda bar: mf.Opening.of([["#", "."], [".", "#"]], pitch="56 um")),
        (OpeningError, "MF201", lambda bar: mf.Opening.of(np.ones((7, 6)), pitch="56 um")),
        (OpeningError, "MF201", lambda bar: mf.Opening.of(np.ones(7), pitch="56 um")),
        (OpeningError, "MF203", lambda bar: mf.Opening.of(np.zeros((7, 7)), pitch="56 um")),
        (JobError, "MF105", lambda bar: mf.read_opening(np.ones((7, 7)))),
        (JobError, "MF105", lambda bar: mf.Panel.tile(bar, "spiral", size="560 um")),
        (JobError, "MF111", lambda bar: mf.Panel.tile(bar, "random", size="560 um")),
        (JobError, "MF105", lambda bar: mf.Panel.tile(bar, "random", seed="one", size="560 um")),
        (JobError, "MF104", lambda bar: mf.Panel.tile(bar, "random", seed=-1, size="560 um")),
        (JobError, "MF103", lambda bar: mf.Panel.tile(bar, size="560")),
        (JobError, "MF105", mf.Panel.tile),
        (JobError, "MF108", lambda bar: mf.Panel.tile(bar, size="50 um")),
        (JobError, "MF107", lambda bar: mf.Panel.tile(bar, size="560 um", gutter="3 nm")),
        (JobError, "MF107", lambda bar: mf.Panel.tile(bar, size="560 um", pitch="300 dpi")),
        (JobError, "MF103", lambda bar: mf.Camera("5", **LOOK)),
        (JobError, "MF105", lambda bar: mf.Camera("5 mm", **LOOK | {"stop": {"shape": "star"}})),
        (JobError, "MF131", lambda bar: mf.Camera("5 mm", **LOOK | {"stop": "20 mm"})),
        (JobError, "MF112", lambda bar: mf.Camera("5 mm", **LOOK | {"wavelengths": "530 um"})),
        (JobError, "MF105", lambda bar: mf.Camera("5 mm", **LOOK | {"wavelengths": []})),
        (JobError, "MF105", lambda bar: mf.Camera("5 mm", **LOOK).psf(mf.Panel.tile(bar, **TILE))),
        (JobError, "MF114", lambda bar: mf.Camera("5 mm", **LOOK).mtf(mf.Panel.tile(bar, size="112 um"), 530)),
        (JobError, "MF113", lambda bar: mf.Camera("1 mm", **LOOK | {"window": "1 mm"}).psf(
            mf.Panel.tile(bar, **TILE), 530)),
        (JobError, "MF104", lambda bar: mf.Camera("5 mm", **LOOK).mtf(mf.Panel.tile(bar, **TILE), 530).frequency_at(2)),
        (JobError, "MF105", lambda bar: mf.Camera("5 mm", **LOOK).mtf(mf.Panel.tile(bar, **TILE), 530).frequency_at(
            "half")),
        (JobError, "MF105", lambda bar: mf.Plate.of(A=bar)),
        (JobError, "MF105", lambda bar: mf.Plate.of()),
        (JobError, "MF105", lambda bar: mf.Plate.of(A=mf.Panel.tile(bar, **TILE), columns="two")),
        (JobError, "MF102", lambda bar: mf.Plate.of(A=mf.Panel.tile(bar, **TILE), sections={"camera": {}})),
        (JobError, "MF110", lambda bar: mf.Plate.of(A=mf.Panel.tile(bar, **TILE), name="PLATE 1")),
        (JobError, "MF114", lambda bar: mf.Plate.of(A=mf.Panel.tile(bar, **TILE)).layout()),
        (JobError, "MF125", lambda bar: mf.Plate.of(A=mf.Panel.tile(bar, **TILE), template="9in").layout()),
        (OutputError, "MF430", lambda bar: mf.Plate.of(A=mf.Panel.tile(bar, **TILE)).write("a.psd")),
        (JobError, "MF105", lambda bar: mf.run(mf.Plate.of(A=mf.Panel.tile(bar, **TILE)))),
        (JobError, "MF105", lambda bar: mf.run("job.toml", mf.Camera("5 mm", **LOOK), "out")),
        (JobError, "MF105", lambda bar: mf.verify(README)),
        (JobError, "MF103", lambda bar: mf.design(dots=7, pitch="56", clear_dots=9)),
        (JobError, "MF105", lambda bar: mf.design(dots=7, pitch="56 um")),
        (JobError, "MF102", lambda bar: mf.design(dots=7, pitch="56 um", clear_dots=9, speed=3)),
        (JobError, "MF103", lambda bar: mf.design(dots=7, pitch="56 um", clear_dots=9, budget="9")),
        (OpeningError, "MF204", lambda bar: mf.design(dots=7, pitch="56 um", clear_dots=49, rules={"rim_dots": 1})),
    ],
)  # fmt: skip
def test_bad_input_is_refused_with_the_code_of_the_job_file(bar, error, code, call):
    with pytest.raises(error) as refusal:
        call(bar)
    assert refusal.value.code == code
    assert refusal.value.cure


def test_two_openings_of_one_name_are_refused(bar, camera):
    other = mf.Opening.bar(dots=7, size=(3, 5), pitch="56 um", name=bar.name)
    panels = {name: mf.Panel.tile(each, size="560 um") for name, each in (("A", bar), ("B", other))}
    with pytest.raises(JobError, match="MF109 two different openings have the name 'bar_5x3'"):
        mf.Plate.of(panels, blank="27 mm", writable="22 mm").layout(camera)


def test_sections_of_a_job_file_reach_the_job(panel, camera):
    plate = mf.Plate.of(A=panel, sections={"scene": {"gap": "0.5 mm"}, "limits": {"min_feature": "4 um"}})
    job = plate.job(camera)
    assert job.spec.scene.gap == 500
    assert job.spec.limits.min_feature == 4
    with pytest.raises(JobError, match=r"MF102 unknown key 'scene\.gape'"):
        mf.Plate.of(A=panel, sections={"scene": {"gape": "0.5 mm"}}).job(camera)


def test_public_names_are_no_rooms_and_stay_functions_after_any_import():
    from maskfab import designs as pareto  # noqa: F401
    from maskfab.mask.comparison import files  # noqa: F401

    assert not {each.name for each in pkgutil.iter_modules(mf.__path__)} & set(mf.__all__)
    for name in mf.__all__:
        assert getattr(mf, name) is not None
    assert dir(mf) == sorted(mf.__all__)
    assert "clear_dots" in inspect.signature(mf.design).parameters
    assert "against" in inspect.signature(mf.verify).parameters
    with pytest.raises(JobError, match="MF103"):
        mf.design(dots=7, pitch="56", clear_dots=9)
