"""The job file: what the user asks for, validated completely before any work starts.

Every length is written with its unit (``"168 um"``); a validated spec holds micrometres, nanometres and kelvins, and
dumps back to text that loads to the same spec.
"""

from maskfab.jobfile.checks import check_die, check_lens, check_optics, even_nm
from maskfab.jobfile.read import parse_section, read, validate
from maskfab.jobfile.scene_values import ACCURACIES, COLDEST_K, HOTTEST_K, is_table
from maskfab.jobfile.sections import (
    DRAWING_KEYS,
    AnyDesign,
    BlankSection,
    CameraSection,
    DesignSection,
    DieSection,
    EmittersSection,
    ExportSection,
    ExposureSection,
    JobSection,
    JobSpec,
    LightSection,
    LimitsSection,
    ParetoSection,
    PlateSection,
    ProcessSection,
    RelaxSection,
    RulesSection,
    SceneSection,
    SearchSection,
    SensorSection,
    StopSection,
    WiresSection,
)
from maskfab.jobfile.values import MASK_FORMATS, MOST_DOTS_PER_UM, FileFormat, check_name

__all__ = [
    "ACCURACIES",
    "COLDEST_K",
    "DRAWING_KEYS",
    "HOTTEST_K",
    "MASK_FORMATS",
    "MOST_DOTS_PER_UM",
    "AnyDesign",
    "BlankSection",
    "CameraSection",
    "DesignSection",
    "DieSection",
    "EmittersSection",
    "ExportSection",
    "ExposureSection",
    "FileFormat",
    "JobSection",
    "JobSpec",
    "LightSection",
    "LimitsSection",
    "ParetoSection",
    "PlateSection",
    "ProcessSection",
    "RelaxSection",
    "RulesSection",
    "SceneSection",
    "SearchSection",
    "SensorSection",
    "StopSection",
    "WiresSection",
    "check_die",
    "check_lens",
    "check_name",
    "check_optics",
    "even_nm",
    "is_table",
    "parse_section",
    "read",
    "validate",
]
