"""Actions in several representations: exported, trained on with lerobot, and evaluated.

    python -m benchmarks.consumers.representations OUT [--steps 20] [--representations ee:6d,...]

Of each representation: `export --format lerobot --actions ... --rotation ...` of the dataset OUT,
`lerobot-train` of a small ACT, and `evaluate --like EXPORT` of its checkpoint on a scene of each
cell. The policy has learnt nothing yet: a row is ok if all three commands succeed and every answer
of the policy was a valid action. Exit code 1 if one fails.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

from benchmarks.consumers.__main__ import ReaderOutcome, call, train

USUAL = "joints,joints-relative,ee:6d,ee-relative:6d,ee-relative:axis-angle"


def domino(*words: str) -> list[str]:
    """A command of this installation."""
    return [str(Path(sys.executable).with_name("domino-data")), *words]


def try_representation(
    dataset: Path, words: str, steps: int, place: Path, home: Path
) -> list[ReaderOutcome]:
    """Export, train and evaluate one representation, up to the first command that fails."""
    actions, _, rotation = words.partition(":")
    options = ["--actions", actions, *(["--rotation", rotation] if rotation else [])]
    export, results = place / "lerobot", place / "evaluation"
    written = domino(
        *("export", str(dataset), "--format", "lerobot", "--out", str(export), "--quiet"), *options
    )
    outcomes = [call(f"{words}: export", written, home)]
    if outcomes[-1].code == 0:
        outcomes.append(train(export, place, home, steps, save=True))
    if outcomes[-1].code == 0:
        checkpoint = place / "act" / "checkpoints" / "last" / "pretrained_model"
        like = json.loads((export / "export.json").read_text())["options"]
        stated = "&".join(
            f"{key}={like[key]}" for key in ("actions", "rotation", "frame") if key in like
        )
        policy = f"lerobot:{checkpoint}?device=cpu{stated and f'&{stated}'}"
        asked = domino(
            *("evaluate", "--policy", policy, "--like", str(dataset), "--episodes", "1"),
            *("--executor", "inline", "--quiet", "--out", str(results)),
        )
        outcomes.append(call(f"{words}: evaluate", asked, home))
        if "without a valid answer" in outcomes[-1].said:
            outcomes[-1] = ReaderOutcome(outcomes[-1].name, 0.0, 1, outcomes[-1].said)
    return outcomes


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--representations", default=USUAL)
    args = parser.parse_args()
    failed = False
    for words in args.representations.split(","):
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            for o in try_representation(
                args.dataset.resolve(), words, args.steps, place, place / "home"
            ):
                failed |= bool(o.code)
                state = "FAIL" if o.code else "ok"
                print(f"{state:5}{o.name:34}{o.seconds:8.1f} s  {o.said}", flush=True)
    if failed:
        sys.exit(1)


if __name__ == "__main__":
    main()
