"""Public functions called with anything: nothing but maskfab's own refusals comes out of the door."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from small_job import write_job

import maskfab as mf
from maskfab.base.checks import checked_arguments, options_kept
from maskfab.base.errors import InputError, JobError, ManyFaultsError

BAD: dict[str, Any] = {
    "None": None, "nan": math.nan, "inf": math.inf, "zero": 0, "negative": -1, "tiny": 1e-300, "huge": 1e300,
    "text": "x", "no list": [], "huge list": [1e300, -1e300], "thing": object(), "array": np.ones((2, 3)),
    "ragged": [[1, 0], [1]],
}  # fmt: skip
"""By what they are called in the report of a failure."""

UNASKED = {"Design", "MaskfabError", "Psf", "Quantities", "__version__", "doctor", "shapes"}
"""Results, which only maskfab makes, and functions without arguments."""

PUBLIC = set(mf.__all__) - UNASKED

LINES = ["610 nm", "530 nm", "470 nm"]
LOOK = {
    "focal": "5 mm",
    "stop": "400 um",
    "pixel": "2 um",
    "wavelengths": ["610 nm", "530 nm", "470 nm"],
    "window": "64 um",
}


def calls(job: Path, out: Path) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Every public function and method with arguments that its annotations allow, and that make it do little."""
    bar = mf.Opening.bar(dots=7, size=(3, 5), pitch="56 um")
    panel, camera = mf.Panel.tile(bar, size="560 um"), mf.Camera(**LOOK)
    plate = mf.Plate.of(A=panel)
    dots = torch.from_numpy(bar.mask.astype(np.float64))
    none = job.with_name("none.toml")
    loaded = mf.load_job(job)
    of_job, behind = {"job": loaded}, {"job": loaded, "die": "NONE"}
    return {
        "Camera": (mf.Camera, LOOK),
        "Camera.psf": (camera.psf, {"panel": panel, "wavelength": 530}),
        "Camera.mtf": (camera.mtf, {"panel": panel, "wavelength": 530}),
        "Mtf.frequency_at": (camera.mtf(panel, 530).frequency_at, {"level": 0.5}),
        "Opening.bar": (mf.Opening.bar, {"dots": 7, "size": (3, 5), "pitch": "56 um"}),
        "Opening.shape": (mf.Opening.shape, {"kind": "disc", "dots": 7, "pitch": "56 um", "clear_dots": 9}),
        "Opening.of": (mf.Opening.of, {"mask": np.ones((2, 2)), "pitch": "16 um"}),
        "Opening.reduced": (bar.reduced, {"clear_dots": 99}),
        "Opening.save": (bar.save, {"path": out / "a.toml"}),
        "Panel.tile": (mf.Panel.tile, {"opening": bar, "size": "560 um"}),
        "Panel.plot": (panel.plot, {}),
        "Panel.to_trimesh": (panel.to_trimesh, {}),
        "Plate.of": (mf.Plate.of, {"A": panel}),
        "Plate.job": (plate.job, {}),
        "Plate.layout": (plate.layout, {}),
        "Plate.write": (plate.write, {"path": out / "a.psd"}),
        "advise": (mf.advise, {"job": none}),
        "analyse": (mf.analyse, {"subject": none, "camera": camera}),
        "bench": (mf.bench, behind),
        "cache": (mf.cache, {}),
        "check": (mf.check, behind),
        "check --look": (mf.check, behind | {"look": True}),
        "check --optics": (mf.check, behind | {"optics": True}),
        "cite": (mf.cite, {"directory": out}),
        "compare": (mf.compare, {"reports": out}),
        "design": (mf.design, {"dots": 7, "pitch": "56 um", "clear_dots": 99}),
        "design --front": (mf.design, {"job": none, "front": True}),
        "edge": (mf.edge, behind | {"picture": none}),
        "edge of a curve": (mf.edge, behind | {"picture": none.with_suffix(".csv")}),
        "explain": (mf.explain, {"code": "MF101"}),
        "forecast": (mf.forecast, {"job": none, "out": out}),
        "learn": (mf.learn, behind | {"out": out / "a.pt"}),
        "load_job": (mf.load_job, {"path": none}),
        "measure": (mf.measure, behind | {"captures": none}),
        "new": (mf.new, {"place": out, "source": "none"}),
        "new --shape": (mf.new, {"place": out / "a.toml", "shape": "disc", "dots": 7, "clear_dots": 9}),
        "order.compare": (mf.order.compare, of_job | {"shop": "none"}),
        "order.fill": (mf.order.fill, of_job | {"shop": "none"}),
        "order.list": (mf.order.list, {}),
        "order.pack": (mf.order.pack, of_job | {"shop": "none"}),
        "pairs": (mf.pairs, behind | {"photos": none, "count": 1}),
        "read_map": (mf.read_map, {"path": none}),
        "read_opening": (mf.read_opening, {"source": np.ones((2, 2)), "pitch": "16 um"}),
        "restore": (mf.restore, behind | {"photos": none}),
        "run": (mf.run, {"job": none, "out": out}),
        "simulate": (mf.simulate, behind | {"reference": "NONE"}),
        "study": (mf.study, of_job),
        "sweep": (mf.sweep, {"study": none, "out": out}),
        "torch.psf": (mf.torch.psf, {"dots": dots, "camera": camera, "wavelength": 530, "pitch": "56 um"}),
        "torch.mtf": (mf.torch.mtf, {"dots": dots, "camera": camera, "wavelength": 530, "pitch": "56 um"}),
        "torch.restored_error": (mf.torch.restored_error, {"dots": dots, "camera": camera, "pitch": "56 um"}),
        "verify": (mf.verify, {"subject": none, "against": none}),
        "verify --again": (mf.verify, {"subject": out, "again": True}),
        "view": (mf.view, {"directory": out}),
    }  # fmt: skip


def given(function: Callable[..., Any], arguments: dict[str, Any]) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Calls with one bad argument each, and what it is."""
    for name, parameter in inspect.signature(function).parameters.items():
        # A progress is a function, and what is left out is not bad.
        for said, value in BAD.items() if name != "progress" else ():
            named = {key: held for key, held in arguments.items() if key != name}
            if parameter.kind in (parameter.POSITIONAL_ONLY, parameter.VAR_POSITIONAL):
                yield f"{name} = {said}", partial(function, value, **named)
            elif value is not parameter.default:
                yield f"{name} = {said}", partial(function, **named, **{name: value})


def test_wrong_types_and_extreme_values_are_refused_by_an_error_of_maskfabs_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    job = write_job(tmp_path, ('["530 nm"]', '["610 nm", "530 nm", "470 nm"]'))
    every = calls(job, tmp_path / "nowhere" / "out")
    assert {re.split("[. ]", name)[0] for name in every} == PUBLIC
    raw, count = [], 0
    for name, (function, arguments) in every.items():
        for said, call in given(function, arguments):
            count += 1
            try:
                call()
            except InputError:
                pass
            except Exception as error:  # what is looked for
                raw.append(f"{name}({said}): {type(error).__name__}: {error}")
    assert raw == []
    assert count > 2000


@pytest.mark.parametrize(
    ("call", "code", "said"),
    [
        (lambda: mf.Camera(wavelengths=None), "MF105", "focal"),
        (lambda: mf.Camera(**LOOK | {"wavelengths": None}), "MF105", "Camera: wavelengths"),
        (lambda: mf.Camera(**LOOK | {"stop": "1e-300 um"}), "MF104", "1e-300"),
        (lambda: mf.Camera(**LOOK | {"stop": "0.5 um"}), "MF104", "wavelength of 0.61 um"),
        (lambda: mf.Camera(**LOOK, windows=3), "MF105", "windows"),
        (lambda: mf.Panel.tile(np.ones((7, 7)), size="560 um"), "MF105", "pitch"),
        (lambda: mf.compare(3), "MF105", "int states no job"),
        (lambda: mf.compare([]), "MF105", "no report"),
        (lambda: mf.simulate(3), "MF105", "int states no job"),
        (lambda: mf.simulate(np.ones((2, 2))), "MF105", "Panel.tile(array"),
        (lambda: mf.simulate("job.toml", levels=24), "MF105", "24 is not a list"),
        (lambda: mf.simulate("job.toml", checkpoints="net.pt"), "MF105", "'net.pt' is not a list"),
    ],
)
def test_what_is_wrong_is_said_with_its_place_and_its_cure(call: Callable[[], Any], code: str, said: str) -> None:
    with pytest.raises(JobError) as caught:
        call()
    assert caught.value.code == code
    assert said in str(caught.value)
    assert caught.value.where
    assert caught.value.cure


def test_what_a_user_would_expect_of_the_door_works(tmp_path: Path) -> None:
    """A panel alone is a plate of one, an array with a pitch is an opening, and reports may come in a list."""
    mask = np.zeros((7, 7))
    mask[1:4, 2:6] = 1
    bar = mf.Opening.of(mask, pitch="56 um")
    panel = mf.Panel.tile(bar, size="560 um", gutter="8 um")
    drawn = mf.Panel.tile(mask, size="560 um", pitch="64 um", gutter="8 um")
    assert np.array_equal(drawn.held[0].mask, bar.mask)
    assert (drawn.held[0].dot_nm, drawn.pitch_nm) == (panel.held[0].dot_nm, panel.pitch_nm)
    camera = mf.Camera(**LOOK)
    alone = mf.check(panel, optics=True, camera=camera)
    plate = mf.check(mf.Plate.of(PANEL=panel), optics=True, camera=camera)
    # Of the two a plate alone states a [plate], which no optics use.
    assert alone.to_dict() == plate.to_dict() | {"unused": []}
    with pytest.raises(InputError) as one:
        mf.compare(tmp_path / "a", tmp_path / "b")
    with pytest.raises(InputError) as listed:
        mf.compare([tmp_path / "a", tmp_path / "b"])
    assert str(one.value) == str(listed.value)
    assert one.value.code == "MF403"


SMALL = mf.Panel.tile(mf.Opening.bar(dots=7, size=(5, 3), pitch="56 um"), size="560 um")
NEAR = mf.Camera("5 mm", stop="400 um", pixel="2 um", window="64 um")


@pytest.mark.parametrize(
    ("call", "where", "cure"),
    [
        (lambda: mf.Plate.of(A=SMALL).write("no/a.gds", NEAR), "", "Give path=... a path in a writable folder"),
        (lambda: mf.sweep(SMALL, NEAR, "full", over={"camera.pixel": [1, 2]}), "", "Give out=... a new or empty"),
        (lambda: mf.view("full", "full/a.html"), "out", "Give out=... a path beside the directory"),
        (lambda: mf.analyse("dots.npy", NEAR), "dot", 'Add dot="8 um"'),
        (lambda: mf.simulate(SMALL, NEAR, restore="learned"), "restore", 'give it with checkpoints=["FILE"]'),
        (lambda: mf.sweep(SMALL, NEAR, over={"camera.pixel": [1]}, engine="dask"), "engine", 'engine="serial"'),
        (lambda: mf.order.compare(mf.Plate.of(A=SMALL)), "", "Give the camera that looks through it"),
        (
            lambda: mf.check(SMALL, rules={"emitters": {"min_width": "8 um", "colour_gap": "8 um"}}),
            "",
            "Give the camera that looks through",
        ),
    ],
)
def test_refusals_name_arguments_in_python(call, where, cure, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "other").write_text("")
    np.save("dots.npy", np.eye(7))
    with pytest.raises(mf.MaskfabError) as refusal:
        call()
    assert cure in refusal.value.cure
    assert where in refusal.value.where
    assert "--" not in str(refusal.value)
    assert str(refusal.value).endswith(refusal.value.cure)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("such as --times '1 ms' --times '4 ms', in order", 'such as times=["1 ms", "4 ms"], in order'),
        ("such as --white 65535", "such as white=65535"),
        ("Run maskfab order pack JOB --shop X --dry-run", "Run maskfab order pack JOB --shop X --dry-run"),
        ("Add --force to replace it", "Add force=True to replace it"),
        ("Restore it, or add --bin for less", "Restore it, or add --bin for less"),
        ("two faults -- one here", "two faults -- one here"),
    ],
)
def test_options_become_arguments_of_the_function_that_has_them(text, told):
    @checked_arguments
    def taken(times: Sequence[str] = (), white: float | None = None) -> None:
        raise ManyFaultsError([JobError("MF105", text, where="--white", cure=text), JobError("MF104", "b")])

    with pytest.raises(ManyFaultsError) as refusal:
        taken()
    first = refusal.value.faults[0]
    assert (first.what, first.where, first.cure) == (told, "white", told)
    assert told in str(refusal.value)
    with pytest.raises(ManyFaultsError, match="--white"), options_kept():
        taken()
