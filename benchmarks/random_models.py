"""Networks of the real architecture with random weights: their speed is that of the real ones, and
nothing is downloaded."""

from pathlib import Path

from pipeline.annotate.options import FeatureOptions, MaskOptions


def random_models(root: Path, size: str) -> tuple[MaskOptions, FeatureOptions]:
    """Save a detector, a segmenter and an encoder under `root` and name them in options; `size` is
    "small" or "full"."""
    import torch
    from transformers import (
        BertTokenizer,
        Dinov2Config,
        Dinov2Model,
        GroundingDinoConfig,
        GroundingDinoForObjectDetection,
        GroundingDinoImageProcessor,
        GroundingDinoProcessor,
        Sam2Config,
        Sam2HieraDetConfig,
        Sam2Model,
        Sam2VisionConfig,
    )
    from transformers.utils import logging

    logging.disable_progress_bar()
    torch.manual_seed(0)
    full = size == "full"
    marks = {
        0: "[PAD]",
        100: "[UNK]",
        101: "[CLS]",
        102: "[SEP]",
        103: "[MASK]",
        1012: ".",
        1029: "?",
    }
    words = BertTokenizer(vocab={marks.get(i, f"[unused{i}]"): i for i in range(30522)})
    short = 800 if full else 224
    sides = {"shortest_edge": short, "longest_edge": round(short * 1.67)}
    GroundingDinoProcessor(GroundingDinoImageProcessor(size=sides), words).save_pretrained(
        root / "detector"
    )
    GroundingDinoForObjectDetection(
        GroundingDinoConfig(disable_custom_kernels=True)
    ).save_pretrained(root / "detector")
    large = Sam2HieraDetConfig(
        hidden_size=144,
        num_attention_heads=2,
        blocks_per_stage=[2, 6, 36, 4],
        embed_dim_per_stage=[144, 288, 576, 1152],
        num_attention_heads_per_stage=[2, 4, 8, 16],
        global_attention_blocks=[23, 33, 43],
        window_size_per_stage=[8, 4, 16, 8],
    )
    vision = (
        Sam2VisionConfig(backbone_config=large, backbone_channel_list=[1152, 576, 288, 144])
        if full
        else Sam2VisionConfig()
    )
    Sam2Model(Sam2Config(vision_config=vision)).save_pretrained(root / "segmenter")
    width, heads = (768, 12) if full else (384, 6)
    Dinov2Model(
        Dinov2Config(hidden_size=width, num_attention_heads=heads, image_size=518)
    ).save_pretrained(root / "encoder")
    masks = MaskOptions(
        detector=str(root / "detector"),
        segmenter=str(root / "segmenter"),
        prompt="instruction",
        box_threshold=0.0,
        batch=8 if full else 4,
    )
    return masks, FeatureOptions(encoder=str(root / "encoder"), batch=16 if full else 8)
