"""The policy type of LeRobot: its factory makes, trains, saves and loads it; the past it keeps is
that of training."""

from pathlib import Path

import numpy as np
import pytest
import torch

SMALL = [
    "model.backbone.width=32",
    "model.backbone.layers=1",
    "model.chunk=6",
    "model.stride=2",
    "model.history_length=2",
]
SETTINGS = [*SMALL, "execute.actions=4", "data.image_size=[32, 32]", "data.flow_size=[32, 32]"]


@pytest.fixture(scope="module")
def lr():
    """What the tests name of LeRobot, which takes 8 s of CPU to import: in the process that runs
    them only."""
    pytest.importorskip("lerobot")
    from tests.lerobot_policy import imported

    return imported


def config(lr, **values: object):
    images = {
        f"observation.images.{n}": lr.PolicyFeature(lr.FeatureType.VISUAL, (3, 48, 64))
        for n in ("cam_high", "cam_left_wrist")
    }
    state = {"observation.state": lr.PolicyFeature(lr.FeatureType.STATE, (14,))}
    action = {"action": lr.PolicyFeature(lr.FeatureType.ACTION, (14,))}
    given = {
        "input_features": {**images, **state},
        "output_features": action,
        "device": "cpu",
        "settings": SETTINGS,
        **values,
    }
    return lr.PumaConfig(**given)


def batch(frames: int, seed: int = 0) -> dict:
    g = torch.Generator().manual_seed(seed)
    shape = (2, frames, 3, 48, 64) if frames else (2, 3, 48, 64)
    return {
        "observation.images.cam_high": torch.rand(shape, generator=g),
        "observation.images.cam_left_wrist": torch.rand(shape, generator=g),
        "observation.state": torch.rand((2, frames, 14) if frames else (2, 14), generator=g),
        "task": ["press the bell", "ring it"],
    }


def test_lerobot_finds_the_policy_and_its_processors(lr):
    made = config(lr)
    assert made.type == "puma" and lr.get_policy_class("puma") is lr.PumaPolicy
    assert made.observation_delta_indices == [-4, -2, 0] and made.action_delta_indices == list(
        range(6)
    )
    stats = {
        name: {"min": torch.full((14,), -2.0), "max": torch.full((14,), 2.0)}
        for name in ("observation.state", "action")
    }
    before, after = lr.make_pre_post_processors(made, dataset_stats=stats)
    given = {name: value[0] for name, value in batch(0).items()}
    scaled = before({**given, "observation.state": torch.full((14,), 1.0)})
    torch.testing.assert_close(scaled["observation.state"], torch.full((1, 14), 0.5))
    torch.testing.assert_close(after(torch.full((1, 14), 0.5)), torch.full((1, 14), 1.0))


def test_a_step_of_training_leaves_padded_actions_out(lr):
    torch.manual_seed(0)
    policy = lr.PumaPolicy(config(lr))
    given = batch(3) | {
        "action": torch.randn(2, 6, 14),
        "action_is_pad": torch.zeros(2, 6, dtype=torch.bool),
    }
    given["action_is_pad"][:, 3:] = True
    loss, _ = policy.forward(given)
    changed = given | {"action": given["action"].clone()}
    changed["action"][:, 3:] = 1e6
    assert float(policy.forward(changed)[0].detach()) == float(loss.detach())
    optimizer = torch.optim.AdamW(policy.get_optim_params())
    for _ in range(12):
        optimizer.zero_grad()
        policy.forward(given)[0].backward()
        optimizer.step()
    assert float(policy.forward(given)[0].detach()) < 0.9 * float(loss.detach())


def test_a_saved_policy_answers_as_before_with_the_past_of_training(tmp_path: Path, lr):
    torch.manual_seed(0)
    policy = lr.PumaPolicy(config(lr)).eval()
    policy.save_pretrained(tmp_path)
    again = lr.PumaPolicy.from_pretrained(
        tmp_path, config=lr.PreTrainedConfig.from_pretrained(tmp_path)
    )
    frames = [batch(0, seed) for seed in range(5)]
    played = []
    for one in (policy, again):
        one.reset()
        played.append([one.select_action(frame).numpy() for frame in frames])
    np.testing.assert_array_equal(played[0], played[1])
    # the fifth action is the first of a new chunk, whose past are the frames 0, 2 and 4
    keys = [name for name in frames[0] if name != "task"]
    whole = {name: torch.stack([frames[i][name] for i in (0, 2, 4)], 1) for name in keys} | {
        "task": frames[0]["task"]
    }
    seen = {}
    policy.network.register_forward_hook(
        lambda module, given, out: seen.update(actions=out.actions)
    )
    policy.forward(whole | {"action": torch.zeros(2, 6, 14)})
    np.testing.assert_allclose(played[0][4], seen["actions"][:, 0].detach().numpy(), atol=1e-6)


def test_inputs_that_lerobot_lacks_are_refused(lr):
    with pytest.raises(ValueError, match="clock, history_times and oracle are no inputs here"):
        config(lr, settings=[*SETTINGS, "model.clock=true"])
