"""The job file as a validated spec: defaults, what round-trips, and what no section alone can tell."""

from __future__ import annotations

import json
import tomllib
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import pytest
from small_job import JOB, write_job

from maskfab.api.lengths import lengths_as_text
from maskfab.base import resources
from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import Tiling
from maskfab.job.camera import Camera, Stop
from maskfab.job.die import check_optics, even_nm
from maskfab.job.faults import parse_section
from maskfab.job.process import Process
from maskfab.job.read import read, validate
from maskfab.job.sections import EmittersSection, SceneSection
from maskfab.job.values import check_name

SHIPPED = sorted(resources.path("layouts").glob("*.toml"))
CAMERA = Camera(5000.0, Stop("circle", 400.0), (530.0,), 2.0, 64.0)


def spec_of(text: str = JOB):
    return validate(tomllib.loads(text), where="job.toml")


def refused(code: str, text: str) -> JobError:
    with pytest.raises(JobError) as caught:
        spec_of(text)
    assert caught.value.code == code, str(caught.value)
    return caught.value


def test_a_job_is_read_in_micrometres_and_nanometres():
    spec = spec_of()
    assert spec.camera == CAMERA
    assert spec.plate.blank == 27_000
    assert (spec.die[0].dot, spec.die[0].pitch, spec.die[0].gutter) == (8.0, 56.0, 0.0)
    assert [die.tiling for die in spec.die] == [Tiling.PERIODIC, Tiling.RANDOM]
    assert [die.seed for die in spec.die] == [None, 3]
    assert spec.limits.min_feature is None
    assert spec.design is None


def test_defaults():
    assert spec_of(JOB.replace('window = "64 um"', 'window = "256 um"')).camera.window_um == 256
    assert spec_of(JOB.replace('shape = "circle", ', "")).camera.stop.shape == "circle"
    without = JOB.replace('window = "64 um"\n', "")
    assert spec_of(without).camera.window_um == 256


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_spec_survives_being_dumped(path):
    spec = read(path)
    dumped = spec.dump()
    again = validate(json.loads(json.dumps(dumped)), where="again")
    assert again == spec
    assert again.dump() == dumped


@pytest.mark.parametrize("text", ["0.1 um", "1e-9 m", "84.665 um", "123.456789 mm", "0.333333333333333 mm"])
def test_a_length_survives_being_dumped(text):
    spec = spec_of(JOB.replace('die_size = "560 um"', f'die_size = "{text}"'))
    again = validate(spec.dump(), where="again")
    assert again.plate.die_size == spec.plate.die_size


def test_a_pitch_in_dpi_survives_being_dumped():
    spec = spec_of(JOB.replace('pitch = "56 um"', 'pitch = "300 dpi"'))
    assert spec.die[0].pitch == pytest.approx(25400 / 300, rel=1e-14)
    assert validate(spec.dump(), where="again") == spec


def test_a_spec_cannot_be_changed():
    spec = spec_of()
    with pytest.raises(ValueError, match="frozen"):
        spec.plate = None
    with pytest.raises(FrozenInstanceError):
        spec.camera.focal_um = 1.0


def test_an_unknown_key_is_told_before_the_one_it_stands_for():
    error = refused("MF102", JOB.replace("columns = 2", "colums = 2"))
    assert error.where == "job.toml: plate.colums"
    assert error.cure == "Write columns = 2"


def test_one_wrong_item_of_a_list_is_one_problem():
    error = refused("MF112", JOB.replace('["530 nm"]', '["530 nm", "100 nm"]'))
    assert error.where == "job.toml: camera.wavelengths[1]"


def test_braces_of_a_value_stand_in_the_message_as_written():
    error = refused("MF103", JOB.replace('focal = "5 mm"', 'focal = "{x} | {}"'))
    assert error.what == "camera.focal = '{x} | {}' is not a number with a unit"
    assert error.cure.startswith("Write it as")
    assert error.where == "job.toml: camera.focal"


@pytest.mark.parametrize("kind", ["[]", "3", "null", '"text"'])
def test_a_document_of_another_kind_is_refused(kind):
    with pytest.raises(JobError) as caught:
        validate(json.loads(kind), where="job.json")
    assert caught.value.code == "MF105"
    assert caught.value.where == "job.json: the file"


@pytest.mark.parametrize("name", ["A", "TOLED_P150", "x" * 24, "a1_", "ring"])
def test_names_that_mask_houses_take(name):
    assert check_name(name) == name


@pytest.mark.parametrize("name", ["", "1A", "_A", "A B", "A-B", "Ä", "A\n", "x" * 25, "MAIN", "domain", "A$", "A.B"])
def test_names_that_mask_houses_refuse(name):
    with pytest.raises(JobError, match="MF110"):
        check_name(name)


def test_the_window_may_be_as_wide_as_the_alias_free_range_and_no_wider():
    limit = 0.530 * 5000 / 8
    check_optics(with_(window_um=limit), 8.0, where="here")
    with pytest.raises(JobError, match=r"MF113 .*λf/dot = 331\.2 um at 530 nm"):
        check_optics(with_(window_um=limit * (1 + 1e-9)), 8.0, where="here")


def test_the_shortest_wavelength_limits_the_window():
    with pytest.raises(JobError, match=r"at 470 nm .* at most 293\.7 um"):
        check_optics(with_(wavelengths_nm=(610.0, 470.0, 530.0), window_um=300.0), 8.0, where="here")


def test_what_would_take_all_memory_is_refused():
    check_optics(with_(stop=Stop("circle", 6000.0)), 1.0, where="here")
    with pytest.raises(JobError, match=r"MF115 .* 6001 dots of 1 um"):
        check_optics(with_(stop=Stop("circle", 6001.0)), 1.0, where="here")
    check_optics(with_(pixel_um=0.05, window_um=102.4), 8.0, where="here")
    with pytest.raises(JobError, match=r"MF115 .* 4100 samples"):
        check_optics(with_(pixel_um=0.05, window_um=102.5), 8.0, where="here")
    # The samples of a wide stop are finer than half a pixel.
    with pytest.raises(JobError, match="MF115"):
        check_optics(with_(focal_um=600.0, stop=Stop("circle", 40_000.0), window_um=20.0), 10.0, where="here")


def with_(**changes) -> Camera:
    return replace(CAMERA, **changes)


def test_half_a_gutter_lies_on_the_grid():
    assert even_nm(8.0, where="", name="gutter") == 8000
    assert even_nm(0.0, where="", name="gutter") == 0
    with pytest.raises(JobError, match=r"MF107 gutter 0\.003 um is an odd number"):
        even_nm(0.003, where="", name="gutter")


def test_one_section_may_come_from_elsewhere():
    values = {"focal": "5 mm", "stop": {"diameter": "400 um"}, "wavelengths": ["530 nm"], "pixel": "2 um"}
    assert parse_section(Camera, values, where="here") == with_(window_um=256.0)
    with pytest.raises(JobError, match=r"MF103 .*here: pixel"):
        parse_section(Camera, values | {"pixel": "2"}, where="here")


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_files_of_any_editor_are_read(tmp_path: Path, line_end, mark):
    job = write_job(tmp_path)
    job.write_bytes((mark + JOB.replace("\n", line_end)).encode())
    assert read(job) == spec_of()


# --- [export] and [process] ------------------------------------------------------------------------------------------


def with_export(text: str) -> str:
    return f"{JOB}\n[export]\n{text}\n"


def with_process(text: str) -> str:
    return f"{JOB}\n[process]\n{text}\n"


def test_who_names_no_file_learns_where_jobs_to_start_from_lie(tmp_path: Path):
    """Beside an installed package there is no layouts/."""
    with pytest.raises(SourceError, match="MF301") as refused:
        read(tmp_path / "layouts" / "upc12.toml")
    shipped = Path(refused.value.cure.rpartition(" in ")[2])
    assert read(shipped / "upc12.toml").job.name == read(resources.path("layouts/upc12.toml")).job.name


def test_a_job_without_export_or_process_says_nothing_of_them():
    spec = spec_of()
    assert (spec.export, spec.process) == (None, None)
    assert not {"export", "process"} & spec.dump().keys()
    assert spec_of(with_export("")).export.formats == ("gdsii", "oasis", "dxf_r12", "dxf_r2010")
    assert spec_of(with_process("")).written == Process(0.0, 0.0)


ALL_FORMATS = (
    'formats = ["oasis", "gdsii", "dxf_r12", "dxf_r2010", "gerber", "cif", "svg", "step", "glb", "3mf", "stl", "png", '
    '"tiff"]'
)


@pytest.mark.parametrize(
    "text",
    [
        with_export(ALL_FORMATS),
        with_export('formats = ["cif"]'),
        with_export('formats = ["dxf_r12"]\nshop = "pog"\nchrome = "80 nm"\nmax_references = 7\nstl_limit_mb = 0.5'),
        with_process('corner_radius = "0.5 um"\ncd_bias = "-0.1 um"'),
        with_process('cd_bias = "1 nm"'),
        with_process('roughness = { sigma = "50 nm", correlation = "0.5 um" }'),
    ],
)
def test_export_and_process_survive_being_dumped(text):
    spec = spec_of(text)
    assert validate(json.loads(json.dumps(spec.dump())), where="again") == spec


@pytest.mark.parametrize("first", ["gerber", "svg", "step", "glb", "3mf", "stl", "png", "tiff"])
def test_the_first_format_must_be_a_layout(first):
    error = refused("MF105", with_export(f'formats = ["{first}", "gdsii"]'))
    assert f"{first} cannot be measured" in error.what
    assert error.where == "job.toml: export.formats"
    assert "gdsii" in error.cure


def test_a_format_is_named_once():
    error = refused("MF105", with_export('formats = ["gdsii", "svg", "gdsii"]'))
    assert "twice" in error.what
    assert error.where == "job.toml: export.formats"


@pytest.mark.parametrize(
    ("text", "code", "key"),
    [
        ('formats = ["gdsii", "dwg"]', "MF105", "export.formats[1]"),
        ('formats = ["GDSII"]', "MF105", "export.formats[0]"),
        ("formats = []", "MF105", "export.formats"),
        ('formats = "gdsii"', "MF105", "export.formats"),
        ("stl_limit_mb = 0", "MF104", "export.stl_limit_mb"),
        ("stl_limit_mb = 10001", "MF104", "export.stl_limit_mb"),
        ("stl_limit_mb = nan", "MF104", "export.stl_limit_mb"),
        ("stl_limit_mb = inf", "MF104", "export.stl_limit_mb"),
        ('stl_limit_mb = "1 MB"', "MF105", "export.stl_limit_mb"),
        ("max_vertices = 3", "MF104", "export.max_vertices"),
        ("max_vertices = 4095", "MF104", "export.max_vertices"),
        ("max_references = 0", "MF104", "export.max_references"),
        ("dots_per_um = 0", "MF104", "export.dots_per_um"),
        ("dots_per_um = inf", "MF104", "export.dots_per_um"),
        ('chrome = "0 um"', "MF104", "export.chrome"),
        ('chrome = "100"', "MF103", "export.chrome"),
        ("exaggeration = 0.5", "MF104", "export.exaggeration"),
        ('holes = "layer"', "MF105", "export.holes"),
        ('hierarchy = "deep"', "MF105", "export.hierarchy"),
        ("shop = 3", "MF105", "export.shop"),
        ("shops = 3", "MF102", "export.shops"),
    ],
)
def test_what_export_refuses(text, code, key):
    assert refused(code, with_export(text)).where == f"job.toml: {key}"


@pytest.mark.parametrize(
    ("text", "um"),
    [
        ('"-0.1 um"', -0.1),
        ('" - 100 nm "', -0.1),
        ('"0.1 um"', 0.1),
        ('"0 um"', 0.0),
        ('"-0 um"', 0.0),
        ('"-1e-3 mm"', -1.0),
    ],
)
def test_a_bias_has_a_sign(text, um):
    spec = spec_of(with_process(f"cd_bias = {text}"))
    assert spec.written.cd_bias_um == pytest.approx(um, abs=1e-15)
    again = validate(spec.dump(), where="again")
    assert again == spec


@pytest.mark.parametrize(
    ("text", "code", "key"),
    [
        ('corner_radius = "-1 um"', "MF104", "process.corner_radius"),
        ('corner_radius = "1"', "MF103", "process.corner_radius"),
        ("corner_radius = 1.0", "MF103", "process.corner_radius"),
        ('cd_bias = "--1 um"', "MF104", "process.cd_bias"),
        ('cd_bias = "-"', "MF103", "process.cd_bias"),
        ('cd_bias = "-0.1"', "MF103", "process.cd_bias"),
        ('cd_bias = "+-1 um"', "MF103", "process.cd_bias"),
        ("cd_bias = -0.1", "MF103", "process.cd_bias"),
        ('cd_bias = "-inf um"', "MF104", "process.cd_bias"),
        ('spot = "1 um"', "MF102", "process.spot"),
    ],
)
def test_what_process_refuses(text, code, key):
    """What was written is told, its sign included."""
    if (stated := text.partition('"')[2].rstrip('"')) and code != "MF102":
        assert repr(stated) in refused(code, with_process(text)).what
    assert refused(code, with_process(text)).where == f"job.toml: {key}"


@pytest.mark.parametrize("section", [EmittersSection, SceneSection])
def test_numbers_are_lengths_of_the_keys_that_read_a_length_and_of_no_other(section):
    whole = {"colour_gap": "8 um", "min_width": "8 um"} if section is EmittersSection else {}

    def reads_a_length(key: str) -> bool:
        try:
            return getattr(parse_section(section, {**whole, key: "20 um"}, where="x"), key) == 20.0
        except JobError:
            return False

    keys = {key for key in section.model_fields if reads_a_length(key)}
    assert len(keys) == 3
    assert lengths_as_text(dict.fromkeys(section.model_fields, 20), section) == {
        key: "20 um" if key in keys else 20 for key in section.model_fields
    }


@pytest.mark.parametrize(
    ("code", "where", "table"),
    [
        ("MF102", "sensor.full_well_um", {"sensor": {"full_well_um": 3.0}}),
        ("MF102", "camera.focal_um", {"camera": {"focal_um": "10 mm"}}),
        ("MF104", "sensor.read_noise", {"sensor": {"read_noise": -1.0}}),
        ("MF105", "sensor.bits", {"sensor": {"bits": "12"}}),
        ("MF105", "sensor", {"sensor": 12}),
        ("MF140", "sensor", {"sensor": {"bits": 8, "black_level": 255}}),
        ("MF103", "process.roughness.sigma", {"process": {"roughness": {"sigma": 0.06, "correlation": "1 um"}}}),
        ("MF105", "process.roughness.correlation", {"process": {"roughness": {"sigma": "60 nm"}}}),
        ("MF105", "plate", {"plate": {"film_phase": 0.5}}),
    ],
)
def test_a_table_that_the_optics_take_as_it_is_is_refused_as_any_other(code, where, table):
    values = tomllib.loads(JOB)
    for name, stated in table.items():
        values[name] = {**values.get(name, {}), **stated} if isinstance(stated, dict) else stated
    with pytest.raises(JobError) as refused:
        validate(values, where="job.toml")
    assert (refused.value.code, refused.value.where) == (code, f"job.toml: {where}")


def test_a_table_that_the_optics_take_is_made_from_plain_numbers_and_from_a_job_alike():
    values = {"focal": "10 mm", "pixel": "2 um", "wavelengths": ["530 nm"], "stop": {"diameter": "4 mm"}}
    camera = Camera(10_000.0, Stop("circle", 4000.0), (530.0,), 2.0)
    assert parse_section(Camera, values, where="here") == camera
    assert parse_section(Camera, camera.model_dump(mode="json"), where="here") == camera
