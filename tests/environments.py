"""Builds environments that maskfab says it runs in, tries it in each, and keeps what was seen: ``make environments``.

Only the standard library is needed. *lowest* has the least versions that ``pyproject.toml`` allows; *newest* what the
index gives today, on every Python that is on the path; *slim* and *unstable* are Debian's smallest systems, made by
mmdebstrap as root. In each: an installation from the wheel and one from the checkout, the doctor, a shipped plate, a
small job of every format, and part of the tests. torch is left out: for most of these Pythons it comes as gigabytes,
and none of what is tried needs it.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "export_templates" / "environments.json"
EXTRAS = "solid,gerber,raw,pandas"
TOLD = (
    "numpy", "scipy", "OpenImageIO", "klayout", "gdstk", "ezdxf", "finufft", "pydantic", "typer", "matplotlib",
    "cadquery", "trimesh", "manifold3d", "gerbonara", "rawpy", "pandas",
)  # fmt: skip
TESTERS = ("pytest", "pytest-xdist", "hypothesis", "tifffile", "jsonschema", "grimp")
TESTS = (
    "tests/base",
    *(f"tests/mask/formats/test_{name}.py" for name in ("reading_dxf", "drawn_apart", "agreement", "tiff_tone")),
    "tests/cli/test_commands.py",
)
NOT_TRIED = ("tests/base/test_clock.py", "tests/base/test_provenance.py")
"""Needs torch; holds the record that is being made."""
SMALL = """\
[job]
name = "SMALL"
title = "EVERY FORMAT"
[camera]
focal = "5 mm"
stop = { shape = "circle", diameter = "400 um" }
wavelengths = ["530 nm"]
pixel = "2 um"
window = "64 um"
[plate]
blank = "27 mm"
writable = "22 mm"
die_size = "560 um"
die_pitch = "2 mm"
columns = 1
[export]
formats = FORMATS
[[die]]
name = "BAR"
label = "bar"
opening = "LAYOUTS/openings/toled.toml"
dot = "8 um"
pitch = "168 um"
tiling = "random"
seed = 3
"""
_MINUTES = 40
_CHROOT = ("unshare", "--mount", "sh", "-c", 'mount -t proc proc "$0/proc" && exec chroot "$0" "$@"')


@dataclass
class Environment:
    """Where maskfab is tried.

    Attributes:
        name: of it.
        python: that makes its virtual environment, as seen inside.
        folder: of that, as seen inside.
        root: of another system; this one's if None.
        pins: of packages.
        libraries: of the system, by Debian's names, that come after a run without them.
    """

    name: str
    python: str
    folder: str
    root: Path | None = None
    pins: Sequence[str] = ()
    libraries: tuple[str, ...] = ()

    def run(self, *words: str, where: str | None = None, check: bool = True) -> subprocess.CompletedProcess[str]:
        """Run a command inside; its own exit code is checked or told."""
        line = [*((*_CHROOT, str(self.root)) if self.root else ()), "env", "-C", where or "/", *words]
        kept = {name: os.environ[name] for name in os.environ if not name.startswith(("PYTHON", "VIRTUAL"))}
        kept |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MASKFAB_CACHE": "off"}
        done = subprocess.run(line, capture_output=True, text=True, check=False, env=kept, timeout=60 * _MINUTES)
        if check and done.returncode:
            raise RuntimeError(
                f"{' '.join(words)[:200]}: exit {done.returncode}\n{(done.stdout + done.stderr)[-2000:]}"
            )
        return done

    def tool(self, name: str) -> str:
        """A program of the virtual environment."""
        return f"{self.folder}/bin/{name}"

    def outside(self, path: str) -> Path:
        """A path inside, as seen from here."""
        return (self.root or Path("/")) / path.lstrip("/")


def lowest() -> list[str]:
    """Lower bounds of the core and of the extras as pins."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    every = [*project["dependencies"], *(line for name in EXTRAS.split(",") for line in
             project["optional-dependencies"][name])]  # fmt: skip
    return [re.sub(r">=([\w.]+).*", r"==\1", line) for line in every]


def _installed(told: Environment, source: str, wheel: str) -> None:
    """Install the wheel, then the checkout in its place."""
    told.run(told.python, "-m", "venv", "--clear", told.folder)
    pip = (told.tool("python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    told.run(*pip, *told.pins, f"{wheel}[{EXTRAS}]")
    told.run(told.tool("maskfab"), "--version")
    told.run(*pip, *told.pins, *TESTERS, "--editable", f"{source}[{EXTRAS}]")


def tried(environment: Environment, source: str, wheel: str) -> dict:
    """What is seen in an environment, which is made first.

    Raises:
        RuntimeError: for a step that fails.
    """
    begun, told = time.monotonic(), environment
    work = f"{told.folder}/work"
    if not told.outside(work).is_dir():
        _installed(told, source, wheel)
        told.outside(work).mkdir()
    formats = json.loads(
        told.run(
            told.tool("python"), "-c",
            "import json; from maskfab.mask.formats.table import FORMATS; "
            "print(json.dumps([name for name in FORMATS if not name.startswith('plate_')]))",
        ).stdout
    )  # fmt: skip
    text = SMALL.replace("LAYOUTS", f"{source}/layouts")
    everything = told.outside(f"{work}/every.toml")
    everything.write_text(text.replace("FORMATS", json.dumps(formats)), encoding="utf-8")
    seen: dict = {}
    if told.libraries:
        refused = told.run(told.tool("maskfab"), "run", f"{work}/every.toml", "--out", f"{work}/no", check=False)
        doctor = told.run(told.tool("maskfab"), "self", "doctor", "--quiet", check=False)
        cure = f"apt-get install {told.libraries[0]}"
        if refused.returncode != 2 or doctor.returncode != 1 or cure not in refused.stderr or cure not in doctor.stdout:
            raise RuntimeError(f"no refusal that names {cure}: {refused.stderr[-900:]} {doctor.stdout[-900:]}")
        seen["without"] = f"{' '.join(told.libraries)}: STEP refused before work (MF152), doctor exit 1"
        told.run("apt-get", "update", "--quiet", "--option", "Acquire::Check-Valid-Until=false")
        told.run("apt-get", "install", "--yes", "--quiet", "--no-install-recommends", *told.libraries)
    examined = json.loads(told.run(told.tool("maskfab"), "self", "doctor", "--quiet", "--json").stdout)
    told.run(
        told.tool("maskfab"),
        "run",
        f"{source}/layouts/first_plate.toml",
        "--out",
        f"{work}/first",
        "--quiet",
        "--force",
    )
    told.run(told.tool("maskfab"), "run", f"{work}/every.toml", "--out", f"{work}/every", "--quiet", "--force")
    report = json.loads(told.outside(f"{work}/first/report.json").read_text("utf-8"))
    tests = told.run(
        told.tool("python"), "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "2", "-o", "filterwarnings=default",
        *TESTS, *(f"--ignore={each}" for each in NOT_TRIED), where=source,
    ).stdout.splitlines()[-1]  # fmt: skip
    facts = {name.lower(): version for name, version in examined["facts"].items()}
    return {
        **seen,
        "python": facts["python"],
        "packages": {name: facts[name.lower()] for name in TOLD if name.lower() in facts},
        "doctor": f"{sum(check['passed'] is True for check in examined['checks'])} of {len(examined['checks'])}",
        "first_plate": report["verdict"],
        "every_format": len(formats),
        "tests": re.sub(r" in .*|=+ ?", "", tests),
        "minutes": round((time.monotonic() - begun) / 60, 1),
        "job": report["job_hash"],
        "files": {
            file["format"]: file["sha256"]
            for file in report["files"]
            if Path(file["path"]).suffix in (".gds", ".oas")
        },
    }  # fmt: skip


def pythons() -> list[str]:
    """Every Python on the path that is new enough, once."""
    found = (shutil.which(f"python3.{minor}") for minor in range(11, 30))
    works = [
        one for one in filter(None, found) if subprocess.run([one, "-c", "import venv"], check=False).returncode == 0
    ]
    return works or [sys.executable]


def system(name: str, suite: str, packages: str, folder: Path) -> Path:
    """A smallest Debian, with the checkout under /src.

    Raises:
        RuntimeError: without mmdebstrap, or where this is not root.
    """
    if shutil.which("mmdebstrap") is None or os.geteuid() != 0:
        raise RuntimeError("needs mmdebstrap, run as root")
    root = folder / f"{name}_root"
    if not (root / "usr").is_dir():
        wanted = ("--variant=minbase", '--aptopt=Acquire::Check-Valid-Until "false"', f"--include={packages}")
        subprocess.run(["mmdebstrap", *wanted, suite, str(root)], check=True)
    for told in ("etc/resolv.conf", "etc/ssl/certs/ca-certificates.crt"):
        shutil.copyfile(f"/{told}", root / told)
    shutil.rmtree(root / "src", ignore_errors=True)
    kept = shutil.ignore_patterns(".git", ".venv", "build", "dist", "__pycache__")
    shutil.copytree(ROOT, root / "src", ignore=kept)
    shutil.copytree(ROOT / "dist", root / "dist", dirs_exist_ok=True)
    return root


def wanted(names: Sequence[str], folder: Path) -> dict[str, Callable[[], Environment]]:
    """Environments by name, each made when it is asked for."""
    every: dict[str, Callable[[], Environment]] = {}

    def here(name: str, python: str, pins: Sequence[str] = ()) -> Callable[[], Environment]:
        return lambda: Environment(name, python, str(folder / name), pins=pins)

    def debian(name: str, suite: str, python: str, packages: str) -> Callable[[], Environment]:
        base = f"{packages},ca-certificates"
        return lambda: Environment(
            name, python, "/root/venv", system(name, suite, base, folder), libraries=("libgl1", "libx11-6")
        )

    found = pythons()
    every["lowest"] = here("lowest", found[0], lowest())
    for python in found:
        version = re.search(r"3\.\d+", Path(python).name)
        name = f"newest-{version[0] if version else '3'}"
        every[name] = here(name, python)
    every["slim"] = debian("slim", "bookworm", "python3", "python3,python3-venv")
    every["unstable"] = debian("unstable", "unstable", "python3.14", "python3.14,python3.14-venv")
    return {name: make for name, make in every.items() if not names or name in names}


def main() -> int:
    """Try the environments that are named, all if none is; 1 if one fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="environments, such as lowest newest-3.11 slim")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "environments")
    parser.add_argument("--keep", action="store_true", help="keep what was built, and take it where it is")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    (wheel,) = (ROOT / "dist").glob("maskfab-*.whl")
    failed = []
    for name, make in wanted(asked.names, asked.folder).items():
        try:
            environment = make()
            source, built = ("/src", f"/dist/{wheel.name}") if environment.root else (str(ROOT), str(wheel))
            seen = tried(environment, source, built)
        except (RuntimeError, subprocess.SubprocessError, OSError) as problem:
            failed.append(name)
            print(f"{name}: FAIL {problem}", flush=True)
            continue
        version, record = wheel.name.split("-")[1], json.loads(RECORD.read_text("utf-8"))
        kept = record["environments"] if record["maskfab"] == version else {}
        every = {"maskfab": version, "environments": dict(sorted({**kept, name: seen}.items()))}
        RECORD.write_text(json.dumps(every, indent=1) + "\n", encoding="utf-8")
        print(f"{name}: {json.dumps(seen)}", flush=True)
        if not asked.keep:
            shutil.rmtree(environment.root or environment.folder, ignore_errors=True)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
