"""What each format takes, told after a run and before it; and helpers that end with whoever started them."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from small_job import write_job

from maskfab.job.values import FileFormat
from maskfab.mask.job import load_job
from maskfab.runs.forecast import dry_run

FORMATS: tuple[FileFormat, ...] = ("gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber", "cif", "svg", "step", "glb")
MORE: tuple[FileFormat, ...] = ("3mf", "stl", "png", "tiff")


def _job(folder: Path, formats: tuple[FileFormat, ...] = (*FORMATS, *MORE)) -> Path:
    path = write_job(folder)
    names = ", ".join(f'"{name}"' for name in formats)
    text = path.read_text(encoding="utf-8")
    head, _, tail = text.partition("[[die]]")
    assert "[export]" not in head
    path.write_text(f"{head}[export]\nformats = [{names}]\ndots_per_um = 0.125\n\n[[die]]{tail}", encoding="utf-8")
    return path


def _command(*words: object) -> list[str]:
    return [sys.executable, "-m", "maskfab", *map(str, words), "--quiet"]


@pytest.mark.parametrize(
    "formats",
    [
        pytest.param(("gdsii", "dxf_r12", "gerber", "svg", "png"), id="without solids"),
        pytest.param((*FORMATS, *MORE), id="all", marks=pytest.mark.slow),
    ],
)
def test_every_format_has_a_row_in_timing_and_the_forecast_is_within_a_factor_of_two(tmp_path, formats):
    """Of a process of its own, for what a run takes is that of its imports and helpers, too."""
    job = _job(tmp_path, formats)
    told = dry_run(load_job(job), tmp_path / "out")
    command = _command("run", job, "--out", tmp_path / "out", "--no-cache")
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode in (0, 1)
    took_s, held = used.ru_utime + used.ru_stime, used.ru_maxrss * 1024
    assert took_s / 2 < told.seconds < 2 * took_s
    # A process begins with the peak of the one that starts it.
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    assert told.bytes < 2 * held
    assert held <= own or held / 2 < told.bytes
    assert told.all_bytes >= told.bytes
    rows = {row["format"]: row for row in json.loads((tmp_path / "out" / "timing.json").read_text())["formats"]}
    assert set(rows) == set(formats)
    for name, row in rows.items():
        assert row["files"] == (1 if name in FORMATS[:7] else 3 if name == "step" else 2)
        assert row["read_s"] > 0.0
        assert min(row["write_bytes"], row["read_bytes"]) > 1e7
    assert "step" not in rows or rows["step"]["read_s"] > rows["cif"]["read_s"]


def _children(process: int) -> list[int]:
    found = []
    for thread in Path(f"/proc/{process}/task").iterdir():
        for child in map(int, (thread / "children").read_text().split()):
            found += [child, *_children(child)]
    return found


def _lives(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="looks for children in /proc")
@pytest.mark.parametrize(
    "after_s", [pytest.param(0.0, marks=pytest.mark.slow), 0.05, pytest.param(0.3, marks=pytest.mark.slow)]
)
def test_helpers_end_with_a_run_that_is_killed(tmp_path, after_s):
    """Killed as soon as it has a helper, and a little later."""
    command = _command("run", _job(tmp_path), "--out", tmp_path / "out", "--no-cache", "--workers", 2)
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        children: list[int] = []
        while not children and process.poll() is None:
            time.sleep(0.01)
            try:
                children = _children(process.pid)
            except OSError:
                continue
        time.sleep(after_s)
        children += _children(process.pid) if process.poll() is None else []
        process.send_signal(signal.SIGKILL)
    assert children
    until = time.monotonic() + 10
    while any(map(_lives, children)) and time.monotonic() < until:
        time.sleep(0.02)
    left = [child for child in children if _lives(child)]
    for child in left:
        os.kill(child, signal.SIGKILL)
    assert not left
