"""What a browser shows of a GLB: three.js draws it straight from above, and the picture is held against the die.

The viewer is the one that comes with trimesh: its loader of GLB, its renderer, its lamp at the camera. The files hold
no camera; ours sees in perspective from straight above the middle, so that the film keeps its shape. Any Chromium
draws it, without a network and without a graphics card.
"""

from __future__ import annotations

import base64
import io
import json
import struct
import zipfile
from dataclasses import dataclass
from importlib.resources import files

import matplotlib.image
import numpy as np
import pytest

from maskfab.mask.dots import die_edges_nm, die_raster
from maskfab.mask.formats.format import Stack
from maskfab.mask.formats.mesh import write_glb

SIDE = 512
EDGE_PX = 0.15
"""Pixels with their middle so near to an edge of the design are not compared; of the others not one may be wrong."""
NEAR = {"fine": 0.5, "coarse": 1e-4}
"""Nearest depth that is drawn, as part of the camera's distance. 24 bits then resolve 0.1 and 200 nm at the film: the
latter is more than its thickness, as in a viewer that sees a die of 8 mm from a hundredth of its distance on."""

PAGE = """
const told = document.createElement("pre");
told.id = "told";
async function look() {
  const pictures = {};
  const renderer = new THREE.WebGLRenderer({antialias: false});
  renderer.setSize(SIDE, SIDE);
  for (const job of JOBS) {
    const bytes = Uint8Array.from(atob(job.glb), letter => letter.charCodeAt(0));
    const model = await new Promise((done, failed) => new THREE.GLTFLoader().parse(bytes.buffer, "", done, failed));
    const scene = new THREE.Scene(), lamp = new THREE.DirectionalLight(0xffffff, 1.75);
    scene.background = new THREE.Color(0xffffff);
    const away = 2 * job.half, opened = 2 * Math.atan(0.5) * 180 / Math.PI;
    const camera = new THREE.PerspectiveCamera(opened, 1, away * job.near, 10 * away);
    camera.up.set(0, 0, -1);
    camera.position.set(0, away, 0);
    camera.lookAt(0, 0, 0);
    lamp.position.copy(camera.position);
    scene.add(model.scene, lamp);
    const box = new THREE.Box3().setFromObject(model.scene);
    renderer.render(scene, camera);
    pictures[job.name] = {
      png: renderer.domElement.toDataURL("image/png").split(",")[1],
      low: box.min.toArray(), high: box.max.toArray(), drawn: renderer.info.render.calls,
    };
  }
  return pictures;
}
const gl = document.createElement("canvas").getContext("webgl2");
(gl ? look() : Promise.resolve("no WebGL")).catch(error => "error: " + error).then(answer => {
  told.textContent = JSON.stringify(answer);
  document.body.appendChild(told);
});
"""


@dataclass(frozen=True, eq=False)
class Picture:
    """One canvas: float64 [y, x, 3] of 0 to 255, upper row first; the scene's box in metres; meshes drawn."""

    rgb: np.ndarray
    low_m: list[float]
    high_m: list[float]
    drawn: int

    @property
    def what(self):
        """Material at each pixel [y, x], y upwards as in a die."""
        dark, bright = self.rgb.max(axis=-1) < 110, self.rgb.min(axis=-1) > 150
        white = (self.rgb == 255).all(axis=-1)
        return np.select([dark, white, bright], ["chrome", "nothing", "glass"], "neither")[::-1]


def half_width_nm(die):
    x0, y0, x1, y1 = die.box_nm
    return 0.55 * max(x1 - x0, y1 - y0)


def expected(die, mirrored=False):
    """Material at each pixel [y, x], y upwards, and whether the pixel is far enough from all edges to tell."""
    half = half_width_nm(die)
    place = (np.arange(SIDE) + 0.5) * (2 * half / SIDE) - half
    cells, clear = [], []
    for sign, edges, centre in zip((-1 if mirrored else 1, 1), die_edges_nm(die), die.centre_nm, strict=True):
        at = np.asarray(edges) - centre
        cells.append(np.searchsorted(at, sign * place) - 1)
        clear.append(np.abs(sign * place[:, None] - at).min(axis=1) > EDGE_PX * 2 * half / SIDE)
    raster = np.pad(np.where(die_raster(die), "glass", "chrome").astype("<U7"), 1, constant_values="nothing")
    x, y = cells
    return raster[np.ix_(y + 1, x + 1)], clear[1][:, None] & clear[0]


def shows(picture, die, mirrored=False):
    """Whether a picture is that of a die, pixel by pixel."""
    wanted, telling = expected(die, mirrored)
    assert telling.mean() > 0.8
    return bool((picture.what == wanted)[telling].all())


def changed(path, change):
    """A file with another document, written beside it."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + length])
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    other = path.with_stem(f"{path.stem}_{change.__name__}")
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest)) + struct.pack("<I4s", len(text), b"JSON")
    other.write_bytes(head + text + rest)
    return other


def mirrored(document):
    document["nodes"][0]["matrix"][0] = -1


def pale(document):
    document["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.7, 0.85, 0.9, 0.3]


@pytest.fixture(scope="module")
def pictures(chromium, small_plate, tmp_path_factory):
    """Every picture of this module, by name, from one page."""
    place = tmp_path_factory.mktemp("glb")
    jobs = []

    def add(name, path, die, depth="fine"):
        glb = base64.b64encode(path.read_bytes()).decode()
        jobs.append({"name": name, "glb": glb, "half": half_width_nm(die) * 1e-9, "near": NEAR[depth]})

    for die in small_plate.dies:
        path = place / f"{die.name}.glb"
        # Corners that touch keep so little chrome between them that no pixel tells it.
        write_glb(die, path, stack=Stack(corner_nm=10.0))
        add(die.name, path, die)
        add(f"{die.name} mirrored", changed(path, mirrored), die)
    add("coarse", path, die, "coarse")
    add("pale", changed(path, pale), die)
    add("pale coarse", changed(path, pale), die, "coarse")

    viewer = files("trimesh") / "resources" / "templates" / "viewer.zip"
    with zipfile.ZipFile(io.BytesIO(viewer.read_bytes())) as package:
        template = package.read("viewer.html.template").decode()
    library, start, end = template.rpartition("init();")
    assert start
    page = place / "page.html"
    page.write_text(library + PAGE.replace("SIDE", str(SIDE)).replace("JOBS", json.dumps(jobs)) + end)
    chromium.open(page)
    told = json.loads(chromium.until("return document.querySelector('#told')?.textContent"))
    if told == "no WebGL":
        pytest.skip(f"{chromium.program} has no WebGL here")
    assert isinstance(told, dict), told
    return {name: picture(**each) for name, each in told.items()}


def picture(png, low, high, drawn):
    pixels = matplotlib.image.imread(io.BytesIO(base64.b64decode(png)), format="png")
    return Picture(np.round(np.asarray(pixels, dtype=np.float64)[..., :3] * 255), low, high, drawn)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_browser_shows_the_die(small_plate, pictures, n):
    """Chrome dark, openings clear, every cell in its place and turned as designed; beyond the die, nothing."""
    die = small_plate.dies[n]
    assert shows(pictures[die.name], die)
    assert set(np.unique(pictures[die.name].what)) == {"chrome", "glass", "nothing"}


@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_mirrored_file_is_seen_to_be_mirrored(small_plate, pictures, n):
    die = small_plate.dies[n]
    seen = pictures[f"{die.name} mirrored"]
    assert not shows(seen, die)
    assert shows(seen, die, mirrored=True)


def test_one_die_is_not_taken_for_another(small_plate, pictures):
    """The two have the same opening, gutter and size; only the orientations of their cells differ."""
    periodic, _, turned = small_plate.dies
    assert periodic.box_nm[2] - periodic.box_nm[0] == turned.box_nm[2] - turned.box_nm[0]
    assert not shows(pictures[turned.name], periodic)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_the_browser_finds_metres_with_y_up_and_two_meshes(small_plate, pictures, n):
    die = small_plate.dies[n]
    x, y = die.centre_nm
    x0, y0, x1, y1 = die.box_nm
    film, glass = 50e-9, 2.3e-3
    seen = pictures[die.name]
    assert seen.low_m == pytest.approx([(x0 - x) * 1e-9, -film - glass, (y - y1) * 1e-9], abs=1e-11)
    assert seen.high_m == pytest.approx([(x1 - x) * 1e-9, film, (y - y0) * 1e-9], abs=1e-11)
    assert seen.drawn == 2  # film and glass


def test_what_is_seen_does_not_hang_on_the_depth_buffer(small_plate, pictures):
    """A viewer that takes the film for the glass 100 nm below must show the same, which pale glass would not."""
    die = small_plate.dies[2]
    _, telling = expected(die)

    def change(one, other):
        return np.abs(pictures[one].rgb - pictures[other].rgb)[::-1][telling].max()

    assert shows(pictures["coarse"], die)
    assert change(die.name, "coarse") <= 2
    assert change("pale", "pale coarse") > 40


@pytest.mark.parametrize("n", [0, 1, 2])
def test_each_material_has_one_colour(small_plate, pictures, n):
    """No triangle is shaded by a normal of its own, and no seam shows between cells; the lamp's gleam is faint."""
    die = small_plate.dies[n]
    seen, (what, telling) = pictures[die.name], expected(die)
    for material in ("chrome", "glass"):
        assert np.ptp(seen.rgb[::-1][telling & (what == material)], axis=0).max() <= 12
