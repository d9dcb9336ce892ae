"""Names in jobs become names of files: no file beyond the output folder, and none over another."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from small_job import OPENING, command, listing, look, with_the_die, write_job
from sweeps import in_turns, sweep

from maskfab.job.values import check_name
from maskfab.mask.package.archive import safe_stem

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

FORMATS = '[export]\nformats = ["gdsii", "dxf_r12", "dxf_r2010", "oasis", "gerber", "svg", "png", "tiff", "glb"]\n'
ELSEWHERE = [
    "../x", "..", ".", "", "/tmp/x", "a/b", "a\\b", "C:x", "x\x00y", "x\ny", "~", "$HOME", "-rf", "x.y", " x", "x ",
    "ä", "\ufb01", "\u0410", "x" * 25, "1x", "_x", "\u202ex", "x\u200b",
]  # fmt: skip
DEVICES = ["CON", "con", "Prn", "AUX", "NUL", "COM1", "lpt9"]


def run(capsys, job: Path, *options):
    return command(capsys, "run", job, "--out", job.parent / "out", "--quiet", "--json", *options)


@pytest.mark.parametrize(
    ("key", "name"), sweep(in_turns(("SMALL", "PLAIN"), (*ELSEWHERE, *DEVICES)), len(ELSEWHERE) + len(DEVICES))
)
def test_names_that_lead_elsewhere_are_refused_before_anything_is_written(capsys, tmp_path, name, key):
    job = write_job(tmp_path, (f'name = "{key}"', f"name = {json.dumps(name)}"))
    before = listing(tmp_path)
    answer = run(capsys, job)
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF110")
    assert listing(tmp_path) == before


@pytest.mark.parametrize("name", sweep((*ELSEWHERE, *DEVICES), 8))
def test_an_opening_cannot_have_such_a_name_either(capsys, tmp_path, name):
    job = write_job(tmp_path, opening=OPENING.replace('"ring"', json.dumps(name)))
    answer = run(capsys, job)
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF110")


@pytest.mark.parametrize("pair", [("a", "A"), ("Ring_1", "RING_1"), ("PLAIN", "plain")])
def test_dies_that_differ_in_case_only_are_refused(capsys, tmp_path, pair):
    job = write_job(tmp_path, ('name = "PLAIN"', f'name = "{pair[0]}"'), ('name = "TURNED"', f'name = "{pair[1]}"'))
    before = listing(tmp_path)
    answer = run(capsys, job)
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF109")
    assert all(repr(name) in answer.document["error"]["what"] for name in pair)
    assert listing(tmp_path) == before


@pytest.mark.parametrize(
    "names",
    [
        ("SMALL", "TITLE", "SMALL"),  # the plate's own, and a mark's
        pytest.param(("R2010", "RING_D8000_G0_R0", "CLEAR"), marks=pytest.mark.slow),
        pytest.param(("report", "json", "R12"), marks=pytest.mark.slow),
    ],
)
def test_names_of_other_things_give_each_file_and_cell_a_name_of_its_own(capsys, tmp_path, names):
    plate, *dies = names
    job = write_job(
        tmp_path,
        ('name = "SMALL"', f'name = "{plate}"'),
        ('name = "PLAIN"', f'name = "{dies[0]}"'),
        ('name = "TURNED"', f'name = "{dies[1]}"'),
    )
    job.write_text(job.read_text(encoding="utf-8") + FORMATS, encoding="utf-8")
    answer = run(capsys, job)
    assert (answer.code, answer.document["verdict"]) == (0, "pass")
    out = listing(tmp_path / "out")
    assert len({name.casefold() for name in out}) == len(out) == 7 + 2 * 3 + 10
    listed = [file["path"] for file in json.loads(out["manifest.json"])["files"]]
    assert sorted([*listed, "manifest.json", "timing.json"]) == sorted(out)
    assert {path.name for path in tmp_path.iterdir()} == {"job.toml", "ring.toml", "out"}


def test_wavelengths_that_are_nearly_alike_have_files_of_their_own(capsys, tmp_path):
    (tmp_path / "ring.toml").write_text(OPENING, encoding="utf-8")
    lines = look(wavelengths=["530.0001 nm", "530.0002 nm"])
    answer = command(capsys, "analyse", tmp_path / "ring.toml", *lines, "--out", tmp_path / "out")
    assert answer.code == 0, answer.stderr
    written = sorted(path.name for path in (tmp_path / "out").glob("*.exr"))
    assert len(written) == 4
    assert all(any(line in name for name in written) for line in ("530.0001nm", "530.0002nm"))


@pytest.mark.parametrize("target", ["sub/../../outside"])
def test_out_is_where_the_user_says_and_nothing_else_changes(capsys, tmp_path, target):
    """Dots in --out are the user's own, and are followed; the job's names add nothing to them."""
    inner = tmp_path / "inner"
    job = with_the_die("PLAIN", write_job(inner, ("[plate]", '[export]\nformats = ["gdsii"]\n\n[plate]')))
    (inner / "sub").mkdir()
    answer = command(capsys, "run", job, "--out", inner / target, "--quiet")
    assert answer.code == 0
    assert (tmp_path / "outside" / "report.html").is_file()
    assert {path.name for path in tmp_path.iterdir()} == {"inner", "outside"}


@pytest.mark.parametrize("name", ["a", "A1_b", "x" * 24, "COM", "CONE", "AUX2"])
def test_plain_names_are_names(name):
    assert check_name(name) == name
    assert safe_stem(name) == name
