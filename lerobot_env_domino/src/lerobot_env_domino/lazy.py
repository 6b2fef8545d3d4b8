"""A vector environment that is made when it is first used: one task's workers at a time, not those
of all."""

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
from lerobot.envs.utils import freeze_after_episode_end


class LazyVector:
    """What lerobot-eval uses of a VectorEnv. An environment whose episode has ended waits for the
    next rollout at no cost."""

    def __init__(
        self, makers: Sequence[Callable[[], gymnasium.Env[Any, Any]]], asynchronous: bool
    ) -> None:
        self._makers = [freeze_after_episode_end(make) for make in makers]
        self._asynchronous = asynchronous and len(makers) > 1
        self._made: gymnasium.vector.VectorEnv[Any, Any, Any] | None = None
        self.num_envs = len(makers)
        example = makers[0]()
        self.metadata = example.metadata
        self.single_observation_space, self.single_action_space = (
            example.observation_space,
            example.action_space,
        )
        self.observation_space = gymnasium.vector.utils.batch_space(
            example.observation_space, self.num_envs
        )
        self.action_space = gymnasium.vector.utils.batch_space(example.action_space, self.num_envs)
        example.close()

    @property
    def unwrapped(self) -> "LazyVector":
        """Itself."""
        return self

    @property
    def made(self) -> bool:
        """Whether environments exist."""
        return self._made is not None

    def reset(self, **arguments: Any) -> Any:
        """See VectorEnv."""
        return self._ensure().reset(**arguments)

    def step(self, actions: Any) -> Any:
        """See VectorEnv."""
        return self._ensure().step(actions)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """See VectorEnv."""
        return self._ensure().call(name, *args, **kwargs)

    def get_attr(self, name: str) -> Any:
        """See VectorEnv."""
        return self._ensure().get_attr(name)

    def close(self) -> None:
        """Close what was made; the next use makes it again."""
        if self._made is not None:
            self._made.close()
        self._made = None

    def _ensure(self) -> Any:
        if self._made is None:
            mode = gymnasium.vector.AutoresetMode.NEXT_STEP
            if self._asynchronous:
                self._made = gymnasium.vector.AsyncVectorEnv(
                    self._makers, context="forkserver", autoreset_mode=mode
                )
            else:
                self._made = gymnasium.vector.SyncVectorEnv(self._makers, autoreset_mode=mode)
        return self._made
