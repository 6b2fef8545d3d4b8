"""The network: Qwen3-VL as transformers runs it, queries of their own, losses that see only what
exists."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.training.puma.tiny import config_of, qwen_json
from training.puma.config import Config
from training.puma.errors import TrainError
from training.puma.model.heads import EVERY, action_loss, box_loss, feature_loss, mode_loss
from training.puma.model.inputs import Inputs
from training.puma.model.oracle import oracle_numbers, oracle_size
from training.puma.model.puma import Puma, Sizes, Targets, build_model
from training.puma.model.text import PADDING, HashedWords
from training.puma.model_keys import Lora
from training.puma.processes.flops import forward_flops

SIZES = Sizes(14, 32)


def patches_of(image, *sizes):
    """As of training.puma.model.vision, which imports transformers: that takes seconds, and every
    test process imports this module."""
    from training.puma.model import vision

    return vision.patches_of(image, *sizes)


def qwen_config(folder: Path, **model: object) -> Config:
    backbone = {
        "kind": "qwen3-vl",
        "name": str(qwen_json(folder / "qwen.json")),
        "weights": "random",
    }
    return config_of(folder / "none", folder / "cache", backbone=backbone, **model)


def inputs(batch: int = 2, seed: int = 0, words: int = 60) -> Inputs:
    g = torch.Generator().manual_seed(seed)
    lengths = [5, 3, 7, 2]
    text = torch.full((batch, 16), PADDING)
    for row in range(batch):
        text[row, : lengths[row]] = torch.randint(1, words, (lengths[row],), generator=g)
    return Inputs(
        views=torch.randint(0, 256, (batch, 2, 32, 64, 3), dtype=torch.uint8, generator=g),
        text=text,
        past=torch.randint(0, 256, (batch, 2, 32, 32, 3), dtype=torch.uint8, generator=g),
        state=torch.randn(batch, 14, generator=g),
        clock=torch.rand(batch, 1, generator=g),
        past_time=-torch.rand(batch, 2, generator=g),
        oracle=torch.randn(batch, oracle_size(6), generator=g),
    )


def targets(batch: int = 2, chunk: int = 6, world: int = 32) -> Targets:
    g = torch.Generator().manual_seed(3)
    return Targets(
        torch.randn(batch, chunk, 14, generator=g),
        torch.ones(batch, chunk, dtype=torch.bool),
        torch.randn(batch, 2, world, generator=g),
        torch.ones(batch, 2, dtype=torch.bool),
    )


@pytest.fixture(scope="module", params=["qwen3-vl", "tiny"])
def network(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Puma:
    folder = tmp_path_factory.mktemp("network")
    torch.manual_seed(0)
    return build_model(
        qwen_config(folder) if request.param == "qwen3-vl" else config_of(folder, folder), SIZES
    )


def reference(network: Puma, given: Inputs, row: int) -> torch.Tensor:
    """Hidden states (Q,H) by transformers' own forward: token ids, its positions, its scatter of
    images; queries as new tokens."""
    from transformers import Qwen3VLConfig, Qwen3VLForConditionalGeneration

    backbone = network.backbone
    config = Qwen3VLConfig(**backbone.model.config.to_dict())
    queries = network.queries.detach()
    config.text_config.vocab_size = 96 + len(queries)
    whole = Qwen3VLForConditionalGeneration(config).eval()
    weights = backbone.model.state_dict()
    table = torch.cat([weights["language_model.embed_tokens.weight"], queries])
    whole.model.load_state_dict(weights | {"language_model.embed_tokens.weight": table})
    text = given.text[row][given.text[row] != PADDING]
    images = [["past", 0], ["past", 1], ["views", 0], ["views", 1]]
    ids, pixels, grids = [95], [], []
    for name, k in images:
        image = getattr(given, name)[row, k][None]
        rows, columns = image.shape[1] // 16, image.shape[2] // 16
        ids += [92, *[90] * (rows * columns // 4), 93]
        pixels.append(patches_of(image, 16, 2, 2)[0])
        grids.append([1, rows, columns])
    first = len(queries) - network.config.model.chunk
    asked = [range(96, 96 + first), range(96 + first, 96 + len(queries))]
    spoken = backbone.world.tolist(), backbone.action.tolist()
    ids += [*text.tolist(), *spoken[0], *asked[0], *spoken[1], *asked[1], *backbone.after.tolist()]
    tokens = torch.tensor([ids])
    with torch.no_grad():
        hidden = whole.model(
            input_ids=tokens,
            attention_mask=torch.ones_like(tokens),
            pixel_values=torch.cat(pixels),
            image_grid_thw=torch.tensor(grids),
            mm_token_type_ids=(tokens == 90).int(),
        ).last_hidden_state
    return hidden[0, [i for i, number in enumerate(ids) if number >= 96]]


@pytest.mark.parametrize("lora", [None, Lora(rank=2)], ids=["whole", "lora"])
def test_weights_that_are_trained_are_float32_whatever_the_arithmetic(
    tmp_path: Path, lora: Lora | None
):
    config = qwen_config(tmp_path)
    backbone = config.model.backbone.model_copy(update={"lora": lora})
    model = config.model.model_copy(update={"backbone": backbone})
    config = config.model_copy(
        update={"model": model, "train": config.train.model_copy(update={"precision": "bf16"})}
    )
    kinds = {
        (weight.requires_grad, weight.dtype) for weight in build_model(config, SIZES).parameters()
    }
    assert kinds == (
        {(True, torch.float32)}
        if lora is None
        else {(True, torch.float32), (False, torch.bfloat16)}
    )
    acting = build_model(config, SIZES, trained=True)
    assert {buffer.dtype for buffer in acting.buffers() if buffer.is_floating_point()} == {
        torch.float32
    }


@pytest.mark.parametrize("sentences", [False, True])
def test_hidden_states_are_those_of_transformers(tmp_path: Path, sentences: bool):
    torch.manual_seed(1)
    config = qwen_config(tmp_path, state=False, sentences=sentences)
    network = build_model(config, SIZES).eval()
    assert bool(len(network.backbone.world)) == sentences
    # as large as other embeddings, so that a query in the wrong place shows
    network.queries.data.normal_()
    given = inputs()
    with torch.no_grad():
        ours = network.backbone(given, torch.zeros(2, 0, 64), network.queries)
    for row in range(2):
        np.testing.assert_allclose(
            ours[row].numpy(), reference(network, given, row).numpy(), atol=1e-4
        )


def test_patches_are_those_of_the_image_processor():
    image = torch.randint(
        0, 256, (1, 32, 64, 3), dtype=torch.uint8, generator=torch.Generator().manual_seed(0)
    )
    ours = patches_of(image, 16, 2, 2)[0]
    # block (0, 1) of 2x2 patches begins at column 32; its third patch is one row of patches lower
    wanted = (
        (image[0, 16:32, 32:48].permute(2, 0, 1).float() / 127.5 - 1)[:, None]
        .expand(-1, 2, -1, -1)
        .reshape(-1)
    )
    np.testing.assert_allclose(ours[4 + 2].numpy(), wanted.numpy(), atol=1e-6)


def test_every_query_gets_a_gradient_of_its_own(network: Puma):
    network.zero_grad()
    network.losses(network(inputs()), targets())["loss"].backward()
    gradient = network.queries.grad
    assert gradient is not None and len(gradient) == 2 + 6
    assert (gradient.norm(dim=1) > 0).all()
    unit = gradient / gradient.norm(dim=1, keepdim=True)
    assert (unit @ unit.T - torch.eye(len(unit))).abs().max() < 0.999


def test_padding_of_the_instruction_changes_nothing(network: Puma):
    given = inputs()
    longer = Inputs(
        **(vars(given) | {"text": torch.cat([given.text, torch.full((2, 16), PADDING)], 1)})
    )
    network.eval()
    with torch.no_grad():
        np.testing.assert_allclose(
            network(given).actions.numpy(), network(longer).actions.numpy(), atol=1e-5
        )
    network.train()


@pytest.mark.parametrize("name", ["views", "past", "text", "state"])
def test_every_input_matters(network: Puma, name: str):
    given, other = inputs(seed=0), inputs(seed=1)
    changed = Inputs(**(vars(given) | {name: getattr(other, name)}))
    with torch.no_grad():
        assert (network(given).actions - network(changed).actions).abs().max() > 1e-6


@pytest.mark.parametrize("further", ["clock", "history_times", "oracle"])
def test_optional_inputs_matter_only_where_they_are_asked_for(tmp_path: Path, further: str):
    field = "past_time" if further == "history_times" else further
    given = inputs()
    changed = Inputs(**(vars(given) | {field: 2 * getattr(given, field) + 1}))
    for asked in (True, False):
        torch.manual_seed(0)
        network = build_model(config_of(tmp_path, tmp_path, **{further: asked}), SIZES)
        with torch.no_grad():
            assert (
                bool((network(given).actions - network(changed).actions).abs().max() > 1e-7)
                == asked
            )


@pytest.mark.parametrize("kind", ["features", "boxes"])
def test_losses_and_gradients_see_only_what_exists(tmp_path: Path, kind: str):
    torch.manual_seed(0)
    wide = 4 if kind == "boxes" else 32
    network = build_model(config_of(tmp_path, tmp_path, world=kind), Sizes(14, wide))
    given, wanted = inputs(), targets(world=wide)
    wanted.action_valid[:, 4:], wanted.world_valid[0, 1] = False, False
    outputs = network(given)
    for tensor in (outputs.actions, outputs.world):
        tensor.retain_grad()
    losses = network.losses(outputs, wanted)
    losses["loss"].backward()
    assert (
        not outputs.actions.grad[:, 4:].any() and (outputs.actions.grad[:, :4] != 0).any(-1).all()
    )
    assert (
        not outputs.world.grad[0, 1].any()
        and outputs.world.grad[0, 0].any()
        and outputs.world.grad[1].any()
    )
    # what is masked may be anything
    wanted.action[:, 4:], wanted.world[0, 1] = 1e6, 1e6
    again = network.losses(network(given), wanted)
    assert float(again["loss"].detach()) == float(losses["loss"].detach())
    lone = network.losses(outputs, Targets(wanted.action, torch.zeros_like(wanted.action_valid)))
    assert float(lone["loss"].detach()) == 0


def test_losses_by_hand():
    found, wanted = (
        torch.tensor([[[1.0, 2.0], [5.0, 5.0]]]),
        torch.tensor([[[0.0, 4.0], [5.0, 0.0]]]),
    )
    assert float(action_loss(found, wanted, torch.tensor([[True, True]]))) == pytest.approx(
        (3 + 5) / 2
    )
    assert float(action_loss(found, wanted, torch.tensor([[True, False]]))) == pytest.approx(3)
    mean = action_loss(found, wanted, torch.tensor([[True, True]]), "mean")
    assert float(mean) == pytest.approx((3 + 5) / 4)
    assert float(box_loss(found, wanted, torch.tensor([[False, True]]))) == pytest.approx(5)
    one, other = torch.tensor([[[3.0, 0.0]]]), torch.tensor([[[1.0, 1.0]]])
    assert float(feature_loss(one, other, torch.tensor([[True]]))) == pytest.approx(1 - 0.5**0.5)


def test_only_the_best_of_several_chunks_is_drawn_to_a_sample():
    wanted = torch.tensor([[[1.0], [1.0]], [[-1.0], [9.0]]])
    valid = torch.tensor([[True, True], [True, False]])
    chunks = (
        torch.tensor([[[[0.5], [0.5]], [[-1.0], [-1.0]]]])
        .expand(2, -1, -1, -1)
        .clone()
        .requires_grad_()
    )
    scores = torch.zeros(2, 2, requires_grad=True)
    action, mode = mode_loss(chunks, scores, wanted, valid)
    # summed errors of the chunks: 1 and 4 for the first sample, 1.5 and 0 for the second, over 3
    # steps that exist
    assert action.item() == pytest.approx((1 - EVERY) * (1 + 0) / 3 + EVERY * (2.5 + 0.75) / 3)
    assert mode.item() == pytest.approx(np.log(2))
    (action + mode).backward()
    assert chunks.grad is not None and scores.grad is not None
    assert float(chunks.grad[0, 1].abs().max()) < 0.1 * float(chunks.grad[0, 0].abs().max())
    assert (chunks.grad[1, :, 1] == 0).all() and scores.grad.argmin(1).tolist() == [0, 1]


def test_the_chunk_with_the_highest_score_is_the_answer(tmp_path: Path):
    torch.manual_seed(0)
    backbone = {"kind": "perceptron", "weights": "random", "width": 16, "layers": 1}
    network = build_model(
        config_of(tmp_path, tmp_path, backbone=backbone, world="none", history="none", modes=3),
        SIZES,
    )
    found = network(inputs(4))
    assert (
        found.chunks is not None
        and found.scores is not None
        and found.chunks.shape == (4, 3, 6, 14)
    )
    for row, best in enumerate(found.scores.argmax(1)):
        assert torch.equal(found.actions[row], found.chunks[row, best])
    assert {"action", "mode", "loss"} == set(network.losses(found, targets(4)))


def test_members_learn_alone_and_act_together(tmp_path: Path):
    backbone = {"kind": "perceptron", "weights": "random", "width": 16, "layers": 1}
    config = config_of(
        tmp_path, tmp_path, backbone=backbone, world="none", history="none", members=3
    )
    torch.manual_seed(0)
    network = build_model(config, SIZES)
    found = network(inputs(4))
    assert found.scores is None and found.chunks is not None
    assert found.chunks.shape == (4, 3, 6, 14)
    assert torch.allclose(found.actions, found.chunks.mean(1))
    assert not torch.allclose(found.chunks[:, 0], found.chunks[:, 1])
    wanted = targets(4)
    apart = [
        action_loss(chunk, wanted.action, wanted.action_valid) for chunk in found.chunks.unbind(1)
    ]
    loss = network.losses(found, wanted)["loss"]
    assert float(loss.detach()) == pytest.approx(float(sum(apart).detach()) / 3)
    alone = build_model(
        config_of(tmp_path, tmp_path, backbone=backbone, world="none", history="none"), SIZES
    )
    ratio = forward_flops(network, inputs(4)) / forward_flops(alone, inputs(4))
    assert ratio == pytest.approx(3, rel=0.05)
    # what one member is wrong about moves no weight of another
    apart[0].backward()
    for name, weight in network.named_parameters():
        if name.startswith(("backbone.1.", "backbone.2.", "action_head.1.", "action_head.2.")):
            assert weight.grad is not None and not weight.grad.any()
        elif name.startswith(("extra.", "queries")):
            assert weight.grad is not None
            grad = weight.grad if name == "queries" else weight.grad.movedim(0, -1)
            assert grad[..., :16].any() and not grad[..., 16:].any()


def test_adapters_are_what_is_trained_of_the_backbone(tmp_path: Path):
    backbone = {
        "kind": "qwen3-vl",
        "name": str(qwen_json(tmp_path / "qwen.json")),
        "weights": "random",
        "lora": {"rank": 2},
    }
    network = build_model(config_of(tmp_path, tmp_path, backbone=backbone), SIZES)
    trained = [
        name
        for name, weight in network.named_parameters()
        if weight.requires_grad and name.startswith("backbone.")
    ]
    assert trained and all("lora_" in name and "language_model" in name for name in trained)
    network.losses(network(inputs()), targets())["loss"].backward()
    assert any(
        w.grad is not None and w.grad.any() for n, w in network.named_parameters() if "lora_B" in n
    )


def test_checkpointing_is_on_and_changes_nothing(tmp_path: Path):
    gradients = []
    for on in (False, True):
        config = qwen_config(tmp_path)
        config = config.model_copy(
            update={"train": config.train.model_copy(update={"checkpointing": on})}
        )
        torch.manual_seed(0)
        network = build_model(config, SIZES)
        calls: list[object] = []
        block = network.backbone.model.visual.blocks[0].mlp
        layer = network.backbone.model.language_model.layers[0].mlp
        for module in (block, layer):
            module.register_forward_pre_hook(lambda m, i, calls=calls: calls.append(m))
        network.losses(network(inputs()), targets())["loss"].backward()
        # the flow maps and the views are two batches; checkpointing runs everything a second time
        assert len(calls) == (6 if on else 3)
        gradients.append(network.queries.grad.clone())
    assert torch.equal(*gradients)


def test_images_that_qwen_cannot_take_are_refused(tmp_path: Path):
    config = qwen_config(tmp_path)
    config = config.model_copy(
        update={"data": config.data.model_copy(update={"image_size": (48, 64)})}
    )
    with pytest.raises(TrainError, match=r"data\.image_size 48x64: .* multiples of 32"):
        build_model(config, SIZES)


def test_a_config_without_weights_is_refused(tmp_path: Path):
    backbone = {"kind": "qwen3-vl", "name": str(qwen_json(tmp_path / "qwen.json"))}
    with pytest.raises(TrainError, match=r"set model\.backbone\.weights to random"):
        build_model(config_of(tmp_path, tmp_path, backbone=backbone), SIZES)


def test_hashed_words_are_the_same_everywhere():
    words = HashedWords(64, first=10)
    ids = words.ids(["Press the bell", "the"])
    assert ids.shape == (2, 16) and (ids[0, 3:] == PADDING).all()
    # crc32 of "the" is 0x3c456de6
    assert ids[1, 0] == ids[0, 1] == 10 + 0x3C456DE6 % 54


def test_the_future_is_poses_and_velocities():
    poses = np.zeros((1, 5, 7), np.float32)
    poses[0, :, 0] = [0.0, 0.1, 0.3, 0.6, 1.0]
    poses[0, :, 3] = 1
    numbers = oracle_numbers(poses, fps=10)
    assert numbers.shape == (1, oracle_size(4))
    np.testing.assert_array_equal(numbers[0, :28].reshape(4, 7), poses[0, 1:])
    np.testing.assert_allclose(numbers[0, 28:], [0, 0, 0, 1, 0, 0, 1, 0, 0, 4, 0, 0], atol=1e-6)
