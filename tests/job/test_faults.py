"""Every fault of a job in one answer: what is told, what follows from another and is not, and the lines to write."""

from __future__ import annotations

import pickle
import re
import tomllib

import pytest

from maskfab.base.cell_size import MOST_CELLS
from maskfab.base.errors import AtFault, Faults, JobError, ManyFaultsError, MaskfabError, SourceError
from maskfab.job.grid import check_grid, nearest_grid
from maskfab.job.read import read, validate
from maskfab.mask.job import load_job

JOB = """
[job]
name = "TWO"
title = "TWO"
[camera]
focal = "4.5 mm"
stop = "f/1.8"
wavelengths = ["610 nm", "530 nm", "470 nm"]
pixel = "1.4 um"
window = "64 um"
[plate]
template = "5in"
die_size = "8.4 mm"
die_pitch = "22 mm"
columns = 2
[[die]]
name = "ONE"
label = "one"
opening = "one.toml"
dot = "8 um"
tiling = "periodic"
[[die]]
name = "OTHER"
label = "other"
opening = "other.toml"
dot = "8 um"
tiling = "random"
[emitters]
colour_gap = "8 um"
min_width = "8 um"
[exposure]
snr = [24]
"""


def faults_of(*edits: tuple[str, str]) -> dict[str, tuple[str, str]]:
    """Code and cure of every fault, by its key."""
    text = JOB
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    with pytest.raises(MaskfabError) as caught:
        validate(tomllib.loads(text), where="job.toml")
    return {fault.where.removeprefix("job.toml: "): (fault.code, fault.cure) for fault in caught.value.faults}


def test_faults_of_every_section_are_told_at_once_each_with_the_value_to_write():
    found = faults_of(
        ('focal = "4.5 mm"\nstop = "f/1.8"', 'focal_length = "4.5 mm"\nf_number = 1.8'),
        ('wavelengths = ["610 nm", "530 nm", "470 nm"]', 'wavelength = "530 nm"'),
        ('pixel = "1.4 um"', "pixel_size = 1.4"),
        ('dot = "8 um"', "dot = 8"),
        ('die_pitch = "22 mm"\n', ""),
        ("snr = [24]", "snr_db = [24]"),
        ('label = "other"\n', ""),
    )
    assert {key: cure for key, (_, cure) in found.items()} == {
        "camera.focal_length": 'Write focal = "4.5 mm"',
        "camera.f_number": 'Write stop = "f/1.8"',
        "camera.wavelength": 'Write wavelengths = ["530 nm"]',
        "camera.pixel_size": 'Write pixel = "1.4 um"',
        "die[0].dot": 'Write dot = "8 um", if that is its unit',
        "plate.die_pitch": 'Add die_pitch = "22 mm", say',
        "exposure.snr_db": "Write snr = [24]",
        "die[1].label": 'Add label = "T-OLED as it is", say',
    }


def test_checks_that_need_no_value_at_fault_are_made_beside_those_of_values():
    """A bad label, two dies of one name, and a stop that no lens has; and of the bad pixel nothing else."""
    found = faults_of(
        ('label = "one"', "label = 1"),
        ('name = "OTHER"', 'name = "one"'),
        ('stop = "f/1.8"', 'stop = "f/0.3"'),
        ('pixel = "1.4 um"', 'pixel = "-1 um"'),
        ("[exposure]", '[report]\nreference = "NONE"\n[exposure]'),
    )
    codes = {key: code for key, (code, _) in found.items()}
    assert codes == {
        "die[0].label": "MF105",
        "die": "MF109",
        "camera.stop": "MF131",
        "camera.pixel": "MF104",
        "report.reference": "MF105",
    }


def test_what_follows_from_a_fault_is_not_told_again():
    assert faults_of(('focal = "4.5 mm"', "focal = 4.5")).keys() == {"camera.focal"}  # nor f/1.8 of it
    assert faults_of(('dot = "8 um"', 'dot = "8.0004 um"')).keys() == {"die[0].dot"}
    assert faults_of(('tiling = "random"', 'tiling = "map"\nmaps = "m.toml"')).keys() == {"die[1].maps"}
    assert faults_of(("[emitters]", "[wires]\nlines = 0\n[emitter]")).keys() == {"wires.lines", "emitter"}


def test_files_of_dies_are_told_with_the_faults_of_keys_and_each_names_its_die(tmp_path):
    job = tmp_path / "job.toml"
    job.write_text(JOB.replace("columns = 2", "columns = 0"))
    seen = []
    with pytest.raises(ManyFaultsError) as caught:
        load_job(job, lambda made, faults: seen.append(made))
    assert [fault.code for fault in caught.value.faults] == ["MF104", "MF301", "MF301"]
    assert [re.findall("ONE|OTHER", fault.what) for fault in caught.value.faults] == [[], ["ONE"], ["OTHER"]]
    # A verb goes on with what is sound, and cannot read the rest.
    (made,) = seen
    assert made.spec.camera.pixel_um == 1.4
    with pytest.raises(AtFault):
        _ = made.spec.plate.columns
    with pytest.raises(AtFault):
        _ = made.openings["ONE"]


def test_several_faults_pass_between_processes_and_into_a_document():
    error = ManyFaultsError([JobError("MF104", "one", where="a: b", cure="c"), SourceError("MF301", "two")])
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.to_dict()) == (str(error), error.to_dict())
    assert [fault["code"] for fault in error.to_dict()["faults"]] == ["MF104", "MF301"]


def test_one_fault_is_told_as_itself_and_none_not_at_all():
    faults = Faults()
    faults.refuse()
    one = JobError("MF104", "one", where="a: b")
    with faults:
        raise one
    with pytest.raises(JobError) as caught:
        faults.refuse()
    assert caught.value is one
    assert one.to_dict()["faults"] == [{key: one.to_dict()[key] for key in ("code", "what", "where", "cure")}]


@pytest.mark.parametrize(
    ("stated", "um"),
    [('"f/1.8"', 2500.0), ('"F/ 1.73"', 2601.156), ('"2.5 mm"', 2500.0), ('{ diameter = "f/1.8" }', 2500.0)],
)
def test_a_stop_by_its_ratio_is_its_diameter_to_the_nanometre(stated, um):
    spec = validate(tomllib.loads(JOB.replace('"f/1.8"', stated)), where="job.toml")
    assert spec.camera.stop.diameter_um == um
    assert validate(spec.dump(), where="again") == spec


def test_a_job_for_a_later_version_is_refused_as_such_before_its_keys():
    later = 'maskfab = "99.1"\nnewer = 1\n' + JOB
    with pytest.raises(JobError, match=r"MF154 the job needs maskfab 99\.1 or later") as caught:
        validate(tomllib.loads(later), where="job.toml")
    assert caught.value.where == "job.toml: maskfab"
    spec = validate(tomllib.loads('maskfab = "0.1"\n' + JOB), where="job.toml")
    assert spec.dump() == validate(tomllib.loads(JOB), where="job.toml").dump()


def test_a_folder_in_place_of_a_job_is_told_with_the_job_in_it(tmp_path):
    (tmp_path / "job.toml").write_text(JOB)
    with pytest.raises(SourceError, match=r"MF301 .* is a folder.*job\.toml"):
        read(tmp_path)


@pytest.mark.parametrize(("pitch", "dots"), [(140.0, 21), (63.5, 20), (141.1, 21), (300.0, 21)])
def test_lengths_that_a_refusal_names_work_together(pitch, dots):
    """They are accepted as they are, and keep what the stated ones keep."""
    rules = {"gap_to_opening": 4.1, "colour_gap": 8.0, "min_width": 7.77}
    with pytest.raises(JobError) as caught:
        check_grid(pitch, dots, None, 0, rules, key="design", dots_given=False, where="")
    assert caught.value.code in {"MF106", "MF107", "MF118"}
    for line in caught.value.cure.removeprefix("These work together: ").split(", or "):
        found = {key: float(value) for key, value in re.findall(r'(\w+) = "?([\d.]+)', line)}
        moved = {key: found[key] for key in rules}
        check_grid(found["pitch"], int(found["dots"]), None, 0, moved, key="design", dots_given=False, where="")
        assert all(moved[key] >= rules[key] for key in rules)
        assert abs(found["pitch"] / pitch - 1) < 0.05


def test_a_pitch_off_its_grid_is_told_with_all_that_state_it_each_way_once():
    with pytest.raises(JobError) as caught:
        check_grid(
            141.1111111,
            24,
            None,
            0,
            {},
            key="design",
            dots_given=True,
            also=["[[die]] AS_IS", "[[die]] MADE"],
            where="",
        )
    assert caught.value.cure.count('pitch = "141.12 um"') == 1
    assert caught.value.cure.endswith("; the same pitch stands in [[die]] AS_IS and [[die]] MADE")


def test_lengths_that_share_a_grid_are_the_nearest_to_themselves():
    found = nearest_grid(168_000, (4000, 8000, 8000))
    assert (found.pitch_nm, found.rules_nm) == (168_000, (4000, 8000, 8000))
    assert found.pitch_nm // found.cell_nm <= MOST_CELLS
