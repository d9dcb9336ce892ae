"""The table of ``restore``'s verdicts behind right and wrong dies: ``python tests/judge_table.py FOLDER``.

Arguments: folders of photographs; ``draws=200``, ``seed=1``, ``side=384`` and ``wrong=0.5``, the share of draws that
are judged by another die than the one they were taken through. Without a folder scenes are drawn. Each draw is a die
of ``layouts/upc12.toml``, a stop from f/1.6 to f/8, a photograph and a signal-to-noise ratio of white. Point spreads
come from a simulator that shares no optics with the package, and are kept in a folder (``keep=FOLDER``).
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import gettempdir

import numpy as np
from capture_simulator import Dots, Optics, picture
from PIL import Image
from scipy import signal

import maskfab as mf
from maskfab.base.arrays import Singles
from maskfab.camera.blur import StandingBlur
from maskfab.camera.die_transfer import die_transfer
from maskfab.camera.explained import FOREIGN, Explained
from maskfab.camera.imaging import Blur, MadeBlur
from maskfab.camera.photo import Photo, restored_light
from maskfab.camera.record import Noise, Record
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scenes import dead_leaves, indoors, picture_files
from maskfab.mask.job import load_job
from maskfab.optics.colour import light_of_code

JOB = load_job(Path(__file__).parent.parent / "layouts" / "upc12.toml")
LINES, FOCAL_MM, PIXEL_UM, READ_E = (610.0, 530.0, 470.0), 10.0, 2.0, 4.87
STOPS, LEVELS_DB, PIXELS = (1.6, 2.5, 4.0, 6.25, 8.0), (20, 28, 36), 513
EDGE = 16


@dataclass(frozen=True)
class Draw:
    """One photograph through a die, judged by what is said to be its die."""

    scene: str
    die: str
    said: str
    f_number: float
    level_db: int

    def __str__(self) -> str:
        return f"{self.scene:12} {self.die:11} {self.said:11} f/{self.f_number:<5g} {self.level_db} dB"


def designed(die: str, f_number: float) -> Blur:
    """Its blur as the package has it, row 0 the top."""
    lens = {"stop": f"{FOCAL_MM / f_number} mm", "pixel": f"{PIXEL_UM} um", "window": "256 um"}
    camera = mf.Camera(f"{FOCAL_MM} mm", wavelengths=[f"{line:g} nm" for line in LINES], **lens)
    return StandingBlur(die_transfer(die, JOB.panels()[die], camera.model), 0)


def spread(die: str, f_number: float, keep: Path) -> Singles:
    """Its point spread by the simulator, the sum of each colour 1."""
    file = keep / f"{die}_{f_number:g}.npy"
    if not file.exists():
        dots, stop = Dots.of(JOB.panels()[die]), 1e3 * FOCAL_MM / f_number
        found = [picture(dots, Optics(stop, 1e3 * FOCAL_MM, PIXEL_UM, PIXELS, {line: 1.0})) for line in LINES]
        kernels = np.stack(found) / np.sum(found, axis=(1, 2), keepdims=True)
        np.save(file, kernels.astype(np.float32))
    return np.asarray(np.load(file))


def taken(light: Singles, kernels: Singles, level_db: float, seed: int, side: int) -> tuple[Record, Singles]:
    """A record of a photograph's middle, and the truth behind it; beyond its edges the photograph is mirrored."""
    side, room = min(side, *light.shape[1:]) // 16 * 16, PIXELS // 2
    wide = np.pad(light, [(0, 0), (room, room), (room, room)], mode="symmetric")
    top, left = ((length - side) // 2 for length in light.shape[1:])
    around = wide[:, top : top + side + 2 * room, left : left + side + 2 * room]
    pairs = zip(around, kernels, strict=True)
    clean = np.maximum(np.stack([signal.fftconvolve(*pair, mode="valid") for pair in pairs]), 0)
    ratio, draw = 10 ** (level_db / 20), np.random.default_rng(seed)
    white_e = (ratio**2 + (ratio**4 + 4 * ratio**2 * READ_E**2) ** 0.5) / 2
    values = (draw.poisson(clean * white_e) + READ_E * draw.standard_normal(clean.shape)) / white_e
    return Record(values.astype(np.float32), Noise(white_e, READ_E)), around[:, room:-room, room:-room]


def lit(file: Path) -> Singles:
    """Light of a photograph in codes of 8 bits, [3, rows, columns]."""
    codes = np.asarray(Image.open(file).convert("RGB"), dtype=np.float32).transpose(2, 0, 1)
    return light_of_code(np.ascontiguousarray(codes) / np.float32(255))


def psnr(found: Singles, light: Singles) -> float:
    """In linear light, without the edges."""
    one, other = (np.clip(values[:, EDGE:-EDGE, EDGE:-EDGE].astype(float), 0, 1) for values in (found, light))
    return float(-10 * np.log10(np.square(one - other).mean()))


def judged(record: Record, light: Singles, said: str, f_number: float) -> tuple[Explained, float, float]:
    """The verdict, decibels above the record, and seconds of the processor."""
    blur = designed(said, f_number)
    rivals = {name: MadeBlur(partial(designed, name, f_number)) for name in JOB.panels() if name != said}
    start = time.process_time()
    photo = Photo("p", "", record, (1.0, 1.0, 1.0), np.eye(3), (), noise_stated=True)
    _, won, found, _ = restored_light(photo, blur, (Wiener(),), chosen=False, epsilon=None, bin=False, rivals=rivals)
    spent = time.process_time() - start
    return found, psnr(won.picture, light) - psnr(record.values, light), spent


def main(arguments: list[str]) -> None:
    """Draw, judge and print, worst first told as it comes."""
    stated = dict(argument.split("=", 1) for argument in arguments if "=" in argument)
    keep = Path(stated.get("keep", Path(gettempdir(), "judge_table")))
    keep.mkdir(exist_ok=True)
    files = [file for place in arguments if "=" not in place for file in picture_files(Path(place))[0]]
    photographs = {file.stem: lit(file) for file in files}
    if not files:
        leaves = [dead_leaves(seed, 640, 640) for seed in range(11, 15)]
        photographs = {scene.name: scene.light for scene in (*leaves, *map(indoors, leaves))}
    dies, draw = list(JOB.panels()), np.random.default_rng(int(stated.get("seed", 1)))
    told: Counter[tuple[str, str]] = Counter()
    for number in range(int(stated.get("draws", 40))):
        photo, die = str(draw.choice(list(photographs))), str(draw.choice(dies))
        wrong = draw.random() < float(stated.get("wrong", 0.5))
        said = str(draw.choice([each for each in dies if each != die])) if wrong else die
        one = Draw(photo, die, said, float(draw.choice(STOPS)), int(draw.choice(LEVELS_DB)))
        kernels = spread(die, one.f_number, keep)
        record, light = taken(photographs[photo], kernels, one.level_db, number, int(stated.get("side", 384)))
        found, gained, spent = judged(record, light, said, one.f_number)
        fault = "REFUSED" if not wrong and found.verdict == FOREIGN else "WORSE" if gained < -0.1 else ""
        told["wrong" if wrong else "right", found.verdict] += 1
        told["wrong" if wrong else "right", fault or "well"] += 1
        print(f"{one} {found.verdict:16} {found.power.told:4.2f} {gained:+6.2f} dB {spent:4.1f} s {fault}", flush=True)
    for (kind, verdict), count in sorted(told.items()):
        print(f"{kind} die, {verdict}: {count}")


if __name__ == "__main__":
    main(sys.argv[1:])
