"""A policy by name: it holds the joints where they were at the start."""

from pipeline.evaluate.names import POLICIES
from pipeline.evaluate.policies.policy import Observation, Start


class Stay:
    """Answers every observation with the first measured joints."""

    def reset(self, start: Start) -> None:
        self.joints = None

    def act(self, observation: Observation):
        if self.joints is None:
            self.joints = observation.joints
        return self.joints


POLICIES.add("stay", Stay)
