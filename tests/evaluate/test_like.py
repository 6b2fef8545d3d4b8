"""What one builds one can evaluate on: under the setup of a dataset an evaluation shows its images
and solves its episodes."""

import numpy as np

from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import open_episode
from pipeline.data.episode.frames import encode_frames
from pipeline.evaluate.environment.env import DominoEnv
from pipeline.evaluate.scenes.case import admit, expert_actions
from tests.run.command import inside

RECIPE = """
tasks: click_bell
render: raster-fast
levels: 1
episodes: 1
fps: 30
size: [160, 120]
depth: true
segmentation: true
pointcloud: true
layout: original
cameras:
  - head
  - observer
  - {name: own_wrist, link: right_link6, pose: [0.02, 0, 0.05, 1, 0, 0, 0], width: 64, height: 48, fovy: 60}
"""  # noqa: E501


def test_an_environment_like_a_dataset_shows_its_images_and_solves_its_episodes(tmp_path):
    (tmp_path / "recipe.yaml").write_text(RECIPE)
    out = tmp_path / "out"
    code, _, said = inside(
        "build",
        "--manifest",
        tmp_path / "recipe.yaml",
        "--executor",
        "inline",
        "--quiet",
        "--out",
        out,
    )
    assert code == 0, said
    dataset = Dataset(out)
    [path] = dataset.accepted(dataset.recipe())
    env = DominoEnv("click_bell", setup=str(out))
    with open_episode(path) as episode:
        case = admit(episode.spec, dataset.setup())
        seen, _ = env.reset(options={"case": case})
        assert seen["pixels"].keys() == {"head_camera", "observer_camera", "own_wrist"}
        for camera, image in seen["pixels"].items():
            assert image.shape == (120, 160, 3)
            assert encode_frames(image[None])[0] == episode.array(f"observation/{camera}/rgb")[0]
            for key, stored in (("depth", "depth"), ("segmentation", "actor_segmentation")):
                np.testing.assert_array_equal(
                    seen[key][camera], episode.array(f"observation/{camera}/{stored}")[0]
                )
        np.testing.assert_array_equal(seen["pointcloud"], episode.array("pointcloud")[0])
        actions = expert_actions(case)
        assert len(actions) == len(episode) - 1
    assert env.observation_space.contains(seen) and env.metadata["render_fps"] == 30
    for action in actions:
        *_, ended, cut, info = env.step(action.astype(np.float32))
        if ended or cut:
            break
    assert info["is_success"]
    env.close()


POLICY = """
class Fast:
    fps = 30
    def reset(self, start): pass
    def act(self, observation): return observation.joints
def make_policy(): return Fast()
"""


def test_a_policy_of_another_rate_is_refused_before_a_scene_is_admitted(tmp_path):
    (tmp_path / "fast.py").write_text(POLICY)
    wanted = ("--tasks", "click_bell", "--executor", "inline", "--quiet", "--out", tmp_path / "out")
    code, _, said = inside("evaluate", "--policy", tmp_path / "fast.py", *wanted)
    assert (
        code == 2
        and "fps: the policy has 30, the evaluation 15: add --fps 30" in said
        and said.count("\n") == 1
    )
    assert not (tmp_path / "out").exists()
