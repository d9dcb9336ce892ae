"""Commands are derived from functions: their words, their help, and completion in shells."""

from __future__ import annotations

import inspect
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from small_job import command

import maskfab as mf
from maskfab.cli.command import Command, command_of, summary_of
from maskfab.cli.program import GROUPS, VERBS, run_command_line

SHARED = {"--out", "--force", "--json", "--quiet"}
"""Options that mean the same everywhere, and are said once by ``maskfab --help``."""


def function_of(found: Command):
    return getattr(import_module(found.module), found.function)


def names(found: Command) -> set[str]:
    return {each.spelling[0] for each in found.options}


def test_verbs_and_options_are_few():
    assert len(VERBS) == len(set(VERBS))
    assert len({verb.partition(" ")[0] for verb in VERBS}) == 19
    assert len(GROUPS) == 6
    own = [option for verb in VERBS for option in names(command_of(verb)) - SHARED]
    assert len(own) + len(SHARED) <= 150


@pytest.mark.parametrize("verb", VERBS)
def test_every_word_of_a_command_is_a_parameter_of_its_function_or_of_what_saves_its_result(verb):
    found = command_of(verb)
    function = function_of(found)
    known = {*inspect.signature(function).parameters, "as_json", "quiet"}
    if found.saves:
        returned = str(inspect.signature(function).return_annotation).split(" | ")
        kinds = [getattr(sys.modules[found.module], name) for name in returned]
        known |= {name for kind in kinds if hasattr(kind, "save") for name in inspect.signature(kind.save).parameters}
    assert {each.name for each in found.parameters} <= known
    assert ("quiet" in {each.name for each in found.parameters}) == ("progress" in known)
    assert "--json" in names(found)


@pytest.mark.parametrize("verb", VERBS)
def test_every_word_of_a_command_is_explained(verb):
    found = command_of(verb)
    assert summary_of(verb) == found.summary
    assert found.examples
    for example in found.examples:
        assert example.startswith(f"maskfab {verb}")
    for each in found.parameters:
        assert each.help.endswith("."), each.name
        assert not {"`", "None"} & set(each.help.replace("'", " ").split()), each.help


def test_the_help_of_the_program_lists_every_verb_in_its_group(capsys):
    told = command(capsys, "--help").stdout
    for group, verbs in GROUPS.items():
        below = told.split(f"\n{group}:\n")[1].split("\n\n")[0]
        assert [line[2:].split("  ")[0] for line in below.splitlines() if line[2] != " "] == list(verbs)
    for option in (*SHARED, "--help", "--version", "--install-completion"):
        assert option in told


def test_public_names_are_listed_once():
    text = Path(mf.__file__).read_text(encoding="utf-8")
    for name in set(mf.__all__) - {"__version__"}:
        assert text.count(f"import {name} as {name}\n") == 1
        assert name in dir(mf)
    starred: dict[str, object] = {}
    exec("from maskfab import *", starred)
    assert set(mf.__all__) <= set(starred)


@pytest.fixture
def completed(capsys, monkeypatch):
    """The program's answer to a shell that completes words, the last of them half typed."""

    def answer(shell: str, *words: str) -> str:
        line = " ".join(("maskfab", *words))
        asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(words)), "_TYPER_COMPLETE_ARGS": line}
        asked |= {"_TYPER_COMPLETE_FISH_ACTION": "get-args", "_MASKFAB_COMPLETE": f"complete_{shell}"}
        for name, value in asked.items():
            monkeypatch.setenv(name, value)
        with pytest.raises(SystemExit, match=r"^0$"):
            run_command_line([])
        return capsys.readouterr().out

    return answer


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_completes_verbs_and_options(completed, shell):
    assert "restore" in completed(shell, "res")
    assert "compare" in completed(shell, "order", "comp")
    assert "--budget" in completed(shell, "design", "--bud")


@pytest.mark.parametrize(
    ("shell", "written"),
    [
        ("bash", ".bash_completions/maskfab.sh"),
        ("zsh", ".zfunc/_maskfab"),
        ("fish", ".config/fish/completions/maskfab.fish"),
    ],
)
def test_completion_is_installed_for_a_shell(monkeypatch, shell, written, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    with pytest.raises(SystemExit, match=r"^0$"):
        run_command_line(["--install-completion", shell])
    script = (tmp_path / written).read_text()
    assert "_MASKFAB_COMPLETE" in script
    if shutil.which(shell):
        subprocess.run([shell, "-n", tmp_path / written], check=True)
