"""For an EnvHub repository: `make_env("USER/REPO", trust_remote_code=True)`. It needs the
distribution lerobot_env_domino."""

from typing import Any

from lerobot_env_domino import DominoEnvConfig


def make_env(
    n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None
) -> dict[str, dict[int, Any]]:
    """{task: {0: vector environment}}; `cfg` may name other tasks than the default one."""
    task = getattr(cfg, "task", None)
    config = (
        cfg
        if isinstance(cfg, DominoEnvConfig)
        else DominoEnvConfig(**({"task": task} if task else {}))
    )
    return config.create_envs(n_envs, use_async_envs)
