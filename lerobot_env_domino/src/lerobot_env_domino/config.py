"""`--env.type=domino`: the options, and the features that policies are made for."""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from lerobot.configs import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.utils.constants import ACTION, OBS_IMAGES, OBS_STATE

from lerobot_env_domino.env import DominoTask, Scenes, vector_length
from lerobot_env_domino.lazy import LazyVector
from pipeline.data.names import exported_names
from pipeline.data.recipe.model import Cell
from pipeline.data.setup import Setup
from pipeline.evaluate.scenes.case import setup_of
from pipeline.tasks import TASKS
from pipeline.tasks.contract import expand_tasks
from pipeline.world.cameras import setup_cameras
from pipeline.world.robots import get_embodiment


@EnvConfig.register_subclass("domino")
@dataclass
class DominoEnvConfig(EnvConfig):
    """`task` is a name, several with commas between, or "all". `like` is a dataset whose setup is
    taken (cameras, size, rate, rules, layout, ...), and `setup` are keys of a setup that differ
    from it, as a recipe has them (`{cameras: [head], fps: 30}`). `manifests` is where admitted
    scenes are kept, `protocol_seed` the seed of the protocol they are drawn from, `first_seed` what
    `--seed` is; a `benchmark` (a name or a file) gives its frozen scenes instead. An `fps` other
    than 0 is the setup's. Raises ValueError for what does not exist.
    """

    task: str | None = "click_bell"
    fps: int = 0
    embodiment: str = "aloha-agilex"
    level: int = 1
    alpha: float = 0.1
    domain: str = "clean"
    like: str = ""
    setup: dict[str, Any] = field(default_factory=dict[str, Any])
    manifests: str = "outputs/domino_manifests"
    protocol_seed: int = 0
    first_seed: int = 1000
    benchmark: str = ""
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(
        default_factory=lambda: {ACTION: ACTION, "agent_pos": OBS_STATE}
    )

    def __post_init__(self) -> None:
        setup = self.wanted
        self.fps = setup.fps
        if not setup.cameras:
            raise ValueError("env.setup: cameras: is empty: name some")
        if unknown := [name for name in self.tasks if name not in TASKS]:
            raise ValueError(
                f"env.task: no task {unknown[0]!r}: choose from {', '.join(sorted(TASKS))}"
            )
        length = vector_length(self.embodiment)
        self.features[ACTION] = PolicyFeature(FeatureType.ACTION, (length,))
        self.features["agent_pos"] = PolicyFeature(FeatureType.STATE, (length,))
        cameras = setup_cameras(get_embodiment(self.embodiment), setup)
        names = exported_names([camera.name for camera in cameras], {})
        for camera in cameras:
            name, shape = names[camera.name], (camera.type.height, camera.type.width, 3)
            self.features[f"pixels/{name}"] = PolicyFeature(FeatureType.VISUAL, shape)
            self.features_map[f"pixels/{name}"] = f"{OBS_IMAGES}.{name}"

    @property
    def wanted(self) -> Setup:
        """The setup of the environments."""
        rate = {"fps": self.fps} if self.fps else {}
        return setup_of(self.like or {}).override(
            self.setup | rate, "env.setup", {"fps": "env.fps"}
        )

    @property
    def tasks(self) -> tuple[str, ...]:
        """Names of the tasks."""
        if self.task in (None, "all"):
            return expand_tasks(())
        return tuple(part.strip() for part in str(self.task).split(",") if part.strip())

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Nothing: `create_envs` makes the environments."""
        return {}

    def create_envs(self, n_envs: int, use_async_envs: bool = False) -> dict[str, dict[int, Any]]:
        """{task: {0: vector environment}}: a suite for each task, so that results carry its name.
        Nothing is simulated yet."""
        robot, setup, out = (
            get_embodiment(self.embodiment).name,
            self.wanted,
            dict[str, dict[int, Any]](),
        )
        for task in self.tasks:
            cell = Cell(task, robot, self.level, self.alpha, self.domain)
            seeds = self.protocol_seed, self.first_seed
            scenes = Scenes(cell, Path(self.manifests), *seeds, setup, self.benchmark)
            make = partial(DominoTask, scenes)
            out[task] = {0: LazyVector([make] * n_envs, use_async_envs)}
        return out
