"""maskfab simulate: restored photographs behind the dies of a job."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from once import leaves

from maskfab.api.photographs import simulate
from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import Panel
from maskfab.camera.imaging import Design
from maskfab.camera.protocol import ASSUMED
from maskfab.camera.stop_cells import laid_panel, lay
from maskfab.cli.program import run_command_line
from maskfab.findings.photographs import Conditions
from maskfab.mask.formats.exr import write_png
from maskfab.mask.job import Job, load_job

ROOT = Path(__file__).parents[2]
JOB = ROOT / "layouts" / "upc12.toml"


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    write_png(leaves(3, 832, 832).values, folder / "leaves.png", white=1.0)
    return folder


def stated() -> str:
    """The job, to be read from any folder."""
    text = JOB.read_text()
    for folder in ("openings", "maps"):
        text = text.replace(f'"{folder}/', f'"{JOB.parent / folder}/')
    return text


def test_a_random_tiling_beats_the_periodic_one(photographs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["simulate", str(JOB), "--die", "TOLED_P150", "--die", "PINV_R150", "--images", str(photographs)]
    assert run_command_line([*arguments, "--json", "--quiet"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["reference"] == "TOLED_P150"
    assert told["left_out"] == {"TOLED_P150": [], "PINV_R150": []}
    assert [score["design"] for score in told["scores"]] == ["TOLED_P150"] * 3 + ["PINV_R150"] * 3
    assert all(gain["psnr"]["mean"] > 0.5 and gain["psnr"]["half_width_95"] is None for gain in told["gains"])


def test_f1_has_its_own_camera_and_draw_and_says_what_it_assumes(
    photographs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["simulate", str(JOB), "--die", "PINV_R150", "--images", str(photographs), "--level", "32"]
    by = {}
    for protocol in ("f1", "camera"):
        assert run_command_line([*arguments, "--protocol", protocol, "--light", "code", "--json", "--quiet"]) == 0
        by[protocol] = json.loads(capsys.readouterr().out)
    assert by["f1"]["left_out"] == {"PINV_R150": [f"assumed: {ASSUMED}"]}
    assert set(by["f1"]["unused"]) - set(by["camera"]["unused"]) == {"[camera]"}
    assert "[emitters]" in by["camera"]["unused"]
    # The layout is the die's own, the draw of noise another; the camera is the same.
    one, other = (found["scores"][0]["psnr"] for found in by.values())
    assert one != other
    assert one == pytest.approx(other, abs=0.08)


def test_the_published_protocol_says_what_it_does() -> None:
    told = Conditions.of(load_job(JOB), "paper")
    assert told.lines[0].startswith("protocol paper: focal 10000 um")
    assert told.lines[3] == (
        "darkness round the sensor; pictures scored as bright as the die leaves them; restored by published, "
        "epsilon 0.0037"
    )
    assert len(Conditions.of(load_job(JOB), "f1").lines) == len(told.lines) - 1


def test_light_and_sensor_of_the_job_change_its_photographs(
    photographs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lit = '[exposure]\nluminance = 100\ntime = "5 ms"\nquantum_efficiency = 0.6\n'
    told = []
    for more in ("[exposure]\nsnr = [32]\n", "[exposure]\nsnr = [32]\n[sensor]\nbits = 5\n", lit):
        job = tmp_path / "job.toml"
        job.write_text(f"{stated()}\n{more}")
        arguments = ["simulate", str(job), "--die", "PINV_R150", "--images", str(photographs), "--json", "--quiet"]
        assert run_command_line(arguments) == 0
        told.append(json.loads(capsys.readouterr().out))
    assert told[0]["scene"] == {}
    plain, coarse, dark = (found["scores"][0] for found in told)
    assert coarse["psnr"] < plain["psnr"] - 0.1
    assert dark["level_db"] < 25
    assert dark["psnr"] < plain["psnr"] - 0.5
    assert told[1]["sensor"]["bits"] == 5
    assert told[1]["analog_gains"] == pytest.approx([15506 / (1608 + 3 * (1608 + 4.87**2) ** 0.5)], rel=1e-3)
    assert "analog_gains" not in told[0]


def test_conditions_tell_the_scene_and_what_a_protocol_leaves_of_a_job(tmp_path: Path) -> None:
    job = tmp_path / "job.toml"
    process = '[process]\ncd_bias = "0.1 um"\nroughness = { sigma = "30 nm", correlation = "200 nm" }\n'
    job.write_text(stated() + '[scene]\ngap = "0.5 mm"\nspectrum = "rgb"\n[sensor]\nbits = 12\n' + process)
    own, fixed = (Conditions.of(load_job(job), protocol) for protocol in ("camera", "f1"))
    assert "scene: gap 500 um, spectrum rgb" in own.lines
    assert own.unused == ("[process]",)
    assert fixed.unused == ("[camera]", "[scene]", "[sensor]", *own.unused)
    assert "not used of the job: [camera], [scene], [sensor], [process]" in fixed.lines


def test_dies_that_cannot_be_photographed_are_told_and_a_bad_folder_comes_before_all_of_them(
    photographs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def design(self: Conditions, name: str, panel: Panel, job: Job) -> tuple[Design, tuple[str, ...]]:
        if name != "TOLED_P150":
            raise JobError("MF114", "the panel is too small")
        return laid_panel(name, panel), ()

    monkeypatch.setattr(Conditions, "design", design)
    found = simulate(JOB, images=photographs, levels=[32])
    assert set(found.refused.values()) == {"MF114 the panel is too small"}
    assert "PINV_R150" in found.to_dict()["refused"]
    assert "Not photographed: PINV_R150, MF114 the panel is too small." in str(found)
    monkeypatch.setattr(Conditions, "design", None)
    with pytest.raises(SourceError, match="MF301"):
        simulate(JOB, images=tmp_path / "nowhere")


def test_restorers_are_scored_and_the_choice_tells_its_regret(
    photographs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["simulate", str(JOB), "--die", "PINV_R150", "--images", str(photographs), "--level", "28", "--quiet"]
    restorers = [word for name in ("wiener", "dct+wiener", "auto") for word in ("--restore", name)]
    assert run_command_line([*arguments, *restorers, "--json"]) == 0
    plain, calm, chosen = json.loads(capsys.readouterr().out)["scores"]
    assert [each["restorer"] for each in (plain, calm, chosen)] == ["wiener", "dct+wiener", "auto"]
    assert calm["psnr"] > plain["psnr"] + 0.3
    assert chosen["chosen"] == "dct+wiener"
    # It is the mean of both, a little better than the best alone.
    assert -0.2 < chosen["regret"] <= 0
    assert chosen["regret"] == pytest.approx(calm["psnr"] - chosen["psnr"])
    assert "regret" not in plain


def test_bad_requests_are_refused_before_any_photograph(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, code in (
        (["--protocol", "f2"], "MF105"),
        (["--die", "NOBODY"], "MF105"),
        (["--protocol", "f1", "--light", "linear"], "MF105"),
        (["--light", "blue"], "MF105"),
        (["--white", "2"], "MF105"),
        (["--white", "1"], "MF105"),
        (["--whole"], "MF105"),
        (["--restore", "magic"], "MF105"),
        (["--protocol", "paper", "--restore", "wiener"], "MF105"),
        (["--level", "60"], "MF141"),
        (["--die", "TOLED_P150", "--reference", "TOLED_R300"], "MF105"),
        (["--images", "nowhere"], "MF301"),
    ):
        assert run_command_line(["simulate", str(JOB), *arguments, "--quiet"]) == 2
        assert code in capsys.readouterr().err


def test_a_whole_photograph_is_scored_and_too_large_a_one_by_one_restorer_alone(
    photographs: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["simulate", str(JOB), "--die", "PINV_R150", "--images", str(photographs), "--level", "32", "--quiet"]
    scores = []
    for more in ([], ["--whole"]):
        assert run_command_line([*arguments, *more, "--json"]) == 0
        scores.append(json.loads(capsys.readouterr().out)["scores"])
    assert scores[0] == scores[1]  # there is nothing beyond their middle
    monkeypatch.setattr("maskfab.api.photographs.LARGE", 1)
    assert run_command_line([*arguments, "--whole", "--restore", "gradient"]) == 2
    assert "MF142" in capsys.readouterr().err


def test_a_random_die_is_drawn_as_the_protocol_draws_it() -> None:
    panel = next(die.panel for die in load_job(JOB).plate().dies if die.name == "TOLED_R150")
    assert np.array_equal(laid_panel("x", panel).pupil, lay("x", panel.opening.mask).pupil)
