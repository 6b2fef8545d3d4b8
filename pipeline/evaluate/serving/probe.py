"""Distinguishes served policies by a hash of a server's metadata and of its answer to a fixed question."""

import hashlib

import numpy as np
from numpy.typing import NDArray

from pipeline.data.errors import DominoError
from pipeline.evaluate.policies.policy import Observation, Policy, PolicyError, PolicyName, Start, chunk_of
from pipeline.evaluate.serving.wire import pack

PROMPT = "hold still"


def probe_policy(name: PolicyName, policy: Policy, start: Start) -> PolicyName:
    """The name of a served policy with its probe; the label carries the probe unless the user gave a label.

    The question is asked in two episodes. Raises PolicyError if the two answers differ, or if there is none, unless the user
    gave a label: then that is what names the policy.
    """
    labelled = "label=" in name.text
    try:
        first, second = ask(policy, start), ask(policy, start)
    except DominoError as error:
        if labelled:
            return name
        raise PolicyError(f"{name.text}: gives no answer by which to know it ({error}): name it with ?label=NAME") from error
    finally:
        getattr(policy, "close", lambda: None)()
    if first[1] != second[1] and not labelled:
        raise PolicyError(f"{name.text}: answers the same question differently each time: name it with ?label=NAME")
    same = [a for a, b in zip(first, second, strict=True) if a == b]
    probe = hashlib.sha256(b"|".join(same)).hexdigest()[:8] if same else ""
    return PolicyName(name.text, name.label if labelled else f"{name.label}@{probe}", probe)


def ask(policy: Policy, start: Start) -> tuple[bytes, bytes]:
    """The packed metadata of a policy, and its answer (H,A) to the fixed question in an episode of one question, as bytes.

    Raises what the policy raises."""
    policy.reset(start)
    images = {camera: _pattern(*size) for camera, size in start.image_sizes.items()}
    chunk = chunk_of(
        policy.act(Observation(np.zeros(len(start.action_names)), start.instruction, 0.0, images)), len(start.action_names)
    )
    return pack(dict(getattr(policy, "metadata", {}))), chunk.tobytes()


def _pattern(height: int, width: int) -> NDArray[np.uint8]:
    """An image (H,W,3) that no encoder takes for another."""
    rows, columns = np.mgrid[:height, :width]
    return np.stack([rows * 255 // height, columns * 255 // width, (rows * columns) % 256], axis=-1).astype(np.uint8)
