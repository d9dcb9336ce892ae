"""The table of restorers on photographs that tuned nothing, measured here and now: ``make bench``.

Arguments: folders of more photographs; ``count=5`` takes the first five; ``die=TOLED_R150``, ``level=24`` and
``light=code``, each as often as wanted, stand for the few that make no long bench; ``checkpoint=net.npz`` adds what
``maskfab learn`` made for a die. Strengths are tuned on one drawn
scene of another seed. Seconds are of the processor, for a million pixels.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
import numpy as np
from display.shapes import PUBLISHED
from PIL import Image, ImageDraw, ImageFont
from plug_and_play import PlugAndPlay

from maskfab.base.arrays import Singles
from maskfab.camera.imaging import Blur, Design
from maskfab.camera.protocol import AUTO, Protocol, evaluate
from maskfab.camera.record import Record, Restorer
from maskfab.camera.restorers import named
from maskfab.camera.restorers.choice import Choice
from maskfab.camera.scenes import Photograph, dead_leaves, folder, indoors, scene
from maskfab.camera.scores import MeanDifference, ScoreTable
from maskfab.display.pictures import read_picture
from maskfab.findings.photographs import Conditions, Surroundings, learned_restorers, read_checkpoints
from maskfab.mask.job import load_job
from maskfab.optics.colour import code_of_light

JOB = load_job(Path(__file__).parent.parent / "layouts" / "upc12.toml")
SIDE = 576
DATA = Path(matplotlib.get_data_path())


@dataclass(frozen=True)
class Timed:
    """A restorer, and the seconds of the processor that each photograph took it."""

    restorer: Restorer
    spent: list[tuple[int, float]] = field(default_factory=list)

    @property
    def seconds_of_a_megapixel(self) -> float:
        return 1e6 * sum(seconds for _, seconds in self.spent) / sum(pixels for pixels, _ in self.spent)

    @property
    def name(self) -> str:
        return self.restorer.name

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        start = time.process_time()
        prepared = self.restorer.prepare(record, blur)
        ready = time.process_time() - start

        def restored(epsilon: float) -> Singles:
            start = time.process_time()
            picture = prepared(epsilon)
            self.spent.append((record.values[0].size, ready + time.process_time() - start))
            return picture

        return restored


def page(seed: int) -> Singles:
    """A page of letters of 9 to 29 pixels, by chance."""
    draw, paper = np.random.default_rng(seed), Image.new("RGB", (SIDE, SIDE), (236, 234, 228))
    ink, top = ImageDraw.Draw(paper), 4
    while top < SIDE:
        size = int(draw.integers(9, 30))
        letters = "".join(chr(97 + int(each)) if each < 26 else " " for each in draw.integers(0, 31, 120))
        font = ImageFont.truetype(str(DATA / "fonts" / "ttf" / "DejaVuSerif.ttf"), size)
        ink.text((0, top), letters, font=font, fill=tuple(int(each) for each in draw.integers(0, 90, 3)))
        top += int(1.4 * size)
    return np.asarray(paper, dtype=np.float32) / 255


def chart(seed: int) -> Singles:
    """Patches and bars of 2 to 13 pixels on a ramp."""
    draw, ramp = np.random.default_rng(seed), np.linspace(0.1, 0.9, SIDE, dtype=np.float32)[:, None]
    picture = np.broadcast_to(ramp * np.array([1, 0.9, 0.7], dtype=np.float32), (SIDE, SIDE, 3)).copy()
    for row, column in np.ndindex(4, 6):
        picture[140 + 60 * row : 190 + 60 * row, 110 + 60 * column : 160 + 60 * column] = draw.uniform(0.02, 0.98, 3)
    for width in range(2, 14):
        bars = 0.05 + 0.9 * ((np.arange(30) // width) % 2)
        picture[400:460, 74 + 30 * width : 104 + 30 * width] = bars[:, None]
    return picture


def middle(picture: Singles) -> Singles:
    """At most 640 x 640 pixels of a picture [rows, columns, colours]."""
    top, left = (max(0, side - 640) // 2 for side in picture.shape[:2])
    return picture[top : top + 640, left : left + 640]


def photographs(folders: Sequence[str]) -> list[Photograph]:
    """Those of folders, and those that are at hand; none of them tuned a restorer."""
    found = {"hopper": read_picture(DATA / "sample_data" / "grace_hopper.jpg").values}
    highlights, capture = PUBLISHED.parent / "memorial.hdr", PUBLISHED.parent / "udc2020_toled_capture.png"
    if highlights.exists() and capture.exists():
        light = read_picture(highlights).values
        found["memorial"] = code_of_light(np.clip(light / np.quantile(light, 0.97), 0, 1).astype(np.float32))
        found["capture"] = read_picture(capture).values
    else:
        print(f"without the photographs of {PUBLISHED.parent}, which are not there")
    for seed in (501, 502):
        leaves = dead_leaves(seed, SIDE, SIDE)
        found[f"leaves{seed}"] = (leaves if seed % 2 else indoors(leaves)).values.transpose(1, 2, 0)
    found |= {"page": page(9), "chart": chart(5)}
    given = [each for path in folders for each in folder(path).photographs]
    return [*given, *(scene(name, middle(values)) for name, values in found.items())]


def measured(
    design: Design, protocol: Protocol, level: float, scenes: Sequence[Photograph], learned: Sequence[Restorer]
) -> list[float]:
    """Print the rows of a die at a level; the regret of every photograph."""
    tuning = [scene("tuning", dead_leaves(77, SIDE, SIDE).values.transpose(1, 2, 0))]

    def scored(restorers: Sequence[Restorer], *, choose: bool) -> ScoreTable:
        how = {"protocol": protocol, "restorers": restorers, "choose": choose, "details": False}
        return evaluate([design], scenes, tuning, [level], **how)

    own, others = [Timed(each) for each in named()], [Timed(each) for each in (PlugAndPlay(), *learned)]
    table, beside = scored(own, choose=True), scored(others, choose=False)
    seconds = {each.name: each.seconds_of_a_megapixel for each in (*own, *others)}
    record = protocol.photograph(design, scenes[0], level)
    epsilons = {score.restorer: score.epsilon for score in table.scores if score.restorer != AUTO}
    start = time.process_time()
    Choice(own, coded=protocol.linear).restore(record, design, epsilons)
    seconds[AUTO] = (time.process_time() - start) * 1e6 / record.values[0].size
    chosen = [score for score in table.scores if score.restorer == AUTO]
    light = "linear" if protocol.linear else "code"
    for name, spent in seconds.items():
        heights = [score.psnr for score in (*table.scores, *beside.scores) if score.restorer == name]
        ahead = MeanDifference.of([one - other.psnr for one, other in zip(heights, chosen, strict=True)])
        difference = "" if name == AUTO else ahead.told()
        print(
            f"{design.name:12} {level:3g} dB  {light:7} {name:13} {np.mean(heights):6.2f} dB  {difference:22} "
            f"{spent:6.1f} s",
            flush=True,
        )
    return [table.regret(score) for score in chosen]


def main(arguments: Sequence[str]) -> None:
    """Measure and print everything."""
    named_ones = [each.split("=", 1) for each in arguments if "=" in each]
    asked = {key: [value for name, value in named_ones if name == key] for key, _ in named_ones}
    scenes = photographs([each for each in arguments if "=" not in each])
    scenes = scenes[: int(asked.get("count", [len(scenes)])[0])]
    print(f"{len(scenes)} photographs: {', '.join(each.name for each in scenes)}")
    print("die, level, light, restorer, mean PSNR, behind (-) or ahead of auto, seconds for a million pixels")
    trained = read_checkpoints(asked.get("checkpoint", []))
    regrets = list[float]()
    for light in asked.get("light", ["linear"]):
        for level in map(float, asked.get("level", ["32"])):
            conditions = Conditions.of(JOB, "camera", [level], "code" if light == "code" else "linear")
            for die in asked.get("die", ["TOLED_P150", "FITS_M150"]):
                design, _ = conditions.design(die, JOB.panels()[die], Surroundings.of(JOB))
                own = [each for each in trained if each[1].trade.die == die]
                learned = learned_restorers(own, JOB, conditions, [design]).get(die, ())
                regrets += measured(design, conditions.protocol, level, scenes, learned)
    draws = np.random.default_rng(0).integers(0, len(scenes), (2000, len(scenes)))
    means = np.array(regrets).reshape(-1, len(scenes)).mean(axis=0)[draws].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    print(
        f"regret of auto against the best of each photograph: {np.mean(regrets):.2f} dB in the mean, "
        f"{low:.2f} to {high:.2f} by a bootstrap of the photographs, {max(regrets):.2f} at worst"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
