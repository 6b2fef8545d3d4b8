"""The real model classes with tiny random weights, saved as their maintainers save them; no
network.

`transformers` loads a class when it is first named: every test process imports this module, few
make a model.
"""

from pathlib import Path

import torch
import transformers

WORDS = ("bell", "block", "red", "grey", "the", "click", "with", "left", "arm", "please", "now")
VOCABULARY = 1100
SIDE = 128  # of the segmenter's image


def vocabulary() -> dict[str, int]:
    """Token ids with BERT's own marks where GroundingDINO's phrase splitting looks for them."""
    table = {f"[unused{i}]": i for i in range(VOCABULARY)}
    fixed = {
        "[PAD]": 0,
        "[UNK]": 100,
        "[CLS]": 101,
        "[SEP]": 102,
        "[MASK]": 103,
        ".": 1012,
        "?": 1029,
    }
    fixed |= {w: 200 + i for i, w in enumerate(WORDS)}
    taken = {i: w for w, i in fixed.items()}
    return {taken.get(i, name): i for name, i in table.items()}


def save_detector(path: Path, seed: int = 0) -> Path:
    """GroundingDINO (0.5 M weights) with its processor; images are shrunk to 64 px on the short
    side."""
    torch.manual_seed(seed)
    path.mkdir(parents=True, exist_ok=True)
    tokenizer = transformers.BertTokenizer(vocab=vocabulary(), do_lower_case=True)
    images = transformers.GroundingDinoImageProcessor(
        size={"shortest_edge": 64, "longest_edge": 100}
    )
    transformers.GroundingDinoProcessor(images, tokenizer).save_pretrained(path)
    config = transformers.GroundingDinoConfig(
        backbone_config=transformers.SwinConfig(
            image_size=64,
            patch_size=4,
            embed_dim=16,
            depths=[1, 1, 1, 1],
            num_heads=[1, 1, 2, 2],
            window_size=4,
            out_features=["stage2", "stage3", "stage4"],  # pyright: ignore[reportCallIssue]  (a mixin takes it)
        ),
        text_config=transformers.BertConfig(
            vocab_size=VOCABULARY,
            hidden_size=32,
            num_hidden_layers=1,
            num_attention_heads=2,
            intermediate_size=64,
            max_position_embeddings=64,
        ),
        num_queries=20,
        d_model=32,
        encoder_layers=1,
        decoder_layers=2,
        encoder_ffn_dim=64,
        decoder_ffn_dim=64,
        encoder_attention_heads=2,
        decoder_attention_heads=2,
        encoder_n_points=2,
        decoder_n_points=2,
        max_text_len=32,
        num_feature_levels=4,
        disable_custom_kernels=True,
    )
    transformers.GroundingDinoForObjectDetection(config).save_pretrained(path)
    return path


def save_segmenter(path: Path, seed: int = 0) -> Path:
    """SAM 2 (0.12 M weights), images of SIDE px."""
    torch.manual_seed(seed)
    backbone = transformers.Sam2HieraDetConfig(
        hidden_size=8,
        num_attention_heads=1,
        blocks_per_stage=[1, 1, 2, 1],
        embed_dim_per_stage=[8, 16, 32, 64],
        num_attention_heads_per_stage=[1, 1, 2, 4],
        global_attention_blocks=[3],
        window_size_per_stage=[4, 4, 4, 4],
        window_positional_embedding_background_size=[4, 4],
        image_size=[SIDE, SIDE],
    )
    config = transformers.Sam2Config(
        vision_config=transformers.Sam2VisionConfig(
            backbone_config=backbone,
            backbone_channel_list=[64, 32, 16, 8],
            backbone_feature_sizes=[[32, 32], [16, 16], [8, 8]],
            fpn_hidden_size=32,
            num_feature_levels=3,
        ),
        prompt_encoder_config=transformers.Sam2PromptEncoderConfig(
            hidden_size=32, image_size=SIDE, patch_size=16, mask_input_channels=8
        ),
        mask_decoder_config=transformers.Sam2MaskDecoderConfig(
            hidden_size=32,
            num_attention_heads=2,
            mlp_dim=64,
            iou_head_hidden_dim=32,
            num_hidden_layers=2,
        ),
    )
    transformers.Sam2Model(config).save_pretrained(path)
    return path


def save_encoder(path: Path, kind: str = "dinov2", seed: int = 0) -> Path:
    """DINOv2 (patch 14, one prefix token) or DINOv3 (patch 16, five), width 32."""
    torch.manual_seed(seed)
    if kind == "dinov2":
        model = transformers.Dinov2Model(
            transformers.Dinov2Config(
                hidden_size=32,
                num_hidden_layers=2,
                num_attention_heads=2,
                mlp_ratio=2,
                image_size=56,
                patch_size=14,
            )
        )
    else:
        model = transformers.DINOv3ViTModel(
            transformers.DINOv3ViTConfig(
                hidden_size=32,
                intermediate_size=64,
                num_hidden_layers=2,
                num_attention_heads=2,
                image_size=64,
                patch_size=16,
                num_register_tokens=4,
            )
        )
    model.save_pretrained(path)
    return path
