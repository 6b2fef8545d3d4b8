"""The identity of a physics episode, whatever it was drawn with and wherever it is stored."""

from pipeline.data.episode.state_log import StateLog
from pipeline.data.keys import arrays_digest, digest
from pipeline.data.spec import EpisodeSpec

_ARRAYS = ("times", "poses", "qpos", "qvel", "state", "action", "tcp", "target_velocity")


def physics_id(spec: EpisodeSpec, log: StateLog) -> str:
    """sha256 (32 hex digits) of a spec and of what happened: names of bodies and joints, times,
    poses, joints, commands.

    Images of the same physics share it: variants of one episode, the same episode drawn again into
    another dataset, and a build of the same spec with another renderer. What shares it belongs into
    the same split.
    """
    arrays = {name: getattr(log, name) for name in _ARRAYS}
    return digest([spec.to_json(), list(log.bodies), list(log.joints), arrays_digest(arrays)])
