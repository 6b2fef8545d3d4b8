"""lerobot-train on an export of ours with its environment type and ours, ACT and PUMA; lerobot-eval
of what it saved."""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.export.running import run
from tests.synthetic import make_episode

pytest.importorskip("lerobot")
pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PLUGINS = ("lerobot_env_domino", "lerobot_policy_puma")
SIZE = (24, 32)
ENVIRONMENT = {
    "env.type": "domino",
    "env.task": "click_bell",
    "env.setup": json.dumps({"size": [SIZE[1], SIZE[0]]}),
    "eval.n_episodes": 1,
    "eval.batch_size": 1,
}
SMALL_PUMA = [
    *(
        "model.backbone.width=32",
        "model.backbone.layers=1",
        "model.chunk=16",
        "model.stride=1",
        "model.history_length=1",
    ),
    *("execute.actions=16", "data.image_size=[32, 32]", "data.flow_size=[32, 32]"),
]
POLICIES = {
    "act": {
        "pretrained_backbone_weights": "null",
        "dim_model": 32,
        "n_heads": 2,
        "dim_feedforward": 32,
        "n_encoder_layers": 1,
        "use_vae": "false",
    },
    "puma": {"puma": "puma-tiny", "settings": json.dumps(SMALL_PUMA)},
}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Two episodes as lerobot-train reads them."""
    root = tmp_path_factory.mktemp("bells")
    made = [make_episode(root / "episodes" / f"e{n}.hdf5", seed=n, frames=24) for n in range(2)]
    run("lerobot", root, root / "lerobot", made)
    return root / "lerobot"


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """The environment of a process in which both plugins are installed."""
    site = tmp_path_factory.mktemp("site")
    for plugin in PLUGINS:
        name = tomllib.loads((ROOT / plugin / "pyproject.toml").read_text())["project"]["name"]
        folder = site / f"{name}-0.1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1.0\n")
    paths = (ROOT, *(ROOT / plugin / "src" for plugin in PLUGINS), site)
    return os.environ | {
        "PYTHONPATH": os.pathsep.join(map(str, paths)),
        "HF_HUB_OFFLINE": "1",
        "WANDB_MODE": "disabled",
    }


def lerobot(script, options, environment, place):
    words = [
        sys.executable,
        "-m",
        f"lerobot.scripts.{script}",
        *(f"--{key}={value}" for key, value in options.items()),
    ]
    done = subprocess.run(
        words, check=False, env=environment, cwd=place, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout + done.stderr


@pytest.mark.parametrize("kind", POLICIES)
def test_a_policy_is_trained_and_tried_in_our_environment(kind, dataset, environment, tmp_path):
    scenes, out, tried = tmp_path / "manifests", tmp_path / "out", tmp_path / "tried"
    options = ENVIRONMENT | {
        "env.manifests": scenes,
        "dataset.repo_id": "local/bells",
        "dataset.root": dataset,
        "dataset.video_backend": "pyav",
        "policy.type": kind,
        "policy.device": "cpu",
        "policy.push_to_hub": "false",
        "steps": 2,
        "batch_size": 2,
        "num_workers": 0,
        "prefetch_factor": "null",
        "persistent_workers": "false",
        "env_eval_freq": 2,
        "save_freq": 2,
        "log_freq": 1,
        "output_dir": out,
    }
    told = lerobot(
        "lerobot_train",
        options | {f"policy.{k}": v for k, v in POLICIES[kind].items()},
        environment,
        tmp_path,
    )
    assert "avg_sum_reward" in told
    assert len(list(out.rglob("*.mp4"))) == 1
    saved = out / "checkpoints" / "last" / "pretrained_model"
    assert json.loads((saved / "config.json").read_text())["type"] == kind
    options = ENVIRONMENT | {
        "env.manifests": scenes,
        "policy.path": saved,
        "policy.device": "cpu",
        "output_dir": tried,
    }
    lerobot("lerobot_eval", options, environment, tmp_path)
    told = json.loads((tried / "eval_info.json").read_text())
    assert told["per_group"]["click_bell"]["n_episodes"] == 1
    (metrics,) = [each["metrics"] for each in told["per_task"]]
    assert 0 <= metrics["sum_rewards"][0] <= metrics["max_rewards"][0] <= 100
