"""Text from elsewhere is text: in reports, sheets, drawings and on the terminal nothing of it becomes a command.

Pages are parsed as browsers parse them, and compared with the same pages of harmless text: what an attacker's text adds
are letters, never an element, an attribute or an address.
"""

from __future__ import annotations

import json
import re
import unicodedata
import zipfile
from collections import Counter
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import ezdxf
import gdstk
import pytest
from klayout import db
from lxml import etree
from once import FIGURES, once
from PIL import Image, PngImagePlugin
from small_job import OPENING, command, with_the_die, write_job
from sweeps import in_turns, sweep

from maskfab.cli.printing import one_line
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.mask.package.pack import pack
from maskfab.runs.plate_files import draw_files

pytestmark = pytest.mark.usefixtures("figures_as_they_are", "read_here")

MARKUP = {
    "script": "<script>alert(1)</script>",
    "attribute": "\"><img src=x onerror='alert(1)'>",
    "entity": "&amp;&lt;b&gt; ]]> <!-- -- -->",
    "address": "javascript:alert(1) {{7*7}} %n$x",
}
"""In letters that the plate's font has."""
UNSEEN = {
    "colour": "\x1b[31mred\x1b[0m",
    "title": "\x1b]0;owned\x07",
    "eight bits": "\x9b2J",
    "lines": "TOP\r\nPASS: 5 of 5 checks pass\x0b",
    "direction": "\u202egpj.exe\u202c \u2066x\u2069",
    "no width": "a\u200bb\ufeffc\u2028d",
}
"""What a terminal obeys, or shows as something else."""
VOID = {"area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "track", "wbr"}


@pytest.fixture
def figures_as_they_are() -> Iterator[None]:
    """Figures as they are, once of equal things: an attack may lie in their ink."""
    with once(*FIGURES):
        yield


class Page(HTMLParser):
    """What a page consists of: its elements with their attributes' names, all its text, and its addresses."""

    def __init__(self, content: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: Counter[tuple[str, tuple[str, ...]]] = Counter()
        self.values: list[str] = []
        self.text: list[str] = []
        self.addresses: list[str] = []
        self.open: list[str] = []
        self.others: list[str] = []
        self.feed(content)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements[tag, tuple(sorted(name for name, _ in attrs))] += 1
        self.values += [value or "" for _, value in attrs]
        self.addresses += [value or "" for name, value in attrs if name in {"src", "href", "action", "formaction"}]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    def handle_comment(self, data):
        self.others.append(data)

    unknown_decl = handle_pi = handle_comment


def obeyed(text: str) -> list[str]:
    """Characters that do more than show themselves; lines may end."""
    return [c for c in text if c != "\n" and unicodedata.category(c) in {"Cc", "Cf", "Cs", "Zl", "Zp"}]


LEADS = re.compile(r"#|data:image/|(report\.html|appendix\.html|numbers\.csv|view\.html)(#[\w=&-]+)?$")
"""Into the page, to what it holds, and to the files beside it."""


def page(path_or_text: Path | str) -> Page:
    content = path_or_text.read_text(encoding="utf-8") if isinstance(path_or_text, Path) else path_or_text
    parsed = Page(content)
    assert parsed.open == []
    assert not any(tag in {"script", "iframe", "object", "embed", "base", "form"} for tag, _ in parsed.elements)
    assert not any(name.startswith("on") for _, names in parsed.elements for name in names)
    assert all(LEADS.match(address) for address in parsed.addresses), parsed.addresses
    return parsed


def drawings(parsed: Page) -> list[etree._Element]:
    """The SVGs inside a page."""
    head = "data:image/svg+xml,"
    return [etree.fromstring(unquote(each[len(head) :])) for each in parsed.addresses if each.startswith(head)]


def inert(drawing: etree._Element) -> None:
    """No script, no handler, no address but of the drawing itself."""
    for element in drawing.iter():
        assert isinstance(element.tag, str), element
        assert etree.QName(element).localname not in {"script", "foreignObject", "a", "iframe", "set", "animate"}
        for name, value in element.attrib.items():
            local = etree.QName(name).localname
            assert not local.startswith("on")
            assert local != "href" or value.startswith(("#", "data:image/png")), value


def shape(drawing: etree._Element) -> Counter:
    return Counter((each.tag, tuple(sorted(each.attrib))) for each in drawing.iter() if isinstance(each.tag, str))


# --- the report, and every file beside it ----------------------------------------------------------------------------

EXPORT = """
[export]
formats = ["gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber", "svg", "png", "tiff", "glb", "3mf"]
"""
SPOKEN = """
[provenance]
shape = {0}
command = {0}
version = {0}
seed = {0}
expected_psnr_32 = 30.0
"price_{1}_db" = 0.25
"""


def quoted(text: str) -> str:
    return json.dumps(text)


def spoken_job(folder: Path, title: str, label: str, facts: str) -> Path:
    """A die of the small job with such texts, and an opening whose file says so of its design."""
    job = write_job(
        folder,
        ('title = "SMALL PLATE"', f"title = {quoted(title)}"),
        ('label = "periodic"', f"label = {quoted(label)}"),
        opening=OPENING + SPOKEN.format(quoted(facts), quoted(facts)[1:-1]),
    )
    with_the_die("PLAIN", job)
    job.write_text(job.read_text(encoding="utf-8") + EXPORT, encoding="utf-8")
    return job


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> tuple[Path, Path]:
    """Two results of one job: with texts that attack, and with harmless ones of the same kinds."""
    from maskfab.cli.program import run_command_line

    results = []
    for name, title, label, facts in (
        ("hostile", f"{MARKUP['attribute']}{MARKUP['script'][:20]}", MARKUP["script"][:40], " ".join(MARKUP.values())),
        ("harmless", "a plain title", "a plain label", "a plain fact"),
    ):
        folder = tmp_path_factory.mktemp(name)
        job = spoken_job(folder, title, label, facts)
        with once(*FIGURES):
            assert run_command_line(["run", str(job), "--out", str(folder / "out"), "--quiet"]) == 0
        results.append(folder / "out")
    return results[0], results[1]


def test_the_report_has_the_elements_of_a_harmless_one_and_shows_the_text(finished):
    signed = [page(folder / "report.html") for folder in finished]
    assert signed[0].elements == signed[1].elements
    hostile, harmless = (page(folder / "appendix.html") for folder in finished)
    assert hostile.elements == harmless.elements
    assert hostile.others == harmless.others
    text = "".join(hostile.text)
    assert MARKUP["script"] in text
    assert MARKUP["attribute"] in text
    assert MARKUP["entity"] in text
    assert "{{7*7}}" in text


def test_drawings_in_the_report_are_inert(finished):
    hostile, harmless = (drawings(page(folder / "appendix.html")) for folder in finished)
    assert len(hostile) == len(harmless) > 5
    for one, other in zip(hostile, harmless, strict=True):
        inert(one)
        assert {key[0] for key in shape(one)} == {key[0] for key in shape(other)}


def test_every_other_file_of_the_result_is_well_formed_and_inert(finished):
    folder, _ = finished
    svg = etree.parse(folder / "SMALL.svg").getroot()
    inert(svg)
    assert MARKUP["attribute"] in svg.findtext("{*}title")
    for path in (folder / "SMALL.lyrdb", folder / "layers.lyp"):
        etree.parse(path)
    with zipfile.ZipFile(folder / "SMALL_PLAIN.3mf") as archive:
        assert len(archive.namelist()) == len(set(archive.namelist()))
        for name in archive.namelist():
            if name.endswith((".model", ".rels", ".xml")):
                inert_xml = etree.fromstring(archive.read(name))
                assert not any("script" in str(each.tag) for each in inert_xml.iter())
    document = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert document["title"].startswith('"><img')


def test_a_step_file_of_such_texts_is_well_formed(tmp_path):
    path = spoken_job(tmp_path, f"{MARKUP['attribute']}'", MARKUP["attribute"], " ".join(MARKUP.values()))
    path.write_text(path.read_text(encoding="utf-8").replace('"gdsii", "oasis"', '"gdsii", "step"'), encoding="utf-8")
    job = load_job(path)
    product = next(each for each in draw_files(job, job.plate()).products if each.name == "SMALL.step")
    product.write(tmp_path / product.name)
    assert (tmp_path / product.name).read_text(encoding="ascii").count("'") % 2 == 0


@pytest.mark.slow
def test_a_finished_directory_of_such_texts_verifies(capsys, finished):
    answer = command(capsys, "verify", finished[0], "--quiet", "--json")
    assert (answer.code, answer.document["verdict"]) == (0, "pass")


def test_two_such_results_draw_the_same_die(finished):
    """Of a file's text nothing reaches its polygons: only title and labels, drawn in letters, differ."""
    areas = []
    for folder in finished:
        layout = db.Layout()
        layout.read(str(folder / "SMALL.gds"))
        areas.append(db.Region(layout.cell("PLAIN").begin_shapes_rec(layout.layer(1, 0))).area())
    assert areas[0] == areas[1] > 0


# --- packages --------------------------------------------------------------------------------------------------------

PROFILE = """\
title = {text}
sources = ["https://example.org/{address}"]
[accepts]
formats = ["gdsii", "dxf_r12", "gerber"]
others = [{text}]
versions = {{ gdsii = {text} }}
[order]
fields = ["mask_name", "tone", "comments"]
tone_words = {{ clear = {text} }}
"""


@pytest.mark.parametrize("text", sweep([*MARKUP.values(), *UNSEEN.values()], 1), ids=[*MARKUP, *UNSEEN])
def test_the_papers_of_a_package_are_inert_whatever_its_profile_says(capsys, tmp_path, text):
    pages, orders = [], []
    for name, said in (("hostile", text), ("harmless", "a house")):
        folder = tmp_path / name
        folder.mkdir()
        shop = folder / "house.toml"
        address = "".join(said.split())
        shop.write_text(PROFILE.format(text=quoted(said), address=quoted(address)[1:-1]), encoding="utf-8")
        title = text if text in MARKUP.values() and len(text) <= 40 else "SMALL"
        job = spoken_job(folder, title if name == "hostile" else "SMALL", "a", "b")
        assert pack(load_job(job), load_shop(str(shop)), folder / "p.zip").path is not None
        with zipfile.ZipFile(folder / "p.zip") as archive:
            held = {each.partition("/")[2]: archive.read(each) for each in archive.namelist()}
        pages.append(page(held["order.html"].decode()))
        orders.append(held["order.txt"].decode())
        inert(etree.fromstring(held["plate.svg"]))
        assert held["plate.pdf"].startswith(b"%PDF")
        assert b"/JavaScript" not in held["plate.pdf"]
        assert b"/URI" not in held["plate.pdf"]
        json.loads(held["certificate.json"])
    assert pages[0].elements == pages[1].elements
    assert not obeyed(orders[0])
    assert orders[0].count("\n") == orders[1].count("\n")
    shown = command(capsys, "order", "list", tmp_path / "hostile" / "house.toml")
    assert shown.code == 0
    assert not obeyed(shown.stdout)


# --- what is read, and the terminal ----------------------------------------------------------------------------------

EVERY = {**MARKUP, **UNSEEN}


def square(layer: int = 1):
    return gdstk.rectangle((0, 0), (10, 10), layer=layer)


def stated_gds(path: Path, text: str) -> Path:
    """Two top cells and a label of that text."""
    layout = db.Layout()
    for name in (text, f"{text}2"):
        cell = layout.create_cell(name)
        cell.shapes(layout.layer(1, 0)).insert(db.Box(0, 0, 1000, 1000))
        cell.shapes(layout.layer(1, 0)).insert(db.Text(text, 0, 0))
    layout.write(str(path))
    return path


def stated_dxf(path: Path, text: str) -> Path:
    """Two layers, a block and a note of that text, as far as a line of DXF can hold it."""
    document = ezdxf.new("R2010", units=13)
    line = " ".join(text.split())
    for name in ("LAYERA", "LAYERB"):
        document.layers.add(name)
        document.modelspace().add_lwpolyline([(0, 0), (1, 0), (1, 1)], close=True, dxfattribs={"layer": name})
    document.modelspace().add_text("NOTE", dxfattribs={"layer": "LAYERA"})
    document.saveas(path)
    content = path.read_text(encoding="utf-8")
    for name in ("LAYERA", "LAYERB", "NOTE"):
        content = content.replace(f"\n{name}\n", f"\n{line}{name[-1]}\n")
    path.write_text(content, encoding="utf-8")
    return path


def stated_gerber(path: Path, text: str) -> Path:
    """An attribute and a command of that text."""
    held = re.sub(r"[%*]", "_", text)
    path.write_text(f"%FSLAX46Y46*%\n%MOMM*%\n%TF.Part,Other,{held}*%\n{held}*\nM02*\n", encoding="utf-8")
    return path


def stated_png(path: Path, text: str) -> Path:
    said = PngImagePlugin.PngInfo()
    said.add_itxt("Description", text)
    Image.new("L", (4, 4), 255).save(path, pnginfo=said)
    return path


STATED = {"gds": stated_gds, "oas": stated_gds, "dxf": stated_dxf, "gbr": stated_gerber, "png": stated_png}


@pytest.fixture(scope="module")
def job(tmp_path_factory) -> Path:
    return write_job(tmp_path_factory.mktemp("job"))


@pytest.mark.parametrize(("suffix", "text"), sweep(in_turns(STATED, EVERY), len(EVERY)))
def test_what_foreign_files_are_called_inside_never_reaches_the_terminal_raw(capsys, tmp_path, job, suffix, text):
    path = STATED[suffix](tmp_path / f"x.{suffix}", EVERY[text])
    for options in (("--json",), ()):
        answer = command(capsys, "verify", path, "--against", job, "--quiet", *options)
        assert answer.code in {1, 2}
        assert obeyed(answer.stdout + answer.stderr) == []
        assert not any(line.startswith("PASS") for line in answer.stderr.splitlines())
        if options:
            assert answer.document.keys() & {"error", "verdict"}


@pytest.mark.parametrize("text", EVERY.values(), ids=EVERY)
def test_names_of_files_cells_and_layers_on_the_command_line_are_told_plainly(capsys, tmp_path, job, text):
    path = stated_gds(tmp_path / f"x {text.replace('/', '_')}.gds", "TOP")
    for options in (("--cell", text), ("--layer", text), ("--die", text)):
        answer = command(capsys, "verify", path, "--against", job, "--quiet", *options)
        assert answer.code == 2
        assert obeyed(answer.stdout + answer.stderr) == []
        assert len(answer.stderr.splitlines()) == 1


KEYS = ('name = "SMALL"', 'title = "SMALL PLATE"', 'name = "PLAIN"', 'label = "periodic"', 'opening = "ring.toml"')


@pytest.mark.parametrize(("key", "named"), sweep(in_turns(KEYS, EVERY), len(EVERY)))
def test_texts_of_a_job_are_drawn_or_refused_in_one_line(capsys, tmp_path, key, named):
    """Those that the plate's font has are text; all others are refused, and nothing is written."""
    text = EVERY[named]
    job = write_job(tmp_path, (key, f"{key.split()[0]} = {quoted(text)}"))
    answer = command(capsys, "order", "pack", job, "--shop", "generic-chrome", "--dry-run", "--quiet")
    assert obeyed(answer.stdout + answer.stderr) == []
    drawn = key.startswith(("title", "label")) and text in MARKUP.values() and len(text) <= 40
    assert answer.code == (0 if drawn else 2), answer.stderr
    if not drawn:
        assert answer.stderr.startswith("error: MF")
        assert len(answer.stderr.splitlines()) == 1


def test_an_opening_from_a_foreign_cell_is_named_by_its_job_alone(capsys, tmp_path):
    """`maskfab analyse` of a hostile cell tells it in one line."""
    path = stated_gds(tmp_path / "x.gds", UNSEEN["lines"])
    answer = command(capsys, "analyse", path, "--quiet")
    assert answer.code == 2
    assert obeyed(answer.stdout + answer.stderr) == []
    assert len(answer.stderr.splitlines()) == 1


@pytest.mark.parametrize("text", UNSEEN.values(), ids=UNSEEN)
def test_what_is_printed_plainly_says_the_same(text):
    assert obeyed(one_line(text)) == []
    assert "\n" not in one_line(text)
    assert json.loads(f'"{one_line(text)}"') == text


def test_letters_of_all_languages_are_left_alone():
    told = "Größe ≤ 5 µm ± 1 ΔE λf/d Präzisionsoptik マスク × – …"
    assert one_line(told) == told
