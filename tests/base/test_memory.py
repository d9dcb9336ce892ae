from __future__ import annotations

import platform
import subprocess
import sys

import pytest

from maskfab.base.processes import release_memory

# Small pieces are not given back by themselves as long as one that was allocated after them lives.
HELD = """
from pathlib import Path
from maskfab.base.processes import release_memory

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

pieces = [bytearray(50_000) for _ in range(2000)]
kept = pieces[::100]
del pieces
before = resident()
release_memory()
print(before - resident())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="its allocator alone is told to give back")
def test_what_is_free_goes_back_to_the_system():
    done = subprocess.run([sys.executable, "-c", HELD], capture_output=True, text=True, check=True)
    assert int(done.stdout) > 80_000_000


@pytest.mark.parametrize("system", ["darwin", "win32"])
def test_elsewhere_nothing_is_called(monkeypatch, system):
    monkeypatch.setattr("maskfab.base.processes.sys.platform", system)
    monkeypatch.setattr("maskfab.base.processes.ctypes.CDLL", None)
    release_memory()
