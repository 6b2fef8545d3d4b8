"""Formats of single projects: RoboTwin, XPolicyLab, DynamicWAM and the annotations that PUMA's code
reads."""
