"""The measurement beside a job: in the report of its die, kept with the result, and refused if it is none."""

from __future__ import annotations

import json

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from once import figures_in_words
from small_job import command, write_job

from maskfab.base.errors import SourceError
from maskfab.mask.job import load_job
from maskfab.report.documents.die import MeasuredPart, measured_beside

RINGS = np.linspace(5.0, 245.0, 49)
MARKUP = "<script>alert('x')</script>"


def told(job, **other) -> dict:
    """As maskfab measure writes it: captured below what was expected from 100 cycles per millimetre on."""
    least = np.exp(-RINGS / 60)

    def curve(values):
        return {"mean": (2 * values).tolist(), "minimum": values.tolist()}

    band = {
        "colour": "grey", "frequency_per_mm": RINGS.tolist(), "parted_per_mm": 100.0,
        "captured": curve(np.where(RINGS < 100, least, 0.5 * least)), "expected": curve(least),
        "low": curve(0.9 * least), "high": curve(1.1 * least),
    }  # fmt: skip
    found = {
        "job_hash": job.digest,
        "die": "TURNED",
        "verdict": {"answer": "ACCEPT", "reason": f"Found. {MARKUP}"},
        "sentences": [],
        "mtf": [band],
        "hypotheses": {},
    }
    return found | other


@pytest.fixture
def place(tmp_path):
    """A job's file, and what writes the measurement beside it."""
    path = write_job(tmp_path, ("[plate]", '[export]\nformats = ["gdsii"]\n\n[plate]'))

    def write(content) -> None:
        text = content if isinstance(content, str) else json.dumps(content)
        (tmp_path / "measure.json").write_text(text, encoding="utf-8")

    return path, write


def test_a_measurement_stands_in_the_report_of_its_die_and_is_verified(capsys, place, tmp_path):
    path, write = place
    write(told(load_job(path)))
    with figures_in_words():
        answer = command(capsys, "run", path, "--out", tmp_path / "out", "--quiet", "--no-cache")
        assert answer.code == 0, answer.stderr
        document = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
        plain, turned = document["dies"]
        assert "measured" not in plain
        Draft202012Validator(MeasuredPart.schema_document()).validate(turned["measured"])
        rows = {row["frequency_cy_per_mm"]: row for row in turned["measured"]["mtf"]}
        assert list(rows) == [25.0, 62.5, 125.0]
        assert rows[25.0]["captured"] == pytest.approx(np.exp(-25 / 60), rel=1e-3)
        page = (tmp_path / "out" / "appendix.html").read_text(encoding="utf-8")
        assert MARKUP not in page
        section = page[page.index("Measured beside predicted") :]
        assert section[: section.index("</table>")].count("✓ yes") == 2
        assert section[: section.index("</table>")].count("✗ no") == 1
        kept = tmp_path / "out" / "measure.json"
        assert kept.read_bytes() == (tmp_path / "measure.json").read_bytes()
        (tmp_path / "measure.json").unlink()
        assert command(capsys, "verify", tmp_path / "out", "--quiet").code == 0
        kept.write_text("{", encoding="utf-8")
        answer = command(capsys, "verify", tmp_path / "out", "--quiet")
    assert answer.code == 1
    assert "readable = failed" in answer.stderr


@pytest.mark.parametrize(
    ("other", "note"),
    [
        ({"job_hash": "0" * 64}, ["it is of another job"]),
        ({"die": None}, ["it could not tell which die it is of"]),
        ({}, []),
    ],
)
def test_a_measurement_that_is_left_out_is_noted(place, other, note):
    path, write = place
    job = load_job(path)
    write(told(job, **other))
    found = measured_beside(job)
    assert [each.value for each in found.note(job.digest)] == note
    assert (found.of_die("TURNED", job.digest) is None) == bool(note)
    assert found.of_die("PLAIN", job.digest) is None


@pytest.mark.parametrize(
    "content",
    [
        "", "[]", "{", "[" * 100_000, '{"hypotheses": {}}',
        '{"hypotheses": {}, "job_hash": "a", "die": "A", "verdict": [], "mtf": [{}]}',
    ],
)  # fmt: skip
def test_what_is_no_measurement_is_refused_before_any_work(place, content):
    path, write = place
    write(content)
    with pytest.raises(SourceError) as refusal:
        measured_beside(load_job(path))
    assert refusal.value.code == "MF303"
    assert len(str(refusal.value)) < 1000


@pytest.mark.parametrize(("key", "value"), [("captured", [0.5]), ("frequency_per_mm", [5.0] * 49)])
def test_curves_that_do_not_go_together_are_refused(place, key, value):
    path, write = place
    job = load_job(path)
    document = told(job)
    document["mtf"][0][key] = value if key == "frequency_per_mm" else {"minimum": value}
    write(document)
    with pytest.raises(SourceError, match="MF303"):
        measured_beside(job)


def test_no_file_and_the_measurement_of_an_edge_are_nothing(place):
    path, write = place
    job = load_job(path)
    assert measured_beside(job) is None
    write({"regions": []})
    assert measured_beside(job) is None
