"""What the manual shows is what there is: pictures of the gallery, commands, Python, notebooks, links, README."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import struct
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import maskfab as mf
from maskfab.cli import program

ROOT = Path(mf.__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
TEXTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *PAGES]
GALLERY = runpy.run_path(str(DOCS / "gallery.py"))
ENTRIES = GALLERY["entries"]()
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
QUICK_NOTEBOOKS = {"first_psf"}
MOST_BYTES = 3_000_000


def told(path: Path) -> str:
    return str(path.relative_to(ROOT))


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^ *```{language}\n(.*?)^ *```", text, re.DOTALL | re.MULTILINE)


def size(picture: Path) -> tuple[int, int]:
    """Width and height of a PNG."""
    return struct.unpack(">II", picture.read_bytes()[16:24])


def test_readme_is_short_and_says_what_to_do():
    text = (ROOT / "README.md").read_text("utf-8")
    assert len(text.splitlines()) <= 120
    wheel = f"dist/maskfab-{mf.__version__}-py3-none-any.whl"
    assert {"make plate", "make test", "pip install '.[all]'", "make wheel", f"pip install './{wheel}[solid]'"} <= {
        line.partition("  ")[0] for block in blocks(text, "sh") for line in block.splitlines()
    }
    install = (ROOT / "docs" / "how-to" / "install.md").read_text("utf-8")
    assert f"pip install './{wheel}[solid]'" in install
    assert len(re.findall(r"^\| `maskfab ", text, re.MULTILINE)) == 8


def test_nothing_is_installed_by_a_name_that_no_index_has():
    package = ROOT / "maskfab"
    every = [*ROOT.glob("*.md"), *PAGES, *NOTEBOOKS, *package.rglob("*.py"), package / "base" / "error_codes.toml"]
    told = [each for each in every if re.search(r"pip install (-\S+ )*['\"]?maskfab\b(?! @)", each.read_text("utf-8"))]
    assert [path.name for path in told if path.name != "CHANGELOG.md"] == []


@pytest.mark.parametrize("path", TEXTS, ids=told)
def test_every_link_leads_to_a_file(path):
    text = re.sub(r"```.*?```|`[^`\n]*`", "", path.read_text("utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]+)", text):
        if "://" not in target:
            there = path.parent / target
            assert there.exists() or there.with_suffix(".ipynb").exists(), target


def test_every_source_file_that_is_named_with_its_folder_is_there():
    for path in TEXTS:
        for named in re.findall(r"`([a-z_]+/[a-z_/]*\w+\.py)`", path.read_text("utf-8")):
            assert (ROOT / named).exists() or (ROOT / "maskfab" / named).exists(), f"{told(path)}: {named}"


def test_every_page_stands_in_the_navigation():
    settings = re.sub(r"#.*", "", (ROOT / "mkdocs.yml").read_text("utf-8"))
    named = set(re.findall(r"[\w/-]+\.md", settings))
    there = {told(page).removeprefix("docs/") for page in PAGES}
    assert named == there | {f"notebooks/{path.stem}.md" for path in NOTEBOOKS}


def commands() -> list[tuple[str, list[str]]]:
    """Words of every command line of maskfab that a page or the gallery shows, with its place."""
    shown = [(told(path), block) for path in TEXTS for block in blocks(path.read_text("utf-8"), "sh")]
    shown += [(entry.name, entry.sh) for entry in ENTRIES]
    found = []
    for place, block in shown:
        for line in re.split(r"\n|&&", re.sub(r"(?<=,)\n|\\\n", " ", block)):
            if line.strip().startswith("maskfab "):
                found.append((place, shlex.split(line, comments=True)[1:]))
    return found


def test_every_command_shown_is_one_that_the_program_takes(monkeypatch):
    monkeypatch.setattr(program, "_act", lambda *_: None)
    assert len(commands()) > 50
    for place, words in commands():
        assert words[0] in {verb.split()[0] for verb in program.VERBS}, (place, words)
        assert program._run(words) == 0, (place, words)


def test_every_public_name_has_its_entry():
    named = set(re.findall(r"^::: ([\w.]+)", (DOCS / "reference/python.md").read_text("utf-8"), re.MULTILINE))
    modules = {"maskfab.api.order", "maskfab.api.torch"}
    assert {f"{module}.{name}" for name, module in mf.WHERE.items()} - named == modules
    assert all(any(entry.startswith(module) for entry in named) for module in modules)


@pytest.mark.parametrize("path", TEXTS, ids=told)
def test_python_shown_is_python(path):
    for block in blocks(path.read_text("utf-8"), "python"):
        compile(block, told(path), "exec")


def test_the_gallery_has_its_pictures_and_they_are_light():
    assert len(ENTRIES) >= 20
    pictures = {entry.name: GALLERY["FOLDER"] / f"{entry.name}.png" for entry in ENTRIES}
    assert len(pictures) == len(ENTRIES)
    assert set(pictures.values()) == set(GALLERY["FOLDER"].glob("*.png"))
    assert sum(path.stat().st_size for path in pictures.values()) <= MOST_BYTES
    for entry in ENTRIES:
        assert entry.title
        assert len(entry.look.split()) > 5
        assert bool(entry.python) != bool(entry.sh)
        assert f"{entry.name}.png" in entry.python + entry.sh
        assert not entry.python or compile(entry.python, entry.name, "exec")


def remade(entry, folder: Path) -> None:
    picture = entry.make(folder)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert size(picture) == size(GALLERY["FOLDER"] / picture.name)


@pytest.mark.parametrize("entry", [one for one in ENTRIES if one.cheap][:1], ids=lambda entry: entry.name)
def test_a_picture_is_made_by_the_lines_under_it(entry, tmp_path):
    remade(entry, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("entry", [one for one in ENTRIES if not one.browser], ids=lambda entry: entry.name)
def test_every_picture_is_made_by_the_lines_under_it(entry, tmp_path):
    remade(entry, tmp_path)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_begins_with_its_title_and_keeps_no_answers(path):
    cells = json.loads(path.read_text("utf-8"))["cells"]
    assert cells[0]["source"][0].startswith("# ")
    for cell in cells:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=[pytest.mark.slow] * (path.stem not in QUICK_NOTEBOOKS)) for path in NOTEBOOKS],
    ids=lambda path: path.stem,
)
def test_a_notebook_runs_in_an_empty_folder(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    cells = json.loads(path.read_text("utf-8"))["cells"]
    names: dict[str, object] = {"display": print}
    for number, cell in enumerate(cells):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{path.stem}, cell {number}", "exec"), names)
    plt.close("all")


def test_the_forty_lines_are_forty():
    cells = json.loads((DOCS / "notebooks/forty_lines.ipynb").read_text("utf-8"))["cells"]
    lines = [line for cell in cells if cell["cell_type"] == "code" for line in "".join(cell["source"]).splitlines()]
    written = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    assert len(written) <= 40
    assert max(map(len, written)) <= 100


@pytest.mark.slow
def test_the_ten_minutes_in_python_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks((DOCS / "tutorial/python.md").read_text("utf-8"), "python"):
        exec(block, names)
    assert capsys.readouterr().out.rstrip().endswith("True")
    assert {path.name for path in tmp_path.iterdir()} == {"psf.png", "psf_turned.png", "mine.oas"}


def test_a_cell_of_klayout_becomes_an_opening_as_the_manual_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict[str, mf.Opening] = {}
    exec(blocks((DOCS / "explanation/compared-with.md").read_text("utf-8"), "python")[0], names)
    assert names["opening"].clear_dots == 7 * 13
