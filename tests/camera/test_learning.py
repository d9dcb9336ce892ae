"""A learned restorer: its network, its lessons, its training and its checkpoints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from maskfab.api.photographs import learn
from maskfab.base.errors import JobError, MaskfabError, OutputError, SourceError
from maskfab.base.files import save_state
from maskfab.camera import learning
from maskfab.camera.imaging import Margin
from maskfab.camera.learning import (
    ROW,
    Checkpoint,
    Course,
    Lesson,
    Lessons,
    Trade,
    Training,
    coded,
    kept_for_validation,
    mirrored,
)
from maskfab.camera.protocol import Protocol
from maskfab.camera.restorers.network import PLANES, Learned, Network, View, light_of, shown
from maskfab.camera.scenes import Photograph
from maskfab.optics.colour import code_of_light, light_of_code

SMALL = Course(widths=(8, 12), patch=(24, 32), first=1, known=2, fresh=3)
JOB = Path(__file__).parents[2] / "layouts" / "toled_against_ours.toml"


def striped(number: int) -> Lesson:
    """A random picture that was smeared along its rows; the second picture has what the first lacks."""
    draw = np.random.default_rng(number)
    true = draw.uniform(0.1, 0.9, (3, 40, 48)).astype(np.float32)
    smeared = (true + np.roll(true, 1, axis=2) + np.roll(true, -1, axis=2)) / 3
    planes = np.concatenate([smeared, true, np.full_like(true[:1], 0.05)])
    return Lesson(planes, code_of_light(light_of(true)))


def network(seed: int = 0) -> Network:
    """One that changes its input, as an untrained one does not."""
    torch.manual_seed(seed)
    made = Network(PLANES, (8, 12))
    torch.nn.init.normal_(made.leave.weight, std=0.1)
    return made


def trade(**changes: object) -> Trade:
    """That of no job."""
    known = Trade("job", "0" * 64, "A", "a camera", "a sensor", "linear light", (24, 32), (), np.ones((3, 32, 17)))
    return replace(known, **changes)  # type: ignore[arg-type]


def checkpoint(steps: int) -> Checkpoint:
    run = Training(SMALL, striped)
    for _ in range(steps):
        run.advance()
    return Checkpoint(trade(), SMALL, View({4000.0: 0.2}), 1.5, (dict.fromkeys(ROW, 2.0),), run.state())


def weights(run: Training) -> list[np.ndarray]:
    return [each.detach().numpy() for model in (run.network, run.mean) for each in model.parameters()]


@settings(max_examples=5, deadline=None)
@given(st.floats(1e-3, 1e3), st.integers(1, 21), st.integers(1, 21))
def test_a_network_scales_with_what_it_is_shown_whatever_its_sides(times: float, rows: int, columns: int) -> None:
    seen = torch.rand(1, PLANES, rows, columns)
    model = network()
    with torch.inference_mode():
        once, more = model(seen), model(times * seen)
    assert once.shape == (1, 3, rows, columns)
    assert not torch.allclose(once, seen[:, :3], atol=1e-4)
    torch.testing.assert_close(more, times * once, rtol=1e-4, atol=1e-4 * times)


def test_half_the_light_is_restored_to_half_the_light() -> None:
    light = np.random.default_rng(1).uniform(0.05, 0.4, (PLANES, 20, 28)).astype(np.float32)
    restorer = Learned(network(), View({1.0: 1.0}))
    whole, half = restorer.mended(shown(light)), restorer.mended(shown(light / 2))
    within = whole < 1
    assert within.mean() > 0.9
    np.testing.assert_allclose(half[within], whole[within] / 2, rtol=2e-4, atol=1e-6)


def test_moving_a_picture_by_a_block_moves_what_is_restored() -> None:
    seen = torch.zeros(1, PLANES, 96, 96)
    seen[..., 40:52, 40:52] = torch.rand(PLANES, 12, 12)
    model = network()
    with torch.inference_mode():
        here, there = model(seen), model(torch.roll(seen, (4, -4), (2, 3)))
    torch.testing.assert_close(there, torch.roll(here, (4, -4), (2, 3)), rtol=1e-4, atol=1e-5)


def test_what_is_shown_is_coded_as_srgb_codes_light() -> None:
    light = np.array([0, 1e-4, 1e-3, 3e-3, *np.linspace(0.01, 1, 100)], dtype=np.float32)
    found = coded(torch.from_numpy(shown(light))).numpy()
    np.testing.assert_allclose(found, code_of_light(light), atol=2e-6)


def test_an_untrained_network_changes_nothing_and_loses_nothing() -> None:
    run = Training(SMALL, striped)
    seen = striped(0).shown
    assert np.array_equal(Learned(run.mean, View({1.0: 1.0})).mended(seen), light_of(seen[:3]))
    whole = replace(SMALL, patch=(40, 48), first=1)
    assert Training(whole, striped).advance() == pytest.approx(1, abs=1e-4)


def test_training_takes_from_one_picture_what_the_other_lacks() -> None:
    run = Training(replace(SMALL, patch=(40, 48), fresh=1000), striped)
    for _ in range(60):
        run.advance()
    unseen = striped(77)
    before = np.square(code_of_light(light_of(unseen.shown[:3])) - unseen.true).mean()
    mended = Learned(run.mean, View({1.0: 1.0})).mended(unseen.shown)
    assert np.square(code_of_light(mended) - unseen.true).mean() < 0.9 * before


def test_training_goes_on_as_if_it_had_never_stopped(tmp_path: Path) -> None:
    straight = Training(SMALL, striped)
    for _ in range(8):
        straight.advance()
    # Lessons change after 3 and 6 steps: the second half begins among others than those of the first.
    checkpoint(4).write(tmp_path / "net.npz")
    resumed = Training(SMALL, striped)
    resumed.restore(Checkpoint.read(tmp_path / "net.npz").state)
    for _ in range(4):
        resumed.advance()
    assert resumed.step == 8
    assert all(np.array_equal(a, b) for a, b in zip(weights(straight), weights(resumed), strict=True))


def test_a_seed_is_a_network_and_another_seed_another() -> None:
    torch.manual_seed(5)
    drawn_outside = torch.rand(1)
    torch.manual_seed(5)
    one, same, other = (Training(replace(SMALL, seed=seed), striped) for seed in (0, 0, 1))
    assert torch.equal(torch.rand(1), drawn_outside)
    for run in (one, same, other):
        run.advance()
    assert all(np.array_equal(a, b) for a, b in zip(weights(one), weights(same), strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(weights(one), weights(other), strict=True))


def test_a_checkpoint_holds_every_bit(tmp_path: Path) -> None:
    made = checkpoint(3)
    made.write(tmp_path / "net.npz")
    read = Checkpoint.read(tmp_path / "net.npz")
    assert read.about() == made.about()
    assert read.state.keys() == made.state.keys()
    assert all(np.array_equal(read.state[name], array) for name, array in made.state.items())
    seen = striped(9).shown
    assert np.array_equal(read.restorer().mended(seen), made.restorer().mended(seen))
    assert [each.name for each in tmp_path.iterdir()] == ["net.npz"]


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"die": "B"}, "die A"),
        ({"camera": "another"}, "camera a camera"),
        ({"sensor": "another"}, "sensor a sensor"),
        ({"light": "code values taken for light"}, "light linear light"),
        ({"levels": (24, 40)}, "light of 24 dB, 32 dB"),
        ({"transfer": np.full((3, 32, 17), 0.99)}, "other openings"),
    ],
)
def test_a_checkpoint_is_refused_for_anything_else(changes: dict[str, object], told: str) -> None:
    trade().require(trade(levels=(32,), images=("other",), job="renamed", digest="1" * 64), "net.npz")
    with pytest.raises(JobError, match=f"MF148 .*{told}"):
        trade().require(trade(**changes), "net.npz")


@pytest.mark.parametrize(
    ("changes", "seed"), [({"levels": (24,)}, 0), ({"images": ("01",)}, 0), ({"die": "B"}, 0), ({}, 1)]
)
def test_training_goes_on_with_the_same_light_photographs_and_seed_alone(changes: dict[str, object], seed: int) -> None:
    made = checkpoint(0)
    made.require(trade(), 0, "net.npz")
    with pytest.raises(JobError, match="MF148"):
        made.require(trade(**changes), seed, "net.npz")


def cut_off(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1000])


def turned_bit(path: Path) -> None:
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 2] ^= 4
    path.write_bytes(whole)


def without_a_weight(path: Path) -> None:
    made = checkpoint(1)
    del made.state["mean_leave.weight"]
    made.write(path)


def not_finite(path: Path) -> None:
    made = checkpoint(1)
    made.state["mean_leave.weight"][:] = np.nan
    made.write(path)


def of_no_light(path: Path) -> None:
    replace(checkpoint(1), view=View({})).write(path)


def of_a_huge_network(path: Path) -> None:
    replace(checkpoint(1), course=replace(SMALL, widths=(8, 1_000_000))).write(path)


def of_another_probe(path: Path) -> None:
    replace(checkpoint(1), trade=trade(transfer=np.ones((3, 2, 2)))).write(path)


def array_alone(path: Path) -> None:
    with path.open("wb") as file:
        np.save(file, np.zeros(3))


def of_another_kind(path: Path) -> None:
    save_state(path, "an opening", {"logits": np.zeros(3)})


@pytest.mark.parametrize(
    ("damage", "code"),
    [
        (Path.unlink, "MF301"),
        (cut_off, "MF303"),
        (turned_bit, "MF303"),
        (lambda path: path.write_bytes(b""), "MF303"),
        (array_alone, "MF303"),
        (without_a_weight, "MF303"),
        (not_finite, "MF303"),
        (of_no_light, "MF303"),
        (of_a_huge_network, "MF303"),
        (of_another_probe, "MF303"),
        (of_another_kind, "MF304"),
    ],
)
def test_a_file_that_is_no_whole_checkpoint_is_refused(
    tmp_path: Path, damage: Callable[[Path], object], code: str
) -> None:
    path = tmp_path / "net.npz"
    checkpoint(1).write(path)
    damage(path)
    with pytest.raises(SourceError, match=code):
        Checkpoint.read(path)


class _Everything:
    """A view that shows what was recorded."""

    def planes(self, record: object, _: object) -> np.ndarray:
        return np.repeat(record.values[:1], PLANES, axis=0)  # type: ignore[attr-defined]


class _Open:
    """No panel."""

    name, transmission = "open", 0.2072

    def on(self, shape: tuple[int, int]) -> np.ndarray:
        return np.ones((3, shape[0], shape[1] // 2 + 1), dtype=np.float32)

    def blurred(self, light: np.ndarray, margin: Margin) -> np.ndarray:
        return margin.through(light, self.on(margin.shape))


@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def test_a_network_has_its_way_as_far_as_the_die_passes_nothing(share: float) -> None:
    class Grey(_Open):
        def on(self, shape: tuple[int, int]) -> np.ndarray:
            return np.float32(share**0.5) * super().on(shape)

    planes = np.random.default_rng(3).uniform(0.3, 0.8, (PLANES, 80, 96)).astype(np.float32)
    restorer = Learned(network(), View({1.0: 1.0}))
    before, mended = light_of(planes[:3]), restorer.mended(planes)
    expected = np.clip(mended + share / (share + 0.03) * (before - mended), 0, 1)
    assert abs(before - mended).max() > 0.05
    np.testing.assert_allclose(restorer.restored(planes, Grey()), expected, atol=2e-6)


def test_lessons_are_the_same_in_any_order_and_mix_drawn_scenes_and_photographs() -> None:
    own = Photograph("own", 1, np.linspace(0, 1, 3 * 536 * 544, dtype=np.float32).reshape(3, 536, 544))
    lessons = Lessons(Protocol("camera"), _Open(), (24, 40), _Everything(), (own,), shape=(528, 528))  # type: ignore[arg-type]
    first = [lessons(number) for number in range(4)]
    assert np.array_equal(lessons(1).shown, first[1].shown)
    assert [each.true.shape[1] for each in first] == [16, 24, 16, 24]
    turned = own.values[:, 256:-256, 256:-256]
    ways = [turned[:, ::down, ::across] for down in (1, -1) for across in (1, -1)]
    assert all(any(np.array_equal(each.true, way) for way in ways) for each in first[1::2])
    dark, bright = (np.square(lessons.of(own, level).shown[0] - light_of_code(turned[0])).mean() for level in (24, 40))
    assert dark > 10 * bright


def test_nothing_that_is_learned_from_is_judged_by() -> None:
    photographs = [Photograph(name, k, np.zeros((3, 8, 8), dtype=np.float32)) for k, name in enumerate("abc")]
    small = (64, 64)
    kept, others = kept_for_validation(photographs, 2, small)
    assert [each.name for each in others] == ["a", "b"]
    assert kept[-1].name == "c"
    assert kept_for_validation(photographs[:1], 0, small)[1] == photographs[:1]
    # The scenes that simulate draws have the numbers from 1 on, those that are learned from begin at ten million.
    assert all(1000 < each.number < 10_000_000 for each in kept[:2])
    # Exposures are merged for highlights alone.
    assert max(each.light.max() for each in kept[:2]) <= 1
    assert kept_for_validation((), 1, small, lamps=True)[0][0].light.max() > 1


def test_a_mirrored_photograph_keeps_its_light() -> None:
    light = np.random.default_rng(2).uniform(0, 3, (3, 6, 8)).astype(np.float32)
    made = [mirrored(Photograph("hdr", 1, code_of_light(light), light), seed) for seed in range(12)]
    assert all(np.array_equal(code_of_light(each.light), each.values) for each in made)
    assert len({each.light.tobytes() for each in made}) == 4


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        ({}, "MF105", "2 dies"),
        ({"die": "NONE"}, "MF105", "no die 'NONE'"),
        ({"die": "TOLED", "minutes": 0.0}, "MF105", "0 minutes"),
        ({"die": "TOLED", "minutes": float("nan")}, "MF104", "nan is not finite"),
        ({"die": "TOLED", "device": "abacus"}, "MF105", "abacus"),
        ({"die": "TOLED", "out": "nowhere/net.npz"}, "MF401", "cannot be written"),
        ({"die": "TOLED", "images": "nowhere"}, "MF301", "no photographs"),
        ({"die": "TOLED", "white": 2.0}, "MF105", "stated as white"),
    ],
)
def test_bad_input_is_refused_before_anything_is_trained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: dict[str, object], code: str, told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(learning.Training, "advance", lambda _: pytest.fail("it was trained"))
    with pytest.raises(MaskfabError, match=f"{code} .*{told}") as refused:
        learn(JOB, **({"out": "net.npz"} | arguments))  # type: ignore[arg-type]
    assert isinstance(refused.value, JobError | OutputError | SourceError)
    assert not list(tmp_path.iterdir())
