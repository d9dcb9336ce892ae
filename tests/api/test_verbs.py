"""Every verb of the command line is a function of the same name that does the same."""

from __future__ import annotations

import ast
import inspect
import json

import numpy as np
import pytest
from once import leaves
from small_job import OPENING, command, write_job

import maskfab as mf
from maskfab.api.camera import protocol_f1
from maskfab.base.errors import JobError, OutputError
from maskfab.cli.command import place_of
from maskfab.cli.program import VERBS
from maskfab.mask.formats.exr import write_png

EMITTERS = """
[emitters]
colour_gap = "8 um"
min_width = "8 um"
"""
LOOK = {"stop": "400 um", "pixel": "2 um", "window": "64 um"}


@pytest.fixture(scope="module")
def ring(tmp_path_factory) -> mf.Opening:
    file = tmp_path_factory.mktemp("opening") / "ring.toml"
    file.write_text(OPENING)
    return mf.read_opening(file)


@pytest.fixture(scope="module")
def plate(ring) -> mf.Plate:
    panels = {
        "PLAIN": mf.Panel.tile(ring, size="560 um"),
        "TURNED": mf.Panel.tile(ring, "random", seed=3, size="560 um"),
    }
    return mf.Plate.of(
        panels,
        blank="27 mm",
        writable="22 mm",
        camera=mf.Camera("5 mm", wavelengths=["530 nm"], **LOOK),
        sections={
            "emitters": {"colour_gap": "8 um", "min_width": "8 um"},
            "scene": {"gap": "0.1 mm", "accuracy": "draft"},
        },
    )


def test_every_verb_of_the_command_line_is_a_function():
    for verb in VERBS:
        module, name = place_of(verb)
        function = getattr(mf.order if verb.startswith("order ") else mf, name)
        assert (function.__module__, function.__name__) == (module, name)
        assert inspect.signature(function).parameters


def test_public_names_are_few_and_documented():
    verbs = {verb.removeprefix("self ").partition(" ")[0] for verb in VERBS}
    assert len(set(mf.__all__) - verbs) <= 17
    for name in mf.__all__:
        if name != "__version__":
            assert inspect.getdoc(getattr(mf, name)), name


@pytest.mark.parametrize("optics", [True, False])
def test_a_verb_of_a_plate_says_what_the_command_says_of_its_job(plate, tmp_path, capsys, optics):
    """The plate's job, written out, goes through the command."""
    job = tmp_path / "job.json"
    job.write_text(json.dumps(plate.job().spec.dump()))
    found = mf.check(plate, die="TURNED", **({"optics": True} if optics else {}))
    words = ("check", job, "--die", "TURNED", *(["--optics"] if optics else []))
    assert command(capsys, *words, "--json").document == json.loads(json.dumps(found.to_dict()))
    assert command(capsys, *words).stdout.rstrip("\n") == str(found)
    assert found["TURNED"] is not None


def test_a_rendering_has_numbers_by_die_and_a_picture(plate):
    told = []
    asked = {"look": True, "die": "PLAIN", "pixels": 8, "samples": 3}
    found = mf.check(plate, **asked, progress=lambda *said: told.append(said))
    assert list(found.panels) == ["PLAIN"]
    assert {count for stage, _, count in told if stage == "emitters"} == {1}, "no other die is worked on"
    assert found["PLAIN"].names == tuple(dict.fromkeys(row["name"] for row in found.to_dict()["dies"][0]["quantities"]))
    assert found.picture().startswith(b"\x89PNG")
    assert str(found).startswith("PLAIN\nquantity")


def test_a_simulation_prints_gains_and_keeps_no_pictures_if_asked(tmp_path):
    dots = np.zeros((21, 21), dtype=bool)
    dots[5:16, 5:16] = True
    small, large = (
        mf.Opening.of(mask, pitch="168 um", name=name) for mask, name in ((dots, "small"), (~dots, "large"))
    )
    panels = {each.name.upper(): mf.Panel.tile(each, "random", seed=1, size="4.2 mm") for each in (small, large)}
    write_png(leaves(3, 832, 832).values, tmp_path / "leaves.png", white=1.0)
    found = mf.simulate(mf.Plate.of(panels), images=tmp_path, reference="SMALL", pictures=False)
    gains = {gain.level_db: gain.psnr for gain in found.table.gains("SMALL")}
    assert set(gains) == {24, 32, 40}
    assert "gain over SMALL" in str(found)
    assert len(found.to_dict()["scores"]) == 6
    with pytest.raises(JobError, match="MF105 no pictures were kept"):
        found.picture()


def test_an_analysis_of_an_opening_is_that_of_its_file(ring, tmp_path, capsys):
    camera = mf.Camera("5 mm", wavelengths=530, **LOOK)
    found = mf.analyse(ring, camera, tiling="random", seed=3)
    file = ring.save(tmp_path / "ring.toml")
    look = '{ stop = { diameter = "400 um" }, focal = "5 mm", wavelengths = ["530 nm"], window = "64 um" }'
    said = command(capsys, "analyse", file, "--tiling", "random", "--seed", 3, "--camera", look, "--quiet", "--json")
    assert said.document == json.loads(json.dumps(found.to_dict()))
    assert found["auc_radial_min", 530].value == found.numbers["auc_radial_min"].value
    assert found.passed


def test_shapes_have_the_names_that_the_command_knows(tmp_path, capsys):
    own = mf.Opening.shape("rgb-stripe", name="drawn")
    assert own.emitters is not None
    assert command(capsys, "new", tmp_path / "drawn.toml", "--shape", "rgb-stripe").code == 0
    assert np.array_equal(mf.read_opening(tmp_path / "drawn.toml").mask, own.mask)
    assert {"stripe", "blobs", "diamond-discs", "rgb-stripe"} <= set(mf.shapes())


def test_shops_judge_a_plate_and_a_package_is_sent_only_if_they_take_it(plate, tmp_path):
    assert {shop.name for shop in mf.order.list()} >= {"generic-chrome", "gesim"}
    for shop, taken in (("generic-chrome", True), ("gesim", False)):
        judged = mf.order.pack(plate, dry_run=True, shop=shop)
        assert judged.passed == taken
        assert taken == all(rule["passed"] is not False for rule in judged.to_dict()["rules"])
    sent = mf.order.pack(plate, "gesim", tmp_path / "plate.zip")
    assert sent.path is None
    assert [rule.rule for rule in sent.findings if rule.passed is False] == ["blank"]
    assert not (tmp_path / "plate.zip").exists()


def test_explanations_are_those_of_the_command(capsys):
    for word in ("MF106", "camera.stop"):
        assert str(mf.explain(word)) == command(capsys, "explain", word).stdout.rstrip("\n")
    assert mf.explain("MF106").to_dict()["code"] == "MF106"
    assert "MF901" in str(mf.explain())


@pytest.mark.parametrize(
    ("error", "code", "call"),
    [
        (JobError, "MF105", lambda plate: mf.check(plate, optics=True, die="NONE")),
        # It asks for no emitters, and the die is narrower than the stop of protocol F1.
        (JobError, "MF153", lambda plate: mf.check(mf.Plate.of(plate.panels), die="PLAIN")),
        (JobError, "MF105", lambda plate: mf.order.pack(plate, dry_run=True, shop="gesim", formats=["psd"])),
        (OutputError, "MF420", lambda plate: mf.order.pack(plate, dry_run=True, shop="nobody")),
        (JobError, "MF105", lambda plate: mf.check(plate, formats=["gdsii"])),
        (JobError, "MF105", lambda plate: mf.check(plate, look=True, optics=True)),
        (JobError, "MF105", lambda plate: mf.check(plate, samples=7)),
        (JobError, "MF105", lambda plate: mf.check(plate, look=True, largest_gap=True)),
        (JobError, "MF105", lambda plate: mf.order.pack(plate, dry_run=True, shop="gesim", die="PLAIN")),
        (JobError, "MF105", lambda plate: mf.simulate(plate, protocol="f2")),
        (JobError, "MF134", mf.simulate),
        (JobError, "MF103", lambda plate: mf.check(plate, look=True, distance="300")),
        (JobError, "MF105", lambda plate: mf.analyse(plate["PLAIN"].opening, tiling="spiral")),
        (JobError, "MF102", lambda plate: mf.analyse(plate["PLAIN"].opening, scene={"gape": "1 mm"})),
        (JobError, "MF111", lambda plate: mf.analyse(plate["PLAIN"].opening, plate["PLAIN"] and None, tiling="random")),
        (JobError, "MF105", lambda plate: mf.Opening.shape("hexagon")),
        (JobError, "MF105", lambda plate: mf.Opening.shape("blobs")),
        (JobError, "MF102", lambda plate: mf.Opening.shape("stripe", lengths={"a": 1})),
        (JobError, "MF105", lambda plate: mf.explain("nonsense")),
        (JobError, "MF105", lambda plate: mf.bench(plate, die="NONE")),
    ],
)
def test_bad_input_of_a_verb_is_refused(plate, error, code, call):
    with pytest.raises(error) as refusal:
        call(plate)
    assert refusal.value.code == code


@pytest.mark.parametrize(
    ("name", "arguments", "said"),
    [
        ("folder", {"layer": "1/0"}, "layer does not apply to folder, which is a directory"),
        ("folder", {"against": "job.toml"}, "against does not apply"),
        ("plate.gds", {"against": "job.toml", "dots_per_um": 2.0}, "dots_per_um does not apply to plate.gds"),
        ("plate.png", {"against": "job.toml", "layer": "1/0"}, "layer does not apply to plate.png"),
        ("plate.gds", {"shop": "gesim", "against": "job.toml"}, "applies to packages only"),
    ],
)
def test_what_cannot_be_said_of_a_subject_is_refused_and_not_ignored(tmp_path, name, arguments, said):
    place = tmp_path / name
    if place.suffix:
        place.write_bytes(b"no mask")
    else:
        place.mkdir()
    with pytest.raises(JobError, match=f"MF105.*{said}"):
        mf.verify(place, **arguments)


@pytest.mark.parametrize(
    ("stated", "named"),
    [
        ({"dots": 7}, "dots"),
        ({"method": "search"}, "method"),
        ({"camera": protocol_f1()}, "camera"),
        ({"anneal": 5}, "anneal"),
        ({"emitters": {}, "wires": {}, "sections": {}}, "emitters, wires, sections"),
    ],
)
def test_a_design_of_a_job_takes_nothing_that_the_job_says(tmp_path, stated, named):
    with pytest.raises(JobError, match=rf"MF105 {named} cannot be stated beside a job"):
        mf.design(write_job(tmp_path), **stated)


DESIGN = {"dots": 11, "pitch": "88 um", "clear_dots": 25, "families": ["bars"], "shortlist": 1, "fit": True}
SHOWN = {"required": 0.1, "gap_to_opening": 4, "colour_gap": "8 um", "min_width": 8, "circuit": "800 um^2"}
WIRED = {"lines": 5, "line": 3.0}
ASKED = """
[design]
name = "found"
dots = 11
pitch = "88 um"
clear_dots = 25
families = ["bars"]
map = "equal_light"
shortlist = 1
fit = true

[camera]
focal = "10 mm"
stop = { diameter = "0.512 mm" }
wavelengths = ["610 nm", "530 nm", "470 nm"]
pixel = "2 um"

[emitters]
required = 0.1
gap_to_opening = "4 um"
colour_gap = "8 um"
min_width = "8 um"
circuit = "800 um^2"

[wires]
line = "3 um"
lines = 5
"""


def test_a_display_is_stated_in_a_call_as_in_a_job(tmp_path, monkeypatch):
    """What is asked of the search; the call in the provenance states the display too, and could be made again."""
    asked = []

    def search(spec, command, **_):
        asked.append((spec, command))
        raise OutputError("MF401", "that is enough", cure="none")

    monkeypatch.setattr("maskfab.api.designing.design_spec", search)
    (tmp_path / "job.toml").write_text(ASKED)
    camera = mf.Camera("10 mm", stop="0.512 mm", pixel="2 um", wavelengths=[610, 530, 470])
    for stated in ({"job": tmp_path / "job.toml"}, {**DESIGN, "emitters": SHOWN, "wires": WIRED, "camera": camera}):
        with pytest.raises(OutputError, match="enough"):
            mf.design(**stated)
    (told, _), (called, command) = asked
    used = ("design", "emitters", "wires", "camera")
    assert [getattr(called, name) for name in used] == [getattr(told, name) for name in used]
    said = ast.parse(command, mode="eval").body
    assert isinstance(said, ast.Call)
    again = {each.arg: each.value for each in said.keywords}
    assert ast.literal_eval(again["wires"]) == {"lines": 5, "line": "3 um"}
    assert ast.literal_eval(again["emitters"])["gap_to_opening"] == "4 um"
    assert ast.literal_eval(again["fit"]) is True


@pytest.mark.parametrize(
    ("code", "where", "stated"),
    [
        ("MF105", "design.fit", {}),
        ("MF105", "wires", {"wires": WIRED}),
        ("MF102", "emitters.gap", {"emitters": {**SHOWN, "gap": 4}}),
        ("MF103", "emitters.min_width", {"emitters": {**SHOWN, "min_width": "8"}}),
        ("MF105", "emitters", {"emitters": [8]}),
        ("MF123", "100 um wide", {"emitters": SHOWN, "wires": {"line": 100}}),
        ("MF123", "emitters", {"emitters": {**SHOWN, "required": 0.3}}),
        ("MF102", "sections", {"emitters": SHOWN, "sections": {"limits": {}}}),
        ("MF102", "sections", {"emitters": SHOWN, "sections": {"wires": WIRED}}),
        ("MF127", "process.spread.bias", {"emitters": SHOWN, "sections": {"process": {"spread": {"bias": "9 um"}}}}),
    ],
)
def test_a_display_that_cannot_be_is_refused_in_a_call_as_in_a_job(code, where, stated):
    with pytest.raises(JobError, match=rf"{code}.*{where}"):
        mf.design(**DESIGN, **stated)


@pytest.mark.slow
def test_a_design_says_the_call_that_repeats_it(tmp_path):
    """The call in the provenance, run again, gives the same file."""
    write_png(leaves(3, 1024, 1536).values, tmp_path / "leaves.png", white=1.0)
    camera = mf.Camera("9 mm", stop="3.6 mm", pixel="2 um", wavelengths=[610, 530, 470])
    found = mf.design(dots=4, pitch="168 um", clear_dots=5, camera=camera, map="none", images=tmp_path, anneal=0)
    assert found.map is None
    call = str(found.found.opening.provenance["command"])
    again = eval(call, {"maskfab": mf})
    assert again.texts() == found.texts()
    assert again.found.psnr == found.found.psnr


def test_a_checkpoint_without_its_directory_is_refused_before_any_work(tmp_path):
    with pytest.raises(OutputError, match="MF401 there is no directory for the checkpoint"):
        mf.design(dots=4, pitch="168 um", clear_dots=5, checkpoint=tmp_path / "nowhere" / "state.npz")


def test_a_pareto_front_needs_its_section(tmp_path):
    with pytest.raises(JobError, match=r"MF105 the job has no \[pareto\] section"):
        mf.design(write_job(tmp_path), front=True)
