"""Closed-loop evaluation. Importing this package registers `domino/<task>-v0` with gymnasium."""

from pipeline.gym_ids import env_id, register_ids
from pipeline.tasks import TASKS

from .environment.env import DominoEnv

register_ids(TASKS)
