"""[report]: the reference and the frequencies of a report, and what they leave alone."""

from __future__ import annotations

import pytest
from small_job import write_job

from maskfab.base.errors import JobError
from maskfab.mask.job import load_job

END = ("seed = 3\n", 'seed = 3\n\n[report]\nreference = "TURNED"\nfrequencies = ["30 cy/mm", "250 lp/mm"]\n')


def test_a_report_section_is_read_and_changes_no_data(tmp_path):
    plain, stated = load_job(write_job(tmp_path / "a")), load_job(write_job(tmp_path / "b", END))
    assert stated.spec.report.reference == "TURNED"
    assert stated.spec.frequencies_cy_per_mm == (30.0, 250.0)
    assert plain.spec.frequencies_cy_per_mm == (25.0, 62.5, 125.0)
    assert plain.digest == stated.digest
    assert stated.spec.dump()["report"] == {"reference": "TURNED", "frequencies": ["30 cy/mm", "250 cy/mm"]}


@pytest.mark.parametrize(
    ("old", "new", "code", "said"),
    [
        ('"TURNED"\nfreq', '"NOBODY"\nfreq', "MF105", "Use one of PLAIN, TURNED"),
        ("250 lp/mm", "251 lp/mm", "MF104", "Use at most 250 cy/mm"),
        ("250 lp/mm", "250", "MF103", "cy/mm"),
        ("250 lp/mm", "250 mm", "MF103", "cy/mm"),
        ("30 cy/mm", "0 cy/mm", "MF104", "positive"),
        ("30 cy/mm", "inf cy/mm", "MF104", "positive"),
        ('["30 cy/mm", "250 lp/mm"]', "[]", "MF105", "report.frequencies"),
        ('["30 cy/mm"', '["1 cy/mm", "2 cy/mm", "3 cy/mm"', "MF105", "report.frequencies"),
    ],
)
def test_a_report_that_cannot_be_is_refused(tmp_path, old, new, code, said):
    with pytest.raises(JobError) as refusal:
        load_job(write_job(tmp_path, (END[0], END[1].replace(old, new))))
    assert refusal.value.code == code
    assert said in str(refusal.value)
