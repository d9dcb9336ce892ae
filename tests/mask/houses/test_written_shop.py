"""What a job writes, against the mask house that it names: the files as they are, and what is left to the house."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from house_plates import FIVE_INCH, taken_as
from small_job import command, write_job

from maskfab.base.model import NOTE
from maskfab.mask.houses.files import PlateFiles
from maskfab.mask.houses.findings import Finding, check_written
from maskfab.mask.houses.profiles import load_shop, shop_names
from maskfab.mask.job import load_job
from maskfab.runs.plate_files import draw_files, named_shop, shop_quantities

HOUSE = 'title = "A house"\nsources = []\n[order]\nfields = ["tone"]\n'


def judged(folder: Path, section: str, profile: str = HOUSE, *edits) -> tuple[PlateFiles, tuple[Finding, ...]]:
    """The job's files as drawn for the house of a profile, and what the house says to them."""
    job = write_job(folder, ("[plate]", f"[export]\n{section}\n\n[plate]"), *edits)
    (folder / "mine.toml").write_text(profile, encoding="utf-8")
    loaded = load_job(job)
    made = draw_files(loaded, loaded.plate())
    return made, check_written(made.figures, named_shop(loaded), made.formats)


def of(rule: str, findings) -> dict[str, bool | None]:
    """Verdicts of a rule by value."""
    return {str(each.value): each.passed for each in findings if each.rule == rule}


def the(rule: str, findings) -> Finding:
    (finding,) = (each for each in findings if each.rule == rule)
    return finding


def refused(findings) -> set[str]:
    return {each.rule for each in findings if each.passed is False}


def test_every_layout_that_is_written_is_judged_and_what_is_for_people_is_not(tmp_path):
    formats = '["dxf_r12", "gdsii", "gerber", "svg", "glb", "png"]'
    made, findings = judged(tmp_path, f'formats = {formats}\nshop = "photomask_portal"')
    assert made.formats == ("dxf_r12", "gdsii", "gerber", "svg", "glb", "png")
    assert of("format", findings) == {"dxf_r12": False, "gdsii": True, "gerber": False}
    for finding in findings:
        if finding.rule == "format" and not finding.passed:
            assert finding.limit == "gdsii oasis"
            assert "Keep to gdsii oasis" in finding.cure
            assert "maskfab order pack" in finding.cure


@pytest.mark.parametrize("name", shop_names())
def test_a_job_that_leaves_all_to_its_house_is_taken_as_its_package_would_be(tmp_path, name):
    """But for corners that the house marks, which only a package adds."""
    shop = load_shop(name)
    made, findings = judged(tmp_path, f'shop = "{name}"', HOUSE, *(taken_as(shop) or FIVE_INCH))
    assert made.formats == shop.formats[:1]
    assert refused(findings) == (set() if shop.plate.extent_mm is None else {"extent"})
    if shop.plate.extent_mm is not None:
        assert "maskfab order pack" in the("extent", findings).cure
        assert the("extent", findings).value == "127 x 127"  # what shows the blank is in the file too


# A limit of the house; what the job says against it; the rule; and how the job is drawn that says nothing.
LIMITS = {
    "corners": ("[polygons]\nself_touching = false\n", 'corners = "joined"', "self_touching", "apart"),
    "holes": ("[polygons]\nself_touching = false\n", 'holes = "keyhole"', "self_touching", "bisect"),
    "max_vertices": ("[limits]\nmax_vertices = 12\n", "max_vertices = 4094", "vertices", 12),
    "max_references": ("[limits]\nmax_references = 75\n", "max_references = 8192", "references", 50),
    "hierarchy": ("[limits]\nmax_references = 30\n", 'hierarchy = "cells"', "references", "flat"),
}


@pytest.mark.parametrize("key", LIMITS)
def test_what_the_job_says_is_drawn_and_judged_and_what_it_leaves_out_follows_the_house(tmp_path, key):
    limit, said, rule, kept = LIMITS[key]
    made, findings = judged(tmp_path, 'shop = "mine.toml"', HOUSE + limit)
    assert getattr(made.figures.options, key) == kept
    assert rule not in refused(findings)
    stubborn, findings = judged(tmp_path, f'shop = "mine.toml"\n{said}', HOUSE + limit)
    assert f"{key} = {getattr(stubborn.figures.options, key)!r}".replace("'", '"') == said
    assert refused(findings) == {rule}
    assert the(rule, findings).cure


@pytest.mark.parametrize("profile", ["jd_photo_data", "mine.toml"])
def test_saying_what_the_house_prefers_changes_nothing_that_is_drawn(tmp_path, profile):
    limits = HOUSE + "[limits]\nmax_references = 75\n"
    left, said = judged(tmp_path, f'shop = "{profile}"', limits)
    options = left.figures.options
    lines = [
        f"{key} = {json.dumps(value)}" for key, value in vars(options).items() if value and key not in ("notes", "tone")
    ]
    stated, again = judged(
        tmp_path, "\n".join((f'shop = "{profile}"', f'formats = ["{left.formats[0]}"]', *lines)), limits
    )
    assert stated.figures.options == options
    assert again == said


def test_a_house_that_wants_holes_on_a_layer_of_their_own_gets_them_from_packages_alone(tmp_path):
    """The opening is a ring: what a job writes of it is cut at its hole."""
    ring = 'name = "ring"\npitch = "56 um"\ndots = 7\ngrid = """\n' + "\n".join(
        (".......", ".#####.", ".#...#.", ".#...#.", ".#...#.", ".#####.", ".......", '"""\n')
    )
    job = write_job(tmp_path, ("[plate]", '[export]\nshop = "mr_nanotec"\n\n[plate]'), opening=ring)
    loaded = load_job(job)
    made = draw_files(loaded, loaded.plate())
    assert made.figures.options.holes == "bisect"
    finding = the("shared_boundaries", check_written(made.figures, load_shop("mr_nanotec"), made.formats))
    assert finding.passed is False
    assert "maskfab order pack" in finding.cure


def test_notes_are_polygons_where_the_house_takes_no_text(tmp_path):
    made, findings = judged(tmp_path, 'shop = "pog"')
    assert made.figures.options.notes == "polygons"
    assert not made.figures.notes
    assert the("text", findings).passed
    made, findings = judged(tmp_path, 'shop = "pog"\nformats = ["gdsii", "dxf_r12"]')
    assert the("text", findings).passed  # the drawing's unit is no text either
    assert the("text", findings).value == "none"
    assert made.figures.options.notes == "polygons"
    made, findings = judged(tmp_path, 'shop = "ualberta_mla150"')
    assert made.figures.notes
    assert the("text", findings).passed


def test_layers_for_people_are_told_and_counted_as_the_files_have_them(tmp_path):
    _, findings = judged(tmp_path, 'shop = "mine.toml"', HOUSE + "[limits]\nmax_layers = 2\nmax_layer_number = 10\n")
    told = the("unwritten_layers", findings)
    assert (told.passed, told.value) == (None, "OUTLINE NOTE")
    assert "CLEAR 1/0" in told.cure
    assert the("layers", findings).value == 3
    assert the("layer_number", findings).value == NOTE.number
    assert refused(findings) == {"layers", "layer_number"}
    names = HOUSE + '[names]\nforbidden_layers = ["NOTE"]\nlayer_pattern = "[A-M]+"\n'
    _, findings = judged(tmp_path, 'shop = "mine.toml"', names)
    assert [each.value for each in findings if each.rule == "layer_name"] == ["CLEAR", "NOTE"]


def test_a_flat_file_has_one_level_and_one_name(tmp_path):
    profile = HOUSE + '[limits]\nmax_depth = 2\n[names]\nforbidden = ["turned"]\n'
    _, findings = judged(tmp_path, 'shop = "mine.toml"', profile)
    assert refused(findings) == {"depth", "name"}
    assert "flat" in the("depth", findings).cure
    _, findings = judged(tmp_path, 'shop = "mine.toml"\nhierarchy = "flat"', profile)
    assert refused(findings) == set()


def test_a_house_that_takes_no_layout_still_has_the_optics_measured_from_one(tmp_path):
    made, findings = judged(tmp_path, 'shop = "mine.toml"', HOUSE + '[accepts]\nformats = ["gerber"]\n')
    assert made.formats == ("gdsii", "gerber")
    assert of("format", findings) == {"gdsii": False, "gerber": True}


def test_without_a_shop_nothing_is_judged_and_the_hash_is_that_of_the_defaults(tmp_path):
    bare = load_job(write_job(tmp_path, ("[plate]", "[export]\n\n[plate]")))
    assert shop_quantities(bare, draw_files(bare, bare.plate())) == ()
    formats = 'formats = ["gdsii", "oasis", "dxf_r12", "dxf_r2010"]'
    drawing = 'hierarchy = "cells"\nmax_vertices = 4094\nholes = "bisect"\ncorners = "apart"'
    stated = load_job(write_job(tmp_path, ("[plate]", f"[export]\n{formats}\n{drawing}\n\n[plate]")))
    assert stated.digest == bare.digest
    assert "shops" not in bare.spec.dump()


@pytest.mark.usefixtures("drawn_in_words")
def test_a_run_fails_for_the_format_that_its_house_does_not_take(capsys, tmp_path):
    section = '[export]\nformats = ["gdsii", "dxf_r12"]\nshop = "photomask_portal"\n\n[plate]'
    job = write_job(tmp_path, ("[plate]", section))
    job.write_text(job.read_text(encoding="utf-8").partition('[[die]]\nname = "TURNED"')[0], encoding="utf-8")
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--json", "--quiet")
    assert answer.code == 1
    (failed,) = (check for check in answer.document["checks"] if not check["passed"])
    assert (failed["name"], failed["value"], failed["limit"]) == ("shop_format", "dxf_r12", "gdsii oasis")
    assert "maskfab order pack" in failed["method"]
    again = command(capsys, "verify", tmp_path / "out", "--quiet")
    assert again.code == 1
    assert "FAIL shop_format = dxf_r12" in again.stderr
    assert "reported" not in again.stderr


def test_findings_of_written_files_keep_their_source(tmp_path):
    _, findings = judged(tmp_path, 'shop = "pog"')
    assert all(each.source == load_shop("pog").sources[0] for each in findings)
