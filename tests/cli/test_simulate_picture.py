"""maskfab simulate --picture: a sheet of photographs through the dies."""

from __future__ import annotations

from pathlib import Path

import pytest
from once import leaves

from maskfab.cli.program import run_command_line
from maskfab.mask.formats.exr import write_png

JOB = Path(__file__).parents[2] / "layouts" / "toled_against_ours.toml"


def test_a_sheet_is_written_once_and_replaced_only_if_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenes, sheet = tmp_path / "scenes", tmp_path / "sheet.png"
    scenes.mkdir()
    write_png(leaves(3, 832, 832).values, scenes / "leaves.png", white=1.0)
    arguments = ["simulate", str(JOB), "--die", "OURS", "--images", str(scenes), "-o", str(sheet), "--quiet"]
    arguments += ["--level", "32"]
    assert run_command_line(arguments) == 0
    first = sheet.read_bytes()
    assert first.startswith(b"\x89PNG")
    assert run_command_line(arguments) == 2
    assert "MF402" in capsys.readouterr().err
    assert run_command_line([*arguments, "--force"]) == 0
    assert sheet.read_bytes() == first
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scenes", "sheet.png"]


def test_a_picture_that_cannot_be_written_is_refused_before_any_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for place in (tmp_path, tmp_path / "nowhere" / "sheet.png"):
        assert run_command_line(["simulate", "no_job.toml", "-o", str(place), "--quiet"]) == 2
        assert "MF401" in capsys.readouterr().err
