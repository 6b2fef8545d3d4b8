"""The rungs of the ladder that see images: LeRobot's ACT (one observation) and diffusion (two),
trained by lerobot-train itself on an export of a dataset's episodes."""

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.data.dataset import Dataset
from pipeline.data.recipe.model import Cell
from pipeline.export import EXPORTERS, Job, parse_options
from training.ladder.demonstrations import AFTER_SUCCESS
from training.ladder.samples import LadderError

IMAGE_RUNGS = ("act", "diffusion")

SMALL = {
    "act": (
        *(
            "dim_model=256",
            "n_heads=4",
            "dim_feedforward=1024",
            "n_encoder_layers=2",
            "use_vae=false",
        ),
        *("optimizer_lr=3e-4", "optimizer_lr_backbone=1e-4"),
    ),
    "diffusion": (
        "down_dims=[128,256]",
        "noise_scheduler_type=DDIM",
        "num_inference_steps=10",
        "use_group_norm=true",
    ),
}
"""What differs from LeRobot's defaults: smaller, so that a CPU can train it on small images; for
ACT no variational encoder, because a scripted expert has one style, and a higher rate for the
backbone; for diffusion a normalisation that needs no statistics. Both backbones start from random
weights here."""


@dataclass(frozen=True)
class ImageTraining:
    """One training: ACT or diffusion, actions in a chunk and how many are executed, seed, steps,
    and words for lerobot-train (`--policy.device=cuda`), which win over ours."""

    kind: str
    chunk: int
    execute: int
    seed: int
    steps: int
    words: tuple[str, ...] = ()

    def command(self, dataset: Path, out: Path) -> list[str]:
        """The command line of lerobot-train."""
        length = "chunk_size" if self.kind == "act" else "horizon"
        policy = (
            f"type={self.kind}",
            "device=cpu",
            "push_to_hub=false",
            "pretrained_backbone_weights=null",
            *SMALL[self.kind],
        )
        words = [
            f"--policy.{word}"
            for word in (*policy, f"{length}={self.chunk}", f"n_action_steps={self.execute}")
        ]
        words += [
            "--dataset.repo_id=local/ladder",
            f"--dataset.root={dataset}",
            "--dataset.video_backend=pyav",
        ]
        words += [
            "--batch_size=16",
            "--num_workers=0",
            "--wandb.enable=false",
            f"--seed={self.seed}",
            f"--output_dir={out}",
        ]
        words += [
            f"--steps={self.steps}",
            f"--save_freq={self.steps}",
            "--env_eval_freq=0",
            "--log_freq=100",
        ]
        program = [str(Path(sys.executable).with_name("lerobot-train"))]
        if self.kind == "act":
            program = [sys.executable, "-P", "-m", "training.ladder.train_act"]
        return [*program, *words, *self.words]


def image_policy(training: ImageTraining, dataset: Path, where: Path) -> Path:
    """The directory of a trained policy below `where`, trained if it is not there: its name carries
    a hash of the training and of the name of the LeRobot dataset, which carries one of its
    episodes.

    Raises LadderError in one line if lerobot-train fails.
    """
    digest = hashlib.sha256(f"{training}{dataset.name}".encode()).hexdigest()[:8]
    path = (
        where / f"{training.kind}_c{training.chunk}_e{training.execute}_s{training.seed}_{digest}"
    )
    if not path.exists():
        temporary = where / f".{path.name}"
        shutil.rmtree(temporary, ignore_errors=True)
        where.mkdir(parents=True, exist_ok=True)
        _call(training.command(dataset, temporary))
        (temporary / "checkpoints" / "last" / "pretrained_model").resolve().rename(path)
        shutil.rmtree(temporary)
    return path


def lerobot_dataset(root: Path, cells: Sequence[Cell], where: Path) -> tuple[Path, int]:
    """The dataset's accepted episodes of these cells as a LeRobot dataset below `where`, and how
    many there are.

    They end with the success. The dataset is exported if it is not there; its name carries a hash
    of their bytes. Raises LadderError if there is none, and for corrections.
    """
    dataset = Dataset(root)
    if dataset.recipe().corrections:
        raise LadderError(
            f"{root} holds corrections, whose first frames show a policy's actions: lerobot-train"
            " would imitate them, too"
        )
    found = [
        (dataset.episode(slot), record.sha256)
        for slot, record in dataset.records(dataset.recipe())
        if slot.cell in cells
    ]
    mine = sorted((path, sha) for path, sha in found if sha)
    if not mine:
        raise LadderError(f"{cells[0].task}: {root} has no episode to learn from")
    out = (
        where
        / f"{cells[0].task}_{hashlib.sha256(repr([AFTER_SUCCESS, *(sha for _, sha in mine)]).encode()).hexdigest()[:8]}"  # noqa: E501
    )
    if not out.exists():
        exporter = EXPORTERS["lerobot"]
        exporter.export(
            Job(
                root,
                out,
                [path for path, _ in mine],
                parse_options("lerobot", exporter.options, {"after_success": str(AFTER_SUCCESS)}),
            )
        )
    return out, len(mine)


def _call(command: Sequence[str]) -> None:
    offline = {"HF_HUB_OFFLINE": "1", "WANDB_MODE": "disabled"}
    try:
        done = subprocess.run(
            command, env=os.environ | offline, capture_output=True, text=True, check=False
        )
    except FileNotFoundError as error:
        raise LadderError(
            "act and diffusion are trained by lerobot-train: install domino-data[lerobot]"
        ) from error
    if done.returncode:
        lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        raise LadderError(
            f"lerobot-train failed: {lines[-1][:300] if lines else f'exit code {done.returncode}'}"
        )
