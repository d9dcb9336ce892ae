"""Packages by a profile of one's own: what they were drawn by is in them."""

from __future__ import annotations

import hashlib
import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from once import figures_in_words
from small_job import command, with_the_die, write_job

from maskfab.job.shop import parse_shop
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.mask.package.pack import pack

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

OWN = """\
title = "A house"
sources = []
[limits]
max_references = 75
[polygons]
holes = "layer"
[order]
fields = ["tone"]
"""


@pytest.fixture(scope="module")
def packed_by_own(tmp_path_factory) -> tuple[Path, Path]:
    """A job and its package for a profile that is there no more."""
    folder = tmp_path_factory.mktemp("own")
    job, path, profile = with_the_die("TURNED", write_job(folder)), folder / "p.zip", folder / "mine.toml"
    profile.write_text(OWN, encoding="utf-8")
    with figures_in_words():
        assert pack(load_job(job), load_shop(str(profile)), path).path == path
    profile.unlink()
    return job, path


def repacked(path: Path, target: Path, **changed: str | None) -> Path:
    """The package with other texts in some of its members, or without them; the manifest stays as it is."""
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(target, "w") as other:
        for name in archive.namelist():
            content = changed.get(name.rpartition("/")[2].partition(".")[0], archive.read(name))
            if content is not None:
                other.writestr(name, content)
    return target


def test_a_package_brings_the_profile_that_it_was_drawn_by(capsys, packed_by_own, tmp_path):
    job, path = packed_by_own
    moved = tmp_path / "moved.zip"
    moved.write_bytes(path.read_bytes())
    assert command(capsys, "verify", moved, "--quiet").code == 0
    answer = command(capsys, "verify", moved, "--against", job, "--json", "--quiet")
    assert (answer.code, answer.document["verdict"]) == (0, "pass")
    assert {check["name"] for check in answer.document["checks"]} >= {
        "sha256",
        "readback_xor_area",
        "readback_wrong_dots",
    }
    with zipfile.ZipFile(path) as archive:
        (held,) = (archive.read(name).decode() for name in archive.namelist() if name.endswith("/shop.toml"))
    assert parse_shop(held, "mine", where="shop.toml") == parse_shop(OWN, "mine", where="mine.toml")


def test_a_package_tells_a_changed_or_missing_profile(capsys, packed_by_own, tmp_path):
    job, path = packed_by_own
    bad = repacked(path, tmp_path / "bad.zip", shop="title = 3")
    answer = command(capsys, "verify", bad, "--against", job, "--json", "--quiet")
    failed = {check["name"]: check["method"] for check in answer.document["checks"] if not check["passed"]}
    assert (answer.code, failed.keys()) == (1, {"sha256", "drawn_again"})
    assert "MF421" in failed["drawn_again"]
    assert "shop.toml" in failed["drawn_again"]
    none = repacked(path, tmp_path / "none.zip", shop=None)
    answer = command(capsys, "verify", none, "--against", job, "--json", "--quiet")
    assert (answer.code, answer.document["error"]["where"]) == (2, "--shop")
    assert command(capsys, "verify", none, "--quiet").code == 1


def forged(path: Path, target: Path, edit: Callable[[str], str]) -> Path:
    """The package with another profile and its true hash, as a forger would leave it."""
    with zipfile.ZipFile(path) as archive:
        texts = {name.rpartition("/")[2]: archive.read(name) for name in archive.namelist()}
    profile = edit(texts["shop.toml"].decode())
    assert profile != texts["shop.toml"].decode()
    manifest = json.loads(texts["manifest.json"])
    row = next(row for row in manifest["files"] if row["path"] == "shop.toml")
    row.update(sha256=hashlib.sha256(profile.encode()).hexdigest(), bytes=len(profile.encode()))
    return repacked(path, target, shop=profile, manifest=json.dumps(manifest, indent=1) + "\n")


def relaxed(text: str) -> str:
    """What a house says that no other paper tells of, changed."""
    return re.sub(r"max_vertices = \d+", "max_vertices = 4000", text)


def test_a_profile_that_was_changed_with_its_hash_is_named(capsys, packed_by_own, tmp_path):
    answer = command(capsys, "verify", forged(packed_by_own[1], tmp_path / "f.zip", relaxed), "--json", "--quiet")
    failed = {check["method"] for check in answer.document["checks"] if not check["passed"]}
    assert answer.code == 1
    assert "SHA-256 of certificate.json as its job and profile make it" in failed


def test_a_known_house_s_profile_that_was_changed_is_named_by_what_is_known_here(capsys, packed_by_own, tmp_path):
    path = tmp_path / "p.zip"
    assert pack(load_job(packed_by_own[0]), load_shop("pog"), path).path == path
    answer = command(capsys, "verify", forged(path, tmp_path / "f.zip", relaxed), "--json", "--quiet")
    failed = {check["name"] for check in answer.document["checks"] if check["passed"] is False}
    assert answer.code == 1
    assert "profile" in failed
    assert command(capsys, "verify", path, "--quiet").code == 0
