"""The tasks of domino-data as an environment type of LeRobot. Importing this registers
`--env.type=domino`."""

from lerobot_env_domino.config import DominoEnvConfig
from lerobot_env_domino.env import DominoTask

__all__ = ["DominoEnvConfig", "DominoTask"]
