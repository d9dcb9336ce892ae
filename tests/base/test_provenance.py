"""What is on record of environments in which the bytes of shipped jobs were seen."""

from __future__ import annotations

import json
import re

from maskfab.base import __version__, resources
from maskfab.base.provenance import environments

RECORD = json.loads(resources.path("export_templates/environments.json").read_text("utf-8"))


def test_every_environment_gave_the_same_bytes_of_this_version():
    assert RECORD["maskfab"] == __version__
    every = list(RECORD["environments"].values())
    assert every
    assert len({json.dumps([seen["job"], seen["files"]], sort_keys=True) for seen in every}) == 1
    for seen in every:
        assert re.fullmatch(r"(\d+) of \1", seen["doctor"])
        assert seen["first_plate"] == "pass"
        assert "failed" not in seen["tests"]
        assert {len(digest) for digest in seen["files"].values()} == {64}


def test_a_report_names_the_environments_of_its_bytes():
    seen = RECORD["environments"]["lowest"]
    told = environments(seen["job"], __version__, list(seen["files"].values()))
    assert told is not None
    assert len(told) == len(RECORD["environments"])
    assert any(name.startswith(f"lowest (Python {seen['python']}, numpy {seen['packages']['numpy']}") for name in told)
    assert environments(seen["job"], __version__, ["0" * 64]) == ()
    assert environments("0" * 64, __version__, list(seen["files"].values())) is None
    assert environments(seen["job"], "0.0.1", list(seen["files"].values())) is None
