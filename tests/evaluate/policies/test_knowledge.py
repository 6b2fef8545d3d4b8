"""What reference policies may know: which body is asked for, what a tunnel hides, another scene."""

import numpy as np
import pytest

from pipeline.data.spec import EpisodeSpec
from pipeline.evaluate.policies.reactive import blocks
from pipeline.evaluate.policies.rehearsal import alike, guess_roles
from pipeline.motion.scenery import Prop, hood, standing
from pipeline.poses import pose
from pipeline.stages.scene import build_scene


def test_a_guess_is_right_as_often_as_like_bodies_allow():
    scene = build_scene(EpisodeSpec("follow_light", "aloha-agilex", 1, 0.1, "clean", 0, 3))
    assert alike(scene) == ["bell", "other"]
    guesses = [guess_roles(scene, seed) for seed in range(200)]
    right = np.mean([guessed is scene for guessed, _ in guesses])
    assert right == pytest.approx(0.5, abs=0.1)
    for guessed, asked in guesses:
        assert (guessed is scene) == (asked == scene.task.target)
        assert guessed.bodies[scene.task.target].instance is scene.bodies[asked].instance
        assert {name: body.name for name, body in guessed.bodies.items()} == {
            name: name for name in scene.bodies
        }


def test_a_guess_without_like_bodies_is_right():
    scene = build_scene(EpisodeSpec("click_bell", "aloha-agilex", 1, 0.1, "clean", 0, 3))
    assert all(guess_roles(scene, seed)[0] is scene for seed in range(5))


def test_a_tunnel_hides_what_is_inside_and_behind_it():
    tunnel = Prop("tunnel", hood(0.1, 0.05, 0.08), standing(pose((0.0, 0.2, 0.74))), solid=True)
    eye = pose((0.0, -0.3, 1.3))
    points = {"inside": (0, 0.2, 0.77), "behind": (0, 0.27, 0.75), "beside": (0.2, 0.2, 0.77)}
    hidden = {name: blocks(tunnel, 0.0, eye, np.array(at)) for name, at in points.items()}
    assert hidden == {"inside": True, "behind": True, "beside": False}
