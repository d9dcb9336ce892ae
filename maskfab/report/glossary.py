"""What the reported names mean, and what to do when a check on one of them fails."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Term:
    """A reported quantity in a reader's words.

    Attributes:
        title: heading in tables.
        meaning: one sentence.
        cure: what to do if its check fails.
    """

    title: str
    meaning: str
    cure: str = ""


_DIFFERS = (
    "The written file is not the design. Do not send this plate: compare the file with the design where they differ."
)
_SUSPECT = (
    "The numbers of this die cannot be trusted. Raise the accuracy; if the error stays, report it with report.json."
)


def _written(reading: str, corners: str) -> dict[str, Term]:
    """Terms of a die as its mask is written, in one of two readings."""
    asked = "Ask the mask house for a finer spot, or choose an opening without corners that only touch."
    return {
        f"written_open_ratio_{reading}": Term(
            f"Open ratio as written, {reading}",
            f"Clear share of the lens stop as the writer leaves it. {corners}",
            asked,
        ),
        f"written_psf_difference_{reading}": Term(
            f"PSF difference as written, {reading}",
            f"Relative L2 difference between the PSF of the written mask and that of the drawn one. {corners}",
            asked,
        ),
        f"written_auc_radial_min_{reading}": Term(
            f"AUC of the radial minimum as written, {reading}", f"The same of the written mask. {corners}", asked
        ),
        f"written_mtf50_{reading}": Term(
            f"MTF50 as written, {reading}", f"The same of the written mask. {corners}", asked
        ),
    }


_STATE = "State it in [plate]: the worst is assumed."
_BAR: Mapping[str, Term] = MappingProxyType(
    {
        "model_bar": Term(
            "Model bar",
            "How far the true PSF may be from the one shown by what is not modelled, all rows below added. Numerical "
            "errors, which stand beside each number, are far smaller.",
        ),
        "model_chrome_leak": Term("Chrome leak", "Light through the opaque film, in step with the openings'.", _STATE),
        "model_foreshortening": Term("Foreshortening", "Openings and stop are narrower for light from the side."),
        "model_tangent_for_sine": Term(
            "Tangent for sine", "Where a lens without distortion images a direction, against where diffraction puts it."
        ),
        "model_tangent_off_axis": Term(
            "Tangent off axis", "The same at the largest image height that the scene asks for."
        ),
        "model_vector_field": Term("Vector field", "Light is no scalar: steep rays add as vectors."),
        "model_lens_apodisation": Term("Lens apodisation", "The lens passes steep rays weaker or stronger."),
        "model_glass": Term("Glass", "Light spreads in the glass between the chrome and the lens.", _STATE),
        "model_ghosts": Term(
            "Ghosts", "Light that glass and chrome throw to and fro.", "Ask for low-reflection chrome."
        ),
        "model_cd_bias": Term("CD bias", "Clear features come out wider or narrower than drawn.", "Measure the plate."),
    }
)

QUANTITIES: Mapping[str, Term] = MappingProxyType(
    {
        "open_ratio": Term(
            "Open ratio",
            "Clear share of a display pixel, its wiring gutter included.",
            "Open or close dots of the opening, or change the gutter.",
        ),
        **_BAR,
        "stop_open_ratio": Term(
            "Open ratio in the stop",
            "Clear share of the lens stop. It differs a little from the open ratio, as the rim of the stop cuts cells.",
            "Change the opening, or the stop.",
        ),
        "paraxial_model_error": Term(
            "Error of the paraxial model",
            "How far a scalar, paraxial PSF is from that of a real lens this fast, which no error bar holds.",
            "Use a slower lens, or take what is reported for the trend only.",
        ),
        "auc_radial_min": Term(
            "Area under the radial-minimum MTF",
            "Mean, from 0 to half a cycle per pixel, of the lowest MTF over all directions. "
            "High means that no direction of the picture is lost beyond restoring.",
            "Choose an opening without a preferred direction, or a random tiling.",
        ),
        "mtf50": Term(
            "MTF50",
            "Frequency at which the MTF falls to one half.",
            "Raise the open ratio, or the share of light in the PSF's core.",
        ),
        "mtf30": Term(
            "MTF30",
            "Frequency at which the MTF falls to 30 %.",
            "Raise the open ratio, or the share of light in the PSF's core.",
        ),
        "mtf10": Term(
            "MTF10",
            "Frequency at which the MTF falls to 10 %; what is finer is close to lost.",
            "Raise the open ratio, or the share of light in the PSF's core.",
        ),
        **{
            f"mtf{level}_per_pixel": Term(
                f"MTF{level} per pixel",
                f"The same frequency as MTF{level}, in cycles per sensor pixel; pixels hold at most 0.5.",
                f"As for MTF{level}; or, if it is close to 0.5, choose a finer pixel.",
            )
            for level in (50, 30, 10)
        },
        "mtf_aliasing": Term(
            "Aliasing of the MTF",
            "Largest distance, over all positions of the picture against the pixels, of the MTF that the sampled PSF "
            "shows from the presampled one. It is the error of an MTF that is measured from one picture of a point.",
            "Choose a finer pixel, or compare presampled MTFs only.",
        ),
        "mtf_phase_range": Term(
            "Aliased MTF's change with phase",
            "Largest change of the sampled PSF's MTF when the picture moves by part of a pixel.",
            "Choose a finer pixel, or compare presampled MTFs only.",
        ),
        "wiener_worst30": Term(
            "Restored contrast, worst 30 %",
            "Mean contrast that a Wiener filter gives back at the 30 % of frequencies where it gives back least; "
            "0 is lost, 1 is as without a panel.",
            "Choose an opening and a tiling whose MTF has no nulls.",
        ),
        "wiener_noise_gain": Term(
            "Noise gain of restoration",
            "How much the Wiener filter amplifies the pixels' noise.",
            "Choose an opening with a higher MTF, or restore less: a larger noise-to-signal ratio.",
        ),
        "ensquared_energy": Term(
            "Energy in the core",
            "Share of all light through the panel that lands in the 5 x 5 pixels about the picture of a point.",
            "Raise the open ratio: orders and haze take the rest.",
        ),
        "encircled_energy": Term(
            "Encircled energy",
            "Share of all light through the panel that lands within a circle about the picture of a point.",
            "Raise the open ratio: orders and haze take the rest.",
        ),
        "halo_energy": Term(
            "Energy in the halo",
            "Share of all light through the panel that lands far from the picture of a point, outside the PSF's window "
            "included.",
            "Raise the open ratio, or choose a larger pitch, which keeps orders closer.",
        ),
        "peak_to_side_lobe": Term(
            "Peak to side lobe",
            "Peak of the PSF over its brightest other maximum: how faint the strongest ghost is.",
            "Choose a random tiling, which spreads orders out.",
        ),
        "first_side_lobe": Term(
            "First side lobe",
            "Distance from the axis of the PSF's nearest other maximum; the stop's own first ring, unless orders lie "
            "closer.",
            "Change the stop, or the pitch.",
        ),
        "streak_index": Term(
            "Streak index",
            "Brightest direction of the PSF's tail over the mean of all: 1 is a round haze, 19 a single streak.",
            "Choose an opening without long straight edges, or a random tiling.",
        ),
        "energy_normalised_strehl": Term(
            "Peak, energies equal",
            "Peak of the PSF over an open stop's if both pass the same light. The open ratio alone fixes it.",
            "Raise the open ratio.",
        ),
        "order_zero_incident": Term(
            "Zero order, of incident light",
            "Share of the light falling on a periodic panel that goes straight on.",
            "Raise the open ratio.",
        ),
        "order_zero_transmitted": Term(
            "Zero order, of transmitted light",
            "Share of the light through a periodic panel that goes straight on.",
            "Raise the open ratio.",
        ),
        "orders_lowest_five_incident": Term(
            "Lowest five orders, of incident light",
            "Share of the light falling on a periodic panel that goes into the zero order and its four neighbours.",
            "Raise the open ratio.",
        ),
        "orders_lowest_five_transmitted": Term(
            "Lowest five orders, of transmitted light",
            "Share of the light through a periodic panel that goes into the zero order and its four neighbours.",
            "Raise the open ratio.",
        ),
        "colour_distance": Term(
            "Distance of the colours",
            "Share of the longest wavelength's light that lands where the shortest one's does not.",
            "Choose a random tiling: orders of different colours lie apart, haze overlaps.",
        ),
        "edge_colour_difference": Term(
            "Colour fringe of an edge",
            "Largest colour difference (CIE 1976) from grey along the picture of a black and white edge; about 2 "
            "can be seen.",
            "Choose a random tiling: orders of different colours lie apart, haze overlaps.",
        ),
        "restored_psnr": Term(
            "Restored PSNR",
            "Peak signal-to-noise ratio that restored photographs behind this die are expected to have, at a level of "
            "light: protocol F1, its camera of 10 mm at f/2.5 and 2 µm pixels, no denoiser. The level is the "
            "signal-to-noise ratio of white behind the published display.",
            "Choose one compact opening and a designed map of its orientations, or open more of the cell.",
        ),
        "psf_energy_in_window": Term(
            "PSF energy in window",
            "Share of all light through the panel that lands inside the window in which the PSF is shown; "
            "the rest is haze beyond its edge.",
            "Widen the window (camera.window).",
        ),
        "readback_psf_difference": Term(
            "Read-back PSF difference",
            "Relative L2 difference between the PSF of the polygons read back from the file and that of the design.",
            _DIFFERS,
        ),
        "solid_instances": Term("Cells in the solid", "Unit cells that a file of solids places.", _DIFFERS),
        "solid_wrong_cells": Term(
            "Wrong cells in the solid",
            "Cells that are missing, placed twice, or whose film is not that of their opening, dot by dot.",
            _DIFFERS,
        ),
        "solid_position_error": Term(
            "Position error of the solid", "Largest distance of a cell from where the design has it.", _DIFFERS
        ),
        "solid_vertex_error": Term(
            "Vertex error of the solid", "Largest distance of a vertex from the grid lines of the dots.", _DIFFERS
        ),
        "solid_volume_error": Term(
            "Volume error of the solid",
            "Relative difference between the film's volume and area times thickness.",
            _DIFFERS,
        ),
        "solid_glass_error": Term(
            "Glass error", "Largest distance of a corner of the substrate from its place.", _DIFFERS
        ),
        "solid_flaws": Term("Flaws of the solid", "Shapes that are not valid, or not watertight.", _DIFFERS),
        "solid_dies": Term("Dies in the assembly", "Dies that the plate's assembly holds.", _DIFFERS),
        "solid_strangers": Term(
            "Strangers in the assembly", "Parts of the assembly that the plate does not have.", _DIFFERS
        ),
        "bitmap_wrong_pixels": Term(
            "Wrong pixels of the picture",
            "Pixels that are not what the share of them that is clear makes them: white from a half on, or that share "
            "as a grey.",
            _DIFFERS,
        ),
        "bitmap_xor_area": Term(
            "XOR area of the picture",
            "Area that only one of picture and die covers, each pixel clear or not; where pixels follow the dots it "
            "has to be 0, elsewhere it is what pixels so large cannot show.",
            "Choose dots_per_um so that a dot is a whole number of pixels.",
        ),
        "psf_file_wrong_facts": Term(
            "Wrong entries of the PSF's file", "Entries of the header that are missing or not as written.", _DIFFERS
        ),
        "psf_file_wrong_samples": Term(
            "Wrong samples of the PSF's file", "Samples of the file that are not those of the PSF measured.", _DIFFERS
        ),
        "drawn_holes": Term("Outlines with holes", "Outlines whose holes were drawn in another way; their area stays."),
        "drawn_parted": Term("Outlines parted", "Outlines that touched themselves and were parted there."),
        "drawn_split": Term("Outlines cut", "Outlines cut because they had more vertices than a reader takes."),
        **_written("fused", "Corners that only touch have become one shape."),
        **_written("open", "Corners that only touch have come apart."),
        "readback_xor_area": Term(
            "Read-back XOR area",
            "Area that is clear in the file and not in the design, or the reverse.",
            _DIFFERS,
        ),
        "scene_psf_change": Term(
            "Change of the PSF by the scene",
            "Relative L2 difference between the PSF where the scene is hardest (the corner of the field, the end of "
            "the depth that is most out of focus) and the one on the axis, in focus, without a gap.",
        ),
        "plan_error": Term(
            "Estimated error of the plan",
            "Estimated relative L2 error of the scene's PSF by all that the plan leaves out.",
            "Ask for less accuracy in [scene].",
        ),
        "plan_error_measured": Term(
            "Measured error of the plan",
            "Relative L2 difference between the scene's PSF as the plan models it and as the fullest model does, where "
            "the scene is hardest.",
            "An estimate was too low here: ask for more accuracy in [scene], so that the plan leaves out less.",
        ),
        "field_residual": Term(
            "Residual blur in the corner",
            "What is left of the corner's PSF after Wiener deblurring with the centre's, against what is left of the "
            "centre's own; 0 says that one PSF deblurs the whole picture.",
            "Put the panel closer to the lens, or deblur with a PSF for each part of the field.",
        ),
        "field_mtf_tangential": Term(
            "Tangential MTF in the corner",
            "Contrast, in the corner of the field, of lines across the radius, four pixels to a period.",
            "Raise the open ratio, or choose an opening without a preferred direction.",
        ),
        "field_mtf_sagittal": Term(
            "Sagittal MTF in the corner",
            "Contrast, in the corner of the field, of lines along the radius, four pixels to a period.",
            "Raise the open ratio, or choose an opening without a preferred direction.",
        ),
        "depth_residual": Term(
            "Residual blur over depth",
            "What is left of the PSF of the nearest or farthest object, whichever is more, after Wiener deblurring "
            "with the PSF of the one in focus, against what is left of that one's own.",
            "Ask for less depth, choose a smaller stop, or deblur with a PSF for each distance.",
        ),
        "depth_change": Term(
            "Change of the PSF over depth",
            "Relative L2 difference between the PSF on pixels of the nearest or farthest object, whichever is more, "
            "and of the one in focus.",
            "Ask for less depth, or choose a smaller stop.",
        ),
        "nearest_object": Term(
            "Nearest object",
            "A PSF that is constant over depth holds from here on: for an object in focus nearer than this its change "
            "of scale alone exceeds the accuracy.",
            "Ask for less accuracy, or model the scale of a near focus.",
        ),
        "strehl_invariant_error": Term(
            "Strehl invariant error",
            "Relative difference between the PSF's peak and the value that the clear area alone fixes for it.",
            _SUSPECT,
        ),
        "mtf_volume_invariant_error": Term(
            "MTF volume invariant error",
            "Relative difference between the volume under the transfer function and the value that the clear area "
            "alone fixes for it.",
            _SUSPECT,
        ),
        "corner_touches": Term(
            "Corner touches",
            "Places where two clear dots meet in a single point, which a mask writer may join or part at will.",
            "Open or close one dot at every such corner of the opening.",
        ),
        "min_feature": Term(
            "Minimum feature",
            "Narrowest clear width in the file.",
            "Make the dots larger, or choose a writer with a finer limit.",
        ),
        "min_space": Term(
            "Minimum space",
            "Narrowest chrome between two clear shapes in the file.",
            "Widen the gutter or the dots, or choose a writer with a finer limit.",
        ),
        "peak_strehl": Term(
            "Peak against an open stop",
            "Peak of the PSF over that of the same stop without a panel.",
            "Raise the open ratio: the peak falls with its square.",
        ),
        "led_footprint": Term(
            "Emitter footprint",
            "Share of the pixel that each colour's emitter covers, the smallest relative to its ratio.",
            "Lower the open ratio, or ask for smaller emitters.",
        ),
        "led_footprint_largest": Term(
            "Largest footprint found",
            "The largest placement that was found; smaller ones may be drawn, for their light to be better centred.",
        ),
        "led_footprint_bound": Term(
            "Largest footprint possible", "No placement that keeps the rules has a larger one."
        ),
        "emitter_rules_broken": Term(
            "Emitter rules broken",
            "Rules of gap and width that the emitters' polygons break, every pair of neighbours looked at.",
            "Move or shrink the emitters that are drawn by hand.",
        ),
        "emitters_stranded": Term(
            "Stranded emitters", "Emitters on an island of closed dots, from which no line leads to the pixel's side."
        ),
        "grain_rms": Term(
            "Grain", "Unevenness of an even field for the eye, which comes from pixels whose light is off their centre."
        ),
        "wired_transmission": Term(
            "Light past the wires", "Share of the openings' light that wires over them let pass; the mask has no wires."
        ),
        "wired_psf_change": Term(
            "PSF change by the wires", "How far wires over the openings change the PSF that is told of the mask."
        ),
    }
)

WORDS: Mapping[str, str] = MappingProxyType(
    {
        "opening": "The clear shape in one display pixel.",
        "open ratio": "The clear share of the pixel. Not the fill factor, which is the share of a subpixel that emits.",
        "dot": "One square element of an opening.",
        "pitch": "Side of one display pixel; DPI = 25 400 µm / pitch.",
        "tiling": "Which of the eight mirrored and turned orientations each pixel takes: one for all (periodic), "
        "or drawn from a seed (random; paper4 draws from four).",
        "gutter": "Opaque space round every pixel, kept for wiring.",
        "die": "One panel on the plate.",
        "PSF": "Point spread function: the picture of a distant point of light.",
        "MTF": "Modulation transfer function: contrast of the picture of a sine pattern. Presampled: the sensor "
        "pixel's blur is included, its aliasing is not.",
        "radial minimum": "The lowest MTF over all directions at one frequency.",
        "aliased": "Of samples one pixel apart: frequencies finer than the pixels can hold are folded onto "
        "coarser ones, differently for every position of the picture against the pixels.",
        "scene": "What the camera looks at: distances, field, the gap between panel and lens, aberrations, light.",
        "plan": "The cheapest model of a scene whose error, what it leaves out included, is within the accuracy.",
        "accuracy": "The admissible relative L2 error of the scene's PSF over its window.",
        "design": "How an opening was found, as its file states it. Not part of what is checked.",
        "head room": "What no other opening with as many clear dots can gain over this one, by proof.",
        "protocol F1": "Photographs of fixed scenes, with the noise of real light, restored by a Wiener filter "
        "whose one constant suits the design best; compared with the truth over the whole frame and over the inner "
        "one, without 64 pixels at every edge.",
        "surrogate": "A model that predicts what protocol F1 will find, in two milliseconds.",
        "relative L2": "Root of the sum of squared differences over that of the squared values.",
        "Wiener filter": "The linear restoration with the least mean squared error at a given noise-to-signal ratio.",
        "XOR": "The area in which two layouts differ.",
        "CD": "Critical dimension: a width measured at a named gauge.",
    }
)


def term(name: str) -> Term:
    """The words for a quantity; a name that the glossary lacks is spelt out."""
    if name.startswith("cd_"):
        return Term(f"CD {name[3:].replace('_', ' ')}", "Clear width at a gauge.", _DIFFERS)
    title = name.replace("_", " ")
    return QUANTITIES.get(name) or Term(title[:1].upper() + title[1:], "")
