"""Every writer: equal bytes for equal things; on a disk that is full, and killed half-way, the old file stays.

The kernel's limit on the size of files stands for the disk. A process that has asked for its signal to be ignored is
told by the failing write, as by a full disk; one that has not is killed on the spot, in the middle of its write.
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from small_job import LOOK, command, listing, with_the_die, write_job
from sweeps import sweep

from maskfab.base.errors import OutputError
from maskfab.base.folders import write_bytes
from maskfab.base.model import Die, Plate
from maskfab.mask.figures import Figures, draw
from maskfab.mask.formats.cif import write_cif
from maskfab.mask.formats.dxf_writer import write_dxf
from maskfab.mask.formats.exr import write_exr, write_png
from maskfab.mask.formats.gdsii import write_gdsii, write_oasis
from maskfab.mask.formats.gerber import write_gerber
from maskfab.mask.formats.mesh import write_3mf, write_glb, write_stl
from maskfab.mask.formats.picture import write_picture
from maskfab.mask.formats.step import write_plate_step, write_step
from maskfab.mask.formats.svg import write_svg
from maskfab.mask.job import load_job
from maskfab.mask.package.archive import write_package


def light():
    return np.random.default_rng(0).random((96, 96, 3))


@dataclass(frozen=True)
class Things:
    plate: Plate
    figures: Figures
    die: Die
    folder: Path


WRITERS: dict[str, tuple[str, Callable[[Things, Path], object]]] = {
    "gdsii": (".gds", lambda of, path: write_gdsii(of.figures.layout(), path)),
    "oasis": (".oas", lambda of, path: write_oasis(of.figures.layout(), path)),
    "dxf_r12": (".dxf", lambda of, path: write_dxf(of.figures, path, "R12")),
    "dxf_r2010": (".dxf", lambda of, path: write_dxf(of.figures, path, "R2010")),
    "gerber": (".gbr", lambda of, path: write_gerber(of.figures, path)),
    "cif": (".cif", lambda of, path: write_cif(of.figures, path)),
    "svg": (".svg", lambda of, path: write_svg(of.figures, path)),
    "png": (".png", lambda of, path: write_picture(of.plate, path, 0.25, die=of.die.name)),
    "tiff": (".tif", lambda of, path: write_picture(of.plate, path, 1.0, die=of.die.name)),
    "picture": (".png", lambda of, path: write_png(light(), path)),
    "exr": (".exr", lambda of, path: write_exr(light(), path, {})),
    "step": (".step", lambda of, path: write_step(of.die, path)),
    "plate_step": (".step", lambda of, path: write_plate_step(of.plate, path)),
    "glb": (".glb", lambda of, path: write_glb(of.die, path)),
    "3mf": (".3mf", lambda of, path: write_3mf(of.die, path)),
    "stl": (".stl", lambda of, path: write_stl(of.die, path)),
    "zip": (".zip", lambda of, path: write_package(path, of.folder, ["x.bin"], "x")),
    "bytes": (".json", lambda of, path: write_bytes(path, bytes(100_000))),
}
"""Of all that write a whole file of their own its suffix, and how they are asked for one."""


@dataclass(frozen=True)
class Case:
    suffix: str
    write: Callable[[Path], object]


@pytest.fixture(scope="module")
def things(tmp_path_factory) -> Things:
    folder = tmp_path_factory.mktemp("things")
    (folder / "x.bin").write_bytes(np.random.default_rng(0).bytes(200_000))
    plate = load_job(write_job(folder)).plate()
    return Things(plate, draw(plate), plate.dies[1], folder)


@pytest.fixture(params=WRITERS)
def case(request, things) -> Case:
    suffix, write = WRITERS[request.param]
    return Case(suffix, partial(write, things))


@contextmanager
def room_for(limit: int) -> Iterator[None]:
    """Files of this process end here; it is told by an error, for Python ignores the signal."""
    before, unwritten = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # of what is imported meanwhile the head alone would be kept, for every later start
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = unwritten


def killed_at(limit: int, work: Callable[[], object]) -> int:
    """Exit status of a process that does the work and dies when a file of its has so many bytes."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks among threads
        child = os.fork()
    if child == 0:
        try:
            sys.dont_write_bytecode = True
            oiio.attribute("threads", 1)  # its others are not in this process
            signal.alarm(30)
            signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
            work()
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


EXR = """
import sys; from pathlib import Path; import numpy as np; from maskfab.mask.formats.exr import write_exr
write_exr(np.random.default_rng(0).random((96, 96, 3)), Path(sys.argv[1]), {})
"""


def killed_script(limit: int, script: str, *arguments: object) -> subprocess.CompletedProcess[bytes]:
    """The same of a process of its own."""
    head = (
        "import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_DFL); "
        f"resource.setrlimit(resource.RLIMIT_CORE, (0, 0)); resource.setrlimit(resource.RLIMIT_FSIZE, ({limit},) * 2)\n"
    )
    words = [sys.executable, "-B", "-c", head + script, *map(str, arguments)]
    return subprocess.run(words, check=False, timeout=120, capture_output=True)


def test_two_writes_are_byte_identical_and_quiet_and_none_is_begun_without_a_folder(case, tmp_path, capfd):
    for stem in ("one", "other"):
        case.write(tmp_path / f"{stem}{case.suffix}")
    written = listing(tmp_path)
    assert len(written) == 2
    assert len(set(written.values())) == 1
    assert capfd.readouterr().out == ""
    with pytest.raises(OutputError, match="MF401"):
        case.write(tmp_path / "none" / f"x{case.suffix}")
    assert listing(tmp_path) == written


def test_a_full_disk_is_told_and_leaves_nothing(case, tmp_path):
    """Full from the start, half-way, and at the last byte, which many programs notice only when they close the file."""
    path = tmp_path / f"x{case.suffix}"
    case.write(path)
    size = path.stat().st_size
    path.unlink()
    assert size > 100
    for limit in (0, size // 2, size - 1):
        with room_for(limit), pytest.raises(OutputError, match="MF401"):
            case.write(path)
        assert listing(tmp_path) == {}, limit


def test_a_writer_that_is_killed_half_way_leaves_the_old_file(case, tmp_path):
    path = tmp_path / f"x{case.suffix}"
    case.write(path)
    size = path.stat().st_size
    path.write_bytes(b"old")
    if case.suffix == ".exr":  # whose library waits for its threads, which a fork has not
        assert killed_script(size // 2, EXR, path).returncode == -signal.SIGXFSZ
    else:
        assert killed_at(size // 2, lambda: case.write(path)) == -signal.SIGXFSZ
    assert path.read_bytes() == b"old"
    for other in tmp_path.iterdir():
        assert other == path or (other.name.startswith(".") and "partial" in other.name), other


# --- whole commands --------------------------------------------------------------------------------------------------

COMMANDS = {
    "run": (("run", "JOB", "--out", "OUT", "--quiet"), "OUT"),
    "package": (("order", "pack", "JOB", "--shop", "generic-chrome", "--out", "OUT.zip", "--quiet"), "OUT.zip"),
    "analyse": (
        ("analyse", "RING", *LOOK, "--out", "OUT"),
        "OUT",
    ),
    "shape": (
        ("new", "OUT.toml", "--shape", "stripe", "--dots", "21", "--pitch", "168 um", "--set", "width_dots=5",
         "--clear-dots", "90"),
        "OUT.toml",
    ),
}  # fmt: skip


def spoken(verb: str, folder: Path) -> tuple[list[str], Path]:
    """The words of a command on a job in a folder, and where its result goes."""
    job = with_the_die("TURNED", write_job(folder))
    places = {"JOB": str(job), "RING": str(folder / "ring.toml"), "OUT": str(folder / "out")}
    arguments, result = COMMANDS[verb]
    return [places.get(word, word.replace("OUT", places["OUT"])) for word in arguments], folder / result.lower()


@pytest.mark.parametrize(
    ("verb", "limit"),
    [("run", 100), ("run", 12_000), ("run", 60_000), ("package", 20_000), ("package", 40_000), ("analyse", 5000),
     ("shape", 100)],
)  # fmt: skip
def test_a_command_without_room_says_so_and_leaves_nothing(capsys, tmp_path, verb, limit):
    words, _ = spoken(verb, tmp_path)
    before = listing(tmp_path)
    with room_for(limit):
        answer = command(capsys, *words)
    assert answer.code == 2
    assert answer.stderr.startswith("error: MF401")
    assert listing(tmp_path) == before


@pytest.mark.parametrize(("verb", "limit"), sweep([("run", 12_000), ("package", 20_000)], 1))
def test_a_command_that_is_killed_half_way_leaves_no_result(tmp_path, verb, limit):
    words, result = spoken(verb, tmp_path)
    before = listing(tmp_path)
    script = "from maskfab.cli.program import run_command_line; sys.exit(run_command_line(sys.argv[1:]))"
    done = killed_script(limit, script, *words)
    assert done.returncode == 128 + signal.SIGXFSZ, done.stderr
    assert not result.exists()
    assert all(name.startswith(".") or name in before for name in listing(tmp_path))
