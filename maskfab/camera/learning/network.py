"""A network that scales with what it is shown: f(a x) = a f(x) for a > 0, as every part of it does.

Convolutions have no biases and all that bends is max(x, 0), so there is no light at which it has learned to act (Mohan,
Kadkhodaie, Simoncelli, Fernandez-Granda, Robust and interpretable blind image denoising via bias-free convolutional
neural networks, ICLR 2020). It is a U-Net (Ronneberger, Fischer, Brox, MICCAI 2015, 234) of residual dense blocks
(Zhang, Tian, Kong, Zhong, Fu, CVPR 2018, 2472) on blocks of 2 x 2 pixels, and adds its answer to the first three
planes.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

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
        known = values
        for layer in self.layers:
            known = torch.cat([known, functional.relu(layer(known))], dim=1)
        mixed: torch.Tensor = self.mix(known)
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
        kept = []
        for k, block in enumerate(self.down):
            values = block(values)
            if k < len(self.shrink):
                kept.append(values)
                values = self.shrink[k](values)
        for k in reversed(range(len(self.up))):
            values = self.up[k](kept[k] + self.grow[k](values))
        change = functional.pixel_shuffle(self.leave(values), _BLOCK)[..., :rows, :columns]
        return shown[:, :COLOURS] + change


def _convolution(before: int, after: int) -> nn.Conv2d:
    return nn.Conv2d(before, after, 3, padding=1, bias=False)
