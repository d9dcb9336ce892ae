"""The core: what works without the heavy packages of the extras, and what says which of them it needs."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import grimp
import numpy as np
import pytest
from once import leaves
from small_job import LOOK, command, finished, write_job

import maskfab
import maskfab as mf
from maskfab.base.errors import MissingPackageError
from maskfab.base.extras import EXTRAS, install_command, lacking_libraries
from maskfab.mask.formats.exr import write_png
from maskfab.mask.formats.table import FORMATS, read_layout, require_packages

PACKAGE = Path(maskfab.__file__).parent
PROJECT = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ALL = ("design", "solid", "gerber", "raw", "pandas")
HEAVY = [module for name in ALL for module in EXTRAS[name].modules]
LAYOUTS = PACKAGE.parent / "layouts"
NAMED = {"zxing-cpp": "zxingcpp", "cvvdp": "pycvvdp"}
"""Names on import, where others than on installation."""
NEED_TORCH = {
    "maskfab.camera.learning",
    "maskfab.camera.restorers.network",
    "maskfab.designs.descent.losses",
    "maskfab.designs.descent.relax",
    "maskfab.designs.descent.objective",
    "maskfab.designs.descent.panel_optics",
    "maskfab.designs.descent.schedule",
    "maskfab.designs.model.panel_error",
}
"""Modules of descent along gradients, of panels judged with their slopes, and of the network."""

VERBS = """
import importlib, json, pkgutil, sys
import maskfab
from maskfab.cli.program import run_command_line
from once import OPTICS, compared_once, figures_in_words, once
with figures_in_words(), once(*OPTICS), compared_once():
    codes = {" ".join(line): run_command_line(line) for line in json.loads(sys.argv[1])}
unready = []
for module in pkgutil.walk_packages(maskfab.__path__, "maskfab."):
    if not module.name.endswith("__main__"):
        try:
            importlib.import_module(module.name)
        except ImportError:
            unready.append(module.name)
print(json.dumps([codes, unready]))
"""


def test_the_verbs_of_the_core_work_without_the_heavy_packages(tmp_path):
    blocked, images = tmp_path / "blocked", tmp_path / "images"
    blocked.mkdir()
    # In processes that verbs start, too.
    blocking = f"import sys; sys.modules.update(dict.fromkeys({HEAVY!r}))"
    (blocked / "sitecustomize.py").write_text(blocking, encoding="utf-8")
    job = write_job(tmp_path, ("[plate]", '[export]\nformats = ["gdsii", "dxf_r12"]\n\n[plate]'))
    three_colours = write_job(tmp_path / "three", ('["530 nm"]', '["610 nm", "530 nm", "470 nm"]'))
    images.mkdir()
    write_png(leaves(1, 704, 768).values, images / "leaves.png", white=1.0)
    plate, package = tmp_path / "plate", tmp_path / "plate.zip"
    lines = (
        ("analyse", tmp_path / "ring.toml", *LOOK),
        ("run", job, "--out", plate, "--quiet"),
        ("check", job, "--optics", "--quiet"),
        ("verify", plate, "--quiet"),
        ("order", "pack", job, "--shop", "generic-chrome", "--out", package, "--quiet"),
        ("verify", package, "--quiet"),
        ("simulate", three_colours, "--die", "PLAIN", "--restore", "wiener", "--images", images, "--quiet"),
        ("view", plate),
        ("compare", plate / "report.json"),
        ("explain", "MF152"),
        ("self", "doctor", "--quiet"),
    )
    paths = map(str, (blocked, PACKAGE.parent, Path(__file__).parents[1]))
    done = subprocess.run(
        [sys.executable, "-c", VERBS, json.dumps([[str(word) for word in line] for line in lines])],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    codes, unready = json.loads(done.stdout.splitlines()[-1])
    assert [line for line, code in codes.items() if code] == [], done.stderr
    assert len(codes) == len(lines)
    assert set(unready) == NEED_TORCH
    assert "not installed: torch\n" in done.stdout


@pytest.fixture
def bare(monkeypatch) -> None:
    """An installation of the core."""
    for module in HEAVY:
        monkeypatch.setitem(sys.modules, module, None)


@pytest.mark.parametrize(
    ("form", "extra"), [("step", "solid"), ("glb", "solid"), ("3mf", "solid"), ("stl", "solid"), ("gerber", "gerber")]
)
@pytest.mark.parametrize("option", [(), ("--dry-run",)], ids=["run", "dry run"])
def test_a_format_that_needs_an_extra_is_refused_before_any_work(bare, capsys, tmp_path, form, extra, option):
    job = write_job(tmp_path, ("[[die]]", f'[export]\nformats = ["gdsii", "{form}"]\n\n[[die]]'))
    answer = command(capsys, "run", job, "--out", tmp_path / "out", *option)
    assert answer.code == 2
    assert re.search(
        rf"MF152 writing {form} needs .*pip install .*\[{extra}\]'.*leave these formats out", answer.stderr
    )
    assert answer.stdout == ""
    assert not (tmp_path / "out").exists()


def test_all_formats_that_need_extras_are_named_at_once(bare, capsys, tmp_path):
    answer = command(capsys, "run", LAYOUTS / "all_formats.toml", "--out", tmp_path / "out")
    assert "MF152 writing gerber, step, glb, 3mf, stl needs gerbonara, cadquery, " in answer.stderr
    assert re.search(r"pip install .*\[gerber,solid\]'", answer.stderr)


def test_a_run_with_solids_is_not_called_damaged_where_they_cannot_be_read(capsys, monkeypatch, tmp_path):
    out = finished(tmp_path, ("[[die]]", '[export]\nformats = ["gdsii", "stl"]\n\n[[die]]'))
    for module in EXTRAS["solid"].modules:
        monkeypatch.setitem(sys.modules, module, None)
    answer = command(capsys, "verify", out)
    assert answer.code == 2
    assert "MF152 writing stl needs" in answer.stderr


def test_what_needs_torch_is_refused_before_any_work(bare, tmp_path):
    told: list[object] = []
    job = write_job(tmp_path)

    def told_of(*stage: object) -> None:
        told.append(stage)

    for refused in (
        lambda: mf.design(dots=7, pitch="56 um", clear_dots=20, progress=told_of),
        lambda: mf.design(LAYOUTS / "pareto.toml", front=True, progress=told_of),
        lambda: mf.advise(LAYOUTS / "display_that_fits.toml", progress=told_of),
        lambda: mf.learn(job, out=tmp_path / "a.npz", die="PLAIN", progress=told_of),
        lambda: mf.simulate(job, checkpoints=[tmp_path / "a.npz"], progress=told_of),
    ):
        with pytest.raises(MissingPackageError, match=r"MF152 .*torch.*pip install .*\[design\]'"):
            refused()
    assert told == []


def test_objects_of_other_libraries_say_what_they_need(bare, tmp_path):
    panel = mf.Panel.tile(np.eye(7), pitch="56 um", size="560 um")
    plate, gerber = mf.Plate.of(EYE=panel, blank="27 mm", writable="22 mm"), tmp_path / "eye.gbr"
    gerber.write_text("%FSLAX46Y46*%\nM02*\n", encoding="utf-8")
    for extra, refused in (
        ("solid", panel.to_cadquery),
        ("solid", panel.to_trimesh),
        ("solid", lambda: plate.write(tmp_path / "eye.step")),
        ("gerber", lambda: read_layout(gerber)),
    ):
        with pytest.raises(MissingPackageError, match=rf"MF152 .*pip install .*\[{extra}\]'"):
            refused()
    assert not (tmp_path / "eye.step").exists()


class Installed:
    """A distribution whose installer says where it came from."""

    def __init__(self, told: dict | None) -> None:
        self.told = told

    def read_text(self, name: str) -> str | None:
        assert name == "direct_url.json"
        return None if self.told is None else json.dumps(self.told)


def test_the_cure_installs_from_where_this_installation_came(monkeypatch, tmp_path):
    wheel, folder = tmp_path / "maskfab-1.0-py3-none-any.whl", tmp_path / "a checkout"
    wheel.touch()
    folder.mkdir()
    commit = {"vcs_info": {"vcs": "git", "commit_id": "abc"}, "url": "https://host/maskfab"}
    for told, cure in (
        ({"url": folder.as_uri(), "dir_info": {"editable": True}}, f"run pip install --editable '{folder}[raw]'"),
        ({"url": folder.as_uri(), "dir_info": {}}, f"run pip install '{folder}[raw]'"),
        ({"url": wheel.as_uri(), "archive_info": {}}, f"run pip install '{wheel}[raw]'"),
        (commit, "run pip install 'maskfab[raw] @ git+https://host/maskfab@abc'"),
        ({"url": (tmp_path / "gone").as_uri()}, "run pip install 'PATH[raw]', PATH being the checkout or the wheel"),
        (None, "run pip install 'PATH[raw]', PATH being the checkout or the wheel"),
    ):
        monkeypatch.setattr(metadata, "distribution", lambda _, told=told: Installed(told))
        assert install_command("raw").startswith(cure)


LDD = """\
#!/bin/sh
echo "	libGL.so.1 => not found"
echo "	libX11.so.6 => not found"
echo "	libGL.so.1 => not found"
echo "	libinner-0a1b.so => not found"
echo "	libm.so.6 => /lib/libm.so.6 (0x0)"
"""


@pytest.fixture
def slim(monkeypatch, tmp_path) -> None:
    """A system without libraries of a desktop."""
    (tmp_path / "ldd").write_text(LDD, encoding="utf-8")
    (tmp_path / "ldd").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    lacking_libraries.cache_clear()
    yield
    lacking_libraries.cache_clear()


@pytest.mark.skipif(sys.platform != "linux", reason="libraries are told by ldd")
def test_step_is_refused_before_any_work_where_the_system_lacks_a_library_and_meshes_are_not(slim, capsys, tmp_path):
    job = write_job(tmp_path, ("[[die]]", '[export]\nformats = ["gdsii", "glb", "step"]\n\n[[die]]'))
    answer = command(capsys, "run", job, "--out", tmp_path / "out")
    assert (answer.code, answer.stdout) == (2, "")
    assert "MF152 writing step needs libGL.so.1, libX11.so.6, not installed" in answer.stderr
    assert "apt-get install libgl1 libx11-6 (Debian" in answer.stderr
    assert not (tmp_path / "out").exists()
    require_packages(["gdsii", "glb", "3mf", "stl"])
    panel = mf.Panel.tile(np.eye(7), pitch="56 um", size="560 um")
    with pytest.raises(MissingPackageError, match=r"MF152 an assembly needs libGL"):
        panel.to_cadquery()


@pytest.mark.skipif(sys.platform != "linux", reason="libraries are told by ldd")
def test_doctor_tells_a_format_that_does_not_work_here(slim):
    told = mf.doctor()
    assert not told.passed
    (broken,) = told.checks.failed
    assert broken.method.startswith("STEP")
    assert "apt-get install libgl1" in broken.value


def test_doctor_tries_every_format_and_every_extra_that_is_installed():
    told = mf.doctor()
    assert told.passed, told
    tried = [check.method for check in told.checks if check.name == "part_works"]
    assert {f"{form.title}, written and read back" for form in FORMATS.values()} <= set(tried)
    assert {EXTRAS[name].use for name in ("design", "raw", "pandas") if not EXTRAS[name].missing} <= set(tried)


def test_every_package_that_is_imported_is_of_the_core_or_of_an_extra():
    extras = PROJECT["optional-dependencies"]
    named = {name: {NAMED.get(each, each) for each in map(package, extras[name])} for name in EXTRAS}
    core = {NAMED.get(each, each) for each in map(package, PROJECT["dependencies"])}
    assert {name: set(extra.modules) for name, extra in EXTRAS.items()} == named | {"cluster": {"distributed"}}
    assert not core & set(HEAVY)
    assert set(re.findall(r"\w+", extras["all"][0].partition("[")[2])) == set(ALL)
    imported = grimp.build_graph("maskfab", include_external_packages=True, cache_dir=None).modules
    foreign = {name for name in imported if not name.startswith("maskfab")} - sys.stdlib_module_names
    with_another = {"OCP", "numba", "pydantic_core"}  # which cadquery and pydantic bring
    assert foreign - with_another <= core | set(HEAVY) | {"distributed"}
    assert core <= foreign


def package(requirement: str) -> str:
    """Name of a package in a requirement."""
    return re.split(r"[\[<>=]", requirement)[0]
