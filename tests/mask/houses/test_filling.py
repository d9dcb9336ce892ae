"""Blanks of an order: asked for, held against the house, and put into a job of which nothing else changes."""

from __future__ import annotations

import io
import json
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_job import command, write_job

import maskfab as mf
from maskfab.base.errors import JobError, SourceError
from maskfab.job.toml import inserted

SAID = ("quantity=2", "glass=quartz", "thickness=2.3 mm", "film=chrome", "corner_touches=join",
        "corner_width=2 um",
        "contact.name=A. \"Reader\"", "contact.organisation=Institute", "contact.address=1 Lens Street, Town",
        "contact.email=a@example.org")  # fmt: skip


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def typed(monkeypatch, *lines: str) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("".join(f"{line}\n" for line in lines)))


def test_on_a_terminal_each_blank_is_asked_for_until_its_answer_holds(monkeypatch, capsys, tmp_path):
    job = write_job(tmp_path)
    job.chmod(0o640)
    before = job.read_bytes()
    # Out of range, then right; of no kind, then right; too thick for the house, then right; the rest left blank.
    typed(monkeypatch, "0", "3", "plastic", "quartz", "9 mm", "2.3 mm", "", "", "", "", "", "", "")
    answer = command(capsys, "order", "fill", job, "--shop", "topro_chrome")
    assert answer.code == 1
    assert "1 to 5 mm" in answer.stderr
    assert "quartz" in answer.stderr
    assert job.read_bytes().startswith(before)
    assert job.stat().st_mode & 0o777 == 0o640
    spec = mf.load_job(job).spec
    assert (spec.order.quantity, spec.order.glass, spec.order.thickness) == (3, "quartz", 2300.0)
    assert spec.export.shop == "topro_chrome"
    assert "order.contact.name" in answer.stdout
    assert "maskfab order pack" in answer.stdout


def test_a_terminal_that_ends_leaves_the_job_as_it_was(monkeypatch, capsys, tmp_path):
    job = write_job(tmp_path)
    before = job.read_bytes()
    typed(monkeypatch, "3", "quartz")
    assert command(capsys, "order", "fill", job, "--shop", "topro_chrome").code == 130
    assert job.read_bytes() == before

    assert not list(tmp_path.glob(".*"))


def test_without_a_terminal_blanks_are_named_and_answers_taken_from_options(capsys, tmp_path):
    job = write_job(tmp_path)
    named = command(capsys, "order", "fill", job, "--shop", "compugraphics", "--json")
    keys = [each.partition("=")[0] for each in SAID]
    assert named.code == 1
    assert [each["key"] for each in named.document["missing"]] == keys
    told = command(
        capsys, "order", "fill", job, "--shop", "compugraphics", *(f"--set={each}" for each in SAID), "--json"
    )
    assert told.code == 0
    assert told.document["complete"]
    assert told.document["written"] == [*(f"order.{key}" for key in keys), "order.date", "export.shop"]
    assert mf.load_job(job).spec.order.contact.name == 'A. "Reader"'
    package = ["order", "pack", job, "--shop", "compugraphics", "--out", tmp_path / "p.zip", "--quiet", "--json"]
    assert command(capsys, *package).document["blanks"] == []
    again = command(capsys, "order", "fill", job, "--shop", "compugraphics", "--set", "quantity=3")
    assert again.code == 2
    assert "stated already" in again.stderr


@pytest.mark.parametrize(
    ("said", "code"),
    [
        ("quantity=0", "MF104"),
        ("quantity=two", "MF105"),
        ("glass=plastic", "MF105"),
        ("glas=quartz", "MF102"),
        ("thickness=2.3", "MF103"),
        ("contact.address=" + "x" * 10_000, "MF110"),
        ("contact.address=a\nb", "MF110"),
        ("contact=me", "MF105"),
        ("contact.email=me", "MF105"),
        ("glass.kind=quartz", "MF105"),
        ("bias=house", "MF128"),
        ("thickness=9 mm", "MF128"),
        ("tone", "MF105"),
    ],
)
def test_an_answer_that_cannot_be_is_refused_and_nothing_written(capsys, tmp_path, said, code):
    job = write_job(tmp_path, ("[camera]", '[order]\nrevision = "A"\nprotection = "none"\n[camera]'))
    before = job.read_bytes()
    answer = command(
        capsys, "order", "fill", job, "--shop", "topro_chrome", "--set", "film=chrome", "--set", said, "--json"
    )
    assert answer.code == 2
    assert answer.document["error"]["code"] == code
    assert answer.document["error"]["cure"]
    assert job.read_bytes() == before


def test_tone_that_a_house_does_not_write_is_refused(tmp_path):
    with pytest.raises(JobError, match=r"MF128 .*dark"):
        mf.order.fill(write_job(tmp_path), "mems_exchange_gca3600", {"tone": "clear"})


def test_only_a_file_of_toml_is_written_to(tmp_path):
    job = mf.load_job(write_job(tmp_path))
    with pytest.raises(JobError, match="MF105"):
        mf.order.fill(job, "compugraphics", {"quantity": "1"})
    path = tmp_path / "job.json"
    path.write_text(json.dumps(job.spec.dump()))
    with pytest.raises(SourceError, match="MF308"):
        mf.order.fill(path, "compugraphics", {"quantity": "1"})


LINES = (
    "",
    "# a comment",
    "[order]",
    "[ order . contact ] # here",
    'contact = { name = "x" }',
    "contact = {}",
    'contact.name = "x"',
    'order = { glass = "quartz" }',
    'order.film = "chrome"',
    'glass = "quartz"  # [order]',
    "[export]",
    "[[die]]",
    'text = """\n[order]\n"""',
    "list = [\n[1],\n]",
)


@given(st.lists(st.sampled_from(LINES), max_size=7), st.sampled_from(["\n", "\r\n"]), st.booleans())
def test_a_value_is_added_to_any_toml_and_all_else_stays_byte_for_byte(lines, end, marked):
    text = ("\ufeff" if marked else "") + end.join(lines).replace("\r\n", "\n").replace("\n", end)
    try:
        before = tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError:
        return
    for key in ("order.contact.email", "order.quantity", "order.contact.telephone"):
        try:
            longer = inserted(text, key, 'a "b"' if "contact" in key else 3, where="a test")
        except JobError:
            continue  # a table that TOML forbids to add to
        place = next((i for i, (a, b) in enumerate(zip(text, longer, strict=False)) if a != b), len(text))
        extra = len(longer) - len(text)
        assert any(longer[:i] + longer[i + extra :] == text for i in range(max(0, place - extra), place + 1))
        text = longer
        after = tomllib.loads(text.removeprefix("\ufeff"))
        assert after["order"].get("quantity", 3) == 3
        assert {name: after[name] for name in before if name != "order"} == {
            name: value for name, value in before.items() if name != "order"
        }


@pytest.mark.parametrize(
    ("text", "key", "wanted"),
    [
        ("a = 1\n", "order.quantity", "a = 1\n\n[order]\nquantity = 2\n"),
        ("[order]\na = 1 # x\n\n# y\n[z]\n", "order.quantity", "[order]\na = 1 # x\nquantity = 2\n\n# y\n[z]\n"),
        ("[order.contact]\r\n\r\n[z]", "order.contact.name", "[order.contact]\r\nname = 2\r\n\r\n[z]"),
        ("order = {}", "order.contact.name", "order = { contact.name = 2 }"),
        ("", "export.shop", "[export]\nshop = 2\n"),
    ],
)  # fmt: skip
def test_a_line_stands_where_one_would_write_it(text, key, wanted):
    assert inserted(text, key, 2, where="a test") == wanted
