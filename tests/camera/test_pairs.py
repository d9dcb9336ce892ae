"""Pairs to train restorers on: what is in them, what they are drawn from, and a folder of them."""

from __future__ import annotations

import csv
import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from once import leaves

import maskfab as mf
from maskfab.base.errors import JobError, MaskfabError
from maskfab.camera.blur import read_psf
from maskfab.camera.pairs import SPLITS, Wanted, by_split
from maskfab.camera.record import interpolated
from maskfab.camera.scenes import scene
from maskfab.cli.program import run_command_line
from maskfab.display.pictures import read_picture
from maskfab.findings.photographs import Conditions, Surroundings
from maskfab.mask.formats.exr import write_exr, write_png
from maskfab.mask.job import Job
from maskfab.optics.colour import code_of_light, light_of_code

CAMERA = mf.Camera("10 mm", stop="1 mm", pixel="2 um", wavelengths=["610 nm", "530 nm", "470 nm"])
SENSOR = {"bits": 12, "black_level": 200, "mosaic": "rggb", "full_well": 15000.0, "read_noise": 6.0}


def die(name: str, dots: int) -> mf.Panel:
    bar = mf.Opening.bar(dots=21, size=(dots, 9), pitch="168 um", name=name)
    return mf.Panel.tile(bar, size="1.4 mm")


JOB: Job = mf.Plate.of({"NARROW": die("NARROW", 5), "WIDE": die("WIDE", 13)}, sections={"sensor": SENSOR}).job(CAMERA)


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    for seed in range(1, 8):
        write_png(leaves(seed, 448, 512).values, folder / f"leaves{seed}.png")
    (folder / "LICENSE.txt").write_text("Drawn for a test.\n")
    return folder


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def whole(photos: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set of more than one shard, by this process alone."""
    folder = tmp_path_factory.mktemp("pairs") / "set"
    made = mf.simulate(JOB, images=photos, pairs=folder, count=600, crop=32, seed=3, workers=1)
    assert made.made == 600
    return folder


def given(photos: Path, **more: object) -> mf.pairs:
    return mf.pairs(JOB, photos, **{"count": 600, "crop": 32, "seed": 3, **more})


def test_two_processes_write_what_one_does(photos: Path, whole: Path, tmp_path: Path) -> None:
    mf.simulate(JOB, images=photos, pairs=tmp_path / "set", count=600, crop=32, seed=3, workers=2)
    assert content(tmp_path / "set") == content(whole)


def test_a_set_that_was_cut_off_goes_on_to_the_same_bytes(photos: Path, whole: Path, tmp_path: Path) -> None:
    def cut(stage: str, done: int, total: int) -> None:
        if done:
            raise KeyboardInterrupt

    asked = {"images": photos, "pairs": tmp_path / "set", "count": 600, "crop": 32, "seed": 3, "workers": 1}
    with pytest.raises(KeyboardInterrupt):
        mf.simulate(JOB, **asked, progress=cut)
    before = content(tmp_path / "set")
    assert "index.csv" not in before
    assert "train/00000/raw.npy" in before
    made = mf.simulate(JOB, **asked)
    assert 0 < made.made < 600
    assert content(tmp_path / "set") == content(whole)
    assert mf.simulate(JOB, **asked).made == 0


def test_pairs_one_by_one_are_those_of_the_files(photos: Path, whole: Path) -> None:
    rows = list(csv.DictReader((whole / "index.csv").read_text().splitlines()))
    assert len(rows) == 600
    every = given(photos)
    for number in (0, 7, 255, 256, 480, 599):
        pair, row = every[number], rows[number]
        folder = whole / row["split"] / row["shard"]
        for name in ("clean", "blurred", "raw", "coded"):
            stored = np.load(folder / f"{name}.npy", mmap_mode="r")
            assert stored.dtype == pair[name].dtype
            np.testing.assert_array_equal(stored[int(row["place"])], pair[name])
        for key in ("number", "photograph", "top", "left", "die", "gain"):
            assert str(pair[key]) == row[key]


def test_a_loader_of_torch_takes_them(photos: Path) -> None:
    from torch.utils.data import DataLoader

    train = given(photos, split="train")
    order = train.order(seed=1)
    assert sorted(order) == list(range(len(train)))
    batch = next(iter(DataLoader(pickle.loads(pickle.dumps(train)), batch_size=4, sampler=order)))
    assert tuple(batch["clean"].shape) == (4, 3, 32, 32)
    np.testing.assert_array_equal(batch["coded"][1].numpy(), train[order[1]]["coded"])


def test_every_crop_of_a_photograph_is_in_one_split(photos: Path, whole: Path) -> None:
    split_of: dict[str, set[str]] = {}
    for row in csv.DictReader((whole / "index.csv").read_text().splitlines()):
        split_of.setdefault(row["photograph"], set()).add(row["split"])
    assert len(split_of) == 7
    assert all(len(splits) == 1 for splits in split_of.values())
    sheet = json.loads((whole / "datasheet.json").read_text())
    assert {name: about["photographs"] for name, about in sheet["splits"].items()} == dict(
        zip(SPLITS, (5, 1, 1), strict=True)
    )
    assert split_of == {each["name"]: {each["split"]} for each in sheet["photographs"]["files"]}
    for split in SPLITS:
        assert {pair["photograph"] for pair in map(given(photos, split=split).__getitem__, (0, -1))} <= {
            name for name, splits in split_of.items() if splits == {split}
        }


def test_splits_follow_from_seed_and_names() -> None:
    names = [f"{k}.png" for k in range(40)]
    order, held = by_split(names, Wanted(1, seed=1))
    assert held == (32, 4, 4)
    assert by_split(names[::-1], Wanted(1, seed=1))[0] == [39 - place for place in order]
    assert by_split(names, Wanted(1, seed=2))[0] != order
    assert [by_split(names[:n], Wanted(1))[1] for n in (1, 2, 3)] == [(1, 0, 0), (1, 0, 1), (1, 1, 1)]
    assert by_split(names, Wanted(1, validation=0, test=0))[1] == (40, 0, 0)


@pytest.fixture(scope="module")
def even(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photograph of one colour, so that every pixel of the sensor has the same light."""
    folder = tmp_path_factory.mktemp("even")
    light = np.empty((3, 400, 400))
    light[0], light[1], light[2] = 0.7, 0.3, 0.05
    write_exr(light, folder / "even.exr", {})
    return folder


def test_noise_has_the_mean_and_the_variance_of_the_sensor(even: Path) -> None:
    pairs = mf.pairs(JOB, even, count=24, crop=128, levels=[34], die="WIDE")
    taken = [pairs[number] for number in range(24)]
    electrons, gain = taken[0]["electrons_of_white"], taken[0]["gain"]
    step = SENSOR["full_well"] / gain / (2**12 - 1 - SENSOR["black_level"])
    assert gain > 1.5
    raw = np.stack([pair["raw"] for pair in taken]).astype(float)
    # Red lies at the top left, blue across from it, and green twice.
    for (top, left), light in {(0, 0): 0.7, (0, 1): 0.3, (1, 0): 0.3, (1, 1): 0.05}.items():
        seen = raw[:, top::2, left::2]
        mean = SENSOR["black_level"] + light * electrons / step
        variance = (light * electrons + SENSOR["read_noise"] ** 2) / step**2 + 1 / 12
        assert seen.mean() == pytest.approx(mean, abs=4 * (variance / seen.size) ** 0.5 + 1e-3 * (mean - 200))
        assert seen.var() == pytest.approx(variance, rel=5 * (2 / seen.size) ** 0.5 + 1e-3)
    assert np.corrcoef(raw[0].ravel() - raw[1].ravel(), raw[2].ravel() - raw[3].ravel())[0, 1] == pytest.approx(
        0, abs=0.04
    )


@pytest.mark.parametrize("scene_keys", [{}, {"accuracy": 0.02, "focus": "0.5 m"}])
def test_blurred_light_is_that_of_simulate(scene_keys: dict[str, object], tmp_path: Path) -> None:
    sections = {"sensor": SENSOR} | ({"scene": scene_keys} if scene_keys else {})
    job = mf.Plate.of({"NARROW": die("NARROW", 5), "WIDE": die("WIDE", 13)}, sections=sections).job(CAMERA)
    photograph = leaves(5, 768, 768)
    write_png(photograph.values, tmp_path / "one.png")
    pairs = mf.pairs(job, tmp_path, count=6, levels=[40])
    whole = scene("one", read_picture(tmp_path / "one.png").values)
    conditions = Conditions.of(job, "camera")
    for number in range(6):
        pair = pairs[number]
        design, _ = conditions.design(pair["die"], job.panels()[pair["die"]], Surroundings.of(job))
        for light, rounded in ((whole.light.astype(np.float16).astype(np.float32), 2**-11), (whole.light, 2**-10)):
            seen = conditions.protocol.seen(design, replace(whole, measured=light))[:, 128:384, 128:384]
            np.testing.assert_allclose(pair["blurred"].astype(float), seen, rtol=rounded, atol=1e-6)
        np.testing.assert_allclose(
            pair["clean"].astype(float), whole.light[:, 256:512, 256:512], rtol=2**-11, atol=1e-7
        )
        assert (pair["top"], pair["left"]) == (256, 256)


def test_light_that_falls_into_a_crop_from_outside_is_the_photographs_own(photos: Path, whole: Path) -> None:
    pairs = given(photos)
    for number in range(0, 600, 50):
        pair = pairs[number]
        with np.load(whole / "psf" / f"{pair['die']}.npz") as file:
            psf, beyond = file["psf"], float(file["beyond"])
        light = light_of_code(read_picture(photos / pair["photograph"]).values.transpose(2, 0, 1))
        reach = psf.shape[1] // 2
        for row, column in ((0, 0), (0, 31), (17, 9)):
            y, x = pair["top"] + row, pair["left"] + column
            around = light[:, y - reach : y + reach + 1, x - reach : x + reach + 1]
            summed = (psf[:, ::-1, ::-1] * around).sum(axis=(1, 2))
            # Light from farther is of another place, here as bright as the mean, more or less.
            summed += (1 - psf.sum(axis=(1, 2))) * light.mean(axis=(1, 2))
            np.testing.assert_array_less(abs(pair["blurred"][:, row, column] - summed), beyond / 2)
            assert beyond < 0.1


@pytest.mark.parametrize("bits", [8, 10])
def test_the_cameras_picture_is_its_raw_developed(photos: Path, bits: int) -> None:
    pairs = given(photos, crop=64, bits=bits)
    for number in (1, 300):
        pair = pairs[number]
        step = SENSOR["full_well"] / pair["gain"] / (2**12 - 1 - 200)
        light = interpolated(pair["raw"].astype(np.float32) - 200) * step / pair["electrons_of_white"]
        codes = np.rint(code_of_light(light.astype(float)) * (2**bits - 1))
        assert pair["coded"].dtype == (np.uint8 if bits == 8 else np.uint16)
        assert abs(codes - pair["coded"]).max() <= 1
        assert (codes != pair["coded"]).mean() < 1e-3


def test_a_psf_of_the_set_restores_by_the_die(photos: Path, whole: Path) -> None:
    blur = read_psf([whole / "psf" / "WIDE.exr"])
    assert "as designed" in blur.told[0]
    with np.load(whole / "psf" / "WIDE.npz") as file:
        stored = dict(file)
    light = stored["psf"] / stored["psf"].sum(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(blur.kernels, light, atol=1e-7)
    assert 1 - stored["psf"].sum(axis=(1, 2)).min() <= float(stored["beyond"]) + 1e-3
    pairs = given(photos)
    shape = pairs.plan.window.margin.shape
    assert abs(blur.on(shape) - pairs.transfers["WIDE"]).max() < 2 * float(stored["beyond"]) + 1e-3


def test_the_data_sheet_names_what_nobody_stated(photos: Path, whole: Path, tmp_path: Path) -> None:
    assert (whole / "photographs-LICENSE.txt").read_text() == "Drawn for a test.\n"
    assert "sources of the photographs: LICENSE.txt" in (whole / "README.md").read_text()
    write_png(leaves(1, 448, 512).values, tmp_path / "one.png")
    plain = mf.Plate.of({"WIDE": die("WIDE", 13)}, sections={"exposure": {"snr": [30], "brackets": [1, 4]}}).job(CAMERA)
    sheet = mf.pairs(plain, tmp_path, count=2, crop=32).datasheet
    assert sheet["photographs"]["terms"] == []
    assert (sheet["pairs_of_one_photograph"], sheet["crops_side_by_side"]) == (2, (192 // 32) * (256 // 32))
    assert [text[:8] for text in sheet["assumed"][:2]] == ["assumed:"] * 2
    assert sheet["sensor"]["bits"] == 10
    assert "brackets of [exposure]" in sheet["unused"]


@pytest.mark.parametrize(
    ("more", "code", "words"),
    [
        ({"count": 0}, "MF104", "0 pairs"),
        ({"crop": 33}, "MF104", "33"),
        ({"crop": 256}, "MF121", "512 x 448"),
        ({"bits": 9}, "MF105", "9 bits"),
        ({"seed": -1}, "MF104", "-1"),
        ({"validation": 0.5, "test": 0.5}, "MF104", "leave none"),
        ({"split": "all"}, "MF105", "'all'"),
        ({"die": "NONE"}, "MF105", "NONE"),
        ({"levels": [90]}, "MF141", "90 dB"),
    ],
)
def test_what_cannot_be_is_refused(photos: Path, more: dict[str, object], code: str, words: str) -> None:
    with pytest.raises(MaskfabError, match=words) as refused:
        given(photos, **more)
    assert refused.value.code == code


def test_folders_of_anything_else_are_refused(photos: Path, whole: Path, tmp_path: Path) -> None:
    def refusal(**more: object) -> str:
        asked = {"images": photos, "pairs": whole, "count": 600, "crop": 32, "seed": 3, **more}
        with pytest.raises(MaskfabError) as refused:
            mf.simulate(JOB, **asked)
        return f"{refused.value.code} {refused.value}"

    before = content(whole)
    assert "MF402" in (text := refusal(seed=4))
    assert "another seed" in text
    assert "another count" in refusal(count=601)
    assert content(whole) == before
    (tmp_path / "mine.txt").write_text("mine")
    assert "holds no pairs" in refusal(pairs=tmp_path)
    assert "MF401" in refusal(pairs=tmp_path / "mine.txt")
    (tmp_path / "none").mkdir()
    assert "MF301" in refusal(images=tmp_path / "none")
    write_exr(np.full((3, 400, 400), 3.0), tmp_path / "none" / "bright.exr", {})
    assert "light that is white" in refusal(images=tmp_path / "none", pairs=tmp_path / "new")
    assert not (tmp_path / "new").exists()
    twice = tmp_path / "twice"
    twice.mkdir()
    for name in ("a.png", "b.png"):
        write_png(leaves(1, 448, 512).values, twice / name)
    assert "a.png and b.png" in refusal(images=twice)
    assert "no images" in refusal(images=None)
    assert "restore does not apply to pairs" in refusal(restore="tv")
    with pytest.raises(JobError, match="crop does not apply to scores"):
        mf.simulate(JOB, crop=64)


def test_the_command_line_writes_a_set_to_a_relative_place(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    job = str(Path(__file__).parents[2] / "layouts" / "toled_against_ours.toml")
    words = [
        "simulate",
        job,
        "--die",
        "TOLED",
        "--images",
        str(photos),
        "--pairs",
        "set",
        "--crop",
        "64",
    ]
    assert run_command_line([*words, "--count", "5", "--quiet", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["made"] == 5
    assert told["dies"][0]["name"] == "TOLED"
    assert run_command_line([*words, "--count", "5", "-o", "sheet.png"]) == 2
    assert "out does not apply" in capsys.readouterr().err
    assert run_command_line([*words, "--quiet"]) == 2
    assert "count" in capsys.readouterr().err
