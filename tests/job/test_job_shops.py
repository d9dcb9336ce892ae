"""Profiles of mask houses that a job brings along: kept in it, hashed with it, refused with it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from small_job import JOB, command, listing, write_job

from maskfab.base.errors import OutputError
from maskfab.job.shop import dump_shop, parse_shop, read_shop
from maskfab.mask.houses.profiles import load_shop, shop_names, shop_of
from maskfab.mask.job import load_job

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

PROFILE = """\
title = "A house"
sources = ["https://house.example/rules"]

[accepts]
formats = ["gdsii"]
versions = { gdsii = "7" }

[limits]
min_feature_um = 2.0

[tolerance]
cd_um = [[10, 0.5], [inf, 2.54]]

[order]
fields = ["tone"]
"""
# The same facts, written by somebody else.
ALIKE = """\
# As read in May.
sources = ['https://house.example/rules']
title = 'A house'
order = { fields = ["tone"] }
tolerance.cd_um = [[10.0, 0.50], [inf, 2.54]]
limits.min_feature_um = 2
[accepts]
formats = ["gdsii"]   # no other
[accepts.versions]
gdsii = "7"
"""


def job_with(folder: Path, profile: str = PROFILE, shop: str = "houses/mine.toml") -> Path:
    """The small job's first die, and the profile that its [export] names."""
    job = write_job(folder, ("[plate]", f'[export]\nshop = "{shop}"\n\n[plate]'))
    job.write_text(job.read_text(encoding="utf-8").partition('[[die]]\nname = "TURNED"')[0], encoding="utf-8")
    path = folder / shop
    path.parent.mkdir(exist_ok=True)
    path.write_text(profile, encoding="utf-8")
    return job


@pytest.mark.parametrize("name", shop_names())
def test_a_profile_survives_being_dumped(name):
    shop = load_shop(name)
    text = dump_shop(shop)
    assert parse_shop(text, name, where="again") == shop
    assert dump_shop(parse_shop(text, name, where="again")) == text


def test_no_character_and_no_number_is_lost_in_a_dump():
    title = 'quotes " and \\ and \t and \x7f and \u20ac and \U0001f600 and {braces}'
    values = f"title = {json.dumps(title, ensure_ascii=False).replace(chr(127), chr(92) + 'u007f')}\nsources = []\n"
    more = '[accepts.versions]\n"a key" = "b"\n[limits]\nmin_feature_um = 1e-5\n[order]\nfields = ["tone"]\n'
    shop = parse_shop(values + more, "odd", where="odd.toml")
    assert shop.title == title
    assert parse_shop(dump_shop(shop), "odd", where="again") == shop


def test_a_job_keeps_the_profile_and_needs_its_file_no_more(tmp_path):
    job = load_job(job_with(tmp_path / "here"))
    shutil.rmtree(tmp_path / "here")
    kept = tmp_path / "job.json"
    kept.write_text(json.dumps(job.spec.dump()), encoding="utf-8")
    again = load_job(kept)
    assert again.spec == job.spec
    assert again.digest == job.digest
    shop = shop_of(again.spec, again.where)
    assert shop == parse_shop(PROFILE, "mine", where="mine.toml")


def test_the_hash_covers_what_a_profile_says_and_not_how(tmp_path):
    first = load_job(job_with(tmp_path / "a")).digest
    assert load_job(job_with(tmp_path / "b", ALIKE)).digest == first
    assert load_job(job_with(tmp_path / "c", PROFILE, "mine.toml")).digest == first
    assert load_job(job_with(tmp_path / "d", PROFILE.replace("2.0", "2.1"))).digest != first
    assert load_job(job_with(tmp_path / "e", PROFILE, "yours.toml")).digest != first


def test_a_profile_lies_beside_its_job_wherever_one_stands(tmp_path, monkeypatch):
    job = job_with(tmp_path / "job")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert load_job(job).spec.shops.keys() == {"mine.toml"}


def test_the_profile_of_a_file_is_none_of_the_bundled_ones_of_that_name(tmp_path):
    job = load_job(job_with(tmp_path, PROFILE, "gesim.toml"))
    shop = shop_of(job.spec, job.where)
    assert (shop.name, shop.title) == ("gesim", "A house")
    bundled = load_job(write_job(tmp_path / "other", ("[plate]", '[export]\nshop = "gesim"\n\n[plate]')))
    assert bundled.spec.shops == {}
    assert shop_of(bundled.spec, bundled.where) == load_shop("gesim")


BAD = {
    "none": (None, "MF420"),
    "a folder": ("", "MF420"),
    "empty": (b"", "MF421"),
    "no text": (b"\xff\xfe", "MF421"),
    "no TOML": (b"limits =", "MF421"),
    "a strange key": (PROFILE.encode() + b"[strange]\nkey = 1\n", "MF421"),
    "no number": (PROFILE.replace("2.0", "nan").encode(), "MF421"),
    "too wide": (PROFILE.replace("2.0", "1e12").encode(), "MF421"),
    "no polygon": (PROFILE.replace("min_feature_um = 2.0", "max_vertices = 3").encode(), "MF421"),
    "no plate": (PROFILE.encode() + b"[plate]\nextent_mm = [1e9, 1e9]\n", "MF421"),
}


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("words", [("run", "JOB"), ("order", "pack", "JOB", "--shop", "pog")], ids=["run", "pack"])
def test_a_bad_profile_is_refused_before_anything_is_drawn(capsys, tmp_path, monkeypatch, kind, words):
    content, code = BAD[kind]
    job = job_with(tmp_path)
    path = tmp_path / "houses" / "mine.toml"
    path.unlink()
    if content == "":
        path.mkdir()
    elif content is not None:
        path.write_bytes(content)

    def begun(*_: object, **__: object) -> None:
        raise AssertionError("work has begun")

    monkeypatch.setattr("maskfab.mask.houses.files.PlateFiles", begun)
    monkeypatch.setattr("maskfab.runs.pipeline.draw_files", begun)
    before = listing(tmp_path)
    answer = command(
        capsys, *(job if word == "JOB" else word for word in words), "--out", tmp_path / "out", "--json", "--quiet"
    )
    assert (answer.code, answer.document["error"]["code"]) == (2, code)
    told = answer.document["error"]
    assert "mine.toml" in told["where"] + told["what"]
    assert listing(tmp_path) == before


def test_a_profile_saved_with_a_mark_is_read(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbf" + PROFILE.replace("\n", "\r\n").encode())
    assert read_shop(path) == parse_shop(PROFILE, "mine", where="mine.toml")


def test_a_profile_that_a_job_keeps_is_judged_as_strictly(tmp_path):
    text = JOB.replace("[plate]", '[export]\nshop = "mine.toml"\n\n[plate]', 1)
    job = write_job(tmp_path)
    job.write_text(f'{text}\n[shops]\n"mine.toml" = "title = 3"\n', encoding="utf-8")
    with pytest.raises(OutputError, match=r"MF421 .*shops\.mine\.toml"):
        load_job(job)


def test_a_finished_run_proves_itself_elsewhere_without_the_profile(capsys, tmp_path):
    here = tmp_path / "here"
    job = job_with(here)
    assert command(capsys, "run", job, "--out", here / "out", "--quiet").code == 0
    moved = tmp_path / "far" / "away"
    moved.parent.mkdir()
    shutil.move(here / "out", moved)
    shutil.rmtree(here)
    answer = command(capsys, "verify", moved, "--json", "--quiet")
    assert (answer.code, answer.document["verdict"]) == (0, "pass")
    assert {"shop_format", "shop_min_feature"} <= {check["name"] for check in answer.document["checks"]}
    kept = (moved / "job.json").read_text(encoding="utf-8")
    assert "min_feature_um = 2.0" in kept
    (moved / "job.json").write_text(kept.replace("min_feature_um = 2.0", "min_feature_um = 20.0"), encoding="utf-8")
    answer = command(capsys, "verify", moved, "--json", "--quiet")
    failed = {check["name"] for check in answer.document["checks"] if not check["passed"]}
    assert answer.code == 1
    assert failed >= {"sha256", "job_hash", "shop_min_feature"}
