"""A network that was trained behind one die as a restorer; without training there is none.

Every part of it scales with what it is shown, f(a x) = a f(x) for a > 0: convolutions have no biases and all that bends
is max(x, 0), so there is no light at which it has learned to act (Mohan, Kadkhodaie, Simoncelli, Fernandez-Granda,
Robust and interpretable blind image denoising via bias-free convolutional neural networks, ICLR 2020). It is a U-Net
(Ronneberger, Fischer, Brox, MICCAI 2015, 234) of residual dense blocks (Zhang, Tian, Kong, Zhong, Fu, CVPR 2018, 2472)
on blocks of 2 x 2 pixels, and adds its answer to the first three planes.

Of a record it is shown two restored pictures and the noise, on a scale of even errors. The first picture, of total
variation, is what it mends: it lets edges go on across the gaps of the transfer, and knows of light from outside the
sensor. The second, of the Wiener filter on calm light, has textures that the first lacks. Light x is shown as
x^(1/2.2), which is nearly its code value, so that errors count as they are scored. A power keeps the scale: where f
scales, x → f(x^(1/2.2))^2.2 scales too.

At the frequencies that the die passes, the record knows better than a network, and the picture of total variation t,
which the network mends to n, has taken from it all that it knows. So what is restored is

    n + A (t - n),        A = |H|² / (|H|² + 0.03),

which leaves to the network what the die does not pass: behind a periodic display .15 to .28 dB on three photographs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from maskfab.base.arrays import Singles
from maskfab.camera.imaging import Blur, Margin
from maskfab.camera.record import Record
from maskfab.camera.restorers.dct import Dct
from maskfab.camera.restorers.least_squares import TotalVariation

COLOURS = 3
_BLOCK = 2
"""Pixels along a side that are one of the network's own."""


class DenseBlock(nn.Module):
    """Three convolutions, each of all before it, whose mix is added to the input."""

    def __init__(self, width: int, growth: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(_convolution(width + k * growth, growth) for k in range(3))
        self.mix = nn.Conv2d(width + 3 * growth, width, 1, bias=False)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        features = values
        for layer in self.layers:
            features = torch.cat([features, functional.relu(layer(features))], dim=1)
        mixed: torch.Tensor = self.mix(features)
        return values + mixed


class Network(nn.Module):
    """Three planes of a picture, mended by all that are shown.

    Args:
        planes: shown, the first three of which are mended.
        widths: channels at every scale, each of half the size before.
    """

    def __init__(self, planes: int, widths: tuple[int, ...] = (32, 48, 64, 64)) -> None:
        super().__init__()
        self.enter = _convolution(planes * _BLOCK**2, widths[0])
        self.down = nn.ModuleList(DenseBlock(width, width // 2) for width in widths)
        self.shrink = nn.ModuleList(
            nn.Conv2d(fine, coarse, 2, stride=2, bias=False) for fine, coarse in pairwise(widths)
        )
        self.grow = nn.ModuleList(
            nn.ConvTranspose2d(coarse, fine, 2, stride=2, bias=False) for fine, coarse in pairwise(widths)
        )
        self.up = nn.ModuleList(DenseBlock(width, width // 2) for width in widths[:-1])
        self.leave = _convolution(widths[0], COLOURS * _BLOCK**2)
        nn.init.zeros_(self.leave.weight)
        self.multiple = _BLOCK * 2 ** (len(widths) - 1)

    def forward(self, shown: torch.Tensor) -> torch.Tensor:
        """Mend [pictures, planes, rows, columns] of any sides to [pictures, 3, rows, columns]."""
        rows, columns = shown.shape[-2:]
        whole = functional.pad(shown, (0, -columns % self.multiple, 0, -rows % self.multiple))
        values = self.enter(functional.pixel_unshuffle(whole, _BLOCK))
        skipped = []
        for k, block in enumerate(self.down):
            values = block(values)
            if k < len(self.shrink):
                skipped.append(values)
                values = self.shrink[k](values)
        for k in reversed(range(len(self.up))):
            values = self.up[k](skipped[k] + self.grow[k](values))
        change = functional.pixel_shuffle(self.leave(values), _BLOCK)[..., :rows, :columns]
        return shown[:, :COLOURS] + change


def _convolution(before: int, after: int) -> nn.Conv2d:
    return nn.Conv2d(before, after, 3, padding=1, bias=False)


PLANES = 7
"""Of two pictures, and of the noise."""
EXPONENT = 2.2
"""Of light over what is shown: nearly the curve of sRGB."""
_VARIATION = 0.015
"""ε of total variation, whose penalty follows the noise by itself."""


@dataclass(frozen=True)
class View:
    """The way in which the records of a camera are shown.

    Attributes:
        strengths: ε of the second picture, by the electrons of white that it suits.
    """

    strengths: Mapping[float, float]

    def planes(self, record: Record, blur: Blur) -> Singles:
        """Planes that are shown of a record, float32 [7, rows, columns]: two pictures, and the noise of mean light."""
        nearest = min(self.strengths, key=lambda electrons: abs(math.log(electrons / record.noise.electrons)))
        edges = TotalVariation().prepare(record, blur)(_VARIATION)
        textures = Dct().prepare(record, blur)(self.strengths[nearest])
        noise = np.full_like(edges[:1], math.sqrt(float(record.variance.mean(dtype=np.float64))))
        return shown(np.concatenate([edges, textures, noise]))


def shown(light: Singles) -> Singles:
    """Light of any shape as it is shown; below 0 there is none."""
    return np.asarray(np.maximum(light, 0) ** np.float32(1 / EXPONENT))


def light_of(planes: Singles) -> Singles:
    """The light that is shown so."""
    return np.asarray(np.maximum(planes, 0) ** np.float32(EXPONENT))


_TRUST = 0.03
_AROUND = 64
"""Pixels by which a change is mirrored beyond the record's edges."""


@dataclass(frozen=True, eq=False)
class Learned:
    """A network, and how records are shown to it."""

    network: Network
    view: View
    name: str = "learned"

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        picture = self.restored(self.view.planes(record, blur), blur)
        return lambda _: picture

    def restored(self, planes: Singles, blur: Blur) -> Singles:
        """Light of what is shown of a record, float32 [3, rows, columns] within 0 to 1."""
        before, mended = light_of(planes[:COLOURS]), self.mended(planes)
        margin = Margin.around(mended, _AROUND)
        passed = np.square(abs(blur.on(margin.shape)))
        change = margin.blurred(margin.mirrored(before - mended), passed / (passed + np.float32(_TRUST)))
        return np.asarray(np.clip(mended + change, 0, 1))

    def mended(self, planes: Singles) -> Singles:
        """Light as the network alone has it, of the same shape."""
        where = next(self.network.parameters()).device
        with torch.inference_mode():
            planes_mended = self.network(torch.from_numpy(planes)[None].to(where, memory_format=torch.channels_last))
        return np.clip(light_of(planes_mended[0].cpu().numpy()), 0, 1)
