"""Photographs restored by a PSF that may be wrong: none is worse than the record, and a wrong die is told.

Records come from a simulator that shares no optics with the package; scenes are drawn.
"""

from __future__ import annotations

import io
from functools import cache
from itertools import cycle

import numpy as np
import pytest
from capture_simulator import Dots, Optics, picture, srgb8
from PIL import Image
from scipy import ndimage, signal

import maskfab as mf
from maskfab.camera.blur import MeasuredBlur
from maskfab.camera.die_transfer import die_transfer
from maskfab.camera.explained import FOREIGN, explain
from maskfab.camera.noise_spectrum import noise_of, whitened
from maskfab.camera.photo import Photo, Stated, read_photo, restored_light
from maskfab.camera.record import Noise, Record
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scenes import dead_leaves
from maskfab.optics.colour import light_of_code

LINES = (610.0, 530.0, 470.0)
LENS = {"stop": "2 mm", "pixel": "4 um", "wavelengths": ["610 nm", "530 nm", "470 nm"], "window": "400 um"}
SIDE, PIXELS, ROOM = 256, 193, 96
READ_E = 4.87
KINDS = ("scale", "turn", "die", "focus", "noise", "smoothed", "8 bits", "jpeg")
LEVELS = (400.0, 3000.0, 20000.0)


@cache
def dies():
    """Panels that differ in opening or tiling, all about as clear."""
    draw = np.random.default_rng(7)
    scattered = np.zeros(441, dtype=np.bool_)
    scattered[draw.permutation(441)[:100]] = True
    bar = mf.Opening.bar(dots=21, size=(5, 18), pitch="168 um")
    loose = mf.Opening.of(scattered.reshape(21, 21), pitch="168 um")
    return {
        "bars": mf.Panel.tile(bar, "random", seed=1, size="2.4 mm"),
        "stripes": mf.Panel.tile(bar, "periodic", size="2.4 mm"),
        "scattered": mf.Panel.tile(loose, "random", seed=2, size="2.4 mm"),
        "lattice": mf.Panel.tile(loose, "periodic", size="2.4 mm"),
    }


@cache
def designed(die):
    """Its transfer as designed."""
    return die_transfer(die, dies()[die], mf.Camera("10 mm", **LENS).model)


@cache
def spread(die, scale=1.0, turn=0.0, waves=0.0):
    """The true PSF of three colours, [3, PIXELS, PIXELS], the sum of each 1; two samples along a pixel to turn it."""
    optics = [
        Optics(2000.0, 1e4 * scale, 2.0 if turn else 4.0, 2 * PIXELS if turn else PIXELS, {line: 1.0}, {4: waves * 530 / line} if waves else {})
        for line in LINES
    ]
    found = np.stack([picture(Dots.of(dies()[die]), each) for each in optics])
    if turn:
        turned = ndimage.rotate(found, turn, axes=(1, 2), reshape=False, order=3)
        found = turned.reshape(3, PIXELS, 2, PIXELS, 2).sum(axis=(2, 4))
    return found / found.sum(axis=(1, 2), keepdims=True)


@cache
def scene(number):
    values = dead_leaves(number, 512, 512).values[:, : SIDE + 2 * ROOM, : SIDE + 2 * ROOM]
    return light_of_code(values)


def taken(number, kernels, white_e, seed):
    """A record and the truth behind it, [3, SIDE, SIDE]."""
    draw, light = np.random.default_rng(seed), scene(number)
    seen = np.stack([signal.fftconvolve(*pair, mode="same") for pair in zip(light, kernels, strict=True)])
    inner = (slice(None), slice(ROOM, -ROOM), slice(ROOM, -ROOM))
    clean = np.maximum(seen[inner], 0)
    counted = draw.poisson(clean * white_e) + READ_E * draw.standard_normal(clean.shape)
    return (counted / white_e).astype(np.float32), light[inner]


def psnr(found, light):
    """In linear light after the best gain, without 32 pixels at each edge."""
    found, light = (np.clip(values[:, 32:-32, 32:-32].astype(np.float64), 0, 1) for values in (found, light))
    gain = (found * light).sum() / np.square(found).sum()
    return -10 * np.log10(np.square(gain * found - light).mean())


def coded(values, tmp_path, name):
    """The photograph that a camera would have written as codes of 8 bits."""
    codes = srgb8(values).transpose(1, 2, 0)
    path = tmp_path / f"photo.{name}"
    Image.fromarray(codes).save(path, **({"quality": 88} if name == "jpg" else {}))
    return read_photo(path, Stated())


def case(number, tmp_path):
    """A photograph, the blur that it is said to have, the record, the truth and what is wrong."""
    kind, draw = KINDS[number % len(KINDS)], np.random.default_rng(1000 + number)
    names = list(dies())
    die = names[number // len(KINDS) % len(names)]
    white_e = LEVELS[number // (len(KINDS) * len(names)) % len(LEVELS)]
    of_scene = 1 + number % 5
    noise, blur, setting = 1.0, designed(die), {}
    if kind == "scale":
        setting = {"scale": float(draw.choice([0.95, 0.975, 1.025, 1.05]))}
    if kind == "turn":
        setting = {"turn": float(draw.choice([-3.0, -1.5, 1.5, 3.0]))}
    if kind == "die":
        blur = designed(str(draw.choice([name for name in names if name != die])))
    if kind == "focus":
        setting = {"waves": 0.25}
        blur = MeasuredBlur(spread(die, waves=-0.25), (PIXELS // 2.0, PIXELS // 2.0), ())
    if kind == "noise":
        noise = float(draw.choice([1 / 4, 1 / 2, 2, 4]))
    record, light = taken(of_scene, spread(die, **setting), white_e, number)
    if kind == "smoothed":
        record = ndimage.gaussian_filter(record, (0, 0.7, 0.7))
    if kind in ("8 bits", "jpeg"):
        photo = coded(record, tmp_path, "png" if kind == "8 bits" else "jpg")
    else:
        told = Noise(white_e / noise**2, READ_E / noise)
        photo = Photo("p", "", Record(record, told), (1.0, 1.0, 1.0), np.eye(3), ())
    return photo, blur, photo.record.values, light, f"{kind} {die} {white_e:g} {setting} scene {of_scene}"


def gained(number, tmp_path):
    """Decibels of the restored picture above the record, the verdict, and what is wrong."""
    photo, blur, record, light, words = case(number, tmp_path)
    _, won, found, _ = restored_light(photo, blur, (Wiener(),), chosen=False, epsilon=None, bin=False)
    return psnr(won.picture, light) - psnr(record, light), found.verdict, words
