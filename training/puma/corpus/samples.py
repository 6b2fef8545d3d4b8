"""Batches for the network: what happened until a frame, what was commanded after it, and which of
that exists."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from training.puma.config import Config
from training.puma.corpus.split import SplitFrames
from training.puma.model.oracle import oracle_numbers
from training.puma.preprocess import Preprocessing

type Arrays = dict[str, NDArray[Any]]


def batch_of(
    part: SplitFrames, places: NDArray[np.int64], config: Config, preprocessing: Preprocessing
) -> Arrays:
    """The arrays of B frames of one part.

    `image_<camera>` (B,h,w,3) uint8, where the network looks at them; `past` (B,h,fh,fw,3) uint8,
    oldest first, and `past_time` (B,h) s, at most 0; `state` (B,A) and `action` (B,K,A) normalised;
    `clock` (B,) s; `world` (B,N,D) and `oracle` (B,F). `action_valid` (B,K) is False past the last
    frame of the episode, `world_valid` (B,N) also where the target was not seen. `row` (B,) numbers
    the episodes. Where the target is tracked: `track` (B,2K+2), `tools` (B,2,3) m, `free` (B,),
    whether the robot has not touched it yet, `held` (B,) s since it did, 0 before, and `choice`
    (B,), the number of the arms that act.

    History before the first frame is the first frame, whose flow map is black, as at the start of
    an episode that is played.
    """
    model, arrays = config.model, part.cache.arrays
    frame, first, last = part.frame[places, None], part.first[places, None], part.last[places, None]
    now = frame[:, 0]
    cameras = config.data.cameras if model.looks else ()
    out: Arrays = {f"image_{camera}": arrays[f"image_{camera}"][now] for camera in cameras}
    commands, out["action_valid"] = commands_of(part, places, config)
    out["action"] = preprocessing.action.forward(commands)
    out["state"] = preprocessing.state.forward(arrays["state"][now])
    out["clock"] = np.asarray(arrays["time"][now], np.float32)
    if model.history != "none":
        ages = np.arange(model.history_length)[::-1] * model.stride + (
            model.stride if model.history == "frames" else 0
        )
        at = np.maximum(frame - ages, first)
        out["past"] = arrays["past"][at]
        out["past_time"] = np.asarray(arrays["time"][at] - arrays["time"][now][:, None], np.float32)
    if model.track:
        out |= {
            name: np.asarray(arrays[name][now])
            for name in ("track", "tools", "free", "choice", "held")
        }
    if model.oracle:
        at = np.minimum(frame + np.arange(model.chunk + 1), last)
        out["oracle"] = oracle_numbers(arrays["target"][at], part.cache.fps)
    if model.world != "none":
        later = frame + model.stride * np.arange(1, model.world_queries + 1)
        at = np.minimum(later, last)
        out["world"] = arrays["world"][at].astype(np.float32)
        out["world_valid"] = (later <= last) & arrays["valid"][at]
    out["row"] = part.episode[places]
    return out


def commands_of(
    part: SplitFrames, places: NDArray[np.int64], config: Config
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Actions (B,K,A) of the chunks that begin at B frames, and which of them exist (B,K)."""
    arrays, names = part.cache.arrays, part.cache.names
    frame, first, last = part.frame[places, None], part.first[places, None], part.last[places, None]
    ahead = frame + np.arange(config.model.chunk)
    # the last recorded action belongs to the interval after the last frame: nothing was measured
    # there
    exist = ahead < np.maximum(last, first + 1)
    commands = arrays["action"][np.minimum(ahead, last)]
    if config.data.grippers == "binary":
        commands = np.where(grippers_of(names), commands > 0.5, commands).astype(np.float32)
    if config.model.offsets:
        commands = commands - references(arrays["state"][part.frame[places]], names)[:, None]
    return commands, exist


def references(joints: NDArray[Any], names: Sequence[str]) -> NDArray[Any]:
    """The joints (...,A) that predicted offsets are added to: those measured, and zero for
    grippers."""
    return np.where(grippers_of(names), 0, joints)


def grippers_of(names: Sequence[str]) -> list[bool]:
    """Which joints are grippers."""
    return [name.endswith("gripper") for name in names]


def joined(batches: Sequence[Arrays], order: NDArray[np.int64]) -> Arrays:
    """Batches of several parts as one, row i of the result being row order[i] of all of them."""
    return {name: np.concatenate([batch[name] for batch in batches])[order] for name in batches[0]}


def mixed_batch(
    parts: Sequence[SplitFrames],
    draw: tuple[NDArray[np.int64], NDArray[np.int64]],
    config: Config,
    preprocessing: Preprocessing,
) -> tuple[Arrays, list[str]]:
    """The arrays of a draw of Sampler, and an instruction for each row."""
    sources, places = draw
    groups = [np.flatnonzero(sources == k) for k in range(len(parts))]
    used = [(part, group) for part, group in zip(parts, groups, strict=True) if len(group)]
    batches = [batch_of(part, places[group], config, preprocessing) for part, group in used]
    back = np.argsort(np.concatenate([group for _, group in used]))
    texts: list[str] = [""] * len(sources)
    for (part, group), batch in zip(used, batches, strict=True):
        for i, row in zip(group, batch["row"], strict=True):
            sentences = part.cache.rows[row].instructions
            # another sentence at every frame: which one follows from the frame alone
            texts[i] = sentences[int(part.frame[places[i]] * 7919) % len(sentences)]
    return joined(batches, back), texts
