"""Job files and everything that they name: refused in linear time, whatever they hold, and under a code of ours."""

from __future__ import annotations

import time
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_job import JOB, LOOK, OPENING, command, write_job
from sweeps import examples

from maskfab.base.errors import MaskfabError, catalogue
from maskfab.job.read import read
from maskfab.job.shop import parse_shop
from maskfab.job.toml import MOST_LEVELS, MOST_PARTS, MOST_VALUES, loads
from maskfab.mask import opening_file, panels
from maskfab.mask.marks import load_template

HOSTILE = {
    "a nested key": "a." * 100_000 + "a = 1",
    "a nested table": "[" + "a." * 100_000 + "a]",
    "a nested key of strings and spaces": "\"a\" . 'b'.\t" * 50_000 + "c = 1",
    "a nested key in an inline table": "x = { " + "a." * 100_000 + "a = 1 }",
    "a nested key behind a comment": 'x = """ # """ # "\n' + "a." * 100_000 + "a = 1",
    "nested arrays": "a = " + "[" * 100_000,
    "nested tables": "a = " + "{a = " * 30_000,
    "a string of quotes that never ends": 'a = """' + '\\"""' * 90_000,
    "an escape that never ends": 'a = "' + "\\" * 200_001,
    "one long word": "a" * 4_000_000,
    "one long line": "a" + " " * 4_000_000 + "= 1",
    "many numbers": "a = [" + "1," * 900_000 + "]",
    "many empty lines": "\n" * 9_000_000,
    "many comments": "#\n" * 9_000_000,
    "many escapes": 'a = "' + "\\n" * 2_000_000 + '"',
}
READERS = {
    "job": read,
    "opening": opening_file.load_opening,
    "map": panels.read_map,
    "shop": lambda path: parse_shop(path.read_text(), "x", where="x"),
    "template": load_template,
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_what_would_take_a_reader_of_toml_for_ever_is_refused_at_once(text):
    start = time.process_time()
    with pytest.raises(ValueError, match=r"at most|more than|Unterminated|Unescaped|after a key"):
        loads(text)
    assert time.process_time() - start < 2.0


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
def test_every_reader_refuses_a_nested_key_under_its_code(tmp_path, reader):
    path = tmp_path / "x.toml"
    path.write_text(JOB + HOSTILE["a nested key"])
    with pytest.raises(MaskfabError, match=r"MF(101|124|421).*32 parts"):
        reader(path)


def test_the_limits_themselves_are_allowed():
    key = ".".join(["a"] * MOST_PARTS)
    assert loads(f"{key} = 1") == tomllib.loads(f"{key} = 1")
    with pytest.raises(ValueError, match="parts"):
        loads(f"{key}.a = 1")
    deep = "[" * MOST_LEVELS + "]" * MOST_LEVELS
    assert loads(f"a = {deep}") == tomllib.loads(f"a = {deep}")
    assert len(loads("a = [" + "1," * (MOST_VALUES - 1) + "]")["a"]) == MOST_VALUES - 1


def test_words_and_drawings_with_dots_are_no_keys():
    text = f"# {'a.' * 100}\nx = \"{'a.' * 100}\"\ny = '''\n{'a.' * 100}\n'''\nz = 1.5 # {'b.' * 100}"
    assert loads(text) == tomllib.loads(text)
    drawing = '"""\n' + ("a." * 2048 + "\n") * 64 + '"""'
    assert loads(f"grid = {drawing}") == tomllib.loads(f"grid = {drawing}")


@examples(60)
@given(st.text(alphabet="a1.#\"'\\\n=[]{}, \t-", max_size=60))
def test_a_small_text_is_read_or_refused_as_python_reads_it(text):
    def outcome(parse):
        try:
            return parse(text)
        except (ValueError, RecursionError):
            return "refused"

    assert outcome(loads) == outcome(tomllib.loads)


LONG = "n" * 300
PATHS = {
    "opening": ('opening = "ring.toml"', f'opening = "{LONG}.toml"'),
    "map": ('tiling = "random"\nseed = 3', f'tiling = "map"\nmap = "{LONG}.toml"'),
    "shop": ("[[die]]", f'[export]\nshop = "{LONG}.toml"\n\n[[die]]'),
    "template": ('blank = "27 mm"\nwritable = "22 mm"', f'template = "{LONG}"'),
    "spectrum": ("[[die]]", f'[scene]\nspectrum = "{LONG}.csv"\n\n[[die]]'),
}


@pytest.mark.parametrize("edit", PATHS.values(), ids=PATHS)
def test_a_path_that_is_too_long_for_the_system_is_refused_as_missing(capsys, tmp_path, edit):
    answer = command(capsys, "run", write_job(tmp_path, edit), "--out", tmp_path / "out", "--json")
    assert answer.code == 2
    assert answer.document["error"]["code"] in catalogue().keys() - {"MF901"}


@pytest.mark.parametrize(
    "words",
    [
        ("run", f"{LONG}.toml", "--out", "out"),
        ("analyse", f"{LONG}.gds", *LOOK),
        ("analyse", f"{LONG}.png", *LOOK),
        ("verify", LONG),
        ("verify", f"{LONG}.zip"),
        ("verify", f"{LONG}.gds", "--against", "JOB"),
        ("order", "pack", "JOB", "--shop", f"{LONG}.toml", "--out", "p.zip"),
        ("order", "pack", "JOB", "--shop", "pog", "--out", f"{LONG}.zip"),
        ("simulate", "JOB", "--images", LONG),
        ("run", "JOB", "--out", LONG),
    ],
)
def test_a_name_on_the_command_line_that_is_too_long_is_refused(capsys, tmp_path, monkeypatch, words):
    job = write_job(tmp_path)
    monkeypatch.chdir(tmp_path)
    answer = command(capsys, *(job if word == "JOB" else word for word in words), "--json")
    assert answer.document["error"]["code"] in catalogue().keys() - {"MF901"}


def test_an_error_can_be_read_whatever_a_file_put_into_it(tmp_path):
    path = tmp_path / "ring.toml"
    path.write_text(OPENING + f"{'k' * 100_000} = 1\n")
    with pytest.raises(MaskfabError, match="MF102") as refusal:
        opening_file.load_opening(path)
    assert len(str(refusal.value)) < 20_000
