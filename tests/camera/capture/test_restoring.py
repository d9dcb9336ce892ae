"""Photographs that were taken: read, their noise, their PSF, and what comes out."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from dng_files import write_dng
from PIL import Image
from small_job import command

import maskfab as mf
from maskfab.base.errors import MaskfabError
from maskfab.base.model import Psf, orient
from maskfab.camera.blur import STANDS, MeasuredBlur, StandingBlur, read_psf
from maskfab.camera.die_transfer import die_transfer
from maskfab.camera.photo import Photo, Stated, developed, estimated_noise, read_photo
from maskfab.camera.record import BinnedBlur, Noise, Record, binned, interpolated, sampled
from maskfab.camera.restorers.choice import restored
from maskfab.camera.restorers.wiener import Wiener
from maskfab.mask.formats.exr import camera_header, psf_facts, write_channels, write_png, write_psf

PATTERNS = {"rggb": (0, 0), "grbg": (0, 1), "gbrg": (1, 0), "bggr": (1, 1)}


def kernel(side=9, across=(0.5, 0.3, 0.2)):
    """A lopsided spread of three colours, [3, side, side], each of sum 1."""
    found = np.zeros((3, side, side))
    middle = side // 2
    found[:, middle, middle] = 0.6
    for step, share in enumerate(across):
        found[:, middle + step, middle + 2 - step] += 0.4 * share
    return found


def scene(rows=128, columns=192, seed=0):
    """Blocks of even light, [3, rows, columns]."""
    light = np.random.default_rng(seed).random((3, rows // 16, columns // 16)) * 0.8 + 0.05
    return light.repeat(16, axis=1).repeat(16, axis=2).astype(np.float32)


def blurred(light, kernels):
    spread = np.fft.rfft2(kernels, light.shape[1:], axes=(1, 2))
    middle = kernels.shape[1] // 2
    seen = np.fft.irfft2(np.fft.rfft2(light, axes=(1, 2)) * spread, light.shape[1:], axes=(1, 2))
    return np.roll(seen, (-middle, -middle), axis=(1, 2))


def write_light(path, planes, **facts):
    names = ("R", "G", "B") if len(planes) == 3 else ("Y",)
    write_channels(np.stack(planes, axis=2).astype(np.float32), names, path, facts)
    return path


@pytest.mark.parametrize("red", PATTERNS.values(), ids=PATTERNS)
def test_a_ramp_of_any_mosaic_is_interpolated_exactly(red):
    y, x = np.mgrid[:20, :24].astype(np.float32)
    ramp = np.stack([0.01 * x + 0.02 * y + 0.1] * 3)
    found = interpolated(ramp[0], red)
    assert abs(found - ramp)[:, 4:-4, 4:-4].max() < 1e-6


@pytest.mark.parametrize("red", PATTERNS.values(), ids=PATTERNS)
def test_colours_of_a_mosaic_are_told_by_their_places(red):
    seen = np.full((12, 12), 0.5, dtype=np.float32)
    seen[red[0] :: 2, red[1] :: 2] = 0.9
    seen[1 - red[0] :: 2, 1 - red[1] :: 2] = 0.1
    found = interpolated(seen, red)
    assert found[:, red[0] :: 2, red[1] :: 2][0] == pytest.approx(0.9)
    assert [found[c, 6:, 6:].mean() for c in range(3)] == pytest.approx([0.9, 0.5, 0.1], abs=1e-6)


@pytest.mark.parametrize(("electrons", "read"), [(1000.0, 3.0), (10000.0, 20.0)])
def test_noise_is_told_by_the_photograph_within_a_tenth(electrons, read):
    light = blurred(scene(512, 512), kernel())
    draw = np.random.default_rng(1)
    seen = (draw.poisson(light * electrons) + read * draw.standard_normal(light.shape)) / electrons
    found, true = estimated_noise(list(seen.astype(np.float32))), Noise(electrons, read)
    for level in (0.1, 0.5, 0.8):
        at = np.array([level], dtype=np.float32)
        assert found.variance(at) == pytest.approx(true.variance(at), rel=0.1)


def test_a_binned_blur_is_that_of_means_over_cells():
    fine = MeasuredBlur(kernel(), (4.0, 4.0), ())
    light = scene(32, 48)
    large = blurred(light.repeat(2, axis=1).repeat(2, axis=2), kernel())
    means = binned(Record(large.astype(np.float32), Noise(100, 0))).values
    found = np.fft.irfft2(np.fft.rfft2(light, axes=(1, 2)) * BinnedBlur(fine).on((32, 48)), (32, 48), axes=(1, 2))
    assert found == pytest.approx(means, abs=1e-6)


@pytest.mark.parametrize("way", STANDS.values(), ids=STANDS)
def test_a_die_stands_in_pictures_as_its_drawing_turned(way):
    drawing = kernel()
    shown = np.stack([orient(plane, way) for plane in drawing])[:, ::-1]
    found = StandingBlur(MeasuredBlur(drawing, (4.0, 4.0), ()), way).on((32, 44))
    assert found == pytest.approx(MeasuredBlur(shown, (4.0, 4.0), ()).on((32, 44)), abs=1e-6)


def test_a_kernel_larger_than_a_frame_is_sampled_at_its_frequencies():
    blur = MeasuredBlur(kernel(21), (10.0, 10.0), ())
    assert blur.on((16, 16)) == pytest.approx(blur.on((32, 32))[:, ::2, ::2], abs=1e-6)


def test_a_photograph_is_restored_by_a_capture_of_a_point_light(tmp_path):
    even = (kernel() + kernel()[:, ::-1, ::-1]) / 2
    spread, light, draw = np.pad(even, [(0, 0), (12, 12), (12, 12)]), scene(), np.random.default_rng(2)
    psf = write_light(tmp_path / "light.exr", 5e4 * spread + 30, mosaic="none", holds="electrons_per_s")
    counts = draw.poisson(blurred(light, even) * 20000) / 20000
    photo = write_light(tmp_path / "photo.exr", counts)
    found = mf.restore(photo, psf=psf, restore="wiener", white=1.0).photos[0]
    before, after = abs(counts - light).mean(), abs(found.picture - light)[:, 16:-16, 16:-16].mean()
    assert read_psf([psf]).centre == pytest.approx((16, 16))
    assert after < before / 2
    assert found.restorer == "wiener"


def test_the_strength_that_the_record_speaks_for_is_about_the_best():
    blur, light, draw = MeasuredBlur(kernel(), (4.0, 4.0), ()), scene(), np.random.default_rng(3)
    seen = draw.poisson(blurred(light, kernel()) * 2000) / 2000
    record = Record(seen.astype(np.float32), Noise(2000, 0))
    restorer = Wiener()
    won = restored(record, blur, [restorer])
    at = restorer.prepare(record, blur)
    errors = [np.square(at(each) - light).mean() for each in np.geomspace(1e-4, 1, 9)]
    assert np.square(won.picture - light).mean() < 1.1 * min(errors)


def test_white_stays_neutral_where_a_colour_is_full():
    noise = Noise(100, 0)
    full = np.ones((3, 128, 128), dtype=np.float32)
    photo = Photo("p", "", Record(full, noise), (2.0, 1.0, 1.5), np.eye(3), ())
    assert developed(photo, full).min() == 1
    assert developed(photo, full / 8, stops=1.0)[:, 0, 0] == pytest.approx([0.5, 0.25, 0.375])


@pytest.mark.parametrize("mosaic", ["rggb", "bggr"])
def test_a_dng_becomes_a_record_in_units_of_white(tmp_path, mosaic):
    write_dng(tmp_path / "one.dng", np.full((144, 160), 1064), mosaic=mosaic, white=4064)
    found = read_photo(tmp_path / "one.dng", Stated(electrons_per_count=2.0, read_noise_e=3.0))
    assert found.record.values == pytest.approx(0.25)
    assert found.record.noise == Noise(8000.0, 3.0, 2.0)
    assert min(found.balance) == 1
    assert found.record.interpolated


def test_cells_of_a_mosaic_are_restored_by_cells_alone(tmp_path):
    draw, light = np.random.default_rng(4), scene(256, 288)
    seen = sampled(blurred(light, kernel()).astype(np.float32))
    write_dng(tmp_path / "photo.dng", draw.poisson(seen * 4000) + 64, white=4095)
    y, x = np.mgrid[:64, :64] - 32.0
    psf = write_light(tmp_path / "light.exr", [np.exp(-(x**2 + y**2) / 6) * 1e5 + 2], mosaic="RGGB")
    with pytest.raises(MaskfabError, match="MF353"):
        mf.restore(tmp_path / "photo.dng", psf=psf, restore="wiener")
    found = mf.restore(tmp_path / "photo.dng", psf=psf, restore="wiener", epsilon=0.01, bin=True).photos[0]
    assert found.picture.shape == (3, 128, 144)


def test_an_srgb_picture_is_taken_for_one_and_files_are_written(capsys, tmp_path):
    light = blurred(scene(128, 128), kernel()) + 0.002 * np.random.default_rng(5).standard_normal((3, 128, 128))
    write_png(light.clip(0, 1)[:, ::-1], tmp_path / "photo.png")
    psf = write_light(tmp_path / "light.exr", kernel(15))
    out = tmp_path / "out"
    asked = (
        "restore",
        tmp_path / "photo.png",
        "--psf",
        psf,
        "--restore",
        "wiener",
        "--epsilon",
        0.01,
        "--out",
        out,
        "--json",
    )
    document = command(capsys, *asked).document
    assert "code values of sRGB" in document["photos"][0]["told"][0]
    assert sorted(path.name for path in out.iterdir()) == [
        "manifest.json", "photo.exr", "photo.png", "restore.html", "restore.json",
    ]  # fmt: skip
    with Image.open(out / "photo.png") as picture:
        assert picture.size == (128, 128)


@pytest.mark.parametrize(
    ("code", "stated"),
    [
        ("MF105", {}),
        ("MF105", {"restore": "magic"}),
        ("MF105", {"gain": 2.0}),
        ("MF105", {"die": "A"}),
        ("MF105", {"stands": "mirrored"}),
        ("MF105", {"register": True}),
        ("MF352", {"pixel": "3 um"}),
        ("MF351", {"large": True}),
        ("MF353", {"count": 2}),
        ("MF334", {"light": 1.0}),
        ("MF104", {"stops": 99.0}),
        ("MF104", {"epsilon": -1.0}),
        ("MF121", {"side": 64}),
    ],
)
def test_what_cannot_be_restored_is_refused_by_code(tmp_path, code, stated):
    given = dict(stated)
    side, level = given.pop("side", 128), given.pop("light", None)
    picture = scene(side, side) if level is None else np.full((3, side, side), level)
    write_light(tmp_path / "photo.exr", picture)
    kernels, facts = kernel(9), {}
    if given.pop("large", False):
        # Two lights far apart: about their middle next to nothing is left.
        kernels = np.zeros((3, 401, 401))
        kernels[:, 200, [50, 350]] = 1
    if "pixel" in given:
        facts = {"kind": "point", "step_um": 1.0, "sensor_pixel_um": 2.0, "focal_um": 1e4, "stop_um": 1e3}
        kernels, facts = kernels[:1], {**facts, "wavelength_nm": 530.0}
    psf = [write_light(tmp_path / "psf.exr", kernels, **facts)] * given.pop("count", 1)
    chosen = {"psf": psf} if stated else {}
    with pytest.raises(MaskfabError, match=code):
        mf.restore(tmp_path / "photo.exr", white=1.0, **chosen, **given)


def test_written_psfs_of_a_die_are_its_blur(tmp_path):
    bar = mf.Opening.bar(dots=21, size=(15, 7), pitch="168 um")
    panel = mf.Panel.tile(bar, "random", seed=1, size="1.4 mm")
    lens = {"stop": "1 mm", "pixel": "2 um", "wavelengths": ["610 nm", "530 nm", "470 nm"], "window": "400 um"}
    camera = mf.Camera("10 mm", **lens)
    files, inside = [], []
    for line in camera.model.wavelengths_nm:
        found = camera.psf(panel, line)
        psf = Psf(found.values, found.step_um, line, "point")
        files.append(tmp_path / f"{line:g}.exr")
        inside.append(psf.energy_in_window)
        write_psf(psf, files[-1], {**psf_facts(psf), **camera_header(camera.model)}, "test")
    blur = read_psf(files[::-1])
    die = die_transfer("BAR", panel, camera.model)
    assert blur.pixel_um == 2
    # The light outside the window can change H by no more than its sum, and does by far less at most frequencies;
    # dots that the stop's rim cuts, which the die's transfer takes as their mean, change it by less than a hundredth.
    held = np.array(inside)[:, None, None]
    missed = {way: abs(blur.on((256, 256)) * held - StandingBlur(die, way).on((256, 256))) for way in STANDS.values()}
    assert (missed[0] < 1.01 - held).all()
    assert missed[0].mean() < 0.004
    assert min(missed, key=lambda way: missed[way].mean()) == 0


def test_dies_are_compared_on_one_scene_with_colours_by_its_chart(capsys, tmp_path):
    light = scene(144, 160, seed=6)
    light[:, :32, :] = 0.5
    spread = [(each + each[:, ::-1, ::-1]) / 2 for each in (kernel(), kernel(across=(0.1, 0.8, 0.1)))]
    for name, each, moved in (("a", spread[0], 0), ("b", spread[1], 3)):
        write_light(tmp_path / f"{name}.exr", np.roll(blurred(light, each), moved, axis=2))
        write_light(tmp_path / f"psf_{name}.exr", np.pad(each, [(0, 0), (8, 8), (8, 8)]))
    rows = ["row,column,size,red,green,blue"]
    for row, column in ((y, x) for y in (40, 56, 72) for x in (40, 56, 72)):
        red, green, blue = light[:, row, column]
        rows.append(f"{row - 0.5},{column - 0.5},8,{blue},{green},{red}")
    (tmp_path / "chart.csv").write_text("\n".join(rows), encoding="utf-8")
    psfs = ("--psf", tmp_path / "psf_a.exr", "--psf", tmp_path / "psf_b.exr")
    noise = ("--white", 1, "--gain", 1e5, "--read-noise", 1, "--restore", "wiener", "--epsilon", 1e-4)
    photos = (tmp_path / "a.exr", tmp_path / "b.exr")
    asked = ("restore", *photos, *psfs, *noise, "--chart", tmp_path / "chart.csv", "--register")
    document = command(capsys, *asked, "--out", tmp_path / "out", "--json").document
    (registered,) = document["registered"]
    assert registered["shift_right_px"] == pytest.approx(3, abs=0.05)
    assert registered["scale"] == pytest.approx(1, abs=1e-3)
    assert {"b_on_a.png", "b_on_a.exr"} <= {path.name for path in (tmp_path / "out").iterdir()}
    # Of a chart that is told with red and blue exchanged.
    assert np.array(document["chart"]["matrix"]) == pytest.approx(np.eye(3)[::-1], abs=0.05)
    assert [each["blur"][0] for each in document["photos"]] == [
        f"PSF measured, 25 x 25 pixels of psf_{name}.exr" for name in "ab"
    ]


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_a_photograph_is_written_as_it_is_seen_with_what_its_file_told(tmp_path, orientation):
    codes = np.moveaxis(np.rint(255 * scene() ** (1 / 2.2)).astype(np.uint8), 0, -1)
    exif = Image.Exif()
    exif[0x0112], exif[0x010F], exif[0x0110] = orientation, "Maker", "Model"
    for name, tag in (("lying", exif), ("plain", None)):
        Image.fromarray(codes).save(tmp_path / f"{name}.jpg", quality=95, **({"exif": tag} if tag else {}))
    spot = np.pad(np.ones((3, 1, 1)), ((0, 0), (4, 4), (4, 4)))
    psf = write_light(tmp_path / "psf.exr", spot)
    made = mf.restore([tmp_path / "lying.jpg", tmp_path / "plain.jpg"], psf=psf, trust=True, restore="wiener")
    made.save(tmp_path / "out")
    lying, plain = (Image.open(tmp_path / "out" / f"{name}.png") for name in ("lying", "plain"))
    turns = {3: 2, 6: 3, 8: 1}[orientation]
    assert np.array_equal(np.asarray(lying), np.rot90(np.asarray(plain), turns))
    assert (lying.getexif().get(0x010F), lying.getexif().get(0x0112, 1)) == ("Maker", 1)
    assert any("turned as its tag says" in each for each in made.photos[0].told)


def test_counts_that_lie_are_turned_and_keep_their_camera_and_time(tmp_path):
    light = np.random.default_rng(3).random((128, 192, 3))
    spec = oiio.ImageSpec(192, 128, 3, "uint16")
    for name, value in (("Orientation", 6), ("Model", "Model"), ("ExposureTime", 0.25)):
        spec.attribute(name, value)
    file = oiio.ImageOutput.create(str(tmp_path / "lying.tif"))
    file.open(str(tmp_path / "lying.tif"), spec)
    file.write_image(np.rint(60000 * light).astype(np.uint16))
    file.close()
    photo = read_photo(tmp_path / "lying.tif", Stated())
    assert (photo.orientation, photo.record.values.shape) == (6, (3, 128, 192))
    assert dict(photo.exif) == {"Model": "Model", "ExposureTime": 0.25}
    assert any("counts that grow as the light does" in each for each in photo.told)
