"""Packages by a profile of one's own: what they were drawn by is in them."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from once import figures_in_words
from repacking import members, repacked
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


def with_profile(edit: Callable[[bytes], bytes | None]) -> Callable[[str, bytes], bytes | None]:
    """An edit of a package in which the profile of its house is another, or none."""
    return lambda name, content: edit(content) if name.endswith("/shop.toml") else content


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
    (held,) = (content.decode() for name, content in members(path).items() if name.endswith("/shop.toml"))
    assert parse_shop(held, "mine", where="shop.toml") == parse_shop(OWN, "mine", where="mine.toml")


def test_a_package_tells_a_changed_or_missing_profile(capsys, packed_by_own, tmp_path):
    job, path = packed_by_own
    bad = repacked(path, tmp_path / "bad.zip", with_profile(lambda _: b"title = 3"))
    answer = command(capsys, "verify", bad, "--against", job, "--json", "--quiet")
    failed = {check["name"]: check["method"] for check in answer.document["checks"] if not check["passed"]}
    assert (answer.code, failed.keys()) == (1, {"sha256", "drawn_again"})
    assert "MF421" in failed["drawn_again"]
    assert "shop.toml" in failed["drawn_again"]
    none = repacked(path, tmp_path / "none.zip", with_profile(lambda _: None))
    answer = command(capsys, "verify", none, "--against", job, "--json", "--quiet")
    assert (answer.code, answer.document["error"]["where"]) == (2, "--shop")
    assert command(capsys, "verify", none, "--quiet").code == 1


def relaxed(profile: bytes) -> bytes:
    """What a house says that no other paper tells of, changed."""
    changed = re.sub(rb"max_vertices = \d+", b"max_vertices = 4000", profile)
    assert changed != profile
    return changed


def test_a_profile_that_was_changed_with_its_hash_is_named(capsys, packed_by_own, tmp_path):
    forged = repacked(packed_by_own[1], tmp_path / "f.zip", with_profile(relaxed), honest=True)
    answer = command(capsys, "verify", forged, "--json", "--quiet")
    failed = {check["method"] for check in answer.document["checks"] if not check["passed"]}
    assert answer.code == 1
    assert "SHA-256 of certificate.json as its job and profile make it" in failed


def test_a_known_house_s_profile_that_was_changed_is_named_by_what_is_known_here(capsys, packed_by_own, tmp_path):
    path = tmp_path / "p.zip"
    assert pack(load_job(packed_by_own[0]), load_shop("pog"), path).path == path
    forged = repacked(path, tmp_path / "f.zip", with_profile(relaxed), honest=True)
    answer = command(capsys, "verify", forged, "--json", "--quiet")
    failed = {check["name"] for check in answer.document["checks"] if check["passed"] is False}
    assert answer.code == 1
    assert "profile" in failed
    assert command(capsys, "verify", path, "--quiet").code == 0
