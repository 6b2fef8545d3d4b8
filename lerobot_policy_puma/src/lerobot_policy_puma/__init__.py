"""PUMA as a policy type of LeRobot. Importing this registers `--policy.type=puma`."""

from lerobot_policy_puma.configuration_puma import PumaConfig

__all__ = ["PumaConfig"]
