"""Analog gain: noise against its two stages, the gain that light picks, rows, and the ISO of files."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.fft
from dng_files import write_dng
from hypothesis import given, settings
from hypothesis import strategies as st
from once import leaves

from maskfab.api.camera import protocol_f1
from maskfab.base.errors import JobError
from maskfab.camera.frames.frame import Frame, read_frame
from maskfab.camera.photo import Stated, read_photo
from maskfab.camera.protocol import Protocol, evaluate
from maskfab.camera.scenes import lit
from maskfab.camera.sensor import (
    ELECTRONS,
    Exposure,
    counted,
    picked_gains,
    poisson_quantile,
    record_light,
    sensor_words,
    stated_light,
    told_gains,
)
from maskfab.camera.stop_cells import lay
from maskfab.job.camera import Sensor

FLAT = np.full((3, 160, 160), 0.3, dtype=np.float32)
BAR = lay("bar", np.pad(np.ones((6, 17), dtype=np.bool_), ((0, 15), (0, 4))))


@settings(max_examples=20, deadline=None)
@given(
    gain=st.floats(1, 12),
    early=st.floats(0, 8),
    late=st.floats(0, 40),
    bits=st.sampled_from([None, 8, 10, 14]),
    white=st.floats(60, 900),
)
def test_variance_is_that_of_noise_before_and_after_the_amplifier(gain, early, late, bits, white):
    black = 0 if bits is None else 2 ** (bits - 3)  # deep enough that the dark is not cut
    sensor = Sensor(read_noise=early, converter_noise=late, bits=bits, black_level=black, gain=gain)
    found = record_light(sensor, FLAT, white, 3)
    step = 0.0 if bits is None else 15506 / (2**bits - 1 - black)
    wanted = (0.3 * white + early**2 + late**2 / gain**2 + step**2 / 12 / gain**2) / white**2
    assert float(found.noise.variance(np.float32(0.3))) == pytest.approx(wanted, rel=1e-5)
    if (early**2 + late**2 / gain**2 + 0.3 * white) ** 0.5 > step / gain:  # else rounding is no noise of its own
        assert found.values.var(dtype=np.float64) == pytest.approx(wanted, rel=5 * math.sqrt(2 / FLAT.size) + 0.002)
        assert found.values.mean(dtype=np.float64) == pytest.approx(0.3, abs=5 * math.sqrt(wanted / FLAT.size))


@pytest.mark.parametrize("bits", [None, 10])
@pytest.mark.parametrize("mosaic", ["none", "rggb"])
def test_base_gain_records_what_a_sensor_without_gain_did(bits, mosaic):
    """Drawn by hand as the sensor did before it had a gain: the same numbers, bit by bit."""
    sensor, white = Sensor(bits=bits, mosaic=mosaic, gain=None if bits is None else 1.0), 900.0
    taken = record_light(sensor, FLAT, white, 7).values
    draw = np.random.default_rng(7)
    seen = FLAT if mosaic == "none" else FLAT[0]
    normal, read = (draw.standard_normal(seen.shape, dtype=np.float32) for _ in range(2))
    counts = poisson_quantile(seen.ravel() * np.float32(white), normal.ravel()).reshape(seen.shape)
    counts += np.float32(4.87) * read
    np.minimum(counts, np.float32(15506), out=counts)
    if bits is not None:
        step = np.float32(15506 / (2**bits - 1))
        counts = np.clip(np.rint(counts / step), 0, 2**bits - 1) * step
    counts /= np.float32(white)
    if mosaic == "none":
        np.testing.assert_array_equal(taken, counts)
    else:
        np.testing.assert_array_equal(taken[0, ::2, ::2], counts[::2, ::2])


def test_without_a_converter_no_gain_is_picked_and_facts_are_those_before():
    assert Sensor().gain_for(10.0) == 1.0
    assert picked_gains(Sensor(), (24, 40)) == []
    assert told_gains(Sensor(), (24,)) == ""
    before = {"full_well": 15506.0, "read_noise": 4.87, "bits": None, "black_level": 0, "mosaic": "none"}
    assert Sensor().facts == before
    assert sensor_words(Sensor()) == "full well 15506 electrons, read noise 4.87 electrons"


@settings(max_examples=40, deadline=None)
@given(
    white=st.floats(1, 15_000),
    most=st.floats(1, 64),
    well=st.floats(16_000, 60_000),
    late=st.sampled_from([None, 30.0]),
)
def test_the_gain_that_is_picked_is_the_largest_at_which_white_fits(white, most, well, late):
    sensor = Sensor(full_well=well, bits=10, max_gain=most, converter_noise=late)
    gain = sensor.gain_for(white)
    assert 1 <= gain <= most
    needed = white + 3 * math.sqrt(white + 4.87**2 + (late or 0) ** 2)
    if gain > 1:
        assert needed <= well / gain * (1 + 1e-12)
    if 1 < gain < most:
        assert needed > well / (gain * 1.001)


def test_white_of_a_picked_gain_is_recorded_unclipped():
    sensor, white = Sensor(bits=8), float(ELECTRONS[32])
    light = np.ones((3, 200, 200), dtype=np.float32)
    found = record_light(sensor, light, white, 1)
    assert found.ceiling == pytest.approx((white + 3 * math.sqrt(white + 4.87**2)) / white, rel=1e-5)
    assert found.clipped.mean() < 0.004  # what lies beyond three standard deviations, and half a code
    assert found.values.mean() == pytest.approx(1, abs=1e-3)
    assert record_light(Sensor(bits=8, gain=20.0), light, white, 1).clipped.all()


def test_eight_bits_in_the_dark_lose_next_to_nothing():
    """At 24 dB a largest code of a full well lost most of 8 dB; a camera amplifies until it loses a fraction of one."""
    scene = leaves(1)

    def psnr(sensor):
        table = evaluate([BAR], [scene], [scene], (24,), protocol=Protocol("camera", sensor), details=False)
        return table.scores[0].psnr

    endless = psnr(Sensor())
    assert endless - psnr(Sensor(bits=8)) < 0.3
    assert endless - psnr(Sensor(bits=8, gain=1.0)) > 4


def test_brackets_share_the_gain_of_the_longest_and_keep_their_highlights():
    protocol = Protocol("camera", Sensor(bits=12), brackets=(1, 16))
    scene = lit(leaves(1))
    seen = np.full((3, 32, 32), 6.0, dtype=np.float32)
    record = protocol.record(seen, BAR, scene, 32)
    assert record.values.mean() == pytest.approx(6, rel=0.02)
    assert not record.clipped.any()


def test_banding_has_its_deviation_and_is_one_number_for_each_row():
    """In the spectrum of rows, all of it stands at no frequency along them, even across them."""
    light, rows, columns = np.full((3, 2048, 64), 0.5, dtype=np.float32), 2048, 64
    plain, striped = (record_light(Sensor(read_noise=2.0, banding=rms), light, 1000.0, 5).values for rms in (None, 6.0))
    added = (striped - plain) * 1000
    assert np.ptp(added, axis=2).max() < 1e-3
    np.testing.assert_allclose(added[0], added[2], atol=1e-3)
    assert added[0, :, 0].std() == pytest.approx(6, rel=5 / math.sqrt(2 * rows))
    power = abs(scipy.fft.fft2(added[0])) ** 2 / (rows * columns)
    assert power[:, 1:].max() < 1e-3
    along = power[1 : rows // 2, 0].reshape(-1, 341).mean(axis=1)
    assert along == pytest.approx(np.full(3, 36 * columns), rel=5 / math.sqrt(341))
    noise = record_light(Sensor(read_noise=2.0, banding=6.0), light, 1000.0, 5).noise
    assert float(noise.floor) == pytest.approx((4 + 36) / 1e6)


def test_a_stated_gain_lowers_the_light_that_is_held():
    sensor = Sensor(bits=10, iso=400, base_iso=100)
    assert sensor.stated_gain == 4
    held, words = stated_light(None, sensor, protocol_f1().model)
    assert held[-1] < 40
    assert "3876.5 electrons" in words
    with pytest.raises(JobError, match=r"MF141.*largest code at a gain of 4 is 3876.5.*less gain"):
        Exposure.of_white(4000, sensor)
    assert "analog gain 4 (ISO 400)" in sensor_words(sensor)


def test_a_picked_gain_is_told_with_its_levels():
    words = told_gains(Sensor(bits=10, max_gain=8), (24, 40))
    assert "at most 8: 8 at 24 dB, 1.5 at 40 dB behind the published display" in words


# --- files ----------------------------------------------------------------------------------------------------------


def frame(iso):
    return Frame("leaf.dng", np.zeros((4, 4), np.float32), (64.0,), 1023.0, sensitivity=iso)


def test_electrons_of_a_count_are_the_full_well_over_gain_and_codes():
    """By an ISO that is stated, or the file's over that of base gain; noise after the amplifier counts as little."""
    stated = Sensor(full_well=6000, read_noise=2.0, converter_noise=8.0, bits=10, black_level=64, gain=4.0)
    by_file = Sensor(full_well=6000, read_noise=2.0, converter_noise=8.0, bits=10, black_level=64, base_iso=50)
    for known in (counted(stated, frame(None)), counted(by_file, frame(200))):
        assert known == pytest.approx((6000 / 4 / (1023 - 64), math.sqrt(4 + 4)))
    assert stated.amplified(4.0).step == pytest.approx(6000 / 4 / (1023 - 64))
    assert counted(None, frame(200)) is None
    assert counted(by_file, frame(None)) is None
    assert counted(Sensor(gain=4.0), frame(None)) is None


@pytest.mark.parametrize(
    ("sensor", "iso"),
    [
        (Sensor(bits=10, iso=100, base_iso=50), 400),
        (Sensor(bits=10, gain=2, base_iso=50), 200),
        (Sensor(bits=10, base_iso=100), 50),
    ],
)
def test_an_iso_that_contradicts_the_sensor_is_named(sensor, iso):
    with pytest.raises(JobError, match=rf"MF185.*leaf.dng says that it was taken at ISO {iso}"):
        counted(sensor, frame(iso))


def test_isos_of_a_third_of_a_stop_are_one_however_they_are_rounded():
    assert counted(Sensor(bits=10, iso=125, base_iso=100), frame(126)) is not None


def test_a_coded_pictures_iso_is_held_against_the_sensor(tmp_path):
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    path = tmp_path / "leaf.jpg"
    spec = oiio.ImageSpec(144, 144, 3, "uint8")
    spec.attribute("Exif:PhotographicSensitivity", 800)
    image = oiio.ImageOutput.create(str(path))
    image.open(str(path), spec)
    image.write_image(np.random.default_rng(1).integers(40, 200, (144, 144, 3)).astype(np.uint8))
    image.close()
    assert read_photo(path, Stated(sensor=Sensor(iso=800, base_iso=100))).record.values.shape == (3, 144, 144)
    with pytest.raises(JobError, match=r"MF185.*leaf.jpg.*ISO 800.*ISO 100"):
        read_photo(path, Stated(sensor=Sensor(iso=100, base_iso=100)))


def test_a_photographs_iso_is_read_and_its_noise_is_the_sensors(tmp_path):
    draw = np.random.default_rng(1)
    counts = (64 + draw.integers(200, 600, (128, 128))).astype(np.uint16)
    path = tmp_path / "leaf.dng"
    write_dng(path, counts, black=64, white=1023, iso=320)
    assert read_frame(path).sensitivity == 320
    sensor = Sensor(full_well=6000, read_noise=2.0, bits=10, black_level=64, base_iso=80)
    photo = read_photo(path, Stated(sensor=sensor))
    assert photo.record.noise.electrons == pytest.approx(1500)
    assert photo.record.noise.read_noise == 2
    assert any("noise by [sensor]" in sentence for sentence in photo.told)
    with pytest.raises(JobError, match=r"MF185.*ISO 320.*ISO 80"):
        read_photo(path, Stated(sensor=Sensor(bits=10, iso=80, base_iso=80)))
    own = read_photo(path, Stated(electrons_per_count=3.0, read_noise_e=1.0, sensor=sensor))
    assert own.record.noise.electrons == pytest.approx(3 * (1023 - 64))
