"""Annotations of a dataset: optical flow, object masks, object features; keyed by content, computed once, brought up to date."""

from pipeline.annotate.flow import Colour, Farneback
from pipeline.annotate.keys import AnnotateError
from pipeline.annotate.options import STAGES, AnnotateOptions, FeatureOptions, FlowOptions, MaskOptions
from pipeline.annotate.runner import annotate
from pipeline.annotate.store import find_stage, load, stages_of

__all__ = [
    "STAGES",
    "AnnotateError",
    "AnnotateOptions",
    "Colour",
    "Farneback",
    "FeatureOptions",
    "FlowOptions",
    "MaskOptions",
    "annotate",
    "find_stage",
    "load",
    "stages_of",
]
