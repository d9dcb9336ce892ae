"""Files of very many polygons, no two alike: read in time and memory that grow as they do, or refused at once.

The files are written here byte by byte, for a million polygons in no time. What a command takes is that of its process
and of those that it starts, in seconds of the processor, which a busy machine does not change.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from klayout import db
from small_job import write_job
from sweeps import sweep

from maskfab.base.errors import SourceError
from maskfab.base.model import CLEAR
from maskfab.mask import layout as shape_limits
from maskfab.mask.formats.content import find_layer
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import count_shapes, region

FEW, VERY_MANY = 2_000, 240_000
MEGABYTE = 1_000_000


def steps(count: int) -> np.ndarray:
    """Corners of stairs of one step, int64 [polygon, vertex, axis] in nanometres; none of them congruent by intent."""
    side = int(np.ceil(np.sqrt(count)))
    pitch = 20_000_000 // side
    rng = np.random.default_rng(0)
    width, tread, low, rise = rng.integers(pitch // 8, pitch // 4, (4, count))
    x, y = (np.arange(count) % side) * pitch - 10_000_000, (np.arange(count) // side) * pitch - 10_000_000
    xs = np.stack([x, x, x + tread, x + tread, x + tread + width, x + tread + width], axis=1)
    ys = np.stack([y, y + low + rise, y + low + rise, y + low, y + low, y], axis=1)
    return np.stack([xs, ys], axis=2)


def area(corners: np.ndarray) -> int:
    """By the shoelace formula."""
    x, y = corners[..., 0], corners[..., 1]
    return int(np.abs((x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(axis=1)).sum()) // 2


def record(kind: int, body: bytes = b"") -> bytes:
    return (len(body) + 4).to_bytes(2, "big") + kind.to_bytes(2, "big") + body


def write_gds(path: Path, corners: np.ndarray, layer: int = 1) -> Path:
    """One cell TOP, user unit 1 um, database unit 1 nm, as of the GDSII stream format."""
    real = bytes.fromhex
    head = [
        record(0x0002, (600).to_bytes(2, "big")), record(0x0102, bytes(24)), record(0x0206, b"LIB\0"),
        record(0x0305, real("3e4189374bc6a7f0") + real("3944b82fa09b5a54")),
        record(0x0502, bytes(24)), record(0x0606, b"TOP\0"),
    ]  # fmt: skip
    before = record(0x0800) + record(0x0D02, layer.to_bytes(2, "big")) + record(0x0E02, bytes(2))
    count, vertices, _ = corners.shape
    body = 8 * (vertices + 1)
    before += (body + 4).to_bytes(2, "big") + (0x1003).to_bytes(2, "big")
    rows = np.empty((count, len(before) + body + 4), dtype=np.uint8)
    rows[:, : len(before)] = np.frombuffer(before, dtype=np.uint8)
    closed = np.concatenate([corners, corners[:, :1]], axis=1).astype(">i4")
    rows[:, len(before) : -4] = closed.reshape(count, -1).view(np.uint8).reshape(count, body)
    rows[:, -4:] = np.frombuffer(record(0x1100), dtype=np.uint8)
    path.write_bytes(b"".join(head) + rows.tobytes() + record(0x0700) + record(0x0400))
    return path


def write_oas(path: Path, corners: np.ndarray) -> Path:
    """The same, turned into OASIS by klayout."""
    write_gds(path.with_suffix(".gds"), corners)
    layout = db.Layout()
    layout.read(str(path.with_suffix(".gds")))
    layout.write(str(path))
    return path


WRITERS = {".gds": write_gds, ".oas": write_oas}


def verified(path: Path, job: Path) -> tuple[int, dict, float, float]:
    """Exit code, document, seconds of the processor and megabytes of `maskfab verify`."""
    words = [sys.executable, "-m", "maskfab", "verify", str(path), "--against", str(job), "--json", "--quiet"]
    alone = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=alone)
    assert process.stdout is not None
    with process.stdout:
        said = process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, json.loads(said), used.ru_utime + used.ru_stime, used.ru_maxrss / 1000


def seconds_of(work) -> float:
    """Of the processor, processes that were started and waited for included."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.process_time()
    work()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    started = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.process_time() - start + started


@pytest.mark.slow
def test_a_verdict_on_very_many_polygons_takes_what_a_million_can_afford(tmp_path):
    """One takes 60 us and 180 bytes of the peak; what the program itself takes, however small the file, counts besides.

    That includes the grid of the optics, which does not grow with the polygons, so that the smaller file must need one,
    too. The limits are 300 bytes and four times the time, for processors may share their caches with others.
    """
    job = write_job(tmp_path)
    write_gds(tmp_path / "few.gds", steps(FEW))
    write_gds(tmp_path / "many.gds", steps(VERY_MANY))
    _, _, idle_s, idle_mb = verified(tmp_path / "few.gds", job)
    code, document, took_s, took_mb = verified(tmp_path / "many.gds", job)
    assert (code, document["verdict"]) == (1, "fail")
    (lies,) = [row["value"] for row in document["quantities"] if row["name"] == "lies"]
    assert lies.startswith("unlike the design")
    more = VERY_MANY - FEW
    assert took_s - idle_s < 280e-6 * more
    assert took_mb - idle_mb < 300 / MEGABYTE * more


@pytest.mark.parametrize("suffix", sweep(WRITERS, 1))
def test_every_polygon_is_read_and_time_grows_no_faster_than_their_number(tmp_path, suffix):
    seconds = {}
    for count in (4_000, 24_000):
        corners = steps(count)
        path = WRITERS[suffix](tmp_path / f"{count}{suffix}", corners)
        read = read_layout(path)
        assert count_shapes(read) == count
        clear = region(read, find_layer(read))
        clear.merged_semantics = False
        assert clear.area() == area(corners)
        seconds[count] = seconds_of(lambda path=path: read_layout(path))
    assert seconds[24_000] < 6 * 1.8 * seconds[4_000]


def test_polygons_of_a_file_are_not_made_one_by_one(tmp_path):
    """What this process takes besides the one that reads, in units of what klayout takes to read the same file."""
    path = write_gds(tmp_path / "x.gds", steps(40_000))

    def seconds(work):
        start = time.process_time()
        work()
        return time.process_time() - start

    alone = min(seconds(lambda: db.Layout().read(str(path))) for _ in range(3))
    assert min(seconds(lambda: read_layout(path)) for _ in range(2)) < 17 * alone


def test_more_shapes_than_can_be_worked_with_are_refused_with_value_limit_and_cure(tmp_path, monkeypatch):
    path = write_gds(tmp_path / "x.gds", steps(2_000))
    monkeypatch.setattr(shape_limits, "MOST_SHAPES", 1_999)
    with pytest.raises(SourceError) as refusal:
        read_layout(path)
    assert refusal.value.code == "MF313"
    assert "2e+03 shapes" in refusal.value.what
    assert "the limit is 2e+03" in refusal.value.what
    assert refusal.value.cure


def test_what_is_read_in_parts_is_whole(tmp_path, monkeypatch):
    """However many polygons are turned at once: repeated vertices and empty ones of every part are counted."""
    from maskfab.mask.formats import content
    from maskfab.mask.layout import left_out

    corners = steps(100)
    corners[10, 1] = corners[10, 0]
    corners[60:62] = corners[60:62, :1]
    path = write_gds(tmp_path / "x.gds", corners)
    seen = []
    for at_once in (1, 7, 100, 1000):
        monkeypatch.setattr(content, "_AT_ONCE", at_once)
        read = read_layout(path)
        seen.append((count_shapes(read), region(read, CLEAR).area(), left_out(read)))
    assert len(set(seen)) == 1
    assert seen[0][0] == 98
    assert seen[0][2].empty_polygons == 2
    assert seen[0][2].repeated_vertices >= 1
