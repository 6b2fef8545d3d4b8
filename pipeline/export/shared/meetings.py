"""What is derived from the log of an exported episode."""

from pipeline.export.shared.episodes import ExportError, Facts
from pipeline.motion.models import motion_from_json
from pipeline.motion.recorded.interception import Interception


def interception(facts: Facts) -> Interception:
    """The derived data of an episode. Raises ExportError if its motion cannot be read."""
    try:
        motion = motion_from_json(facts.motion)
    except ValueError as error:
        raise ExportError(f"{facts.source}: {error}") from error
    return Interception(facts.meta, facts.log, motion, facts.target)
