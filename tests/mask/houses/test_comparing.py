"""One plate held against all houses at once."""

from __future__ import annotations

import pytest
from small_job import command, with_the_die, write_job

import maskfab as mf
from maskfab.base.model import Quantity
from maskfab.mask.houses.profiles import shop_names

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")


def test_a_comparison_says_of_each_house_what_its_package_would(capsys, tmp_path):
    job = with_the_die("TURNED", write_job(tmp_path))
    job.write_text(job.read_text() + '\n[order]\nglass = "quartz"\nquantity = 1\n')
    found = command(capsys, "order", "compare", job, "--json", "--quiet")
    bids = {each["shop"]: each for each in found.document["shops"]}
    assert found.code == 0
    assert set(bids) == set(shop_names())
    for name in ("compugraphics", "gesim", "jd_photo_data", "topro_film"):
        bid = bids[name]
        package = ["order", "pack", job, "--shop", name, "--out", tmp_path / f"{name}.zip", "--json", "--quiet"]
        made = command(capsys, *package).document
        assert bid["answer"] == made["answer"]
        assert (bid["answer"] == "does not") == (made["verdict"] == "fail")
        assert bid["mail"] == made["mail"]
        assert [each["rule"] for each in bid["refusals"]] == [
            each["rule"] for each in made["rules"] if each["passed"] is False
        ]
        if bid["answer"] != "does not":
            assert bid["blanks"] == made["blanks"]
            assert bid["format"] == made["files"][0]["format"]
    assert bids["gesim"]["changes"] == ["squares at its corners"]
    assert "holes as keyholes" in bids["jd_photo_data"]["changes"]


def test_the_table_fits_a_terminal_and_tells_why_houses_refuse(capsys, tmp_path):
    # Half a micrometre is finer than most houses write, and no multiple of the coarser grids.
    job = with_the_die("PLAIN", write_job(tmp_path, ("8 um", "0.5 um"), ("56 um", "3.5 um")))
    table = command(capsys, "order", "compare", job, "--quiet")
    lines = table.stdout.split("\n")
    assert all(len(line) <= 100 for line in lines)
    assert any(line.startswith("generic-chrome") and " no " in line and "min_feature" in line for line in lines)
    assert any(line.startswith("compugraphics") and " ask first " in line for line in lines)
    assert any("Do you make plates of 27 x 27 mm" in line for line in lines)
    assert "contact.name" in table.stdout
    one = command(capsys, "order", "compare", job, "generic-chrome", "--quiet")
    assert one.code == 1
    assert "compugraphics" not in one.stdout


def test_a_house_of_the_jobs_own_is_compared_too(tmp_path):
    job = write_job(tmp_path)
    profile = 'title = "House"\nsources = []\n[limits]\ngrid_nm = [3]\n[names.layers]\nCLEAR = "ONE"\n'
    (tmp_path / "own.toml").write_text(profile)
    job.write_text(job.read_text() + '\n[export]\nshop = "own.toml"\n')
    bids = {bid.shop: bid for bid in mf.order.compare(job)}
    assert not bids["own"].taken
    assert bids["own"].changes == ("layers renamed",)
    assert [each.rule for each in bids["own"].refusals] == ["grid"]


def test_a_file_that_does_not_show_the_plate_is_what_refuses_it(capsys, monkeypatch, tmp_path):
    failed = Quantity("readback_xor_area", 1.0, "a test", limit=0.0, passed=False)
    for module in ("pack",):
        monkeypatch.setattr(f"maskfab.mask.package.{module}.read_written", lambda *_, **__: (None, (failed,)))
    job = write_job(tmp_path)
    (bid,) = mf.order.compare(job, "compugraphics")
    assert bid.answer == "does not"
    assert [(each.rule, each.value) for each in bid.refusals] == [("read_back", "readback_xor_area")]
    told = command(capsys, "order", "pack", job, "--shop", "compugraphics", "--out", tmp_path / "p.zip", "--quiet")
    assert told.code == 1
    assert not (tmp_path / "p.zip").exists()
    (line,) = (each for each in told.stderr.split("\n") if each.startswith("REFUSED"))
    assert "readback_xor_area" in line
    assert " 0 of " not in line
