"""Expected errors of the Wiener filter: as the mean of many draws has them, and ε as a scan of all has it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from once import dimmed, leaves
from scipy import integrate, stats

from maskfab.camera import expected
from maskfab.camera.expected import Still, Stills, weights
from maskfab.camera.imaging import Margin
from maskfab.camera.protocol import STRENGTHS, Protocol, evaluate
from maskfab.camera.record import Noise
from maskfab.camera.restorers.wiener import Wiener, prior, wiener
from maskfab.camera.scenes import lit
from maskfab.camera.stop_cells import lay
from maskfab.job.camera import Sensor
from maskfab.optics.colour import code_of_light

LIGHT, CODE = Protocol("camera"), Protocol("code", linear=False)


@pytest.fixture(scope="module")
def bar():
    unit = np.zeros((21, 21), dtype=np.bool_)
    unit[:6, :17] = True
    return lay("bar", unit)


@pytest.fixture(scope="module")
def scenes():
    return leaves(1, 704, 768), dimmed(leaves(2, 704, 768))


def stills_of(protocol, design, scenes, low, high):
    seen = {k: Still.of(scene.true, protocol.seen(design, scene)) for k, scene in enumerate(scenes)}
    return Stills.of(design, seen, (low, high), linear=protocol.linear)


def drawn_errors(protocol, design, scene, level, epsilon, count):
    """Mean squared error of so many draws of the noise."""
    errors = []
    for k in range(count):
        record = protocol.photograph(design, replace(scene, number=scene.number + 1000 * k), level)
        picture = protocol.shown(Wiener().prepare(record, design)(epsilon))
        errors.append(np.square(picture - scene.true).mean(dtype=np.float64))
    return np.array(errors)


def against_draws(protocol, design, scenes, level, epsilon, count):
    """By scene: how far the expected PSNR lies from that of the draws' mean error, and its standard error, dB."""
    stills = stills_of(protocol, design, scenes, epsilon, epsilon)
    noise = protocol.noise([still.seen for still in stills.stills.values()], design, level)
    known, found = dict(stills.psnrs(stills.stills, epsilon, noise, 64)), []
    for k, scene in enumerate(scenes):
        errors = drawn_errors(protocol, design, scene, level, epsilon, count)
        to_db = 10 / np.log(10) / errors.mean()
        drawn = -10 * np.log10(errors.mean())
        found.append((known[k][0] - drawn, to_db * errors.std(ddof=1) / count**0.5))
    return found


@pytest.mark.parametrize(("protocol", "level", "epsilon"), [(LIGHT, 24, 0.4), (LIGHT, 40, 0.01), (CODE, 32, 0.02)])
def test_the_expected_error_is_that_of_some_draws(bar, scenes, protocol, level, epsilon):
    for off, standard in against_draws(protocol, bar, scenes, level, epsilon, 8):
        assert abs(off) < 0.02 + 3 * standard


@pytest.mark.slow
@pytest.mark.parametrize(("protocol", "level", "epsilon"), [(LIGHT, 24, 0.4), (LIGHT, 40, 0.01), (CODE, 32, 0.02)])
def test_the_expected_error_is_the_mean_of_200_draws(bar, scenes, protocol, level, epsilon):
    for off, standard in against_draws(protocol, bar, scenes, level, epsilon, 200):
        assert standard < 0.01
        assert abs(off) < 0.005 + 2 * standard


@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize(("mean", "spread"), [(0.0, 0.02), (-0.05, 0.1), (0.004, 0.003), (0.5, 0.05), (0.98, 0.3)])
def test_tables_hold_the_integrals_over_normal_light(linear, mean, spread):
    def code(light):
        return float(code_of_light(np.array([light]))[0]) if linear else min(max(light, 0.0), 1.0)

    def over(power):
        edges = [each for each in (0.0, 0.0031308, 1.0) if abs(each - mean) < 8 * spread]
        span = mean - 8 * spread, mean + 8 * spread
        density = stats.norm(mean, spread).pdf
        return integrate.quad(lambda x: code(x) ** power * density(x), *span, points=edges, limit=200)[0]

    table = expected._of_normal(linear).reshape(len(expected._SPREADS), -1)
    means, ratios = table.real, table.imag
    lights = expected._LEAST + np.arange(means.shape[1]) / expected._PER_LIGHT

    def told(table):
        rows = [np.interp(mean, lights, row) for row in table]
        return float(np.interp(np.log(spread), np.log(expected._SPREADS), rows))

    assert told(means) == pytest.approx(over(1), abs=3e-4)
    assert told(ratios) * spread**2 == pytest.approx(over(2) - over(1) ** 2, rel=0.01)


def test_a_filter_is_a_sum_of_its_neighbours(bar):
    nodes, shape = (0.01, 0.032, 0.1), (192, 256)
    transfer, below = bar.on(shape), prior(shape)
    known = [wiener(transfer, below, node) for node in nodes]
    for k, node in enumerate(nodes):
        np.testing.assert_allclose(weights(node, nodes), np.eye(3)[k], atol=1e-9)
    for epsilon in (0.016, 0.05):
        mixed = weights(epsilon, nodes)
        assert mixed.sum() == pytest.approx(1, abs=1e-12)
        wanted = wiener(transfer, below, epsilon)
        found = np.tensordot(mixed, known, axes=1)
        assert abs((found - wanted) * transfer).max() < 0.02


@pytest.mark.parametrize("phase", [False, True])
def test_few_pixels_are_those_of_the_whole_picture(phase):
    draw = np.random.default_rng(5)
    margin, values = Margin((96, 160), 16), draw.random((1, 64, 128), dtype=np.float32)
    gain = np.fft.rfft2(draw.random((1, 96, 160))).astype(np.complex64) / 100
    gain = gain if phase else gain.real.copy()
    spectrum = margin.mirrored(values)
    (waves,) = expected._summed(np.ascontiguousarray(gain.swapaxes(1, 2)), spectrum[0].T)
    whole = margin.blurred(spectrum, gain)
    np.testing.assert_allclose(margin.few(waves, 4), whole[0, ::4, ::4], atol=1e-4 * abs(whole).max())


def test_products_of_filters_are_those_of_their_spreads():
    gains = [np.random.default_rng(seed).random((12, 9), dtype=np.float32) for seed in (1, 2)]
    one, other = (np.fft.irfft2(gain, (12, 16)) for gain in gains)
    # A column that stands for itself holds no more than its even part.
    even = [np.fft.rfft2(each) for each in (one, other)]
    products = expected._products(np.stack([each.T for each in even]))
    assert products[0, 1] == pytest.approx((one * other).sum(), rel=1e-5)


@pytest.mark.parametrize("levels", [(24, 32, 40), (40,)])
def test_the_strength_chosen_is_the_best_of_all(bar, scenes, levels):
    """Of one pixel of 16, as it is chosen by; where two are alike within 0.02 dB, either may be."""
    scores = evaluate([bar], scenes, scenes, levels, protocol=LIGHT, details=False, expected=True).scores
    light = {k: Still.of(scene.true, LIGHT.seen(bar, scene)) for k, scene in enumerate(scenes)}
    for level in levels:
        noise = LIGHT.noise([still.seen for still in light.values()], bar, level)
        chosen = STRENGTHS.index(next(score.epsilon for score in scores if score.level_db == level))
        # Two nodes that are each a strength of the grid restore by it exactly.
        heights = []
        for epsilon in STRENGTHS[max(0, chosen - 6) : chosen + 7]:
            exact = Stills.of(bar, light, (epsilon, epsilon * 1.01), linear=True)
            heights.append(exact.height(light, noise, epsilon))
        assert max(heights) - heights[min(6, chosen)] < 0.02 * len(scenes)


def test_a_strength_far_from_the_usual_is_found(bar, scenes):
    """In so much read noise more than ten times the usual strength is best, and a draw of it says so too."""
    noisy = Protocol("camera", Sensor(read_noise=60))
    given = [bar], scenes, scenes, (24,)
    known, drawn = (
        evaluate(*given, protocol=noisy, details=False, expected=asked).scores[0] for asked in (True, False)
    )
    usual = STRENGTHS[noisy.start(noisy.exposure(24).behind(bar.transmission))]
    assert known.epsilon > 4 * usual
    assert abs(STRENGTHS.index(known.epsilon) - STRENGTHS.index(drawn.epsilon)) <= 1


def test_expected_scores_are_those_of_a_draw_within_it(bar, scenes):
    given = [bar], scenes, scenes, (24, 40)
    known = evaluate(*given, protocol=LIGHT, expected=True).scores
    for one, other in zip(known, evaluate(*given, protocol=LIGHT).scores, strict=True):
        assert one.psnr == pytest.approx(other.psnr, abs=0.1)
        assert one.psnr != other.psnr
        assert (one.drawn, other.drawn) == (False, True)
        if one.epsilon == other.epsilon:
            # What is not expected is of that draw.
            assert (one.ssim, one.delta_e) == (other.ssim, other.delta_e)


@pytest.mark.parametrize(
    "protocol",
    [
        Protocol("camera", Sensor(mosaic="rggb")),
        Protocol("camera", Sensor(bits=10)),
        Protocol("camera", Sensor(banding=1.0)),
        Protocol("camera", brackets=(1, 4)),
    ],
    ids=["mosaic", "codes", "banding", "brackets"],
)
def test_noise_that_is_not_known_is_drawn(bar, scenes, protocol):
    shown = tuple(map(lit, scenes[:1])) if protocol.brackets else scenes[:1]
    assert protocol.noise([protocol.seen(bar, scene) for scene in shown], bar, 40) is None
    given = [bar], shown, shown, (40,)
    known, drawn = (evaluate(*given, protocol=protocol, details=False, expected=asked) for asked in (True, False))
    assert known == drawn
    assert [score.drawn for score in known.scores] == [True]
    assert not known.noise_told


def test_light_near_a_full_well_is_drawn(bar, scenes):
    sensor = Sensor()
    full = sensor.full_well / LIGHT.exposure(40).behind(bar.transmission)
    shares = {share: LIGHT.noise([np.full((3, 2, 2), share * full)], bar, 40) for share in (0.95, 0.97, 1.1)}
    assert shares[0.95].electrons == pytest.approx(sensor.full_well / full)
    assert shares[0.97] is shares[1.1] is None


@pytest.mark.parametrize(("rows", "step"), [(704, 1), (1024, 2)])
def test_restored_light_is_the_filter_s(bar, rows, step):
    """Without noise the expected error is that of the restored picture, but for the tables' steps.

    Of a sensor of 512 rows every second one is scored, of fewer each.
    """
    scene, epsilon = leaves(1, rows, 768), 0.01
    stills = stills_of(CODE, bar, (scene,), epsilon, epsilon)
    light = stills.stills[0].seen
    margin = Margin.around(light)
    gains = wiener(bar.on(margin.shape), prior(margin.shape), epsilon)
    picture = np.clip(margin.blurred(margin.mirrored(light), gains), 0, 1)
    squares = np.square(picture - scene.true)[:, ::step]
    wanted = [-10 * np.log10(each.mean()) for each in (squares, squares[:, 64 // step : -64 // step, 64:-64])]
    assert dict(stills.psnrs([0], epsilon, Noise(1e9, 0.0), 64))[0] == pytest.approx(wanted, abs=3e-3)
