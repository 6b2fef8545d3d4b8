"""LeRobot policies: --policy lerobot:DIRECTORY_OR_REPO?device=cpu&resize=true&like=EXPORT

Policies that see one observation are asked for `n_action_steps` actions at once, others for one.
Images of other sizes than in training are refused, unless `resize` scales them."""

import logging
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.data.actions import JOINTS, Representation

from .contract import Contract, mismatch
from .files import ACTION_OPTIONS, PolicySettings, digest_of, parse_settings, stated_actions
from .fit import DATASET_CAMERAS, scaled
from .policy import Observation, Policy, PolicyError, PolicyName, Start

OPTIONS = ("device", "resize", "revision", *ACTION_OPTIONS)
IMAGES, STATE, ACTION = "observation.images.", "observation.state", "action"
ENVIRONMENT = "observation.environment_state"


class LerobotPolicy:
    def __init__(
        self,
        policy: Any,
        processors: tuple[Any, Any],
        resize: bool,
        actions: Representation = JOINTS,
    ) -> None:
        self._policy, (self._before, self._after), self._resize = policy, processors, resize
        config = policy.config
        self.sees_state = ENVIRONMENT in (config.input_features or {})
        # keys are those of the dataset, which the preprocessor may rename to those of the policy
        maps = [getattr(step, "rename_map", {}) for step in self._before.steps]
        self._given = {new: old for renamed in maps for old, new in renamed.items()}
        empty = {f"{IMAGES}empty_camera_{n}" for n in range(getattr(config, "empty_cameras", 0))}
        self._keys: dict[str, tuple[str, tuple[int, int]]] = {}
        for key, feature in (config.image_features or {}).items():
            if key in empty:
                continue  # the policy fills it in itself
            name = str(given := self._given.get(key, key)).removeprefix(IMAGES)
            height, width = feature.shape[-2:]
            self._keys[given] = (DATASET_CAMERAS.get(name, name), (height, width))
        self._at_once = getattr(config, "n_action_steps", 1) if config.n_obs_steps == 1 else 1
        self.inferences, self._ran = 0, False
        # whichever method runs the network, some layer of it is called; a queue of actions calls
        # none
        for layer in policy.modules():
            if layer is not policy:
                layer.register_forward_pre_hook(self._note_run)
        self.contract = Contract(None, None, None, self._at_once, *astuple(actions))
        self._needed = replace(self.contract, image_sizes=dict(self._keys.values()))

    def reset(self, start: Start) -> None:
        import torch

        needed, shown = self._needed.image_sizes or {}, dict(start.image_sizes)
        if self._resize:
            shown |= {name: size for name, size in needed.items() if name in shown}
        given = replace(start, image_sizes=shown)
        if reason := mismatch(self._needed, given) or self._other_lengths(start):
            raise PolicyError(reason)
        torch.manual_seed(start.seed)
        self._policy.reset()
        for processor in (self._before, self._after):
            processor.reset()

    def act(self, observation: Observation) -> ArrayLike:
        import torch

        batch = self._before(self.batch(observation))
        with torch.inference_mode():
            actions = list[Any]()
            for _ in range(self._at_once):
                self._ran = False
                actions.append(self._after(self._policy.select_action(batch)))
                self.inferences += self._ran
        return torch.cat(actions).to("cpu", torch.float64).numpy()

    def _note_run(self, *_: Any) -> None:
        self._ran = True

    def batch(self, observation: Observation) -> dict[str, Any]:
        import torch

        state = torch.from_numpy(np.asarray(observation.joints, np.float32))[None]
        key = self._given.get(STATE, STATE)
        batch: dict[str, Any] = {key: state, "task": [observation.instruction]}
        for key, (camera, size) in self._keys.items():
            image = scaled(observation.images[camera], size).transpose(2, 0, 1)
            batch[key] = torch.from_numpy(np.ascontiguousarray(image))[None].float() / 255
        return batch

    def _other_lengths(self, start: Start) -> str:
        config = self._policy.config
        features = dict(config.input_features or {}) | dict(config.output_features or {})
        names = start.state_names
        lengths = {STATE: len(names), ACTION: len(self.contract.actions.names(names))}
        for key, length in lengths.items():
            if key in features and tuple(features[key].shape) != (length,):
                return f"{key}: the policy has {features[key].shape[0]} numbers, the robot {length}"
        return ""


class LerobotForm:
    def name(self, text: str) -> PolicyName:
        settings = parse_settings(text)
        settings.take(*OPTIONS)
        folder, actions = Path(settings.path), stated_actions(settings.options)
        written = "" if actions == JOINTS else f",{','.join(astuple(actions))}"
        if not folder.is_dir():
            if settings.path.count("/") != 1 or settings.path.startswith((".", "/", "~")):
                raise PolicyError(f"--policy {text}: is no directory, and no repository USER/NAME")
            revision = settings.options.get("revision", "main")
            return PolicyName(text, f"lerobot:{settings.path}@{revision}{written}")
        if not (folder / "config.json").is_file():
            raise PolicyError(f"--policy {text}: has no config.json, as save_pretrained writes it")
        files = sorted(p for p in folder.iterdir() if p.suffix in (".json", ".safetensors"))
        label = f"lerobot:{folder.resolve().name}@{digest_of(files)}{written}"
        return PolicyName(settings.at(folder), label)

    def make(self, text: str) -> Policy:
        settings = parse_settings(text)
        try:
            policy = load(settings)
        except ModuleNotFoundError as error:
            raise PolicyError(f"--policy {text} needs {error.name} of the extra lerobot") from error
        except (OSError, ValueError, KeyError, ImportError) as error:
            reason = " ".join(str(error).split())[:300]
            raise PolicyError(f"--policy {text}: cannot be loaded: {reason}") from error
        if policy.sees_state:
            raise PolicyError(f"--policy {text}: sees {ENVIRONMENT}: give ladder:DIRECTORY")
        return policy


def silence_torchcodec() -> None:
    """Else a page of errors about video decoders is printed."""
    logging.getLogger("lerobot.utils.import_utils").setLevel(logging.ERROR)


def load[P: LerobotPolicy](settings: PolicySettings, kind: type[P] = LerobotPolicy) -> P:
    silence_torchcodec()
    from lerobot.configs.policies import PreTrainedConfig
    from lerobot.policies.factory import get_policy_class, make_pre_post_processors

    options = settings.take(*OPTIONS)
    revision = str(options["revision"]) if "revision" in options else None
    config = PreTrainedConfig.from_pretrained(settings.path, revision=revision)
    if "device" in options:
        config.device = str(options["device"])
    network = get_policy_class(config.type)
    policy = network.from_pretrained(settings.path, config=config, revision=revision)
    policy.eval()
    device = {"device_processor": {"device": str(policy.config.device)}}
    processors = make_pre_post_processors(
        config, settings.path, revision, preprocessor_overrides=device
    )
    resize = bool(options.get("resize", False))
    return kind(policy, processors, resize, stated_actions(settings.options))
