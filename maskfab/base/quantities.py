"""The registry of quantities: name, symbol, unit, title, meaning and cure of every reported number, each written once.

Values are computed elsewhere; :class:`maskfab.base.model.Quantity` looks its symbol and unit up here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache, lru_cache
from types import MappingProxyType

from maskfab.base.errors import InternalError


class Subject(StrEnum):
    """Of a plate, what a check is about; each has a verdict of its own, for a plate that can be ordered may be one
    that no display fits."""

    FILES = "files"
    OPTICS = "optics"
    DISPLAY = "display"


@dataclass(frozen=True)
class Entry:
    """One registered quantity, or a family of quantities whose names differ in a word.

    Attributes:
        name: as report.json has it; a word in braces, one of :data:`FAMILIES`, stands for what tells the members of a
            family apart.
        symbol: of the formula; empty for counts and words.
        unit: ``1`` for a ratio, empty for counts and words.
        title: heading in tables.
        meaning: one sentence.
        cure: what to do if its check fails.
        subject: whose verdict its check counts for.

    In ``symbol`` or ``unit``, ``{detail}`` stands for what differs from row to row, such as ``6 um`` in ``SE(6 um)``.
    """

    name: str
    symbol: str
    unit: str
    title: str
    meaning: str
    cure: str = ""
    subject: Subject = Subject.FILES

    @property
    def takes_detail(self) -> bool:
        """Whether symbol or unit differ from row to row."""
        return _DETAIL in self.symbol + self.unit

    def member(self, words: Mapping[str, str]) -> Entry:
        """The entry of one member of the family, which keeps the name of the family."""

        def told(text: str) -> str:
            for word, value in words.items():
                text = text.replace(f"{{{word}}}", value.replace("_", " "))
            return text

        return replace(
            self,
            symbol=told(self.symbol),
            unit=told(self.unit),
            title=told(self.title),
            meaning=told(self.meaning),
            cure=told(self.cure),
        )


_DETAIL = "{detail}"

FAMILIES: Mapping[str, str] = MappingProxyType(
    {
        "axis": "x|y",
        "band": "slow|fine",
        "colour": "red|green|blue",
        "entry": ".*",
        "frequency": "[0-9.e+-]+",
        "gauge": ".*",
        "level": "[0-9.e-]+",
        "picture": ".*",
        "reading": "fused|open",
        "shop_rule": (
            "format|tone|drawing_unit|text|text_charset|text_style|text_layer|one_mask_per_layer|blank|"
            "chrome|glass|plot_area|extent|coordinates|min_feature|min_space|grid|vertices|references|depth|"
            "layers|layer_number|unwritten_layers|flashes|drawing|name|layer_name|block_name|"
            "block_transforms|self_crossing|self_touching|doubled_vertices|shared_boundaries|corner_touches|dpi|edge_error"
        ),
    }
)
"""Words of families, and what may stand in their place: a regular expression."""

_DIFFERS = "The written file differs from the design. Do not send this plate; look at the places where they differ."
_JUDGED = (
    "The written file is not what the job asks for, by rules that anybody can repeat. Do not send this plate; report "
    "it with the job."
)
_SUSPECT = (
    "The numbers of this die cannot be trusted. Set a stricter accuracy; if the error remains, "
    "report it with report.json."
)
_FINER_SPOT = "Ask the mask house for a finer spot, or choose an opening without touching corners."
_STATE = "State it in [plate]; the default is the worst case."
_PACK = "Pack the job again."
_RUN = "Run the job again."
_CORE = "Raise the open ratio, or the share of light in the PSF's core."
_ORDERS = "Raise the open ratio: orders and haze take the rest."
_COLOURS = "Choose a random tiling: orders of different colours lie apart, haze overlaps."
_FINER_PIXEL = "Choose a finer pixel, or compare presampled MTFs only."
_RANDOM = "Choose a random tiling, which spreads orders out."
_REPORT = "Do not trust the report; run the job again."
_DIRECTION = "Raise the open ratio, or choose an opening without a preferred direction."
_CIRCUITS = "Lower the open ratio, or ask for smaller circuits."


_ENTRIES = (
    # A die and its optics
    Entry(
        "open_ratio",
        "ρ",
        "1",
        "Open ratio",
        "Clear fraction of a display pixel, wiring gutter included.",
        "Open or close dots of the opening, or change the gutter.",
    ),
    Entry(
        "stop_open_ratio",
        "η",
        "1",
        "Open ratio in the stop",
        "Clear fraction of the lens stop. It differs slightly from the open ratio because its edge cuts cells.",
        "Change the opening, or the stop.",
    ),
    Entry(
        "clear_stop_psf_error",
        "",
        "1",
        "Error of a clear stop's PSF",
        "Largest difference of a clear square stop's PSF to its formula, over the peak.",
        "This installation computes wrong. Install maskfab again, with the versions in constraints.txt.",
    ),
    Entry(
        "min_feature",
        "w",
        "um",
        "Minimum feature",
        "Narrowest clear width in the file.",
        "Make the dots larger, or choose a writer with a finer limit.",
    ),
    Entry(
        "min_space",
        "s",
        "um",
        "Minimum space",
        "Narrowest chrome between two clear shapes in the file.",
        "Widen the gutter or the dots, or choose a writer with a finer limit.",
    ),
    Entry(
        "corner_touches",
        "",
        "",
        "Corner touches",
        "Places where two clear dots touch at a single point; a mask writer may merge or separate them.",
        "Open or close one dot at every such corner of the opening.",
    ),
    Entry(
        "auc_radial_min",
        "AUC",
        "1",
        "Area under the radial-minimum MTF",
        "Mean, from 0 to half a cycle per pixel, of the lowest MTF over all directions. High means that "
        "no direction of the picture is lost beyond restoration.",
        "Choose an opening without a preferred direction, or a random tiling.",
    ),
    Entry(
        "mtf{level}",
        "ν{level}",
        "cy/mm",
        "MTF{level}",
        "Frequency at which the MTF falls to {level} %; detail finer than at 10 % is almost lost.",
        _CORE,
    ),
    Entry(
        "mtf_worst_{frequency}",
        "MTF({frequency} cy/mm)",
        "1",
        "MTF at {frequency} cy/mm, worst direction",
        "Contrast of stripes of that frequency in the direction in which it is lowest.",
    ),
    Entry(
        "mtf{level}_per_pixel",
        "ν{level} p",
        "cy/pixel",
        "MTF{level} per pixel",
        "MTF{level} in cycles per sensor pixel; the Nyquist limit is 0.5.",
        "As for MTF{level}; if it is close to 0.5, choose a smaller pixel.",
    ),
    Entry(
        "mtf_aliasing",
        "max|A - MTF|",
        "1",
        "Aliasing of the MTF",
        "Largest difference, over all sub-pixel offsets of the picture, between the MTF of the sampled "
        "PSF and the presampled one: the error of an MTF measured from one picture of a point.",
        _FINER_PIXEL,
    ),
    Entry(
        "mtf_phase_range",
        "max A - min A",
        "1",
        "Variation of the aliased MTF with phase",
        "Largest change of the MTF of the sampled PSF when the picture shifts by a fraction of a pixel.",
        _FINER_PIXEL,
    ),
    Entry(
        "wiener_worst30",
        "H̄₃₀",
        "1",
        "Restored contrast, worst 30 %",
        "Mean contrast after Wiener restoration over the worst 30 % of frequencies; 0 is lost, 1 is full contrast.",
        "Choose an opening and a tiling whose MTF has no nulls.",
    ),
    Entry(
        "wiener_noise_gain",
        "g",
        "1",
        "Noise gain of restoration",
        "Amplification of pixel noise by the Wiener filter.",
        "Choose an opening with a higher MTF, or a weaker restoration (a larger noise-to-signal ratio).",
    ),
    Entry(
        "captured_cd_bias",
        "β",
        "um",
        "CD bias, measured",
        "By how much clear features are wider than drawn, half of it on each side, as a camera saw the die.",
        "Ask the mask house to correct its bias, or state it in the job (process.cd_bias).",
    ),
    Entry(
        "captured_turn",
        "φ",
        "deg",
        "Turn of the die",
        "By how much the die stands turned counter-clockwise before the camera, beyond quarter turns.",
    ),
    Entry(
        "captured_scale",
        "s",
        "1",
        "Scale of the picture",
        "By how much the captured picture is larger than that of pitch, pixel, wavelength and focal length as stated.",
    ),
    Entry(
        "captured_term",
        "z({detail})",
        "waves",
        "Error of the lens",
        "Coefficient of a Zernike term in Noll's order that the captured picture asks for, at the camera's first line.",
    ),
    Entry(
        "captured_outside",
        "1 - E({detail})",
        "1",
        "Light beyond the window",
        "Share of the light of a colour that lands outside the captured window, of the fitted die: haze that is in no "
        "number of the capture.",
    ),
    Entry(
        "captured_cost",
        "ΔPSNR({detail})",
        "dB",
        "Cost of restoring as drawn",
        "What photographs through the die as it was measured lose when they are restored by the PSF of the die as "
        "drawn, and not by the PSF that was fitted.",
    ),
    Entry(
        "captured_loss",
        "ΔPSNR*({detail})",
        "dB",
        "Loss for good",
        "What photographs through the die as it was measured lose against the die as drawn, although each is restored "
        "by its own PSF; negative where more light makes up for it.",
    ),
    Entry(
        "captured_light_width",
        "w",
        "um",
        "Width of the light",
        "Full width at half maximum, on the sensor, of the Gaussian that the light behind the plate is like; told "
        "where it is no point, and pixels that spread light are in it.",
        "Use a smaller pinhole, or one farther away.",
    ),
    Entry(
        "captured_misfit",
        "χ²/n",
        "1",
        "Misfit of the capture",
        "Mean over pixels of the squared difference between what was captured and the fitted die, in variances of the "
        "noise; 1 where nothing but noise is left.",
        "Look for another light, dust or a light wider than a pixel; state the spectrum of the light in the job.",
    ),
    Entry(
        "psf_energy_in_window",
        "E",
        "1",
        "PSF energy in window",
        "Fraction of the light through the panel that lands inside the PSF window; the rest is haze outside it.",
        "Widen the window (camera.window).",
    ),
    Entry(
        "ensquared_energy",
        "SE({detail})",
        "1",
        "Energy in the core",
        "Fraction of the light through the panel within 5 x 5 pixels around the image of a point.",
        _ORDERS,
    ),
    Entry(
        "encircled_energy",
        "EE({detail})",
        "1",
        "Encircled energy",
        "Fraction of the light through the panel within a circle around the image of a point.",
        _ORDERS,
    ),
    Entry(
        "halo_energy",
        "1 - EE({detail})",
        "1",
        "Energy in the halo",
        "Fraction of the light through the panel that lands far from the image of a point, including the "
        "light outside the PSF window.",
        "Raise the open ratio, or choose a larger pitch, which brings the orders closer.",
    ),
    Entry(
        "peak_to_side_lobe",
        "PSL",
        "1",
        "Peak to side lobe",
        "Ratio of the PSF peak to its next highest maximum (the strongest ghost).",
        _RANDOM,
    ),
    Entry(
        "first_side_lobe",
        "r₁",
        "um",
        "First side lobe",
        "Distance of the nearest secondary maximum of the PSF from the axis: the first ring of the stop, "
        "unless an order is closer.",
        "Change the stop, or the pitch.",
    ),
    Entry(
        "brightest_side_lobe",
        "r_max",
        "um",
        "Brightest side lobe",
        "Distance of the brightest secondary maximum of the PSF from the axis.",
        _RANDOM,
    ),
    Entry(
        "streak_index",
        "max/mean",
        "1",
        "Streak index",
        "Ratio of the brightest direction of the PSF tail to the mean: 1 is a round haze, 19 a single streak.",
        "Choose an opening without long straight edges, or a random tiling.",
    ),
    Entry(
        "energy_normalised_strehl",
        "S/η",
        "1",
        "Peak at equal energy",
        "Ratio of the PSF peak to that of an unobstructed stop at equal energy. It depends on the open ratio only.",
        "Raise the open ratio.",
    ),
    Entry(
        "peak_strehl",
        "S",
        "1",
        "Peak against an open stop",
        "Ratio of the PSF peak to that of the same stop without a panel.",
        "Raise the open ratio: the peak falls with its square.",
    ),
    Entry(
        "order_zero_incident",
        "η₀₀",
        "1",
        "Zero order, of incident light",
        "Fraction of the light incident on a periodic panel that goes into the zero order.",
        "Raise the open ratio.",
    ),
    Entry(
        "order_zero_transmitted",
        "η₀₀/η",
        "1",
        "Zero order, of transmitted light",
        "Fraction of the light transmitted by a periodic panel that goes into the zero order.",
        "Raise the open ratio.",
    ),
    Entry(
        "orders_lowest_five_incident",
        "Ση₅",
        "1",
        "Lowest five orders, of incident light",
        "Fraction of the light incident on a periodic panel in the zero order and its four neighbours.",
        "Raise the open ratio.",
    ),
    Entry(
        "orders_lowest_five_transmitted",
        "Ση₅/η",
        "1",
        "Lowest five orders, of transmitted light",
        "Fraction of the light transmitted by a periodic panel in the zero order and its four neighbours.",
        "Raise the open ratio.",
    ),
    Entry(
        "colour_distance",
        "½∫|a - b|",
        "1",
        "Colour separation",
        "Fraction of the light of the longest wavelength that does not overlap with that of the shortest.",
        _COLOURS,
    ),
    Entry(
        "edge_colour_difference",
        "ΔE*ab",
        "1",
        "Colour fringe at an edge",
        "Largest colour difference (CIE 1976) from grey across the image of a black and white edge; "
        "about 2 is visible.",
        _COLOURS,
    ),
    Entry(
        "strehl_invariant_error",
        "|S/η² - 1|",
        "1",
        "Strehl invariant error",
        "Relative difference between the PSF peak and its exact value, which follows from the clear area alone.",
        _SUSPECT,
        subject=Subject.OPTICS,
    ),
    Entry(
        "mtf_volume_invariant_error",
        "|V/η - 1|",
        "1",
        "MTF volume invariant error",
        "Relative difference between the volume under the transfer function and its exact value, which "
        "follows from the clear area alone.",
        _SUSPECT,
        subject=Subject.OPTICS,
    ),
    # What is not modelled
    Entry(
        "model_bar",
        "Δ",
        "1",
        "Model bar",
        "Estimated distance of the true PSF from the one shown, due to all effects that are not "
        "modelled: the sum of the rows below. The numerical errors given with each number are far "
        "smaller.",
    ),
    Entry(
        "model_chrome_leak",
        "Δ",
        "1",
        "Chrome leak",
        "Light that leaks through the chrome and interferes with the light of the openings.",
        _STATE,
    ),
    Entry("model_foreshortening", "Δ", "1", "Foreshortening", "Openings and stop appear narrower to oblique light."),
    Entry(
        "model_tangent_for_sine",
        "Δ",
        "1",
        "Tangent for sine",
        "Difference between the image position of a distortion-free lens (tangent) and of diffraction (sine).",
    ),
    Entry("model_tangent_off_axis", "Δ", "1", "Tangent off axis", "The same at the largest image height of the scene."),
    Entry("model_vector_field", "Δ", "1", "Vector field", "Polarisation: steep rays add as vectors, not as scalars."),
    Entry(
        "model_lens_apodisation", "Δ", "1", "Lens apodisation", "Transmission of the lens that varies over its pupil."
    ),
    Entry("model_glass", "Δ", "1", "Glass", "Aberration by the glass between the chrome and the lens.", _STATE),
    Entry(
        "model_ghosts",
        "Δ",
        "1",
        "Ghosts",
        "Light reflected back and forth between glass and chrome.",
        "Ask for low-reflection chrome.",
    ),
    Entry(
        "model_cd_bias",
        "Δ",
        "1",
        "CD bias",
        "Clear features are written wider or narrower than drawn.",
        "Measure the plate.",
    ),
    Entry(
        "fast_lens",
        "",
        "",
        "Fast lens",
        "Focal ratio of a lens that is too fast for the scalar, paraxial model; the model bar holds the "
        "size of its error.",
        "Use a slower lens, or read the results as trends only.",
    ),
    # Photographs
    Entry(
        "restored_psnr",
        "PSNR",
        "dB",
        "Restored PSNR",
        "Peak signal-to-noise ratio of restored photographs of drawn scenes through this die at a given light "
        "level: taken by the job's camera and sensor in linear light, restored by the Wiener filter, no denoiser. The "
        "level is the signal-to-noise ratio of white behind the published display.",
        "Choose one compact opening with a designed orientation map, or raise the open ratio.",
    ),
    Entry(
        "expected_psnr",
        "PSNR",
        "dB",
        "Expected PSNR",
        "Estimate of the restored PSNR from one opening alone, as if its cells were tiled at random anew for every "
        "photograph; for comparing many openings.",
        "Choose a compact opening, or raise the open ratio.",
    ),
    Entry(
        "restored_gain",
        "ΔPSNR",
        "dB",
        "Gain of restored photographs",
        "Mean difference in PSNR to the first die of the job that can be photographed, scene by scene, with its 95 % "
        "interval. Dies whose interval holds 0 are a tie.",
        "Choose one compact opening with a designed orientation map, or raise the open ratio.",
    ),
    Entry(
        "photographs_refused",
        "",
        "",
        "Photographs not taken",
        "Why the job's camera takes no photographs behind this die.",
        "Change the camera as it says; everything else is measured all the same.",
    ),
    Entry(
        "designed_for",
        "",
        "",
        "Another camera's design",
        "Camera that the die's opening or map was made for, where it is not the job's.",
        "Design it again with maskfab design and this job's camera.",
    ),
    Entry(
        "unused_keys",
        "",
        "",
        "Not used of the job",
        "Keys and tables of the job on which neither the files nor the numbers depend.",
        "Remove them, or see maskfab explain KEY for the verbs that they are for.",
    ),
    Entry(
        "display_seed",
        "",
        "",
        "Die of another seed",
        "Seed of a die whose opening or map names the seeds of dies that its display fits, and not this one.",
        "Leave the die's seed out, or state one that its map names.",
    ),
    # A scene
    Entry(
        "scene_psf_change",
        "Δ",
        "1",
        "Change of the PSF by the scene",
        "Relative L2 difference between the PSF at the worst point of the scene (corner of the field, "
        "most defocused end of the depth) and the PSF on the axis, in focus, without a gap.",
    ),
    Entry(
        "plan_error",
        "Σε",
        "1",
        "Estimated error of the plan",
        "Estimated relative L2 error of the scene's PSF due to all effects that the plan omits.",
        "Set a looser accuracy in [scene].",
        subject=Subject.OPTICS,
    ),
    Entry(
        "plan_error_measured",
        "ε",
        "1",
        "Measured error of the plan",
        "Relative L2 difference between the PSF of the planned model and of the fullest model at the "
        "worst point of the scene.",
        "The estimate was too low here: set a stricter accuracy in [scene], so that the plan omits less.",
        subject=Subject.OPTICS,
    ),
    Entry(
        "field_residual",
        "R",
        "1",
        "Residual blur in the corner",
        "Residue of the corner's PSF after Wiener deblurring with the centre's PSF, relative to the "
        "residue of the centre itself; 0 means that one PSF deblurs the whole picture.",
        "Put the panel closer to the lens, or deblur with a PSF for each part of the field.",
    ),
    Entry(
        "field_mtf_tangential",
        "MTF T",
        "1",
        "Tangential MTF in the corner",
        "Contrast, in the corner of the field, of lines across the radius, four pixels to a period.",
        _DIRECTION,
    ),
    Entry(
        "field_mtf_sagittal",
        "MTF S",
        "1",
        "Sagittal MTF in the corner",
        "Contrast, in the corner of the field, of lines along the radius, four pixels to a period.",
        _DIRECTION,
    ),
    Entry(
        "depth_residual",
        "R",
        "1",
        "Residual blur over depth",
        "Residue of the PSF of the nearest or farthest object (the larger) after Wiener deblurring with "
        "the in-focus PSF, relative to the residue of the in-focus PSF itself.",
        "Ask for less depth, choose a smaller stop, or deblur with a PSF for each distance.",
    ),
    Entry(
        "depth_change",
        "Δz",
        "1",
        "Change of the PSF over depth",
        "Relative L2 difference between the pixel PSF of the nearest or farthest object (the larger) and "
        "the in-focus one.",
        "Ask for less depth, or choose a smaller stop.",
    ),
    Entry(
        "nearest_object",
        "z",
        "m",
        "Nearest object",
        "Shortest focus distance at which a depth-independent PSF is accurate enough; nearer, its change "
        "of scale alone exceeds the accuracy.",
        "Set a looser accuracy, or model the scale of a near focus.",
    ),
    # The mask as written
    Entry(
        "written_open_ratio_{reading}",
        "η_w",
        "1",
        "Open ratio as written, {reading}",
        "Clear fraction of the lens stop as written; fused: touching corners merge, open: they separate.",
        _FINER_SPOT,
    ),
    Entry(
        "written_psf_difference_{reading}",
        "δ_w",
        "1",
        "PSF difference as written, {reading}",
        "Relative L2 difference between the PSF of the written mask and that of the drawn one; fused: "
        "touching corners merge, open: they separate.",
        _FINER_SPOT,
    ),
    Entry(
        "written_psf_shape_{reading}",
        "δ_p",
        "1",
        "PSF shape as written, {reading}",
        "The same difference with both PSFs scaled to a peak of 1, as far as neither exposure nor total light tell: "
        "what the writer does to the PSF's shape.",
        _FINER_SPOT,
    ),
    Entry(
        "written_scattered_{reading}",
        "s_w",
        "1",
        "Light scattered by rough edges, {reading}",
        "Share of all light that rough edges take from the orders of smooth ones and spread, most of it far beyond the "
        "PSF's window; fused: touching corners merge, open: they separate.",
        _FINER_SPOT,
    ),
    Entry(
        "written_auc_radial_min_{reading}",
        "AUC",
        "1",
        "AUC of the radial minimum as written, {reading}",
        "auc_radial_min of the written mask; fused: touching corners merge, open: they separate.",
        _FINER_SPOT,
    ),
    Entry(
        "written_mtf50_{reading}",
        "ν50",
        "cy/mm",
        "MTF50 as written, {reading}",
        "MTF50 of the written mask; fused: touching corners merge, open: they separate.",
        _FINER_SPOT,
    ),
    Entry(
        "written_min_feature",
        "w_w",
        "um",
        "Minimum feature as written",
        "Narrowest clear width once the writer's bias has moved its edges.",
        _FINER_SPOT,
    ),
    Entry(
        "written_min_space",
        "s_w",
        "um",
        "Minimum space as written",
        "Narrowest chrome between two clear shapes once the writer's bias has moved their edges.",
        _FINER_SPOT,
    ),
    # Displays that are made, over the spread of the process
    Entry(
        "band_stop_open_ratio",
        "±η_w",
        "1",
        "Band of the open ratio in the stop",
        "Half the interval that holds the open ratio in the stop of 95 % of the displays made.",
        "Narrow the writer's spread, or choose a design that is less sensitive to it.",
    ),
    Entry(
        "band_auc_radial_min",
        "±AUC",
        "1",
        "Band of the AUC",
        "Half the interval that holds auc_radial_min of 95 % of the displays made.",
        "Narrow the writer's spread, or choose a design that is less sensitive to it.",
    ),
    Entry(
        "band_mtf50",
        "±ν50",
        "cy/mm",
        "Band of MTF50",
        "Half the interval that holds MTF50 of 95 % of the displays made.",
        "Narrow the writer's spread, or choose a design that is less sensitive to it.",
    ),
    Entry(
        "band_psf_shape",
        "δ₉₅",
        "1",
        "Band of the PSF's shape",
        "Change of the PSF's shape, both peaks scaled to 1, that 95 % of the displays made stay below.",
        "Narrow the writer's spread, or choose a design that is less sensitive to it.",
    ),
    Entry(
        "band_mtf_worst_{frequency}",
        "±MTF({frequency} cy/mm)",
        "1",
        "Band of the MTF at {frequency} cy/mm, worst direction",
        "Half the interval that holds mtf_worst_{frequency} of 95 % of the displays made.",
        "Narrow the writer's spread, or choose a design that is less sensitive to it.",
    ),
    Entry(
        "band_halo_energy",
        "±h",
        "1",
        "Band of the halo energy",
        "Half the interval that holds the energy of the halo of 95 % of the displays made.",
        "Narrow the writer's spread, or choose a design that is less sensitive to it.",
    ),
    Entry(
        "band_restored_psnr",
        "±PSNR",
        "dB",
        "Band of the PSNR of restored photographs",
        "Half the interval that holds restored_psnr of 95 % of the displays made, restored by the filter of the die as "
        "drawn.",
        "Narrow the writer's spread, or choose a design that is less sensitive to it.",
    ),
    Entry(
        "band_restored_gain",
        "±ΔPSNR",
        "dB",
        "Band of the gain",
        "Half the interval that holds restored_gain of 95 % of the plates made, on each of which both dies are written "
        "alike.",
        "Narrow the writer's spread, or choose a design that is less sensitive to it.",
    ),
    Entry(
        "band_led_footprint",
        "±a",
        "1",
        "Band of the emitter footprint",
        "Half the interval that holds the emitter footprint of 95 % of the displays made, as far as openings that are "
        "written wider leave the emitters their gap.",
        "Narrow the writer's spread, or draw the emitters farther from the opening.",
    ),
    Entry(
        "sensitivity_psf_shape",
        "δ_0.1",
        "1",
        "Sensitivity of the PSF's shape",
        "Change of the PSF's shape, both peaks scaled to 1, by 0.1 µm of CD bias.",
        "Choose an opening with less edge for its area.",
    ),
    Entry(
        "sensitivity_restored_psnr",
        "ΔPSNR_0.1",
        "dB",
        "Sensitivity of the restored PSNR",
        "Change of restored_psnr by 0.1 µm of CD bias, restored by the filter of the die as drawn.",
        "Choose an opening with less edge for its area, or measure the die and restore by what was measured.",
    ),
    # Emitters, circuits and wires
    Entry(
        "display_fits",
        "",
        "",
        "Display fits",
        "Whether emitters, circuits and wires fit around the openings: 1 they do, 0 they cannot; none where neither is "
        "known.",
        "Lower the open ratio, or ask for smaller emitters.",
        subject=Subject.DISPLAY,
    ),
    Entry(
        "led_footprint",
        "a",
        "1",
        "Emitter footprint",
        "Emitter area per colour as a fraction of the pixel (the colour furthest below its target ratio).",
        "Lower the open ratio, or ask for smaller emitters.",
        subject=Subject.DISPLAY,
    ),
    Entry(
        "led_footprint_largest",
        "â",
        "1",
        "Largest footprint found",
        "Footprint of the largest placement found; smaller emitters may be drawn to centre their light better.",
    ),
    Entry(
        "led_footprint_bound",
        "ā",
        "1",
        "Largest footprint possible",
        "Proven upper bound of the footprint under the rules.",
    ),
    Entry(
        "led_footprint_rectangles",
        "a□",
        "1",
        "Largest footprint of rectangles",
        "Largest footprint of three rectangular emitters, found exactly.",
    ),
    Entry(
        "circuit_room",
        "A",
        "um^2",
        "Circuit area",
        "Opaque area of a pixel that is wide enough for its circuits.",
        _CIRCUITS,
    ),
    Entry(
        "circuit_room_{colour}",
        "A",
        "um^2",
        "Circuit area, {colour}",
        "Circuit area under the {colour} emitter.",
        _CIRCUITS,
    ),
    Entry(
        "emitter_rules_broken",
        "n",
        "1",
        "Emitter rules broken",
        "Gap and width rules broken by the emitter polygons, checked for every pair of neighbours.",
        "Move or shrink the emitters that are drawn by hand.",
        subject=Subject.DISPLAY,
    ),
    Entry(
        "emitters_stranded",
        "n",
        "1",
        "Stranded emitters",
        "Emitters on an island of opaque dots that no line connects to the edge of the pixel.",
    ),
    Entry(
        "luminance_centroid",
        "|c|",
        "px",
        "Luminance centroid",
        "Distance of the centroid of the emitted light from the centre of the pixel.",
    ),
    Entry(
        "grain_rms",
        "σ",
        "1",
        "Grain",
        "Visible unevenness of a uniform field, caused by emitters that are off-centre in their pixels.",
    ),
    Entry(
        "current_density_{colour}",
        "J",
        "mA/cm2",
        "Current density, {colour}",
        "Current density of the {colour} emitters at the display's white.",
    ),
    Entry(
        "relative_life_{colour}",
        "t",
        "1",
        "Relative life, {colour}",
        "Life of the {colour} emitters relative to that of an emitter of 9.3 % of the pixel at equal luminance.",
    ),
    Entry("wire_lines_{axis}", "n", "1", "Wires along {axis}", "Lines along {axis} drawn for every pixel."),
    Entry(
        "wired_transmission",
        "τ̄",
        "1",
        "Transmission of the wires",
        "Fraction of the light of the openings that wires over them transmit; the mask has no wires.",
    ),
    Entry(
        "wired_psf_change",
        "δ",
        "1",
        "PSF change by the wires",
        "Relative change of the PSF of the mask by wires over its openings.",
    ),
    # A display as it looks
    Entry(
        "pixels_per_degree", "ppd", "1/deg", "Pixels per degree", "Display pixels in one degree of the viewer's field."
    ),
    Entry(
        "centroid_offset",
        "|c|",
        "px",
        "Centroid offset",
        "Root mean square distance of the light's centroids from their mean, in pixels.",
    ),
    Entry(
        "grain_predicted",
        "",
        "1",
        "Grain, predicted",
        "Grain of a uniform field, predicted from the centroid offset alone.",
    ),
    Entry(
        "grain_{band}",
        "",
        "1",
        "Grain, {band}",
        "Contrast of the luminance of a uniform field; slow: up to 10 cycles per degree, fine: above.",
    ),
    Entry(
        "{picture}_delta_e_mean",
        "ΔE",
        "1",
        "Mean colour difference, {picture}",
        "Mean S-CIELAB difference between the picture on this panel and on a perfect display.",
    ),
    Entry(
        "{picture}_delta_e_95",
        "",
        "1",
        "95th percentile of the colour difference, {picture}",
        "S-CIELAB difference that 95 % of the picture stays below.",
    ),
    Entry(
        "{picture}_delta_e_aligned",
        "",
        "1",
        "Mean colour difference, aligned, {picture}",
        "The mean S-CIELAB difference after the common shift of all pixels is removed.",
    ),
    Entry(
        "{picture}_jod",
        "JOD",
        "1",
        "JOD, {picture}",
        "ColorVideoVDP's quality in just-objectionable differences; 10 is indistinguishable from a perfect display.",
    ),
    Entry(
        "edge_fringe",
        "Δab",
        "1",
        "Colour fringe at an edge, as seen",
        "Largest S-CIELAB difference in a* and b* along an edge, the common shift of all pixels removed.",
    ),
    # Files against the plate
    Entry("lens_view", "", "", "Seen from", "Side of the plate that the lens sees, and how the design reads there."),
    Entry("drawn_holes", "", "", "Outlines with holes", "Outlines whose holes were redrawn; their area is unchanged."),
    Entry("drawn_parted", "", "", "Outlines separated", "Outlines that touched themselves and were separated there."),
    Entry("drawn_snapped", "", "", "Vertices moved to the grid", "Vertices of marks moved to the grid of the data."),
    Entry("drawn_split", "", "", "Outlines cut", "Outlines cut because they had more vertices than max_vertices."),
    Entry(
        "polygons",
        "",
        "",
        "Polygons",
        "Polygons in the file, every reference followed; the limit is how many were drawn.",
        _DIFFERS,
    ),
    Entry("cd_{gauge}", "CD", "nm", "CD {gauge}", "Clear width at a gauge, in the file that was read back.", _DIFFERS),
    Entry(
        "readback_xor_area",
        "A_xor",
        "um^2",
        "Read-back XOR area",
        "Area that is clear in the file and not in the design, or the reverse.",
        _DIFFERS,
    ),
    Entry(
        "data_bias",
        "",
        "um",
        "Bias of the data",
        "Change of clear widths in the data, out of which the writer's bias is taken.",
    ),
    Entry(
        "data_xor_area",
        "",
        "um^2",
        "XOR area of biased data",
        "Area that is clear in the file and not in the sized design, or the reverse.",
        _DIFFERS,
    ),
    Entry(
        "data_width_error",
        "",
        "nm",
        "CD error of biased data",
        "Largest difference of a CD structure in the file from its target less the bias.",
        _DIFFERS,
    ),
    Entry(
        "data_wrong_parts",
        "",
        "",
        "Wrong parts of biased data",
        "Parts of dots, cut along the biased lines, that are clear otherwise than the opening says.",
        _DIFFERS,
    ),
    Entry(
        "readback_wrong_dots",
        "",
        "",
        "Wrong dots",
        "Dots of the file whose clear fraction differs from the opening and its orientation.",
        _DIFFERS,
    ),
    Entry(
        "judged_die",
        "",
        "",
        "Corners not asked for",
        "Corners of a die in the file that its place, tiling rule and opening in the job do not ask for, or that are "
        "missing: a second derivation, without the plate that the file was written from.",
        _JUDGED,
    ),
    Entry(
        "judged_marks",
        "",
        "",
        "Marks not as asked for",
        "Marks of the file that do not lie where job and template ask for them, in their sense and shape, or that are "
        "missing: a second derivation, without the plate that the file was written from.",
        _JUDGED,
    ),
    Entry(
        "judged_text",
        "",
        "",
        "Text not as asked for",
        "Lines of text and codes of the file that read otherwise than the job says, lie elsewhere, or are missing.",
        _JUDGED,
    ),
    Entry(
        "readback_psf_difference",
        "δ",
        "1",
        "Read-back PSF difference",
        "Relative L2 difference between the PSF of the polygons read back from the file and that of the design.",
        _DIFFERS,
        subject=Subject.OPTICS,
    ),
    Entry(
        "plate_bitmap_wrong_dots",
        "",
        "",
        "Wrong dots in the plate's bitmap",
        "Dots of the plotter's bitmap that are not 1 where, and only where, their centre lies in a polygon.",
        _DIFFERS,
    ),
    Entry(
        "dot_edge_error",
        "",
        "um",
        "Largest error of an edge in the plate's bitmap",
        "Farthest that an edge along x or y lies from where it is drawn, as the plotter's dots make it; a width is "
        "off by at most twice that.",
        "Plot at more dots per inch, or at a number of which every edge keeps to the dots.",
    ),
    Entry(
        "dot_edge_error_rms",
        "",
        "um",
        "Error of edges in the plate's bitmap, rms",
        "Root of the mean square of the errors of all edges along x or y, each by its length.",
    ),
    Entry(
        "bitmap_wrong_pixels",
        "",
        "",
        "Wrong pixels in the picture",
        "Pixels whose value does not match the clear fraction of their area (thresholded at 50 %, or as a grey level).",
        _DIFFERS,
    ),
    Entry(
        "bitmap_xor_area",
        "A_xor",
        "um^2",
        "XOR area of the picture",
        "Area in which the thresholded picture and the die differ; 0 where pixels divide the dots, "
        "elsewhere the area that pixels of this size cannot resolve.",
        "Choose dots_per_um so that a dot is a whole number of pixels.",
    ),
    Entry(
        "solid_instances",
        "",
        "",
        "Films in the solid",
        "Films placed: one of every cell in STEP, one in a mesh.",
        _DIFFERS,
    ),
    Entry("solid_pieces", "", "", "Pieces of the film", "Closed surfaces of the film in a mesh.", _DIFFERS),
    Entry(
        "solid_wrong_cells",
        "",
        "",
        "Wrong cells in the solid",
        "Cells that are missing, placed twice, or whose film differs from their opening in a dot.",
        _DIFFERS,
    ),
    Entry(
        "solid_position_error",
        "",
        "nm",
        "Position error of the solid",
        "Largest offset of a cell from its design position.",
        _DIFFERS,
    ),
    Entry(
        "solid_vertex_error",
        "",
        "nm",
        "Vertex error of the solid",
        "Largest offset of a vertex from the dot grid.",
        _DIFFERS,
    ),
    Entry(
        "solid_volume_error",
        "",
        "",
        "Volume error of the solid",
        "Relative difference between the volume of the film and its area times its thickness.",
        _DIFFERS,
    ),
    Entry("solid_glass_error", "", "nm", "Glass error", "Largest offset of a corner of the substrate.", _DIFFERS),
    Entry("solid_flaws", "", "", "Flaws of the solid", "Shapes that are invalid or not closed.", _DIFFERS),
    Entry("solid_dies", "", "", "Dies in the assembly", "Dies in the assembly of the plate.", _DIFFERS),
    Entry(
        "solid_strangers",
        "",
        "",
        "Unexpected parts in the assembly",
        "Parts of the assembly that are not on the plate.",
        _DIFFERS,
    ),
    Entry(
        "psf_file_wrong_facts",
        "",
        "",
        "Wrong entries in the PSF file",
        "Header entries that are missing or differ from those written.",
        _DIFFERS,
        subject=Subject.OPTICS,
    ),
    Entry(
        "psf_file_wrong_samples",
        "",
        "",
        "Wrong samples in the PSF file",
        "Samples of the file that differ from the PSF measured.",
        _DIFFERS,
        subject=Subject.OPTICS,
    ),
    # Files of any maker
    Entry(
        "lies",
        "",
        "",
        "Position, unit and tone",
        "Whether the file lies as the design does: not moved, turned, scaled or inverted.",
        "Export the file again as the row says.",
    ),
    Entry(
        "layer",
        "",
        "",
        "Clear layer",
        "Layer of the file that is read as clear.",
        "State the layer with --layer, or export to the layer of the job.",
    ),
    Entry(
        "layer_taken_out",
        "",
        "",
        "Layer subtracted",
        "Layer of the file whose shapes are taken out of what is clear.",
        "Tell the mask house to subtract it, or merge the layers.",
    ),
    Entry(
        "other_layers",
        "",
        "",
        "Other layers",
        "Layers with shapes that the job does not have.",
        "Delete them, or state them with --ignore.",
    ),
    Entry("passed_over", "", "", "Ignored layers", "Layers with shapes that were not looked at."),
    Entry(
        "rounding",
        "",
        "nm",
        "Distance to the grid",
        "Largest distance of a coordinate of the file to the database grid.",
    ),
    Entry("empty_polygons", "", "", "Empty polygons", "Polygons of the file without area.", "Delete them."),
    Entry(
        "repeated_vertices",
        "",
        "",
        "Repeated vertices",
        "Vertices of the file that repeat the one before.",
        "Delete them.",
    ),
    Entry("approximated_curves", "", "", "Approximated curves", "Circles of the file that were read as polygons."),
    Entry(
        "texts",
        "",
        "",
        "Texts",
        "Texts on the clear layer of the file, of which a mask shows nothing.",
        "Convert them to polygons, or delete them.",
    ),
    Entry(
        "grey_pixels",
        "",
        "",
        "Grey pixels",
        "Pixels of the picture that are neither black nor white.",
        "Export it without smoothing.",
    ),
    Entry(
        "xor_area",
        "A_xor",
        "um^2",
        "XOR area",
        "Area that is clear in the file or in the design, but not in both.",
        _DIFFERS,
    ),
    Entry("sliver_area", "", "um^2", "Sliver area", "Area that differs in slivers no wider than the tolerance."),
    # An edge that a camera photographed through a die
    Entry("edge_angle", "θ", "deg", "Angle of the edge", "Of a slanted edge from the nearer axis of the sensor."),
    Entry(
        "edge_mtf50",
        "ν50",
        "cy/mm",
        "MTF50 measured",
        "Frequency at which the MTF measured across an edge first falls below one half, pixel included.",
        "Focus again, and compare edges in several places of the picture.",
    ),
    Entry(
        "edge_mtf50_per_pixel",
        "ν50",
        "cy/pixel",
        "MTF50 measured, per pixel",
        "MTF50 measured in cycles per pixel of the sensor, which holds for any pixel.",
        "As for MTF50 measured.",
    ),
    Entry(
        "edge_mtf",
        "M({detail})",
        "1",
        "MTF measured",
        "Contrast that optics and pixel leave of a wave across the edge, at one frequency.",
    ),
    Entry(
        "edge_mtf_difference",
        "ΔM",
        "1",
        "MTF measured and designed",
        "Largest difference up to half a cycle per pixel between the MTF measured across an edge and the design's.",
        "Check focus, the die and the side of the plate; then the light, and the widths on the plate.",
    ),
    Entry(
        "edge_mtf_parting",
        "ν",
        "cy/mm",
        "MTF as designed up to",
        "First frequency at which the measured MTF differs from the design's by more than its band explains.",
        "As for the largest difference.",
    ),
    Entry(
        "mtf_difference",
        "ΔM",
        "1",
        "MTF difference",
        "Largest difference between the MTF of the file and that of the design.",
        _DIFFERS,
        subject=Subject.OPTICS,
    ),
    Entry(
        "raster_psf_difference",
        "δ",
        "1",
        "Error of the raster",
        "Relative L2 difference between the PSF of the file's polygons and that of their raster.",
    ),
    Entry(
        "optics",
        "",
        "",
        "Light through the file",
        "Whether anything is clear before the stop.",
        _DIFFERS,
        subject=Subject.OPTICS,
    ),
    Entry(
        "rule_width",
        "",
        "{detail}",
        "Rule: width",
        "Places where a clear shape is narrower than the limit.",
        "Widen them, or lower the limit.",
    ),
    Entry(
        "rule_space",
        "",
        "{detail}",
        "Rule: space",
        "Places where the chrome between clear shapes is narrower than the limit.",
        "Move the shapes apart, or lower the limit.",
    ),
    Entry(
        "rule_notch",
        "",
        "{detail}",
        "Rule: notch",
        "Places where the chrome between two edges of one polygon is narrower than the limit.",
        "Widen the notch, or lower the limit.",
    ),
    Entry(
        "rule_area", "", "{detail}", "Rule: clear area", "Clear islands of too little area.", "Delete or enlarge them."
    ),
    Entry(
        "rule_chrome_area",
        "",
        "{detail}",
        "Rule: chrome area",
        "Chrome islands of too little area.",
        "Delete or enlarge them.",
    ),
    Entry(
        "rule_corner_touch",
        "",
        "{detail}",
        "Rule: corner touches",
        "Points in which two clear corners touch.",
        "Merge or separate the shapes.",
    ),
    Entry(
        "rule_name_pattern",
        "",
        "names",
        "Rule: characters of names",
        "Cell names with characters that some software refuses.",
        "Rename the cells.",
    ),
    Entry(
        "rule_name_length",
        "",
        "names",
        "Rule: length of names",
        "Cell names that some software cuts short.",
        "Rename the cells.",
    ),
    Entry(
        "rule_vertices",
        "",
        "polygons over {detail} vertices",
        "Rule: vertices",
        "Polygons with more vertices than some readers take.",
        "Cut the polygons when exporting.",
    ),
    Entry(
        "rule_manhattan",
        "",
        "edges",
        "Rule: slanted edges",
        "Edges that run along neither axis, where the design has none.",
        "Export without turning or scaling.",
    ),
    Entry(
        "rule_extent",
        "",
        "um",
        "Rule: extent",
        "Distance by which the drawing extends beyond the blank.",
        "Move it onto the blank.",
    ),
    Entry(
        "rule_overlap",
        "",
        "places",
        "Rule: overlaps",
        "Places where shapes of the file overlap.",
        "Merge the shapes when exporting.",
    ),
    # Mask houses
    Entry(
        "shop_{shop_rule}",
        "",
        "{detail}",
        "Shop rule: {shop_rule}",
        "A published rule of the mask house: what the plate has, and what the house takes.",
        "Do as the row says, or ask the house.",
    ),
    # Finished folders and packages
    Entry(
        "measurement_left_out",
        "",
        "",
        "Measurement left out",
        "Why the measurement beside the job is not shown.",
    ),
    Entry(
        "sha256",
        "",
        "",
        "SHA-256",
        "Hash of a file against the one that was recorded for it.",
        "Take the files from the original, or make them again.",
    ),
    Entry("unlisted", "", "", "Unlisted file", "File that was not written with the others.", "Remove it."),
    Entry("readable", "", "", "Readable", "Whether a file can be read.", "Make it again."),
    Entry("job", "", "", "Job", "Whether the copy of the job can be used.", _RUN),
    Entry("job_hash", "", "", "Job hash", "Hash of the job's copy against the recorded one.", _RUN),
    Entry(
        "made_again", "", "", "Made again", "Whether a file that is made again equals the one that was written.", _RUN
    ),
    Entry("report", "", "", "Report", "Whether report.json can be read.", _RUN),
    Entry("report_schema", "", "", "Schema of the report", "Earlier schema by which report.json was written."),
    Entry("report_units", "", "", "Units of the report", "A unit as report.json of an earlier version spells it."),
    Entry(
        "report_photographs",
        "",
        "",
        "Photographs of the report",
        "Numbers of photographs that report.json of an earlier version predicts by a model.",
    ),
    Entry(
        "report_wires",
        "",
        "",
        "Wires of the report",
        "What report.json of an earlier version says of wires that were drawn alike in every pixel.",
    ),
    Entry(
        "report_protocol",
        "",
        "",
        "Protocol of the report's designs",
        "Designs of which report.json of an earlier version does not name the protocol.",
    ),
    Entry(
        "report_verdicts",
        "",
        "",
        "Verdicts of the report",
        "The one verdict that report.json of an earlier version gives for files, optics and displays.",
    ),
    Entry(
        "reported",
        "",
        "",
        "Reported value",
        "A value of report.json against the one measured now.",
        _REPORT,
        subject=Subject.OPTICS,
    ),
    Entry(
        "reported_differences",
        "",
        "",
        "Differences from the report",
        "Values of report.json that differ from those measured now.",
        _REPORT,
        subject=Subject.OPTICS,
    ),
    Entry(
        "drawn_again", "", "", "Drawn again", "Whether the plate of a package can be drawn again from its job.", _PACK
    ),
    Entry("foreign_bytes", "", "", "Foreign bytes", "Bytes of a package that belong to none of its files.", _PACK),
    Entry("package_folder", "", "", "Folder", "Folder in the package against the one that its order names.", _PACK),
    Entry("mask_files", "", "", "Mask files", "Mask files in the package.", _PACK),
    Entry(
        "extent",
        "",
        "nm",
        "Extent",
        "Distance by which anything in a mask file extends beyond the extent that the house asks for.",
        _PACK,
    ),
    Entry("paper", "", "", "Papers", "A paper of the package against the one that its job and profile make.", _PACK),
    Entry(
        "profile",
        "",
        "",
        "Shop profile",
        "Whether the profile of the package is the one known of that house.",
        "Ask the house for its rules, then pack the job again.",
    ),
    Entry("files", "", "", "Listed files", "Files, formats and lengths that the package's manifest lists.", _PACK),
    Entry(
        "manifest_{entry}",
        "",
        "",
        "Manifest: {entry}",
        "An entry of the package's manifest against what its job and profile make.",
        _PACK,
    ),
)

QUANTITIES: Mapping[str, Entry] = MappingProxyType({entry.name: entry for entry in _ENTRIES})
"""Every entry by its name, in the order of the glossary."""


def _pattern(name: str) -> re.Pattern[str]:
    def group(word: re.Match[str]) -> str:
        return f"(?P<{word[1]}>{FAMILIES[word[1]]})"

    return re.compile(re.sub(r"\{(\w+)\}", group, name), re.DOTALL)


@cache
def _families() -> tuple[tuple[re.Pattern[str], Entry], ...]:
    return tuple((_pattern(entry.name), entry) for entry in _ENTRIES if "{" in entry.name)


@lru_cache(maxsize=1024)
def registered(name: str) -> Entry:
    """The entry of a quantity, its family's words filled in.

    Raises:
        InternalError: MF901 if neither a quantity nor a family of that name is registered.
    """
    if "{" not in name and name in QUANTITIES:
        return QUANTITIES[name]
    for pattern, entry in _families():
        if found := pattern.fullmatch(name):
            return entry.member(found.groupdict())
    what = f"no quantity {name!r} is registered"
    raise InternalError("MF901", what, cure="Add it to QUANTITIES in maskfab/base/quantities.py")
