"""Rules of houses, held against the files in their packages by readers of this test alone."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import ezdxf
import pytest
from ezdxf import bbox
from house_plates import checked
from klayout import db
from once import figures_in_words
from repacking import members, repacked
from small_job import command, with_the_die, write_job
from sweeps import sweep

from maskfab.base.errors import OutputError
from maskfab.job.shop import parse_shop
from maskfab.mask.houses.findings import Finding
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.mask.package.pack import pack, verify_package

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

TEMPLATE = (('blank = "27 mm"\nwritable = "22 mm"', 'template = "5in"'), ('die_pitch = "2 mm"', 'die_pitch = "20 mm"'))
ROWS = {
    "dot": (".......", ".......", ".......", "..###..", ".......", ".......", "......."),
    "bar": (".......", ".......", ".......", "#######", ".......", ".......", "......."),
    "eye": (".......", ".#####.", ".#...#.", ".#.#.#.", ".#...#.", ".#####.", "......."),
}
HOUSE = 'title = "A house"\nsources = []\n'


def opening(name: str) -> str:
    return f'name = "{name}"\npitch = "56 um"\ndots = 7\ngrid = """\n' + "\n".join(ROWS[name]) + '\n"""\n'


def house(text: str, name: str = "mine"):
    return parse_shop(HOUSE + text, name, where="mine.toml")


def the(rule: str, findings) -> Finding:
    (finding,) = (each for each in findings if each.rule == rule)
    return finding


def unpacked(package: Path, suffix: str) -> Path:
    """The one member of a package that ends so, beside the package."""
    (name,) = (name for name in members(package) if name.endswith(suffix))
    path = package.with_name(name.rpartition("/")[2])
    path.write_bytes(members(package)[name])
    return path


# --- what a drawing spans --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def gesim(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("gesim") / "p.zip"
    with figures_in_words():
        job = with_the_die("PLAIN", write_job(path.parent, *TEMPLATE))
        assert pack(load_job(job), load_shop("gesim"), path).path == path
    return path


def test_a_drawing_spans_what_the_house_asks_with_its_text_and_its_header(gesim):
    drawing = ezdxf.readfile(unpacked(gesim, ".dxf"))
    box = bbox.extents(drawing.modelspace())
    assert (tuple(box.extmin)[:2], tuple(box.extmax)[:2]) == ((-50_000, -50_000), (50_000, 50_000))
    assert tuple(drawing.header["$EXTMIN"])[:2] == (-50_000, -50_000)
    assert tuple(drawing.header["$EXTMAX"])[:2] == (50_000, 50_000)
    assert len(drawing.modelspace().query("TEXT")) == 1
    rules = json.loads(unpacked(gesim, "certificate.json").read_text())["rules"]
    assert [(rule["value"], rule["passed"]) for rule in rules if rule["rule"] == "extent"] == [("100 x 100", True)]


@pytest.mark.parametrize(
    ("old", "new"),
    [(b"\n 10\n-49900.0\n", b"\n 10\n-63500.0\n"), (b"$EXTMAX\n 10\n50000.0", b"$EXTMAX\n 10\n63500.0")],
    ids=["text", "header"],
)
def test_an_extent_is_measured_in_the_file(gesim, tmp_path, old, new):
    def edit(name: str, content: bytes) -> bytes:
        assert not name.endswith(".dxf") or content.count(old) == 1
        return content.replace(old, new) if name.endswith(".dxf") else content

    failed = {
        check.name
        for check in verify_package(repacked(gesim, tmp_path / "q.zip", edit, honest=True))
        if not check.passed
    }
    # Its certificate tells of another extent, and so may its header.
    assert failed - {"judged_headers"} == {"extent", "paper"}


# --- figures that share an edge --------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", sweep(["dot", "bar"], 1))
def test_no_two_figures_of_a_file_share_an_edge_where_the_house_minds(tmp_path, shape):
    """A plain bar needs no cut, and no mark of ours, code included, has one."""
    job = load_job(with_the_die("TURNED", write_job(tmp_path, *TEMPLATE, opening=opening(shape))))
    path = tmp_path / "p.zip"
    made = pack(job, load_shop("mr_nanotec"), path)
    assert made.path == path, [str(each) for each in made.findings]
    options = db.LoadLayoutOptions()
    options.dxf_dbu, options.dxf_unit = 0.001, 1.0
    layout = db.Layout()
    layout.read(str(unpacked(path, ".dxf")), options)
    drawn = {info.name: db.Region(layout.top_cell().begin_shapes_rec(layout.find_layer(info)))
             for info in layout.layer_infos()}  # fmt: skip
    assert drawn["CLEAR"].count() > 100
    for region in drawn.values():
        region.merged_semantics = False
        assert region.perimeter() == region.merged(True, 1).perimeter()
    assert {name for name, region in drawn.items() if region.count()} == {"CLEAR", "CUT"}
    layers = {layer.dxf.name for layer in ezdxf.readfile(unpacked(path, ".dxf")).layers}
    assert layers == {"0", "Defpoints", "CLEAR", "CUT", "NOTE"}  # ezdxf adds the second when it reads


def test_a_cut_in_an_opening_is_told_by_its_die_and_a_cut_in_a_mark_by_its_mark(tmp_path):
    plate = load_job(write_job(tmp_path, *TEMPLATE, opening=opening("eye"))).plate()
    finding = the("shared_boundaries", checked(plate, load_shop("mr_nanotec")))
    assert finding.passed is False
    assert "die PLAIN" in finding.place or "die TURNED" in finding.place
    assert "inside its holes" in finding.cure


def test_a_job_for_such_a_house_writes_stencils_too(tmp_path):
    from maskfab.runs.plate_files import draw_files, shop_quantities

    edits = (*TEMPLATE, ("[plate]", '[export]\nshop = "mr_nanotec"\n\n[plate]'))
    job = load_job(write_job(tmp_path, *edits, opening=opening("dot")))
    made = draw_files(job, job.plate())
    assert not [each for each in shop_quantities(job, made) if each.passed is False]


# --- names of layers -------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_layers_are_called_as_the_profile_says(capsys, tmp_path):
    text = '[names]\nforbidden_layers = ["CLEAR", "NOTE"]\n'
    named = 'layers = { CLEAR = "MASK_1", CUT = "MASK_2", NOTE = "TEXT" }\n[polygons]\nholes = "layer"\n'
    job, path = load_job(write_job(tmp_path, *TEMPLATE)), tmp_path / "p.zip"
    sent = ("dxf_r12", "dxf_r2010", "oasis")
    refused = pack(job, house(text), path, sent)
    assert refused.path is None
    bad = [each for each in refused.findings if each.passed is False]
    assert {each.rule for each in bad} == {"layer_name"}
    assert '[names] layers = { CLEAR = "..." }' in bad[0].cure
    made = pack(job, house(text + named), path, sent)
    assert made.path == path, [str(each) for each in made.findings if each.passed is False]
    for suffix in ("_R12.dxf", "_R2010.dxf"):
        drawing = ezdxf.readfile(unpacked(path, suffix))
        assert {layer.dxf.name for layer in drawing.layers} == {"0", "Defpoints", "MASK_1", "MASK_2", "TEXT"}
    layout = db.Layout()
    layout.read(str(unpacked(path, ".oas")))
    used = [info for info in layout.layer_infos() if not layout.top_cell().bbox(layout.find_layer(info)).empty()]
    assert {info.to_s() for info in used} == {"MASK_1 (1/0)", "MASK_2 (2/0)"}
    assert all(check.passed for check in verify_package(path))


def test_a_run_for_a_house_with_its_own_names_of_layers(capsys, tmp_path):
    section = '[export]\nformats = ["gdsii", "dxf_r12"]\nshop = "mine.toml"\n\n[plate]'
    job = with_the_die("PLAIN", write_job(tmp_path, ("[plate]", section)))
    (tmp_path / "mine.toml").write_text(HOUSE + '[names]\nlayers = { CLEAR = "MASK_1" }\n', encoding="utf-8")
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--quiet")
    assert answer.code == 0, answer.stderr
    drawing = ezdxf.readfile(tmp_path / "out" / "SMALL_R12.dxf")
    assert {"MASK_1", "OUTLINE", "NOTE"} <= {layer.dxf.name for layer in drawing.layers}
    assert "CLEAR" not in {layer.dxf.name for layer in drawing.layers}


# --- the blank, and what cures say -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("chrome", "edits", "refused"),
    [('"100 nm"', TEMPLATE, set()), ('"500 nm"', TEMPLATE, {"chrome"}), ('"500 nm"', (), {"chrome"})],
)
def test_chrome_and_glass_are_held_against_the_house(capsys, tmp_path, chrome, edits, refused):
    job = write_job(tmp_path, *edits, ("[plate]", f"[export]\nchrome = {chrome}\n\n[plate]"))
    answer = command(capsys, "order", "pack", job, "--shop", "topro_chrome", "--dry-run", "--json", "--quiet")
    rules = {rule["rule"]: rule for rule in answer.document["rules"]}
    assert {name for name, rule in rules.items() if rule["passed"] is False} == refused
    assert rules["chrome"]["limit"] == "100 to 125"
    assert rules["glass"]["passed"] is (True if edits else None)
    if refused:
        assert "export.chrome" in rules["chrome"]["cure"]


def test_glass_of_another_thickness_is_refused_with_templates_that_have_it(tmp_path):
    (tmp_path / "thick.toml").write_text(HOUSE + "[plate]\nglass_mm = [1.0, 2.0]\n", encoding="utf-8")
    made = pack(load_job(write_job(tmp_path, *TEMPLATE)), load_shop(str(tmp_path / "thick.toml")), tmp_path / "p.zip")
    finding = the("glass", made.findings)
    assert (made.path, finding.passed, finding.value) == (None, False, 2.286)
    assert 'plate.template to "4in"' in finding.cure


def test_a_blank_of_the_wrong_size_is_cured_by_a_template(capsys, tmp_path):
    job = write_job(tmp_path, (TEMPLATE[0][0], 'template = "6in"'), TEMPLATE[1])
    answer = command(capsys, "order", "pack", job, "--shop", "gesim", "--dry-run", "--json", "--quiet")
    cure = the("blank", [Finding(**rule) for rule in answer.document["rules"]]).cure
    assert 'plate.template to "5in"' in cure
    cured = write_job(tmp_path, *TEMPLATE)
    assert command(capsys, "order", "pack", cured, "--shop", "gesim", "--dry-run", "--quiet").code == 0


def test_marks_lie_on_the_grid_of_the_house_and_dies_that_do_not_are_told(tmp_path):
    shop = house("[limits]\ngrid_nm = [5]\n")
    job = load_job(with_the_die("PLAIN", write_job(tmp_path, *TEMPLATE)))
    path = tmp_path / "p.zip"
    made = pack(job, shop, path, ("gdsii",))
    assert made.path == path, [str(each) for each in made.findings]
    assert the("grid", made.findings).value == 5
    layout = db.Layout()
    layout.read(str(unpacked(path, ".gds")))
    region = db.Region(layout.top_cell().begin_shapes_rec(layout.find_layer(1, 0)))
    region.merged_semantics = False
    assert region.grid_check(5, 5).is_empty()
    odd = (('dot = "8 um"', 'dot = "8.001 um"'), ('pitch = "56 um"', 'pitch = "56.007 um"'))
    finding = the("grid", checked(load_job(write_job(tmp_path, *TEMPLATE, *odd)).plate(), shop))
    assert finding.passed is False
    assert "die PLAIN" in finding.place
    assert "multiples of 5 nm" in finding.cure


@pytest.mark.parametrize("name", ["jd_photo_data", "mr_nanotec"])
def test_where_no_list_of_formats_is_published_none_is_refused(tmp_path, name):
    plate = load_job(write_job(tmp_path, opening=opening("dot"))).plate()
    finding = the("format", checked(plate, load_shop(name), ("gdsii",)))
    assert finding.passed is None
    assert "dxf_r12" in finding.cure
    assert "GDSII" in finding.question
    # A house whose rules are about drawings takes drawings.
    assert the("format", checked(plate, load_shop(name), ("dxf_r12",))).passed


def test_rules_of_text_and_of_masks_on_a_layer_are_judged(tmp_path):
    findings = checked(load_job(write_job(tmp_path, opening=opening("dot"))).plate(), load_shop("mr_nanotec"))
    assert {each.rule for each in findings} >= {"text_charset", "text_style", "text_layer", "one_mask_per_layer"}


# --- the package itself ----------------------------------------------------------------------------------------------


def test_a_package_holds_its_job_and_nothing_else_is_read(capsys, tmp_path):
    job, path = load_job(with_the_die("PLAIN", write_job(tmp_path))), tmp_path / "p.zip"
    pack(job, load_shop("pog"), path)
    assert load_job(unpacked(path, "job.json")).digest == job.digest

    def names_a_file(name: str, content: bytes) -> bytes:
        if not name.endswith("job.json"):
            return content
        document = json.loads(content)
        document["die"][0]["opening"] = "../elsewhere.toml"
        return json.dumps(document).encode()

    failed = [
        check
        for check in verify_package(repacked(path, tmp_path / "q.zip", names_a_file, honest=True))
        if not check.passed
    ]
    assert [check.name for check in failed] == ["drawn_again"]
    assert "elsewhere" in failed[0].method
    without = lambda name, content: None if name.endswith("job.json") else content  # noqa: E731
    lacking = repacked(path, tmp_path / "r.zip", without, honest=True)
    answer = command(capsys, "verify", lacking, "--quiet")
    assert answer.code == 1
    assert "--against" in answer.stderr
    assert command(capsys, "verify", lacking, "--against", tmp_path / "job.toml", "--quiet").code == 0


def test_folders_above_a_package_are_made_with_it_and_not_for_a_refusal(capsys, tmp_path):
    job, out = write_job(tmp_path), tmp_path / "a" / "b" / "p.zip"
    assert command(capsys, "order", "pack", job, "--shop", "gesim", "--out", out, "--quiet").code == 1
    assert not (tmp_path / "a").exists()
    assert command(capsys, "order", "pack", job, "--shop", "pog", "--out", out, "--quiet").code == 0
    assert zipfile.is_zipfile(out)


def test_a_full_temporary_folder_is_told_as_such(monkeypatch, tmp_path):
    from maskfab.mask.formats import cif, dxf_writer, gdsii, gerber

    def full(figures, path, *_):
        raise OutputError("MF401", f"{path} cannot be written: No space left on device", cure="Choose another --out")

    job = load_job(write_job(tmp_path))
    for module, writer in (
        (gdsii, "write_gdsii"),
        (gdsii, "write_oasis"),
        (dxf_writer, "write_dxf"),
        (gerber, "write_gerber"),
        (cif, "write_cif"),
    ):
        monkeypatch.setattr(module, writer, full)
    with pytest.raises(OutputError, match="temporary folder") as refusal:
        pack(job, load_shop("pog"), tmp_path / "p.zip")
    assert "TMPDIR" in refusal.value.cure
    assert not (tmp_path / "p.zip").exists()


def test_a_target_that_cannot_be_written_is_told_as_such_even_beside_the_temporary_folder(monkeypatch, tmp_path):
    from maskfab.mask.package import pack as packing

    def full(target, *_, **__):
        raise OutputError("MF401", f"{target} cannot be written: No space left on device", cure="Choose another --out")

    monkeypatch.setattr(packing, "write_package", full)
    with pytest.raises(OutputError, match=r"p\.zip cannot be written") as refusal:
        pack(load_job(write_job(tmp_path)), load_shop("pog"), tmp_path / "p.zip")
    assert "--out" in refusal.value.cure
