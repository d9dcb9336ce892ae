"""The gain by photon transfer against the one that frames were drawn with."""

from __future__ import annotations

import numpy as np
import pytest
from capture_frames import GAIN, READ_NOISE, frame

from maskfab.base.errors import SourceError
from maskfab.camera.frames.stack import photon_transfer

SIDE = 160
RAMP = np.broadcast_to(np.linspace(200.0, 9000.0, SIDE), (SIDE, SIDE))
EVEN = np.full((SIDE, SIDE), 5000.0)


def pair(light, draw, second=1.0):
    return [frame(light * each, 1.0, draw) for each in (1.0, second)]


@pytest.mark.parametrize("light", [RAMP, EVEN], ids=["ramp", "even"])
def test_gain_and_read_noise_scatter_as_their_errors_say_about_the_truth(light):
    off, noise_off, errors = [], [], []
    for seed in range(24):
        draw = np.random.default_rng(seed)
        # A lamp that drifts by three hundredths does not show.
        found = photon_transfer(pair(light, draw, 1.03), pair(0 * light, draw))
        errors.append(found.error / GAIN)
        off.append((found.electrons_per_count - GAIN) / found.error)
        noise_off.append((found.read_noise_e - READ_NOISE) / found.read_noise_error_e)
        assert found.misfit < 2.5
    assert max(errors) < 0.015  # of so few pixels; it goes down with their root
    for scatter in (off, noise_off):
        assert abs(np.mean(scatter)) < 4 / np.sqrt(24)
        assert 0.5 < np.std(scatter) < 1.5


def test_more_frames_and_pictures_tell_more():
    draw = np.random.default_rng(1)
    two = photon_transfer(pair(RAMP, draw))
    eight = photon_transfer([each for _ in range(4) for each in pair(RAMP, draw)])
    assert eight.error == pytest.approx(two.error / np.sqrt(7), rel=0.15)
    assert eight.electrons_per_count == pytest.approx(GAIN, abs=4 * eight.error)


def test_read_noise_would_flatten_a_line_through_the_noisy_means_themselves():
    """As it would an even light of few electrons; the light beside a pixel knows nothing of its noise."""
    faint = np.broadcast_to(np.linspace(10.0, 60.0, SIDE), (SIDE, SIDE))
    draw = np.random.default_rng(5)
    found = [photon_transfer(pair(faint, draw), pair(0 * faint, draw)) for _ in range(12)]
    mean = np.mean([each.electrons_per_count for each in found])
    assert mean == pytest.approx(GAIN, abs=4 * found[0].error / np.sqrt(12))


def test_pixels_that_jump_and_full_pixels_do_not_count():
    draw = np.random.default_rng(2)
    frames, dark = pair(RAMP, draw), pair(0 * RAMP, draw)
    frames[1].counts[5::20, 7::20] += 3000
    frames[0].counts[100:110, 100:110] = frames[0].white
    found = photon_transfer(frames, dark)
    assert found.electrons_per_count == pytest.approx(GAIN, abs=4 * found.error)


def test_frames_that_cannot_tell_a_gain_are_refused():
    draw = np.random.default_rng(3)
    one, two = frame(RAMP, 1.0, draw), frame(RAMP, 2.0, draw)
    for frames, dark in (([], ()), ([one], ()), ([one, two], ()), (pair(RAMP, draw), [one]), (pair(EVEN, draw), ())):
        with pytest.raises(SourceError, match="MF335") as caught:
            photon_transfer(frames, dark)
        assert caught.value.cure
