"""The glossary of reports: meaning of each quantity, and what to do if a check on it fails."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Term:
    """One glossary entry.

    Attributes:
        title: heading in tables.
        meaning: one sentence.
        cure: what to do if its check fails.
    """

    title: str
    meaning: str
    cure: str = ""


_DIFFERS = "The written file differs from the design. Do not send this plate; look at the places where they differ."
_SUSPECT = (
    "The numbers of this die cannot be trusted. Set a stricter accuracy; if the error remains, report it with "
    "report.json."
)


def _written(reading: str, corners: str) -> dict[str, Term]:
    """Terms of a die as its mask is written, in one of two readings."""
    asked = "Ask the mask house for a finer spot, or choose an opening without touching corners."
    return {
        f"written_open_ratio_{reading}": Term(
            f"Open ratio as written, {reading}",
            f"Clear fraction of the lens stop as written. {corners}",
            asked,
        ),
        f"written_psf_difference_{reading}": Term(
            f"PSF difference as written, {reading}",
            f"Relative L2 difference between the PSF of the written mask and that of the drawn one. {corners}",
            asked,
        ),
        f"written_auc_radial_min_{reading}": Term(
            f"AUC of the radial minimum as written, {reading}", f"auc_radial_min of the written mask. {corners}", asked
        ),
        f"written_mtf50_{reading}": Term(
            f"MTF50 as written, {reading}", f"MTF50 of the written mask. {corners}", asked
        ),
    }


_STATE = "State it in [plate]; the default is the worst case."
_BAR: Mapping[str, Term] = MappingProxyType(
    {
        "model_bar": Term(
            "Model bar",
            "Estimated distance of the true PSF from the one shown, due to all effects that are not modelled: the sum "
            "of the rows below. The numerical errors given with each number are far smaller.",
        ),
        "model_chrome_leak": Term(
            "Chrome leak", "Light that leaks through the chrome and interferes with the light of the openings.", _STATE
        ),
        "model_foreshortening": Term("Foreshortening", "Openings and stop appear narrower to oblique light."),
        "model_tangent_for_sine": Term(
            "Tangent for sine",
            "Difference between the image position of a distortion-free lens (tangent) and of diffraction (sine).",
        ),
        "model_tangent_off_axis": Term("Tangent off axis", "The same at the largest image height of the scene."),
        "model_vector_field": Term("Vector field", "Polarisation: steep rays add as vectors, not as scalars."),
        "model_lens_apodisation": Term("Lens apodisation", "Transmission of the lens that varies over its pupil."),
        "model_glass": Term("Glass", "Aberration by the glass between the chrome and the lens.", _STATE),
        "model_ghosts": Term(
            "Ghosts", "Light reflected back and forth between glass and chrome.", "Ask for low-reflection chrome."
        ),
        "model_cd_bias": Term(
            "CD bias", "Clear features are written wider or narrower than drawn.", "Measure the plate."
        ),
    }
)

QUANTITIES: Mapping[str, Term] = MappingProxyType(
    {
        "open_ratio": Term(
            "Open ratio",
            "Clear fraction of a display pixel, wiring gutter included.",
            "Open or close dots of the opening, or change the gutter.",
        ),
        **_BAR,
        "stop_open_ratio": Term(
            "Open ratio in the stop",
            "Clear fraction of the lens stop. It differs slightly from the open ratio because its edge cuts cells.",
            "Change the opening, or the stop.",
        ),
        "paraxial_model_error": Term(
            "Error of the paraxial model",
            "Difference between a scalar, paraxial PSF and that of a real lens this fast; not in the error bars.",
            "Use a slower lens, or read the results as trends only.",
        ),
        "auc_radial_min": Term(
            "Area under the radial-minimum MTF",
            "Mean, from 0 to half a cycle per pixel, of the lowest MTF over all directions. "
            "High means that no direction of the picture is lost beyond restoration.",
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
            "Frequency at which the MTF falls to 10 %; finer detail is almost lost.",
            "Raise the open ratio, or the share of light in the PSF's core.",
        ),
        **{
            f"mtf{level}_per_pixel": Term(
                f"MTF{level} per pixel",
                f"MTF{level} in cycles per sensor pixel; the Nyquist limit is 0.5.",
                f"As for MTF{level}; if it is close to 0.5, choose a smaller pixel.",
            )
            for level in (50, 30, 10)
        },
        "mtf_aliasing": Term(
            "Aliasing of the MTF",
            "Largest difference, over all sub-pixel offsets of the picture, between the MTF of the sampled PSF and the "
            "presampled one: the error of an MTF measured from one picture of a point.",
            "Choose a finer pixel, or compare presampled MTFs only.",
        ),
        "mtf_phase_range": Term(
            "Variation of the aliased MTF with phase",
            "Largest change of the MTF of the sampled PSF when the picture shifts by a fraction of a pixel.",
            "Choose a finer pixel, or compare presampled MTFs only.",
        ),
        "wiener_worst30": Term(
            "Restored contrast, worst 30 %",
            "Mean contrast after Wiener restoration over the worst 30 % of frequencies; 0 is lost, 1 is full contrast.",
            "Choose an opening and a tiling whose MTF has no nulls.",
        ),
        "wiener_noise_gain": Term(
            "Noise gain of restoration",
            "Amplification of pixel noise by the Wiener filter.",
            "Choose an opening with a higher MTF, or a weaker restoration (a larger noise-to-signal ratio).",
        ),
        "ensquared_energy": Term(
            "Energy in the core",
            "Fraction of the light through the panel within 5 x 5 pixels around the image of a point.",
            "Raise the open ratio: orders and haze take the rest.",
        ),
        "encircled_energy": Term(
            "Encircled energy",
            "Fraction of the light through the panel within a circle around the image of a point.",
            "Raise the open ratio: orders and haze take the rest.",
        ),
        "halo_energy": Term(
            "Energy in the halo",
            "Fraction of the light through the panel that lands far from the image of a point, including the light "
            "outside the PSF window.",
            "Raise the open ratio, or choose a larger pitch, which brings the orders closer.",
        ),
        "peak_to_side_lobe": Term(
            "Peak to side lobe",
            "Ratio of the PSF peak to its next highest maximum (the strongest ghost).",
            "Choose a random tiling, which spreads orders out.",
        ),
        "first_side_lobe": Term(
            "First side lobe",
            "Distance of the nearest secondary maximum of the PSF from the axis: the first ring of the stop, unless an "
            "order is closer.",
            "Change the stop, or the pitch.",
        ),
        "streak_index": Term(
            "Streak index",
            "Ratio of the brightest direction of the PSF tail to the mean: 1 is a round haze, 19 a single streak.",
            "Choose an opening without long straight edges, or a random tiling.",
        ),
        "energy_normalised_strehl": Term(
            "Peak at equal energy",
            "Ratio of the PSF peak to that of an unobstructed stop at equal energy. It depends on the open ratio only.",
            "Raise the open ratio.",
        ),
        "order_zero_incident": Term(
            "Zero order, of incident light",
            "Fraction of the light incident on a periodic panel that goes into the zero order.",
            "Raise the open ratio.",
        ),
        "order_zero_transmitted": Term(
            "Zero order, of transmitted light",
            "Fraction of the light transmitted by a periodic panel that goes into the zero order.",
            "Raise the open ratio.",
        ),
        "orders_lowest_five_incident": Term(
            "Lowest five orders, of incident light",
            "Fraction of the light incident on a periodic panel in the zero order and its four neighbours.",
            "Raise the open ratio.",
        ),
        "orders_lowest_five_transmitted": Term(
            "Lowest five orders, of transmitted light",
            "Fraction of the light transmitted by a periodic panel in the zero order and its four neighbours.",
            "Raise the open ratio.",
        ),
        "colour_distance": Term(
            "Colour separation",
            "Fraction of the light of the longest wavelength that does not overlap with that of the shortest.",
            "Choose a random tiling: orders of different colours lie apart, haze overlaps.",
        ),
        "edge_colour_difference": Term(
            "Colour fringe at an edge",
            "Largest colour difference (CIE 1976) from grey across the image of a black and white edge; about 2 "
            "is visible.",
            "Choose a random tiling: orders of different colours lie apart, haze overlaps.",
        ),
        "restored_psnr": Term(
            "Restored PSNR",
            "Expected peak signal-to-noise ratio of restored photographs through this die at a given light "
            "level: taken by the job's camera, restored as protocol F1 does, no denoiser. The level is the "
            "signal-to-noise ratio of white behind the published display.",
            "Choose one compact opening with a designed orientation map, or raise the open ratio.",
        ),
        "photographs_refused": Term(
            "Photographs not judged",
            "Why restored photographs behind this die are not judged, or not taken, by the job's camera.",
            "Change the camera as it says; everything else is measured all the same.",
        ),
        "designed_for": Term(
            "Another camera's design",
            "Camera that the die's opening or map was made for, where it is not the job's.",
            "Design it again with maskfab design and this job's camera.",
        ),
        "psf_energy_in_window": Term(
            "PSF energy in window",
            "Fraction of the light through the panel that lands inside the PSF window; the rest is haze outside it.",
            "Widen the window (camera.window).",
        ),
        "readback_psf_difference": Term(
            "Read-back PSF difference",
            "Relative L2 difference between the PSF of the polygons read back from the file and that of the design.",
            _DIFFERS,
        ),
        "solid_instances": Term("Cells in the solid", "Unit cells placed in the solid file.", _DIFFERS),
        "solid_wrong_cells": Term(
            "Wrong cells in the solid",
            "Cells that are missing, placed twice, or whose film differs from their opening in a dot.",
            _DIFFERS,
        ),
        "solid_position_error": Term(
            "Position error of the solid", "Largest offset of a cell from its design position.", _DIFFERS
        ),
        "solid_vertex_error": Term(
            "Vertex error of the solid", "Largest offset of a vertex from the dot grid.", _DIFFERS
        ),
        "solid_volume_error": Term(
            "Volume error of the solid",
            "Relative difference between the volume of the film and its area times its thickness.",
            _DIFFERS,
        ),
        "solid_glass_error": Term("Glass error", "Largest offset of a corner of the substrate.", _DIFFERS),
        "solid_flaws": Term("Flaws of the solid", "Shapes that are invalid or not watertight.", _DIFFERS),
        "solid_dies": Term("Dies in the assembly", "Dies in the assembly of the plate.", _DIFFERS),
        "solid_strangers": Term(
            "Unexpected parts in the assembly", "Parts of the assembly that are not on the plate.", _DIFFERS
        ),
        "bitmap_wrong_pixels": Term(
            "Wrong pixels in the picture",
            "Pixels whose value does not match the clear fraction of their area (thresholded at 50 %, or as a grey "
            "level).",
            _DIFFERS,
        ),
        "bitmap_xor_area": Term(
            "XOR area of the picture",
            "Area in which the thresholded picture and the die differ; 0 where pixels divide the dots, elsewhere the "
            "area that pixels of this size cannot resolve.",
            "Choose dots_per_um so that a dot is a whole number of pixels.",
        ),
        "psf_file_wrong_facts": Term(
            "Wrong entries in the PSF file", "Header entries that are missing or differ from those written.", _DIFFERS
        ),
        "psf_file_wrong_samples": Term(
            "Wrong samples in the PSF file", "Samples of the file that differ from the PSF measured.", _DIFFERS
        ),
        "drawn_holes": Term("Outlines with holes", "Outlines whose holes were redrawn; their area is unchanged."),
        "drawn_parted": Term("Outlines separated", "Outlines that touched themselves and were separated there."),
        "drawn_split": Term("Outlines cut", "Outlines cut because they had more vertices than max_vertices."),
        **_written("fused", "Touching corners are assumed to merge."),
        **_written("open", "Touching corners are assumed to separate."),
        "readback_xor_area": Term(
            "Read-back XOR area",
            "Area that is clear in the file and not in the design, or the reverse.",
            _DIFFERS,
        ),
        "scene_psf_change": Term(
            "Change of the PSF by the scene",
            "Relative L2 difference between the PSF at the worst point of the scene (corner of the field, most "
            "defocused end of the depth) and the PSF on the axis, in focus, without a gap.",
        ),
        "plan_error": Term(
            "Estimated error of the plan",
            "Estimated relative L2 error of the scene's PSF due to all effects that the plan omits.",
            "Set a looser accuracy in [scene].",
        ),
        "plan_error_measured": Term(
            "Measured error of the plan",
            "Relative L2 difference between the PSF of the planned model and of the fullest model at the worst point "
            "of the scene.",
            "The estimate was too low here: set a stricter accuracy in [scene], so that the plan omits less.",
        ),
        "field_residual": Term(
            "Residual blur in the corner",
            "Residue of the corner's PSF after Wiener deblurring with the centre's PSF, relative to the residue of the "
            "centre itself; 0 means that one PSF deblurs the whole picture.",
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
            "Residue of the PSF of the nearest or farthest object (the larger) after Wiener deblurring with the "
            "in-focus PSF, relative to the residue of the in-focus PSF itself.",
            "Ask for less depth, choose a smaller stop, or deblur with a PSF for each distance.",
        ),
        "depth_change": Term(
            "Change of the PSF over depth",
            "Relative L2 difference between the pixel PSF of the nearest or farthest object (the larger) and the "
            "in-focus one.",
            "Ask for less depth, or choose a smaller stop.",
        ),
        "nearest_object": Term(
            "Nearest object",
            "Shortest focus distance at which a depth-independent PSF is accurate enough; nearer, its change of "
            "scale alone exceeds the accuracy.",
            "Set a looser accuracy, or model the scale of a near focus.",
        ),
        "strehl_invariant_error": Term(
            "Strehl invariant error",
            "Relative difference between the PSF peak and its exact value, which follows from the clear area alone.",
            _SUSPECT,
        ),
        "mtf_volume_invariant_error": Term(
            "MTF volume invariant error",
            "Relative difference between the volume under the transfer function and its exact value, which follows "
            "from the clear area alone.",
            _SUSPECT,
        ),
        "corner_touches": Term(
            "Corner touches",
            "Places where two clear dots touch at a single point; a mask writer may merge or separate them.",
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
            "Ratio of the PSF peak to that of the same stop without a panel.",
            "Raise the open ratio: the peak falls with its square.",
        ),
        "led_footprint": Term(
            "Emitter footprint",
            "Emitter area per colour as a fraction of the pixel (the colour furthest below its target ratio).",
            "Lower the open ratio, or ask for smaller emitters.",
        ),
        "led_footprint_largest": Term(
            "Largest footprint found",
            "Footprint of the largest placement found; smaller emitters may be drawn to centre their light better.",
        ),
        "led_footprint_bound": Term(
            "Largest footprint possible", "Proven upper bound of the footprint under the rules."
        ),
        "emitter_rules_broken": Term(
            "Emitter rules broken",
            "Gap and width rules broken by the emitter polygons, checked for every pair of neighbours.",
            "Move or shrink the emitters that are drawn by hand.",
        ),
        "emitters_stranded": Term(
            "Stranded emitters", "Emitters on an island of opaque dots that no line connects to the edge of the pixel."
        ),
        "grain_rms": Term(
            "Grain", "Visible unevenness of a uniform field, caused by emitters that are off-centre in their pixels."
        ),
        "wired_transmission": Term(
            "Transmission of the wires",
            "Fraction of the light of the openings that wires over them transmit; the mask has no wires.",
        ),
        "wired_psf_change": Term(
            "PSF change by the wires", "Relative change of the PSF of the mask by wires over its openings."
        ),
    }
)

WORDS: Mapping[str, str] = MappingProxyType(
    {
        "opening": "The clear shape in one display pixel.",
        "open ratio": "Clear fraction of the pixel; not the fill factor, which is the emitting fraction of a subpixel.",
        "dot": "One square element of an opening.",
        "pitch": "Side of one display pixel; DPI = 25 400 µm / pitch.",
        "tiling": "The orientation of each pixel, out of eight rotated and mirrored ones: one for all (periodic), "
        "or drawn from a seed (random; paper4 draws from four).",
        "gutter": "Opaque border around every pixel, reserved for wiring.",
        "die": "One panel on the plate.",
        "PSF": "Point spread function: the image of a distant point of light.",
        "MTF": "Modulation transfer function: contrast of the image of a sine pattern. Presampled: includes the blur "
        "of the sensor pixel, but not its aliasing.",
        "radial minimum": "The lowest MTF over all directions at one frequency.",
        "aliased": "Sampled at one pixel: frequencies above the Nyquist limit fold onto lower ones, in a way that "
        "depends on the sub-pixel offset of the picture.",
        "scene": "What the camera looks at: distances, field, the gap between panel and lens, aberrations, light.",
        "plan": "The cheapest model of a scene whose error, omitted effects included, is within the accuracy.",
        "accuracy": "The admissible relative L2 error of the scene's PSF over its window.",
        "design": "How an opening was found, as stated in its file; not checked.",
        "headroom": "Proven limit of the gain that any other opening with the same number of clear dots can have.",
        "protocol F1": "Photographs of fixed scenes with photon noise, restored by a Wiener filter with the best "
        "constant for the design; compared with the truth over the whole frame and over the inner "
        "one, without 64 pixels at every edge.",
        "surrogate": "A model that predicts the PSNR of restored photographs in two milliseconds.",
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
