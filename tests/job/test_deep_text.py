"""Text that is nested deeper, or counts further, than a parser can follow is refused as any other that is wrong."""

from __future__ import annotations

import json
import shutil

import pytest
from small_job import write_job

from maskfab.base.errors import InputError, OutputError
from maskfab.mask import opening_file, panels
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.mask.marks import load_template
from maskfab.runs.verification import verify

DEPTH = 100_000
READERS = {
    "job.toml": load_job,
    "job.json": load_job,
    "map.toml": panels.read_map,
    "opening.toml": opening_file.load_opening,
    "template.toml": load_template,
    "shop.toml": lambda path: load_shop(str(path)),
}


@pytest.mark.parametrize("value", ["[" * DEPTH + "]" * DEPTH, "9" * DEPTH], ids=["nested", "long"])
@pytest.mark.parametrize("name", READERS)
def test_what_no_parser_can_follow_is_refused(tmp_path, name, value):
    write_job(tmp_path)
    path = tmp_path / name
    path.write_text(f'{{"job": {value}}}' if path.suffix == ".json" else f"name = {value}\n", encoding="utf-8")
    with pytest.raises(InputError) as refusal:
        READERS[name](path)
    assert refusal.value.code in {"MF101", "MF124", "MF303", "MF421"}
    assert len(str(refusal.value)) < 1000


def test_a_deeply_nested_manifest_is_no_result(small_result, tmp_path):
    out = shutil.copytree(small_result, tmp_path / "out")
    manifest = out / "manifest.json"
    assert json.loads(manifest.read_text(encoding="utf-8"))
    manifest.write_text("[" * DEPTH, encoding="utf-8")
    with pytest.raises(OutputError, match="MF403"):
        verify(out)
