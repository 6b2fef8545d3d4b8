"""A RoboTwin policy folder with its own eval.sh, unchanged, on our scenes."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HOME = Path(__file__).parents[2] / "robotwin_eval"

DEPLOY = """
def get_model(usr_args):
    assert usr_args["chunk"] == 5 and usr_args["ckpt_setting"] == "tiny" and usr_args["seed"] == 3
    return usr_args["chunk"]

def eval(TASK_ENV, model, observation):
    for _ in range(model):
        TASK_ENV.take_action(TASK_ENV.get_obs()["joint_action"]["vector"])

def reset_model(model):
    pass
"""

# as in RoboTwin's policy/ACT
EVAL = """
policy_name=Holds
task_name=${1}
export CUDA_VISIBLE_DEVICES=${6}
cd ../..
PYTHONWARNINGS=ignore::UserWarning \\
python script/eval_policy.py --config policy/$policy_name/deploy_policy.yml \\
    --overrides \\
    --task_name ${task_name} \\
    --task_config ${2} \\
    --ckpt_setting ${3} \\
    --expert_data_num ${4} \\
    --seed ${5} \\
    --policy_name ${policy_name}
"""


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "policy" / "Holds"
    path.mkdir(parents=True)
    (path / "__init__.py").write_text("from .deploy_policy import *\n")
    (path / "deploy_policy.py").write_text(DEPLOY)
    (path / "deploy_policy.yml").write_text("chunk: 5\nseed: 0\n")
    (path / "eval.sh").write_text(EVAL)
    return path


@pytest.fixture
def convert():
    spec = importlib.util.spec_from_file_location("eval_policy", HOME / "script" / "eval_policy.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.evaluate_arguments


@pytest.mark.parametrize("own", [True, False])
def test_a_folder_is_evaluated_by_its_own_script_and_by_ours(folder, tmp_path, own):
    arguments = ["click_bell", "demo_clean", "tiny", "50", "3", ""]
    options = f"--levels 0 --episodes 1 --cameras none --executor inline --out {tmp_path / 'out'}"
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"DOMINO_OPTIONS": options, "PATH": path}
    command, at = ["bash", str(HOME / "eval.sh"), str(folder)], tmp_path
    if own:
        shutil.copytree(HOME / "script", tmp_path / "script")
        command, at = ["bash", "eval.sh"], folder
    done = subprocess.run(
        [*command, *arguments], cwd=at, env=environment, check=False, capture_output=True
    )
    assert done.returncode == 0, done.stderr.decode()
    (row,) = map(json.loads, (tmp_path / "out" / "episodes.jsonl").read_text().splitlines())
    assert row["policy"].startswith("robotwin:Holds@") and row["process"] == "own"
    assert row["ending"] == "time_limit" and row["seed"] >= 400_000
    assert row["inferences"] == -(-row["periods"] // 5)


def test_options_of_the_environment_win(folder, convert):
    given = [
        "--config",
        str(folder / "deploy_policy.yml"),
        "--overrides",
        "--task_name",
        "click_bell",
    ]
    plain, other = convert(given), convert(given, "--cameras head --seed 9")
    assert plain[plain.index("--cameras") + 1] == "head,left,right"
    assert other.count("--cameras") == 1 and other[other.index("--seed") + 1] == "9"


@pytest.mark.parametrize(
    "bad", [[], ["--config", "x"], ["--config", "x", "--overrides", "--seed", "1"]]
)
def test_other_arguments_end_in_one_line(convert, bad):
    with pytest.raises(SystemExit, match="eval_policy"):
        convert(bad)
