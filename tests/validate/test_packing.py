"""Packages: equal bytes, safe names, proofs from the files in the zip, and nothing where the house would refuse."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace

import pytest
from small_job import command, write_job

from maskfab.errors import SourceError
from maskfab.export.package import safe_stem
from maskfab.export.shops import load_shop
from maskfab.layout.job import load
from maskfab.validate.packing import pack, verify_package


def test_equal_jobs_make_equal_packages_that_prove_themselves(tmp_path):
    job, shop = load(write_job(tmp_path)), load_shop("generic-chrome")
    made = [pack(job, shop, tmp_path / name, ("gdsii", "dxf_r12")) for name in ("a.zip", "b.zip")]
    assert made[0].path is not None
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()
    checks = verify_package(made[0].path, job, shop)
    assert all(check.passed for check in checks)
    assert {"sha256", "readback_xor_area", "readback_wrong_dots", "cd_x_1x"} <= {check.name for check in checks}
    with zipfile.ZipFile(made[0].path) as archive:
        names = {name.partition("/")[2] for name in archive.namelist()}
        order = archive.read("SMALL_generic-chrome/order.txt").decode()
        manifest = json.loads(archive.read("SMALL_generic-chrome/manifest.json"))
    assert names - {"manifest.json"} == {file["path"] for file in manifest["files"]}
    assert "digitized data = clear" in order
    assert "right reading, chrome up" in order


def test_a_refused_plate_leaves_no_package(capsys, tmp_path):
    job = write_job(tmp_path)
    answer = command(capsys, "package", job, "--shop", "gesim", "--out", tmp_path / "p.zip", "--quiet")
    assert answer.code == 1
    assert "REFUSED blank" in answer.stdout
    assert not list(tmp_path.glob("*.zip"))


@pytest.mark.parametrize("name", ["../../etc/passwd", "a\\b", "/root", "..", "CON", ""])
def test_names_with_path_separators_become_plain(name):
    stem = safe_stem(name)
    assert stem
    assert not set(stem) & set("/\\.:")
    assert stem.upper() != "CON"


@pytest.mark.parametrize("member", ["../evil.txt", "/etc/evil", "x/../../evil", "x\\..\\evil", "C:evil"])
def test_a_package_with_a_hostile_member_is_refused(tmp_path, member):
    path = tmp_path / "hostile.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("x/manifest.json", '{"files": []}')
        archive.writestr(member, "evil")
    with pytest.raises(SourceError) as refusal:
        verify_package(path)
    assert refusal.value.code == "MF423"


def test_a_changed_file_is_a_failed_check(tmp_path):
    path = tmp_path / "p.zip"
    made = pack(load(write_job(tmp_path)), load_shop("pog"), path)
    assert made.path == path
    with zipfile.ZipFile(path) as archive:
        held = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(tmp_path / "q.zip", "w") as archive:
        for name, content in held.items():
            archive.writestr(name, content + b" " if name.endswith("order.txt") else content)
    (failed,) = (check for check in verify_package(tmp_path / "q.zip") if not check.passed)
    assert "order.txt" in failed.method


def test_what_is_no_package_is_refused(tmp_path):
    (tmp_path / "no.zip").write_text("no zip", encoding="utf-8")
    for name, code in (("no.zip", "MF422"), ("none.zip", "MF301")):
        with pytest.raises(SourceError) as refusal:
            verify_package(tmp_path / name)
        assert refusal.value.code == code


def test_findings_keep_their_source(tmp_path):
    shop = load_shop("gesim")
    made = pack(load(write_job(tmp_path)), shop, tmp_path / "p.zip")
    assert made.path is None
    assert all(replace(each).source == shop.sources[0] for each in made.findings)
