"""A loss of one's own, little halo and a strong MTF: Adam finds an opening, and a design makes it keep the rules."""

import os

import torch

import maskfab as mf

CLEAR, STEPS = 105, int(os.environ.get("STEPS", "80"))
camera = mf.Camera("10 mm", stop="4 mm", pixel="2 um", wavelengths="530 nm", window="64 um")
layout = {"pitch": "168 um", "tiling": "random", "seed": 1}


def loss(dots):
    """Light beyond 8 um of the point, less the weakest tenth of the MTF."""
    psf = mf.torch.psf(dots, camera, **layout)
    away = torch.linspace(-32, 32, len(psf))
    halo = psf[torch.hypot(away[:, None], away) > 8].sum() / psf.sum()
    mtf = mf.torch.mtf(dots, camera, **layout).flatten()
    return 5 * halo - 10 * mtf.topk(len(mtf) // 10, largest=False).values.mean()


torch.manual_seed(0)
logits = torch.randn(1, 21, 21, requires_grad=True)
adam, best = torch.optim.Adam([logits], lr=0.1), (1e9, None)
for _ in range(STEPS):
    smooth = logits
    for _ in range(4):  # neighbours go together, so that no dot stands alone
        smooth = torch.nn.functional.avg_pool2d(smooth, 3, stride=1, padding=1)
    edge = smooth.detach().flatten().topk(CLEAR).values[-1]
    clear, grey = (smooth[0].detach() >= edge).float(), torch.sigmoid(4 * (smooth[0] - edge) / smooth.detach().std())
    value = loss(clear + grey - grey.detach())  # the loss of clear and closed dots, the slopes of grey ones
    best = min(best, (value.item(), clear), key=lambda found: found[0])
    adam.zero_grad()
    value.backward()
    adam.step()
start = mf.Opening.of(best[1].numpy(), pitch="168 um", name="own_loss")
design = mf.design(start=start, camera=camera, map="none", rules={"min_feature_dots": 3}, budget="10 s")
for name, opening in (("found", start), ("buildable", design.opening)):
    print(f"{name}: loss {loss(torch.tensor(opening.mask, dtype=torch.float32)):.3f}, {opening.clear_dots} clear dots")
    opening.plot().save(f"own_loss_{name}.png")
print(design, *design.notes, sep="\n")
