"""`domino-data doctor`: whether this machine has what a build, an export and an annotation need."""

from pipeline.run.doctor.diagnosis import diagnose

__all__ = ["diagnose"]
