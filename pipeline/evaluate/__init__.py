"""Closed-loop evaluation. Importing this package registers `domino/<task>-v0` with gymnasium for
every task, plugins included."""

from pipeline.evaluate.environment.env import DominoEnv
from pipeline.gym_ids import env_id, register_ids
from pipeline.tasks import TASKS

register_ids(TASKS)
