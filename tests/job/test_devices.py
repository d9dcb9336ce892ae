"""Devices: what was published answers a brief, and what was not is named, asked for and never filled in."""

from __future__ import annotations

import re

import pytest

import maskfab as mf
from maskfab.base.errors import JobError
from maskfab.job.brief import Brief
from maskfab.job.devices import devices


def refused(code, answers):
    with pytest.raises(JobError) as caught:
        Brief.of(answers)
    assert caught.value.code == code
    return str(caught.value)


@pytest.mark.parametrize("name", devices())
def test_every_number_has_its_page_and_the_day_on_which_it_was_read(name):
    device = devices()[name]
    assert re.fullmatch(r"20\d\d-\d\d-\d\d", device.day)
    assert "https://" in device.source
    assert device.dpi is not None
    assert {"focal length"} <= set(device.missing)
    assert name in str(mf.new.__doc__)


def test_a_device_answers_its_pitch_and_its_camera():
    brief = Brief.of({"device": "galaxy_z_fold_3", "camera": "2.4 mm"})
    assert brief.pitch == pytest.approx(25_400 / 94)
    assert (brief.camera.focal, brief.camera.f_number, brief.camera.pixel) == (2400, 1.8, 2)
    assert "Fold 3" in brief.camera.title


def test_answers_of_ones_own_stand_before_those_of_the_device():
    brief = Brief.of({"device": "axon_20", "camera": "3 mm f/2.2 1.12 um", "dpi": "300"})
    assert brief.pitch == pytest.approx(25_400 / 300)
    assert (brief.camera.focal, brief.camera.f_number) == (3000, 2.2)


@pytest.mark.parametrize("name", devices())
def test_what_is_not_published_is_asked_for_by_name_with_a_cure_that_works(name):
    said = refused("MF105", {"device": name})
    for words in ("focal length", "f-number", "camera's pixel"):
        assert (words in said) == (words in devices()[name].missing)
    answer = re.search(r"camera = '([^']+)'", said)
    assert answer is not None
    assert Brief.of({"device": name, "camera": answer[1]}).camera.focal == 2400


def test_a_device_that_is_not_listed_is_refused_with_the_nearest():
    assert "galaxy_z_fold_3" in refused("MF105", {"device": "galaxy z fold3"})


def test_a_job_begun_from_a_device_says_what_was_not_published(tmp_path):
    begun = mf.new(tmp_path / "mine", "axon_30", camera="2.4 mm")
    text = begun.job.read_text(encoding="utf-8")
    assert "# Not published: focal length" in text
    assert "slashgear.com" in text
    assert "maskfab design" in str(begun)
    assert 'pixel = "2.24 um"' in text
    with pytest.raises(JobError, match="no page tells the focal length"):
        mf.new(tmp_path / "other", "axon_30")
    assert not (tmp_path / "other").exists()
    with pytest.raises(JobError, match="states its camera"):
        mf.new(tmp_path / "other", "upc12", camera="2.4 mm")
