"""Functions that give a quantity, found in the code: none is lost, and each registered name has one."""

import pytest

import maskfab as mf
from maskfab.base.errors import JobError
from maskfab.base.makers import guards, makers
from maskfab.base.quantities import registered


def test_a_number_leads_to_its_function_its_formula_and_its_tests() -> None:
    found = {maker.function: maker for maker in makers("peak_strehl", "peak_strehl")}
    maker = found["optics.metrics.strehl_quantities"]
    assert "square of the open" in maker.formula
    assert maker.place.startswith("maskfab/optics/metrics.py:")
    assert any(test.startswith("tests/optics/") for test in guards("peak_strehl", maker))


def test_a_member_of_a_family_is_found_by_its_form() -> None:
    family = registered("mtf50").name
    assert "optics.metrics.falls_to" in {maker.function for maker in makers("mtf50", family)}


@pytest.mark.parametrize(
    ("name", "room"),
    [
        ("open_ratio", "findings"),
        ("halo_energy", "optics"),
        ("border_delta_e_step", "display"),
        ("restored_psnr", "findings"),
        ("judged_die", "mask"),
    ],
)
def test_quantities_are_found_in_their_rooms(name: str, room: str) -> None:
    assert any(maker.function.startswith(room) for maker in makers(name, name))


def test_explain_tells_sources_of_numbers_and_codes_and_refuses_others() -> None:
    answer = mf.explain("MF141", source=True)
    assert "camera.sensor.check" in str(answer)
    assert answer.to_dict()["makers"]
    with pytest.raises(JobError, match=r"MF105.*no quantity and no code"):
        mf.explain("camera.stop", source=True)
    for asked in ({}, {"schema": "job"}):
        with pytest.raises(JobError, match=r"MF105.*is named"):
            mf.explain(source=True, **asked)


def test_tests_that_lie_beside_an_installed_package_are_not_taken_for_its_own(monkeypatch, tmp_path) -> None:
    (maker,) = (each for each in makers("peak_strehl", "peak_strehl") if each.function.endswith("strehl_quantities"))
    assert guards("peak_strehl", maker)
    monkeypatch.setattr("maskfab.base.makers.PACKAGE", tmp_path / "maskfab")
    assert guards("peak_strehl", maker) == ()
