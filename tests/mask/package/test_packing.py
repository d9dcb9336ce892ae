"""Packages: equal bytes, safe names, proofs from the files in the zip, and nothing where the house would refuse."""

from __future__ import annotations

import multiprocessing
import sys
import time
import zipfile
from pathlib import Path

import pytest
from hostile_files import overlapping
from once import figures_in_words
from repacking import repacked
from small_job import command, write_job

from maskfab.base.errors import MissingPackageError, SourceError
from maskfab.mask import layout, sandbox
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.mask.package.archive import safe_stem
from maskfab.mask.package.pack import pack, verify_package
from maskfab.mask.process_limits import children_seconds

LAYOUTS = Path(__file__).parents[3] / "layouts"

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")


def test_a_package_that_could_not_be_read_back_is_not_begun(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "gerbonara", None)
    job, told = write_job(tmp_path), []
    with pytest.raises(MissingPackageError, match=r"MF152 .*\[gerber\]"):
        pack(
            load_job(job),
            load_shop("generic-chrome"),
            tmp_path / "p.zip",
            ("gdsii", "gerber"),
            progress=lambda *stage: told.append(stage),
        )
    assert not told
    assert not (tmp_path / "p.zip").exists()


@pytest.mark.parametrize("name", ["../../etc/passwd", "a\\b", "/root", "..", "CON", ""])
def test_names_with_path_separators_become_plain(name):
    stem = safe_stem(name)
    assert stem
    assert not set(stem) & set("/\\.:")
    assert stem.upper() != "CON"


@pytest.mark.parametrize("packing", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_package_packed_in_another_way_is_refused(tmp_path, packing):
    path = tmp_path / "p.zip"
    with zipfile.ZipFile(path, "w", packing) as archive:
        archive.writestr("x/manifest.json", '{"files": []}')
    with pytest.raises(SourceError, match="packed in a way"):
        verify_package(path)


@pytest.mark.parametrize("offset", [0, 2**31 - 1, 2**32 - 1])
@pytest.mark.parametrize("field", [2, 6])
def test_a_package_whose_directory_lies_elsewhere_is_refused(tmp_path, field, offset):
    """Size and place of the directory, which zipfile seeks without asking whether they can be."""
    path = tmp_path / "p.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("x/manifest.json", '{"files": []}')
    data = bytearray(path.read_bytes())
    data[len(data) - field - 4 : len(data) - field] = offset.to_bytes(4, "little")
    path.write_bytes(data)
    with pytest.raises(SourceError) as refusal:
        verify_package(path)
    assert refusal.value.code in {"MF303", "MF422"}


# --- maskfab verify PACKAGE ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    """A job and its package for a shop."""
    folder = tmp_path_factory.mktemp("packed")
    job, path = write_job(folder), folder / "p.zip"
    with figures_in_words():
        assert pack(load_job(job), load_shop("generic-chrome"), path, ("gdsii", "oasis")).path == path
    return job, path


def names_of(answer) -> set[str]:
    return {check["name"] for check in answer.document["checks"]}


def test_verify_takes_a_package_by_its_bytes_alone_or_with_its_job_and_shop(capsys, packed):
    job, path = packed
    answer = command(capsys, "verify", path, "--json", "--quiet")
    assert (answer.code, answer.document["verdict"]) == (0, "pass")
    assert names_of(answer) >= {"sha256", "manifest_job_hash", "readback_xor_area", "readback_wrong_dots"}
    assert (answer.document["package"], answer.document["against"], answer.document["shop"]) == (str(path), None, None)
    answer = command(capsys, "verify", path, "--against", job, "--shop", "generic-chrome", "--json", "--quiet")
    assert (answer.code, answer.document["shop"]) == (0, "generic-chrome")
    assert names_of(answer) >= {"sha256", "readback_xor_area", "readback_wrong_dots"}
    answer = command(capsys, "verify", path)
    assert (answer.code, answer.stdout) == (0, "")
    assert answer.stderr.splitlines()[-3].startswith("FILES: PASS, can be ordered: ")


def _renamed(source, target):
    with zipfile.ZipFile(source) as archive, zipfile.ZipFile(target, "w") as changed:
        for name in archive.namelist():
            changed.writestr(f"other/{name.partition('/')[2]}", archive.read(name))


def _commented(source, target):
    target.write_bytes(source.read_bytes())
    with zipfile.ZipFile(target, "a") as archive:
        archive.comment = b"12345"


def _between(source, target):
    """Seven bytes behind the first file; the directory says where the others lie now."""
    with zipfile.ZipFile(source) as archive, zipfile.ZipFile(target, "w") as changed:
        for name in archive.namelist():
            changed.writestr(name, archive.read(name))
            if changed.fp is not None and len(changed.namelist()) == 1:
                changed.fp.write(b"unknown")
                changed.start_dir += 7


def _extra(source, target):
    with zipfile.ZipFile(source) as archive, zipfile.ZipFile(target, "w") as changed:
        for name in archive.namelist():
            member = zipfile.ZipInfo(name)
            if name.endswith("order.txt"):
                member.extra, member.comment = b"\xfe\xca\x02\x00hi", b"note"
            changed.writestr(member, archive.read(name))


@pytest.mark.parametrize(
    ("change", "row", "told"),
    [
        (_renamed, "package_folder", "other"),
        (
            lambda source, target: target.write_bytes(b"#!/bin/sh\nexit\n" + source.read_bytes()),
            "foreign_bytes", "15 bytes before SMALL_generic-chrome/",
        ),
        (
            lambda source, target: target.write_bytes(source.read_bytes() + b"junk"),
            "foreign_bytes", "4 bytes behind its end",
        ),
        (_commented, "foreign_bytes", "5 bytes of a comment"),
        (_between, "foreign_bytes", "7 bytes before SMALL_generic-chrome/"),
        (_extra, "foreign_bytes", "4 bytes of a comment on SMALL_generic-chrome/order.txt"),
    ],
    ids=["renamed", "before", "behind", "comment", "between", "extra"],
)  # fmt: skip
def test_verify_names_what_is_in_a_package_besides_its_files(packed, tmp_path, change, row, told):
    change(packed[1], tmp_path / "q.zip")
    (failed,) = (check for check in verify_package(tmp_path / "q.zip") if check.passed is False)
    assert failed.name == row
    assert told in f"{failed.value} {failed.method}"
    wrapped = {check.name: check for check in verify_package(packed[1]) if check.name in (row,)}
    assert wrapped[row].passed


def test_verify_tells_a_package_of_another_job(capsys, packed, tmp_path):
    _, path = packed
    other = write_job(tmp_path, ("seed = 3", "seed = 4"))
    answer = command(capsys, "verify", path, "--against", other, "--shop", "generic-chrome", "--json", "--quiet")
    failed = {(check["name"], check.get("die")) for check in answer.document["checks"] if not check["passed"]}
    assert answer.code == 1
    assert ("readback_xor_area", "TURNED") in failed
    assert ("readback_xor_area", "PLAIN") not in failed
    assert "sha256" not in {name for name, _ in failed}


def test_verify_tells_a_changed_package(capsys, packed, tmp_path):
    path = tmp_path / "q.ZIP"
    repacked(packed[1], path, lambda name, content: content[:-1] if name.endswith(".oas") else content)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(archive.namelist()[0].partition("/")[0] + "/more.txt", "more")
    answer = command(capsys, "verify", path, "--quiet")
    assert answer.code == 1
    assert "SHA-256 of SMALL.oas" in answer.stderr
    assert "more.txt" in answer.stderr


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="limits are those of a copy")
@pytest.mark.slow
@pytest.mark.usefixtures("within_limits")
def test_masks_of_a_package_are_compared_within_limits(packed, tmp_path, monkeypatch):
    monkeypatch.setattr(sandbox, "SECONDS", 0)  # for so few bytes one is added
    monkeypatch.setattr(layout, "MOST_COVERED", 1e9)  # or it is refused at once
    hostile = overlapping(tmp_path / "few.oas", 2000).read_bytes()
    repacked(packed[1], tmp_path / "q.zip", lambda name, content: hostile if name.endswith(".oas") else content)
    before = children_seconds() + time.process_time()
    failed = [check for check in verify_package(tmp_path / "q.zip") if check.passed is False]
    assert children_seconds() + time.process_time() - before < 12
    assert [check.method[:17] for check in failed if check.name == "readable"] == ["SMALL.oas: MF322 "]
    assert {check.name for check in failed} >= {"readable", "sha256"}


@pytest.mark.parametrize(
    ("options", "code", "where"),
    [
        (("--against", "none.toml"), "MF301", None),
        (("--shop", "pog"), "MF105", "--against"),
        (("--die", "PLAIN"), "MF105", "--die"),
        (("--layer", "1/0", "--dots-per-um", "1"), "MF105", "--layer"),
        (("--against", "none.toml", "--shop", "no-such-house"), "MF420", ""),
        (("--against", "none.toml", "--shop", "pog"), "MF301", None),
    ],
)
def test_verify_refuses_what_cannot_be_said_of_a_package(capsys, packed, options, code, where):
    answer = command(capsys, "verify", packed[1], *options, "--json")
    assert (answer.code, answer.document["error"]["code"]) == (2, code)
    if where is not None:
        assert answer.document["error"]["where"] == where


@pytest.mark.parametrize(("content", "code"), [(None, "MF301"), (b"", "MF422"), (b"PK no zip", "MF422")])
def test_verify_refuses_what_is_no_package(capsys, tmp_path, content, code):
    path = tmp_path / "p.zip"
    if content is not None:
        path.write_bytes(content)
    answer = command(capsys, "verify", path, "--json")
    assert (answer.code, answer.document["error"]["code"]) == (2, code)


def test_a_shop_is_for_packages(capsys, packed):
    job, _ = packed
    for subject in (job.parent, job):
        answer = command(capsys, "verify", subject, "--against", job, "--shop", "pog", "--json")
        assert (answer.code, answer.document["error"]["where"]) == (2, "--shop")


def test_a_package_is_called_zip(capsys, packed, tmp_path):
    job, _ = packed
    out = tmp_path / "p.txt"
    answer = command(capsys, "order", "pack", job, "--shop", "generic-chrome", "--out", out, "--json", "--quiet")
    assert (answer.code, answer.document["error"]["code"], answer.document["error"]["where"]) == (2, "MF105", "--out")
    assert not out.exists()


@pytest.mark.parametrize("name", ["p.txt", "p", "p.gds"])
def test_a_package_is_known_by_its_content_whatever_it_is_called(capsys, packed, tmp_path, name):
    (tmp_path / name).write_bytes(packed[1].read_bytes())
    answer = command(capsys, "verify", tmp_path / name, "--json", "--quiet")
    assert (answer.code, answer.document["verdict"]) == (0, "pass")


@pytest.mark.parametrize(
    ("subject", "options", "where"),
    [
        (".", ("--against",), "--against"),
        (".", ("--layer", "1/0"), "--layer"),
        ("m.gds", ("--dots-per-um", "3", "--against"), "--dots-per-um"),
        ("m.gds", ("--unit", "mm", "--against"), "--unit"),
        ("m.png", ("--layer", "5/0", "--cell", "X", "--against"), "--layer"),
        ("m.TIF", ("--cell", "X", "--against"), "--cell"),
    ],
)
def test_verify_refuses_options_without_a_meaning(capsys, packed, tmp_path, subject, options, where):
    for name in ("m.gds", "m.png", "m.TIF"):
        (tmp_path / name).write_bytes(b"")
    job = (packed[0],) if options[-1] == "--against" else ()
    error = command(capsys, "verify", tmp_path / subject, *options, *job, "--json", "--quiet").document["error"]
    assert (error["code"], error["where"]) == ("MF105", where)
    assert ("directory" in error["what"]) == (subject == ".")


def test_a_tolerance_without_an_end_and_a_thickness_that_nobody_states_are_told_in_words(capsys, tmp_path):
    shop = tmp_path / "mine.toml"
    shop.write_text(
        'title = "A house"\nsources = []\n[plate]\nglass_mm = [1.0, 2.0]\n'
        "[tolerance]\ncd_um = [[10.0, 0.5], [inf, 2.54]]\n",
        encoding="utf-8",
    )
    job, path = write_job(tmp_path), tmp_path / "p.zip"
    answer = command(capsys, "order", "pack", job, "--shop", shop, "--out", path, "--quiet")
    assert "glass: not stated by the job, 1 to 2 mm taken" in answer.stdout
    with zipfile.ZipFile(path) as archive:
        sheets = [archive.read(name).decode() for name in archive.namelist() if "/order." in name]
    assert len(sheets) == 3
    for sheet in sheets:
        assert "widths up to 10 um: +-0.5 um; any width beyond: +-2.54 um" in sheet
        assert "inf um" not in sheet


@pytest.mark.slow
def test_a_format_asked_for_twice_is_sent_once_and_verifies(tmp_path):
    job, path = load_job(write_job(tmp_path)), tmp_path / "p.zip"
    made = pack(job, load_shop("generic-chrome"), path, ("gdsii", "gdsii"))
    assert [file.format for file in made.files].count("gdsii") == 1
    assert all(check.passed for check in verify_package(path))
