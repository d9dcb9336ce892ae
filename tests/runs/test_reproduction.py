"""A finished directory made once more, and the installation that makes it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_job import command, listing

from maskfab.api.camera import Camera, Psf
from maskfab.base import provenance
from maskfab.runs import pipeline

pytestmark = pytest.mark.usefixtures("drawn_in_words")


@pytest.fixture
def copy(small_result: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(small_result, tmp_path / "copy"))


def test_a_directory_is_made_again_byte_for_byte_and_left_alone(capsys, copy):
    before = listing(copy)
    told = command(capsys, "verify", "--again", copy, "--quiet")
    assert told.code == 0
    assert told.stdout.endswith("files: every byte is the same\n")
    assert listing(copy) == before


def test_what_differs_is_told_with_place_stage_and_version(capsys, copy, monkeypatch):
    report = json.loads((copy / "report.json").read_text())
    report["title"] = "ANOTHER"
    (copy / "report.json").write_text(json.dumps(report))
    (copy / "SMALL.oas").unlink()
    body = bytearray((copy / "SMALL.gds").read_bytes())
    body[100] ^= 1
    (copy / "SMALL.gds").write_bytes(body)
    monkeypatch.setattr(provenance, "versions", lambda: {"maskfab": "0.1.0", "numpy": "9.9"})
    told = command(capsys, "verify", "--again", copy, "--quiet", "--json")
    assert told.code == 1
    files = {file["name"]: file for file in told.document["files"]}
    assert {name for name, file in files.items() if file["difference"]} == {
        "report.json", "SMALL.gds", "SMALL.oas", "manifest.json"
    }  # fmt: skip
    assert files["report.json"]["difference"] == 'title: "ANOTHER" then, "SMALL PLATE" now'
    assert files["SMALL.gds"]["difference"].startswith("from byte 100 on")
    assert files["SMALL.gds"]["stage"] == "drawing and writing"
    assert files["SMALL.oas"]["difference"] == "it is missing"
    assert {"name": "numpy", "then": np.__version__, "now": "9.9"} in told.document["versions"]


@pytest.mark.parametrize("manifest", [None, "{}", "[]", '{"files": [], "versions": 3}', "\0"])
def test_what_no_run_has_finished_is_refused(capsys, tmp_path, manifest):
    if manifest is not None:
        (tmp_path / "manifest.json").write_text(manifest)
    told = command(capsys, "verify", "--again", tmp_path)
    assert told.code == 2
    assert "MF403" in told.stderr


def test_the_installation_is_examined_and_what_it_computes_wrong_is_told(capsys, monkeypatch):
    told = command(capsys, "self", "doctor", "--quiet", "--json")
    assert told.code == 0
    assert told.document["facts"]["numpy"] == np.__version__
    names = {check["name"] for check in told.document["checks"]}
    assert {"clear_stop_psf_error", "readback_xor_area", "part_works"} <= names

    right = Camera.psf

    def wrong(self: Camera, *given: object) -> Psf:
        psf = right(self, *given)  # type: ignore[arg-type]
        return replace(psf, values=psf.values * (1 + 1e-6))

    monkeypatch.setattr(Camera, "psf", wrong)
    told = command(capsys, "self", "doctor", "--quiet")
    assert told.code == 1
    assert "clear_stop_psf_error" in told.stdout


def test_the_version_and_job_of_a_run_are_cited(capsys, small_result):
    manifest = json.loads((small_result / "manifest.json").read_text())
    program = command(capsys, "self", "cite", small_result, "--json").document["program"]
    assert f"version = {{{manifest['maskfab_version']}}}" in program
    assert f"job {manifest['job_hash'][:16]}" in program
    told = command(capsys, "self", "cite").stdout
    assert told.count("{") == told.count("}")
    assert "Sankaranarayanan" in told


def test_nothing_is_taken_from_the_cache(capsys, copy, tmp_path, monkeypatch):
    """A kept result would hide what this installation makes otherwise."""
    monkeypatch.setenv("MASKFAB_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(pipeline, "give_result", lambda *_: pytest.fail("taken from the cache"))
    assert command(capsys, "verify", "--again", copy, "--quiet").code == 0
    assert not (tmp_path / "cache").exists()
