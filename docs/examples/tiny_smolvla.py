# /// script
# requires-python = ">=3.12,<3.13"
# dependencies = ["lerobot[smolvla]>=0.6.1,<0.7"]
# ///
"""Writes a SmolVLA with random weights, small enough for any machine, as lerobot saves a policy: uv
run tiny_smolvla.py DIRECTORY.

It answers nonsense. Serve it to see that the environment for such policies works before you
download a large one.
"""

import sys
from pathlib import Path

import torch
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.policies.factory import get_policy_class, make_pre_post_processors
from lerobot.policies.smolvla.configuration_smolvla import SmolVLAConfig
from tokenizers import Tokenizer, models, pre_tokenizers
from transformers import (
    PreTrainedTokenizerFast,
    SmolVLMConfig,
    SmolVLMImageProcessor,
    SmolVLMProcessor,
)
from transformers.models.smolvlm import SmolVLMVideoProcessor

JOINTS = 14
WORDS = (
    "<pad>",
    "<unk>",
    "<image>",
    "<fake_token_around_image>",
    "<global-img>",
    "<end_of_utterance>",
    "press",
    "the",
    "bell",
    "\n",
)


def backbone(folder: Path) -> None:
    """A vision-language model of two layers, with a tokenizer of a few words."""
    text = {
        "hidden_size": 64,
        "intermediate_size": 64,
        "num_hidden_layers": 2,
        "num_attention_heads": 4,
        "num_key_value_heads": 2,
    }
    vision = {
        "hidden_size": 32,
        "intermediate_size": 32,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
        "image_size": 32,
    }
    text |= {"model_type": "llama", "head_dim": 16, "vocab_size": len(WORDS), "pad_token_id": 0}
    SmolVLMConfig(
        text_config=text, vision_config=vision | {"patch_size": 8}, scale_factor=2, image_token_id=2
    ).save_pretrained(folder)
    words = Tokenizer(
        models.WordLevel({word: n for n, word in enumerate(WORDS)}, unk_token="<unk>")
    )
    words.pre_tokenizer = pre_tokenizers.WhitespaceSplit()
    named = {
        "fake_image_token": WORDS[3],
        "global_image_token": WORDS[4],
        "image_token": WORDS[2],
        "end_of_utterance_token": WORDS[5],
    }
    tokenizer = PreTrainedTokenizerFast(
        tokenizer_object=words, pad_token="<pad>", unk_token="<unk>", extra_special_tokens=named
    )
    images = SmolVLMImageProcessor(size={"longest_edge": 32}, max_image_size={"longest_edge": 32})
    SmolVLMProcessor(
        images, tokenizer, SmolVLMVideoProcessor(size={"longest_edge": 32})
    ).save_pretrained(folder)


def policy(folder: Path) -> None:
    """The policy for the head camera of ALOHA at 320x240, with its processors."""
    backbone(folder / "backbone")
    torch.manual_seed(0)
    config = SmolVLAConfig(
        input_features={
            "observation.state": PolicyFeature(FeatureType.STATE, (JOINTS,)),
            "observation.images.cam_high": PolicyFeature(FeatureType.VISUAL, (3, 240, 320)),
        },
        output_features={"action": PolicyFeature(FeatureType.ACTION, (JOINTS,))},
        device="cpu",
        vlm_model_name=str((folder / "backbone").resolve()),
        load_vlm_weights=False,
        num_vlm_layers=2,
        resize_imgs_with_padding=(32, 32),
        chunk_size=8,
        n_action_steps=4,
        num_steps=2,
        empty_cameras=1,
    )
    one = torch.ones(JOINTS)
    stats = {key: {"mean": 0 * one, "std": one} for key in ("observation.state", "action")}
    get_policy_class("smolvla")(config).save_pretrained(folder)
    for processor in make_pre_post_processors(config, dataset_stats=stats):
        processor.save_pretrained(folder)


if __name__ == "__main__":
    policy(Path(sys.argv[1]))
