"""A process of its own for every file: whatever becomes of it is told, and nothing else comes of it."""

from __future__ import annotations

import io
import runpy
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import copies
import fuzz_originals
import pytest

from maskfab.base.errors import OpeningError, SourceError
from maskfab.mask import process_limits as limits
from maskfab.mask import sandbox
from maskfab.mask.formats.table import read_layout
from maskfab.mask.sandbox import read_apart

HEAD = """
import os, signal, sys, time, warnings
from maskfab.mask.sandbox import answer_message, error_message
def say(answer, kind=int):
    sys.stdout.buffer.write(answer_message(answer, kind))
"""


def answer(folder, code, *arguments, kind=int, seconds=60.0):
    script, path = folder / "reader.py", folder / "file.gds"
    script.write_text(HEAD + code, encoding="utf-8")
    path.write_bytes(b"1234")
    return read_apart(path, script, *arguments, kind=kind, seconds=seconds)


def refusal(folder, code, **options):
    with pytest.raises(SourceError) as caught:
        answer(folder, code, **options)
    assert "file.gds" in caught.value.what
    assert caught.value.where == str(folder / "file.gds")
    return caught.value


def test_what_is_read_comes_back_with_its_arguments(tmp_path):
    code = "say((sys.argv[1], open(sys.argv[2], 'rb').read()), tuple[str, bytes])"
    assert answer(tmp_path, code, "how", kind=tuple[str, bytes]) == ("how", b"1234")


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize(
    ("code", "stands"),
    [
        ("sys.exit('its end is missing')", "MF303"),
        ("raise ValueError('its end is missing')", "MF303"),
        ("warnings.warn('its end is missing')", "MF303"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "MF303"),
        ("os.abort()", "MF303"),
        ("import resource; resource.setrlimit(resource.RLIMIT_CPU, (1, 1))\nwhile True: pass", "MF316"),
    ],
)
def test_any_other_end_is_a_refusal(tmp_path, code, stands):
    error = refusal(tmp_path, code)
    assert error.code == stands
    assert ("its end is missing" in error.what) == ("missing" in code)


def test_an_error_of_ours_comes_as_it_is(tmp_path):
    code = """
from maskfab.base.errors import OpeningError
sys.stdout.buffer.write(error_message(OpeningError("MF203", "it is closed", where="here", cure="Open it")))
"""
    with pytest.raises(OpeningError) as caught:
        answer(tmp_path, code)
    error = caught.value
    assert (error.code, error.what, error.where, error.cure) == ("MF203", "it is closed", "here", "Open it")
    assert str(error) == "MF203 it is closed (here). Open it"


@pytest.mark.skipif(sys.platform == "win32", reason="limits of POSIX")
@pytest.mark.parametrize(
    ("limits", "work", "stands"),
    [
        ("1 << 30, 1 << 20", "bytes(2 << 30)", "MF303"),
        ("1 << 30, 1 << 20, 1", "while True: pass", "MF316"),
        ("1 << 30, 1 << 20, 60", "say(1)", ""),
    ],
)
def test_a_reader_ends_that_takes_more_than_its_share(tmp_path, limits, work, stands):
    code = (
        "from pathlib import Path; from maskfab.mask.process_limits import limit_share\n"
        f"limit_share(Path(sys.argv[1]), {limits})\n{work}"
    )
    if stands:
        assert refusal(tmp_path, code).code == stands
    else:
        assert answer(tmp_path, code) == 1


@pytest.mark.parametrize("script", copies.LIBRARIES, ids=lambda script: Path(script).stem)
def test_every_reader_script_takes_a_limited_share_before_it_reads(tmp_path, monkeypatch, script):
    """Of a small file: a few gigabytes and seconds, which no larger share is set after."""
    path, held = tmp_path / "small", {}
    path.write_bytes(b"1234")
    monkeypatch.setattr(limits, "_set_limit", lambda kind, value, **_: held.setdefault(kind, []).append(value))
    monkeypatch.setattr(sys, "argv", [script, *["_read_gdsii"] * ("gdstk" in script), str(path)])
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO()))
    with suppress(Exception, SystemExit):
        runpy.run_path(script, run_name="__main__")
    assert {kind: len(values) for kind, values in held.items()} == {"RLIMIT_AS": 1, "RLIMIT_CPU": 1}
    assert 1 << 30 <= held["RLIMIT_AS"][0] <= 5 << 30
    assert 1 <= held["RLIMIT_CPU"][0] <= (30 if "frame" in script else 10)


def test_a_reader_that_sleeps_is_ended(tmp_path):
    error = refusal(tmp_path, "time.sleep(60)", seconds=0.3)
    assert error.code == "MF316"
    assert error.cure


def test_nothing_is_imported_from_where_the_file_lies(tmp_path, monkeypatch):
    (tmp_path / "json.py").write_text("raise SystemExit('read from the folder')", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert answer(tmp_path, "import json; say(json.__name__, str)", kind=str) == "json"


@pytest.mark.parametrize("reader", ["gdsii", "gerber"])
@pytest.mark.parametrize("whole", [True, False])
def test_a_new_process_reads_and_refuses_as_the_copy_of_this_one_does_in_other_tests(
    tmp_path, monkeypatch, reader, whole
):
    path = tmp_path / f"x{fuzz_originals.SUFFIXES[reader]}"
    content = fuzz_originals.originals(reader)[0]
    path.write_bytes(content if whole else content.replace(b"D01*", b"D09*"))
    if not whole and reader == "gdsii":
        path.write_bytes(content + b"anything")

    def told():
        try:
            layout = read_layout(path)
        except SourceError as error:
            return str(error)
        return [(cell.name, str(cell.dbbox()), cell.child_instances()) for cell in layout.each_cell()]

    copied = told()
    assert isinstance(copied, str) is not whole
    monkeypatch.setattr(sandbox, "subprocess", subprocess)
    assert told() == copied
