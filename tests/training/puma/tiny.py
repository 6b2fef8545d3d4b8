"""A dataset of made-up episodes with its export and annotations, and configurations of networks
with a few thousand weights."""

import json
from pathlib import Path

from pipeline.annotate.options import AnnotateOptions, FeatureOptions, FlowOptions, MaskOptions
from pipeline.export import EXPORTERS, Job
from pipeline.run.annotate import annotate
from tests.annotate.tiny import save_encoder
from tests.synthetic import episode_path, make_episode
from training.puma.config import Config, parse_config

FRAMES = (14, 9, 14)


def make_dataset(root: Path, models: Path) -> Path:
    """Three episodes with two cameras, exported, with flow of stride 2 at 32x32, exact masks, and
    features of a random encoder."""
    paths = [episode_path(root, slot=slot) for slot in range(len(FRAMES))]
    for slot, (path, frames) in enumerate(zip(paths, FRAMES, strict=True)):
        make_episode(
            path,
            slot=slot,
            seed=slot,
            frames=frames,
            cameras=("head_camera", "left_camera"),
            segmentation=True,
        )
    export(root, paths)
    encoder = models / "encoder"
    if not encoder.exists():
        save_encoder(encoder)
    options = AnnotateOptions(
        flow=FlowOptions(stride=2, size=(32, 32)),
        masks=MaskOptions(source="sim", objects=("target",)),
        features=FeatureOptions(encoder=str(encoder), size=56),
    )
    annotate(root, options=options)
    return root


def export(root: Path, paths: list[Path]) -> None:
    """The Parquet export, where `domino-data export` puts it."""
    exporter = EXPORTERS["parquet"]
    exporter.export(Job(root, root / "exports" / "parquet", paths, exporter.options()))


def qwen_json(path: Path) -> Path:
    """The configuration of a Qwen3-VL with 0.2 million weights."""
    rope = {
        "rope_type": "default",
        "rope_theta": 5e6,
        "mrope_section": [4, 2, 2],
        "mrope_interleaved": True,
    }
    text = {
        "vocab_size": 96,
        "hidden_size": 64,
        "intermediate_size": 128,
        "num_hidden_layers": 2,
        "num_attention_heads": 4,
        "num_key_value_heads": 2,
        "head_dim": 16,
        "max_position_embeddings": 2048,
        "rope_parameters": rope,
        "pad_token_id": 0,
    }
    vision = {
        "depth": 2,
        "hidden_size": 32,
        "intermediate_size": 64,
        "num_heads": 2,
        "patch_size": 16,
        "spatial_merge_size": 2,
        "temporal_patch_size": 2,
        "out_hidden_size": 64,
        "num_position_embeddings": 256,
        "deepstack_visual_indexes": [0, 1],
    }
    marks = {
        "image_token_id": 90,
        "video_token_id": 91,
        "vision_start_token_id": 92,
        "vision_end_token_id": 93,
    }
    path.write_text(
        json.dumps(
            {"text_config": text, "vision_config": vision, "tie_word_embeddings": True, **marks}
        )
    )
    return path


def config_of(dataset: Path, cache: Path, **model: object) -> Config:
    """A small configuration for `make_dataset`."""
    backbone = {
        "kind": "tiny",
        "weights": "random",
        "width": 32,
        "layers": 1,
        "heads": 2,
        "keypoints": 8,
        "words": 64,
    }
    return parse_config(
        {
            "name": "test",
            "model": {
                "backbone": backbone,
                "chunk": 6,
                "stride": 2,
                "history_length": 2,
                "world_queries": 2,
                "state": True,
            }
            | model,
            "data": {
                "sources": [{"dataset": str(dataset)}],
                "cameras": ["head_camera", "left_camera"],
                "image_size": [32, 64],
                "flow_size": [32, 32],
                "validation": 0.0,
                "cache": str(cache),
            },
            "train": {
                "steps": 6,
                "batch": 4,
                "warmup": 2,
                "precision": "no",
                "checkpointing": False,
                "save_every": 3,
                "validate_every": 3,
                "backbone_rate": 1e-3,
                "head_rate": 1e-3,
            },
            "execute": {"actions": 4},
        },
        "test",
    )
