"""What better sight could add to puma-small: networks that are given the target's true track,
without and with its true height.

    python -m benchmarks.sight DATA OUT [--seeds 0,1] [--set KEY=VALUE]

DATA is what `make puma` builds and exports (PUMA/data). The head camera cannot see how high the
target is, wrist cameras might. The height replaces a number that is zero while the target is
upright, so all networks have one shape. The rest is that of `puma train
--config puma-small`; 50 scenes a level. Rerun the same command to resume.
"""

import argparse
import json
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.hardware import hardware
from benchmarks.study.rows import markdown
from pipeline.data.atomic import write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.episode.file import open_episode
from pipeline.data.episode.state_log import StateLog
from pipeline.evaluate.evaluate import evaluate
from pipeline.evaluate.names import policy_name
from pipeline.evaluate.scenes.case import Case, blind
from pipeline.evaluate.scenes.manifests import inline
from pipeline.evaluate.scenes.trial import Trial
from pipeline.evaluate.scoring.statistics import interval
from pipeline.poses import quat_rotate
from pipeline.run.evaluation import evaluation_of
from pipeline.world.objects import FAMILIES, Family
from training.puma import checkpoint
from training.puma.corpus.cache import Cache
from training.puma.corpus.mixture import Corpus
from training.puma.finding.tracking import with_tracks
from training.puma.model.puma import Puma
from training.puma.model_keys import Finder
from training.puma.policy import PumaPolicy
from training.puma.reading import read_config
from training.puma.track import AXES, Tracks
from training.puma.train import train

EPISODES, HEIGHT = 50, 6
"""Scenes a level, and the number of a track that the height replaces: x of the way to the point on
the target's z axis."""

POLICY = (
    "import pathlib, benchmarks.sight as b\nmake_policy = lambda: b.TruePolicy(pathlib.Path({!r}),"
    " {})\n"
)


def true_track(log: StateLog, target: str, family: Family, tall: bool) -> NDArray[np.float32]:
    """Tracks (T,8) of all frames as training.puma.track.Tracks has them; `tall`: with the height
    (m)."""
    poses = log.pose(target)
    ways = [quat_rotate(poses[:, 3:], Finder().reach * axis)[:, :2] for axis in AXES[1:]]
    found = np.concatenate([poses[:, :2], log.target_velocity[:, :2], *ways], 1)
    if tall:
        found[:, HEIGHT] = max(point[2] for point in family.frames().points.values())
    return found.astype(np.float32)


def follow_truth(
    data: Path, tall: bool, corpus: Corpus, network: Puma, trained: bool, quiet: bool
) -> Corpus:
    """As training.puma.finding.tracking.follow, by the truth of the episode files in place of
    images."""

    def tracks(cache: Cache) -> NDArray[np.float32]:
        out = list[NDArray[np.float32]]()
        for row in cache.rows:
            with open_episode(data / row.source) as file:
                known = file.meta.objects[file.meta.target]
                family = FAMILIES[known.family](**known.parameters)
                out.append(
                    true_track(file.read().log, file.meta.target, family, tall)[: row.length]
                )
        return np.concatenate(out)

    return with_tracks(corpus, network, tracks, trained)


class TrueTrack(Tracks):
    """The track of the target of a running trial."""

    def __init__(self, trial: Trial, tall: bool) -> None:
        target = trial.scene.task.target
        self._newest = lambda: true_track(
            trial.log(), target, trial.scene.bodies[target].instance, tall
        )[-1]

    @property
    def speed(self) -> float:
        """Speed (m/s) on the plane."""
        return float(np.linalg.norm(self.numbers[2:4]))

    @property
    def numbers(self) -> NDArray[np.float32]:
        """(8,) of the newest frame."""
        return self._newest()


class TruePolicy(PumaPolicy):
    """A trained network that is given the true track, and no image."""

    def __init__(self, run: Path, tall: bool) -> None:
        held = checkpoint.load(run)
        network = held.model()
        network.finder, self._tall = None, tall
        super().__init__(network, held.preprocessing)
        self.setup, self.contract = None, None

    def see(self, trial: Trial, case: Case) -> None:
        """The trial that begins."""
        self._episode.track = TrueTrack(trial, self._tall)


def solved(given: argparse.Namespace, seed: str, tall: bool) -> dict[int, NDArray[np.float64]]:
    """Whether the network of a seed solves each scene (S,), by level, in one order; what is missing
    is trained and evaluated."""
    data, out = given.data.absolute(), given.out.absolute()
    settings = [f"data.sources=[{{dataset: {data}}}]", f"train.seed={seed}", *given.set]
    folder = out / f"{'tall' if tall else 'plain'}_{seed}"
    done = train(
        read_config("puma-small", settings),
        folder,
        quiet=True,
        track=partial(follow_truth, data, tall),
    )
    write_atomic(folder / "policy.py", POLICY.format(str(done.checkpoint), tall).encode())
    recipe, policy = Dataset(data).recipe(), policy_name(str(folder / "policy.py"))
    wanted = evaluation_of(recipe, blind(recipe), policy, episodes=EPISODES)
    outcome = evaluate(wanted, folder / "evaluation", inline, out / "manifests")
    rows = sorted(
        map(json.loads, outcome.path.read_text().splitlines()), key=lambda row: row["seed"]
    )
    rows = [
        row
        for row in rows
        if row["policy"] == policy.label and json.loads(row["key"])[0] == wanted.code
    ]
    return {
        level: np.array([float(row["success"]) for row in rows if row["level"] == level])
        for level in recipe.levels
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", default="0,1")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    given = parser.parse_args()
    plain, tall = (
        [solved(given, seed, tall) for seed in given.seeds.split(",")] for tall in (False, True)
    )
    change = [
        np.mean([b[level] - a[level] for a, b in zip(plain, tall, strict=True)], axis=0)
        for level in plain[0]
    ]
    spans = [(100 * of.mean(), *(100 * end for end in interval({"": of}))) for of in change]
    lines = [
        [", ".join(f"{of[level].sum():.0f}" for of in networks) for level in plain[0]]
        for networks in (plain, tall)
    ]
    lines.append(["{:+.0f} ({:+.0f} to {:+.0f})".format(*span) for span in spans])
    heads = ("true track", "true track and height", "difference, points (95 %)")
    body = [[head, *line] for head, line in zip(heads, lines, strict=True)]
    print(
        markdown(["", *(f"level {level}, of {EPISODES}" for level in plain[0])], body),
        hardware(),
        sep="\n\n",
    )


if __name__ == "__main__":
    main()
