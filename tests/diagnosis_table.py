"""How often faults of a bench are named rightly at three times what is noticed, measured here and now.

For each kind of fault the strength is doubled until half of the draws are noticed, in whatever way; at three times of
that the right name is counted, and names of what is not there. Arguments: draws (10 by default), ``mosaic`` for a
sensor of three colours, and kinds.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import replace

from capture_faults import KINDS, Bench
from capture_simulator import Dots, Optics
from optics_cases import camera, noise, panel

from maskfab.camera.frames.merge import merged
from maskfab.camera.inspection.diagnosis import Cause
from maskfab.camera.inspection.die_verdict import Answer, Promise
from maskfab.camera.inspection.measurement import Measured, measured
from maskfab.optics.spectrum import line_spectrum

CAMERA = camera(diameter_um=800.0, window_um=128.0)
DIES = {name: panel(noise(8, 0.45, seed), cells=14, seed=5) for name, seed in (("ONE", 3), ("OTHER", 4))}
BIAS_UM = 0.1
GREY = Bench(
    Dots.of(DIES["ONE"]).grown(BIAS_UM), Optics(800.0, CAMERA.focal_um, CAMERA.pixel_um, 64, {530.0: 1.0}), peak_e=2e4
)
COLOUR = replace(GREY, mosaic={"R": 610.0, "G": 530.0, "B": 470.0})
WEAK = {
    "glare": 5e-4, "lamp size": 0.3, "bandwidth": 1.5, "second lamp": 5e-5, "black": 0.1, "gamma": 5e-4,
    "soft clip": 0.01, "response": 2e-3, "dead": 2e-4, "shading": 5e-3, "dust": 0.02, "hot": 0.3, "rows": 0.3,
    "columns": 0.3, "flicker": 5e-4,
}  # fmt: skip
"""Strengths that nobody notices."""
NAMES = {
    "glare": Cause.GLARE, "black": Cause.BLACK, "gamma": Cause.GAMMA,
    "soft clip": Cause.SOFT_CLIP, "response": Cause.RESPONSE, "dead": Cause.DEAD, "shading": Cause.SHADING,
    "dust": Cause.DUST, "hot": Cause.HOT, "rows": Cause.ROWS, "columns": Cause.COLUMNS, "flicker": Cause.DRIFT,
    "second lamp": Cause.LAMP, "lamp size": "size of the lamp", "bandwidth": "bandwidth",
}  # fmt: skip


def told(bench: Bench, kind: str, strength: float, seed: int) -> Measured:
    """What a capture with a fault is held to be."""
    merging = merged(bench.frames(kind, strength, seed), electrons_per_count=1.3, read_noise_e=4.87)
    lines = bench.mosaic or {"-": next(iter(bench.optics.lines))}
    light = {colour: line_spectrum([line]) for colour, line in lines.items()}
    return measured(merging, DIES, CAMERA, light, promise=Promise(ordered_um=0.25), priced=False)


def named(found: Measured) -> set[str]:
    """Names of all that is said to be there."""
    names = {str(found.verdict.cause)} if found.verdict.cause not in (None, Cause.INTERVAL) else set()
    left_out = found.explained.left_out.counts if found.holds else {}
    names |= {str(Cause(f"{name} pixels" if name != "dust" else name)) for name, count in left_out.items() if count}
    said = " ".join(found.sentences)
    names |= {str(Cause.LAMP)} if "second lamp" in said else set()
    seen = {"no point": "size of the lamp", "no line": "bandwidth", "die's middle": "place", "stop is": "stop"}
    seen |= {"Something cuts": "vignetting"}
    names |= {name for words, name in seen.items() if words in said}
    return names | ({str(Cause.DRIFT)} if "Light of exposures" in said else set())


def main(draws: int, bench: Bench, kinds: tuple[str, ...]) -> None:
    for kind in kinds:
        start, strength = time.process_time(), WEAK[kind]
        while (
            sum(bool(named(told(bench, kind, strength, 100 + k))) for k in range(4)) < 2 and strength < 500 * WEAK[kind]
        ):
            strength *= 2
        answers, right, wrong = Counter[str](), 0, []
        for seed in range(draws):
            found = told(bench, kind, 3 * strength, seed)
            names = named(found)
            right += str(NAMES[kind]) in names
            answers[" + ".join(sorted(names)) or "nothing"] += 1
            bias = next((each for each in found.quantities if each.name == "captured_cd_bias"), None)
            if found.verdict.answer is not Answer.CANNOT_TELL and bias is not None and bias.uncertainty:
                wrong += [seed] if abs(float(bias.value or 0) - BIAS_UM) > 1.7 * bias.uncertainty else []
        spent = (time.process_time() - start) / (draws + 4)
        listed = ", ".join(f"{count} {answer}" for answer, count in answers.most_common())
        print(
            f"{kind}, noticed at {strength:.3g}: named {right} of {draws} ({listed}); widths off {wrong}; "
            f"{spent:.1f} s",
            flush=True,
        )


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    main(
        count, COLOUR if "mosaic" in sys.argv else GREY, tuple(kind for kind in sys.argv[2:] if kind in KINDS) or KINDS
    )
