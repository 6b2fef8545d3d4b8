"""Tells policies of one name apart by a hash of their answer to a fixed question, and of a server's
metadata."""

import hashlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.actions import ActionError
from pipeline.evaluate.policies.contract import action_length
from pipeline.evaluate.policies.policy import (
    NoAnswer,
    Observation,
    Policy,
    PolicyError,
    PolicyName,
    Start,
    attribute,
    chunk_of,
)
from pipeline.evaluate.serving.messages import pack

PROMPT = "hold still"


def probe_policy(name: PolicyName, policy: Policy, start: Start) -> PolicyName:
    """The name of a policy with its probe; the label carries the probe unless the user gave a
    label.

    The question is asked in two episodes, and what is the same in both counts. Raises PolicyError
    if the policy refuses them, and if an address is all that would name a policy that answers
    differently each time, or not at all.
    """
    anonymous = "://" in name.label
    try:
        first, second = ask(policy, start), ask(policy, start)
    except (ActionError, NoAnswer) as error:
        if not anonymous:
            return name
        raise PolicyError(
            f"{name.text}: gives no answer by which to know it ({error}): name it with ?label=NAME"
        ) from error
    if first[1] != second[1] and anonymous:
        raise PolicyError(
            f"{name.text}: answers the same question differently each time: name it with"
            " ?label=NAME"
        )
    probe = hashlib.sha256(
        b"|".join(a for a, b in zip(first, second, strict=True) if a == b)
    ).hexdigest()[:8]
    if "label=" in name.text:
        return replace(name, probe=probe)
    return replace(
        name, label=f"{name.label}{'.' if '@' in name.label else '@'}{probe}", probe=probe
    )


def ask(policy: Policy, start: Start) -> tuple[bytes, bytes]:
    """The packed metadata of a policy, and its answer (H,A) to the fixed question in an episode of
    one question, as bytes.

    Raises what the policy raises."""
    policy.reset(start)
    images = {camera: _pattern(*size) for camera, size in start.image_sizes.items()}
    joints = np.zeros(len(start.action_names))
    answer = policy.act(Observation(joints, start.instruction, 0.0, images))
    chunk = chunk_of(answer, action_length(policy, start.action_names))
    return pack(dict(attribute(policy, "metadata") or {})), chunk.tobytes()


def _pattern(height: int, width: int) -> NDArray[np.uint8]:
    """An image (H,W,3) that no encoder takes for another."""
    rows, columns = np.mgrid[:height, :width]
    return np.stack(
        [rows * 255 // height, columns * 255 // width, (rows * columns) % 256], axis=-1
    ).astype(np.uint8)
