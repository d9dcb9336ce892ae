"""A run of which one function is wrong: never a PASS, whatever room the fault is in."""

from __future__ import annotations

from dataclasses import replace
from pydoc import locate

import numpy as np
import pytest
from once import figures_in_words
from small_job import write_job

from maskfab.base.errors import MaskfabError
from maskfab.runs import pipeline

BIASED = '[process]\ncd_bias = "0.4 um"\n[order]\nbias = "data"\n'


def aside(mark, x=1, y=0):
    return replace(mark, polygons=tuple(tuple((px + x, py + y) for px, py in each) for each in mark.polygons))


def mirrored(mark):
    xs = [x for each in mark.polygons for x, _ in each]
    across = min(xs) + max(xs)
    return replace(mark, polygons=tuple(tuple((across - x, y) for x, y in reversed(each)) for each in mark.polygons))


def after(change):
    """A function whose answer is changed."""
    return lambda true: lambda *given, **named: change(true(*given, **named))


def flipped(count):
    def change(light):
        light = light.copy()
        light[5, 5 : 5 + count] ^= True
        return light

    return after(change)


def other_unit(content):
    return content.replace(b"\x3e\x41\x89\x37\x4b\xc6\xa7\xf0", b"\x3f\x41\x89\x37\x4b\xc6\xa7\xf0", 1)


def with_variable(name, value):
    def change(drawing):
        drawing.header[name] = value
        return drawing

    return after(change)


def further_line(true):
    return lambda name, title, lines, *rest: true(name, title, [*lines, "REV B"], *rest)


def exchanged(laid):
    one, other = laid.dies[0], laid.dies[-1]
    return replace(laid, dies=(replace(one, panel=other.panel), *laid.dies[1:-1], replace(other, panel=one.panel)))


def one_turned(panels_by_name):
    name, panel = next(iter(panels_by_name.items()))
    cells = panel.orientations.copy()
    cells[2, 3] = (cells[2, 3] + 1) % 8
    return {**panels_by_name, name: replace(panel, orientations=cells)}


def with_property(value):
    return lambda _: property(lambda spec: value)


FAULTS = {
    "one module of the code": ("maskfab.mask.marks.modules", flipped(1), ""),
    "three modules": ("maskfab.mask.marks.modules", flipped(3), ""),
    "seven modules": ("maskfab.mask.marks.modules", flipped(7), ""),
    "the code mirrored": ("maskfab.mask.marks.modules", after(np.fliplr), ""),
    "the code turned": ("maskfab.mask.marks.modules", after(np.rot90), ""),
    "the parity mark mirrored": ("maskfab.mask.composition.parity_mark", after(mirrored), ""),
    "a fiducial 1 nm aside": ("maskfab.mask.composition.fiducial", after(aside), ""),
    "crosses 1 nm up": ("maskfab.mask.composition.alignment_cross", after(lambda mark: aside(mark, 0, 1)), ""),
    "a further line in the title": ("maskfab.mask.composition.title_block", further_line, ""),
    "labels mirrored": ("maskfab.mask.composition.label", after(mirrored), ""),
    "the star 1 nm aside": ("maskfab.mask.composition.siemens_star", after(aside), ""),
    "panels of two dies exchanged": ("maskfab.runs.pipeline.plate_of", after(exchanged), ""),
    "one cell turned": ("maskfab.mask.composition.die_panels", after(one_turned), ""),
    "tone of the job": ("maskfab.job.sections.JobSpec.tone", with_property("dark"), ""),
    "parity of the job": ("maskfab.job.sections.JobSpec.mirrored", with_property(True), ""),
    "sign of the bias": ("maskfab.job.sections.JobSpec.data_bias_nm", with_property(-400), BIASED),
    "opening upside down": (
        "maskfab.mask.opening_file.parse_opening", after(lambda held: replace(held, mask=held.mask[::-1])), ""
    ),
    "hash of the job": ("maskfab.base.provenance.job_hash", after(lambda digest: digest[::-1]), ""),
    "hashes of files": ("maskfab.base.provenance.sha256_of_file", after(lambda digest: digest[::-1]), ""),
    "the job's copy": (
        "maskfab.runs.plate_files.job_text", after(lambda text: text.replace('"seed": 3', '"seed": 4')), ""
    ),
    "user unit of GDSII": ("maskfab.mask.formats.gdsii.layout_bytes", after(other_unit), ""),
    "measurement of DXF": ("maskfab.mask.formats.dxf_writer._blank_drawing", with_variable("$MEASUREMENT", 0), ""),
    "the judge gives no rows": ("maskfab.mask.comparison.files.judged", lambda _: lambda *_: (), ""),
    "the judge sees no dies": (
        "maskfab.mask.judge.verdict._die_row", lambda row: lambda die, left, name: row(die, left.none(), name), ""
    ),
    "the judge sees no marks": ("maskfab.mask.judge.verdict._wrong_marks", lambda _: lambda *_: iter(()), ""),
    "the judge cannot read": ("maskfab.mask.judge.verdict._misread", lambda _: lambda *_: "", ""),
    "rows of dies are left out": (
        "maskfab.runs.result.die_quantities",
        after(lambda rows: tuple(row for row in rows if row.name != "judged_die")), "",
    ),
    "a check has no verdict": (
        "maskfab.runs.result.die_quantities",
        after(lambda rows: tuple(replace(row, passed=None, limit=None) for row in rows)), "",
    ),
}  # fmt: skip
OFTEN = {"three modules", "parity of the job", "user unit of GDSII"}


def sabotaged(monkeypatch, where, wrong):
    owner, _, name = where.rpartition(".")
    monkeypatch.setattr(where, wrong(getattr(locate(owner), name)))


@pytest.mark.parametrize(
    "what", [each if each in OFTEN else pytest.param(each, marks=pytest.mark.slow) for each in FAULTS]
)
def test_a_run_with_one_fault_never_passes(what, monkeypatch, tmp_path):
    where, wrong, more = FAULTS[what]
    job = write_job(
        tmp_path, ('blank = "27 mm"\nwritable = "22 mm"', 'template = "5in"'), ("[[die]]", f"{more}\n[[die]]")
    )
    sabotaged(monkeypatch, where, wrong)
    with figures_in_words():
        try:
            made = pipeline.run(job, tmp_path / "out")
        except MaskfabError:
            assert not (tmp_path / "out").exists()
            return
    assert not made.verdicts.files.passed
