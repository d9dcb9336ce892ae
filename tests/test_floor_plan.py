"""Which room may import which, and that the doorway is light."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from importlinter import cli as linter
from small_job import write_job

import maskfab
from maskfab.cli.program import run_command_line

ROOT = Path(maskfab.__file__).resolve().parent.parent
HEAVY = {
    "numpy", "scipy", "torch", "klayout", "gdstk", "ezdxf", "finufft", "OpenImageIO", "pydantic", "pydantic_core",
    "matplotlib", "jinja2", "rich", "threadpoolctl",
}  # fmt: skip
SECONDS = 0.3


def test_the_floor_plan_is_kept(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    code = linter.lint_imports(config_filename="pyproject.toml", no_cache=True)
    printed = capsys.readouterr().out
    assert code == linter.EXIT_STATUS_SUCCESS, printed
    assert "3 kept, 0 broken" in printed


def test_every_room_is_on_the_floor_plan():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    (contract,) = (each for each in settings["contracts"] if each["type"] == "layers")
    planned = {room.strip() for floor in contract["layers"] for room in re.split("[|:]", floor)}
    package = ROOT / "maskfab"
    there = {
        f"maskfab.{path.stem}" for path in package.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()
    }
    assert there - planned == {"maskfab.__init__", "maskfab.__main__"}
    assert planned <= there


def imported(code: str) -> set[str]:
    """The modules that a statement imports in a new interpreter."""
    shown = f"import sys\n{code}\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", shown], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_the_doorway_imports_nothing_heavy():
    code = (
        "import sys, maskfab.cli\nfrom maskfab.__main__ import main\n"
        "sys.argv = ['maskfab', '--version']\nmain()\n"
        "from maskfab.cli.program import VERBS, run_command_line\nassert run_command_line(['--help']) == 0\n"
        "assert len(VERBS) > 10 and not any(run_command_line([*verb.split(), '--help']) for verb in VERBS)"
    )
    assert imported(code) & HEAVY == set()


def test_a_scene_is_planned_without_what_only_files_wires_and_designs_need(tmp_path):
    """Importing these takes longer than planning a die."""
    job = write_job(tmp_path)
    code = (
        f"from maskfab.cli import run_command_line; assert run_command_line(['check', '--optics', {str(job)!r}]) == 0"
    )
    later = {"klayout", "gdstk", "torch", "matplotlib", "OCP", "zxingcpp", "scipy.fft", "scipy.sparse", "scipy.special"}
    assert imported(code) & later == set()


def test_a_sweep_that_is_kept_is_read_without_what_only_finds_cases(tmp_path):
    """Importing these takes longer than reading a thousand cases."""
    study = tmp_path / "study.toml"
    study.write_text(
        f'[sweep]\ntitle = "kept"\njob = "{write_job(tmp_path).name}"\nquantities = ["open_ratio"]\n'
        '[[field]]\nkey = "die.*.size"\nvalues = ["504 um", "560 um"]\n',
        encoding="utf-8",
    )
    command = ["sweep", str(study), "-o", str(tmp_path / "out"), "--engine", "serial", "--quiet"]
    assert run_command_line(command) == 0
    code = f"from maskfab.cli import run_command_line; assert run_command_line({command!r}) == 0"
    later = {"klayout", "torch", "matplotlib", "scipy.fft", "scipy.ndimage", "scipy.sparse", "scipy.special"}
    assert imported(code) & later == set()


FOR_OTHERS = {
    "importlib.metadata", "klayout", "gdstk", "matplotlib", "numpy.ma", "OpenImageIO",
    "scipy", "urllib.request", "maskfab.base.provenance", "maskfab.base.quantities", "maskfab.job.read",
    "maskfab.job.sections", "maskfab.mask.job", "maskfab.optics.lags", "maskfab.optics.metrics", "maskfab.optics.mtf",
    "maskfab.optics.spectrum",
}  # fmt: skip
"""Packages and files that an opening, a panel and a camera in Python have no use for."""


def test_the_first_objects_are_imported_without_what_only_jobs_files_and_measures_need():
    names = imported("import maskfab as mf; mf.Opening; mf.Panel; mf.Camera")
    assert names & (FOR_OTHERS | {"maskfab.optics.psf", "pydantic.plugin._loader"}) == set()
    assert {"maskfab.api.opening", "maskfab.api.panel", "maskfab.api.camera", "maskfab.job.die"} <= names


def test_objects_are_made_and_a_psf_computed_without_what_only_files_need():
    code = (
        "import maskfab as mf\nbar = mf.Opening.bar(7, (3, 5), '56 um')\npanel = mf.Panel.tile(bar, size='560 um')\n"
        "mf.Camera('5 mm', stop='400 um', pixel='2 um', wavelengths='530 nm', window='64 um').psf(panel)"
    )
    # To look for its plugins pydantic reads what is installed.
    assert imported(code) & (FOR_OTHERS - {"importlib.metadata"}) == set()


def test_an_opening_is_analysed_without_what_only_displays_and_designs_need():
    later = {
        *("torch", "matplotlib", "scipy.sparse", "scipy.fft", "maskfab.display", "maskfab.designs"),
        *("maskfab.findings.scene", "maskfab.optics.scene.scene", "maskfab.mask.composition", "maskfab.mask.marks"),
    }
    assert imported("import maskfab.api.analysing") & later == set()


def test_a_plate_is_made_and_verified_without_what_only_designs_and_solids_need():
    later = {"torch", "OCP", "cadquery", "trimesh", "manifold3d", "gerbonara"}
    assert imported("import maskfab.runs.pipeline, maskfab.runs.verification") & later == set()


@pytest.mark.parametrize("option", ["--version", "--help"])
def test_version_and_help_answer_at_once(option, tmp_path):
    """The process's own CPU time with bytecode kept, as after an install; the best of several, on a busy machine."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment = {**kept, "PYTHONPYCACHEPREFIX": str(tmp_path / "bytecode")}
    times = []
    for _ in range(6):
        with (tmp_path / "printed").open("w+b") as printed:
            started = subprocess.Popen([sys.executable, "-m", "maskfab", option], stdout=printed, env=environment)
            _, status, used = os.wait4(started.pid, 0)
            started.returncode = os.waitstatus_to_exitcode(status)
        assert started.returncode == 0
        assert b"maskfab" in (tmp_path / "printed").read_bytes()
        times.append(used.ru_utime + used.ru_stime)
        if times[-1] < SECONDS:
            break
    assert min(times) < SECONDS, times


def test_the_public_names_are_there():
    for name in maskfab.__all__:
        assert getattr(maskfab, name) is not None
    assert {"analyse", "load_job", "run", "verify", "__version__"} <= set(maskfab.__all__)
    assert dir(maskfab) == sorted(maskfab.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        _ = maskfab.nonsense
