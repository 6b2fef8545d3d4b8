"""The corruption matrix: every kind of damage is found, blamed on the right file, and put right where it can be.

python -m tests.run.test_corruption > docs/measurements/corruption.md
"""

import json
import shutil
from dataclasses import replace
from itertools import batched, zip_longest
from pathlib import Path

import pytest
from filelock import FileLock

from benchmarks.chaos.compare import compare
from pipeline.crew.contract import Crew
from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.reading import printable
from pipeline.data.sealed import seal
from pipeline.run.annotate import annotate
from pipeline.run.build import build
from pipeline.run.identity import slot_keys as keys
from pipeline.run.names import recipe_from
from pipeline.run.state import DONE, read_states
from pipeline.run.verify.dataset import verify
from tests.export.running import run as export
from tests.run.damage import (
    ANNOTATE,
    BUILD,
    EPISODE,
    FIRST,
    LEDGER_FILE,
    OTHER,
    SECOND,
    SEGMENT,
    USER,
    Kind,
    cut,
    directory,
    entry_with,
    flip,
    gone,
    kept,
    put,
    rows,
    sealed,
    swap,
    text,
)
from tests.run.damages import ASSET, FLOW, KINDS

DOCUMENT = Path(__file__).parents[2] / "docs" / "measurements" / "corruption.md"
pytestmark = pytest.mark.usefixtures("without_report")
FLOW_FILE = f"{FLOW}/{FIRST}.h5"
FORMATS = {"parquet": {}, "aloha": {}, "robotwin": {"jpeg_order": "rgb"}, "lerobot": {}, "lerobot-v2.1": {}}
RECIPE = recipe_from(
    {"tasks": "click_bell", "embodiments": "aloha", "levels": 1, "episodes": 2, "size": [64, 48], "cameras": ["head", "left"]}
    | {"render": "raster-fast", "instructions": 3}
)


@pytest.fixture(scope="session")
def whole(tmp_path_factory, worker_id):
    """A finished dataset of two small episodes with flow maps and every export, made once for all test processes."""
    base = tmp_path_factory.getbasetemp()
    shared = (base if worker_id == "master" else base.parent) / "whole-once"
    with FileLock(f"{shared}.lock"):
        if not shared.exists():
            making = shared.with_suffix(".making")
            build(making, RECIPE, Crew(), shown="none")
            annotate(making, ("flow",))
            dataset = Dataset(making)
            for format, options in FORMATS.items():
                export(format, making, dataset.exports(format), dataset.accepted(RECIPE), **options)
            making.rename(shared)
    return shared


def batches() -> list[tuple[Kind, ...]]:
    """All kinds; those of different episodes, exports or other files are made at once, since each is judged by itself."""
    groups = [[k for k in KINDS if k.file == file and "another episode" not in k.what] for file in (EPISODE, FLOW_FILE)]
    pairs = [
        tuple(replace(k, file=k.file.replace(FIRST, which)) for k, which in zip(pair, (FIRST, SECOND), strict=False))
        for own in groups
        for pair in batched([k for k in own if "exchanged with" not in k.what and k.by != USER], 2)
    ]
    by_format = [[k for k in KINDS if k.file.startswith(f"exports/{format}/")] for format in FORMATS]
    others = [[k for k in KINDS if k.file == file] for file in (ASSET, "attempts.parquet", "provenance.json")]
    mixed = [tuple(k for k in group if k is not None) for of in (by_format, others) for group in zip_longest(*of)]
    taken = {(k.file.replace(SECOND, FIRST), k.what) for group in (*pairs, *mixed) for k in group}
    return [*pairs, *mixed, *((k,) for k in KINDS if (k.file, k.what) not in taken)]


def copy_for(kinds: tuple[Kind, ...], whole: Path, to: Path) -> Path:
    """A copy of the dataset with those of its exports and annotations that the damage is about."""
    named = {name for kind in kinds for name in kind.file.split("/")[:2]}

    def ignored(folder, names):
        inside = Path(folder).relative_to(whole)
        left_out = {"annotations", "exports"} - named if not inside.parts else {*names} - named
        return left_out if inside.parts in ((), ("exports",)) else ()

    return Path(shutil.copytree(whole, to, ignore=ignored))


def place_of(kind: Kind, dataset: Path) -> tuple[Path, str]:
    """The file of a kind in a dataset, and the name of the check that must fail."""
    stage = next(iter(sorted(p.name for p in dataset.glob("annotations/flow@*"))), "")
    file = kind.file.replace("flow@STAGE", stage)
    if "ASSET" in file:
        return sorted(dataset.glob("assets/bodies/*/*.npz"))[3], kind.check
    return dataset / file, f"annotations {stage}" if kind.check == FLOW else kind.check


def blame(kind: Kind, path: Path, dataset: Path) -> str:
    """What every problem must name: the file, or the export; nothing of a file that says something of others."""
    if kind.file.startswith("exports"):
        return f"exports/{kind.file.split('/')[1]}"
    told = kind.file.startswith(("episodes", "annotations", "assets")) and "exchanged" not in kind.what
    return printable(path.relative_to(dataset).as_posix()) if told else ""


def failures(dataset: Path, draw: int = 0) -> dict[str, list[str]]:
    """Problems by check."""
    return {c["name"]: c["problems"] for c in verify(Dataset(dataset), draw=draw)["checks"] if not c["ok"]}


def test_the_whole_dataset_is_sound(whole):
    assert failures(whole, draw=3) == {}


def test_images_that_this_version_would_draw_differently_are_not_called_sound(whole, tmp_path, monkeypatch):
    dataset = Path(shutil.copytree(whole, tmp_path / "out", ignore=shutil.ignore_patterns("exports", "annotations")))
    with monkeypatch.context() as patched:
        patched.setattr(keys, "_drawing_parts", lambda root: {"renderer": "", "shaders": "", "packages": ""})
        found = verify(Dataset(dataset), draw=1)
    images = next(c for c in found["checks"] if c["name"] == "images")
    said = "2 episodes cannot be compared (changed since: packages, renderer, shaders)"
    assert (found["ok"], found["problems"], found["uncompared"], images["detail"]) == (False, 0, 2, f"0 checked, {said}")
    made = json.loads((dataset / "provenance.json").read_text()) | {"renderer": "another"}
    (dataset / "provenance.json").write_bytes(seal(made))
    assert verify(Dataset(dataset), draw=1)["uncompared"] == 2


@pytest.mark.parametrize("kinds", batches(), ids=lambda kinds: " and ".join(f"{k.file}: {k.what}" for k in kinds))
def test_damage_is_found_and_blamed_on_its_file(kinds, whole, tmp_path):
    dataset = copy_for(kinds, whole, tmp_path / "out")
    places = {kind: place_of(kind, dataset) for kind in kinds}
    for kind, (path, _) in places.items():
        kind.damage(path)
    if kinds[0].check == "refused":
        with pytest.raises(DatasetError, match=r"manifest\.yaml") as caught:
            verify(Dataset(dataset))
        assert "\n" not in str(caught.value)
        return
    failed = failures(dataset, max(kind.draw for kind in kinds))
    problems = [problem for of in failed.values() for problem in of]
    assert all(len(problem.splitlines()) == 1 for problem in problems)
    blamed = {kind: blame(kind, path, dataset) for kind, (path, _) in places.items()}
    for kind, (_, check) in places.items():
        assert any(blamed[kind] in problem for problem in failed[check]), kind
    assert all(any(name in problem for name in blamed.values()) for problem in problems)
    if kinds[0].file.startswith("exports"):
        assert set(failed) == {check for _, check in places.values()}
    if kinds[0].file == SEGMENT:
        Dataset(dataset).ledger.compact()
        assert failures(dataset) == {}
    elif kinds[0].by == BUILD and kinds[0].file.startswith(("episodes", "ledger")) and "twice" not in kinds[0].what:
        assert [s.todo for _, s in read_states(Dataset(dataset), RECIPE, RECIPE.slots())] != [DONE, DONE]
    if kinds[0].by == ANNOTATE:
        annotate(dataset, ("flow",))
        assert failures(dataset) == {}


def test_every_kind_is_made():
    made = sorted((k.file.replace(SECOND, FIRST), k.what) for batch in batches() for k in batch)
    assert made == sorted((k.file, k.what) for k in KINDS)


@pytest.mark.parametrize(
    "damages",
    [
        {EPISODE: cut(0.5), OTHER: directory, "attempts.parquet": text("none"), "provenance.json": gone},
        pytest.param({EPISODE: swap(EPISODE, OTHER), "assets": gone}, marks=pytest.mark.slow),
        pytest.param({LEDGER_FILE: entry_with(sha256="zero"), OTHER: flip(0.3), "assets": cut(0.5)}, marks=pytest.mark.slow),
        {EPISODE: kept(flip(0.3)), OTHER: sealed(put("state/qvel", lambda v: -v)), "assets": kept(flip(0.5))},
    ],
)
def test_a_build_puts_right_what_was_damaged(damages, whole, tmp_path):
    dataset = Path(shutil.copytree(whole, tmp_path / "out", ignore=shutil.ignore_patterns("exports", "annotations")))
    for file, damage in damages.items():
        for path in sorted(dataset.glob("assets/bodies/*/*.npz"))[2:5] if file == "assets" else [dataset / file]:
            damage(path)
    assert failures(dataset) != {}  # and verify makes the build look at what has its length and time
    build(dataset, RECIPE, Crew(), shown="none")
    assert failures(dataset) == {}
    for folder in ("episodes", "assets"):
        files = sorted(p.relative_to(whole) for p in (whole / folder).rglob("*") if p.is_file())
        assert files == sorted(p.relative_to(dataset) for p in (dataset / folder).rglob("*") if p.is_file())
        assert all((dataset / p).read_bytes() == (whole / p).read_bytes() for p in files)


@pytest.mark.parametrize(
    "damage",
    [
        flip(0.5),
        gone,
        directory,
        rows(lambda found: found.append(dict(found[0]))),
        rows(lambda found: [row.update(accepted=None) for row in found]),
    ],
)
def test_a_ledger_is_written_anew_from_the_episodes_which_nobody_blames_or_makes_again(damage, whole, tmp_path):
    dataset = Path(shutil.copytree(whole, tmp_path / "out", ignore=shutil.ignore_patterns("exports", "annotations")))
    damage(dataset / LEDGER_FILE)
    problems = [problem for of in failures(dataset).values() for problem in of]
    if damage is not gone:  # else there is nothing else to name
        assert problems and all(LEDGER_FILE in problem for problem in problems)
    assert build(dataset, RECIPE, Crew(), shown="none").made == 0
    assert failures(dataset) == {}
    assert compare(whole, dataset).different == []


@pytest.mark.parametrize(
    ("damage", "failing"),
    [
        (lambda dataset: shutil.rmtree(dataset / "ledger"), {"files", "attempts"}),
        (lambda dataset: rows(lambda found: found.pop())(dataset / LEDGER_FILE), {"files", "attempts"}),
        (lambda dataset: (dataset / EPISODE).unlink(), {"files"}),
        (lambda dataset: next(dataset.glob("annotations/*/stage.json")).write_text("{"), {"annotations"}),
    ],
)
def test_what_depends_on_a_damaged_file_is_not_blamed(damage, failing, whole, tmp_path):
    dataset = Path(shutil.copytree(whole, tmp_path / "out"))
    damage(dataset)
    assert {name.split()[0] for name in failures(dataset)} <= failing


def test_an_unfinished_dataset_is_no_damaged_one(whole, tmp_path):
    dataset = Path(shutil.copytree(whole, tmp_path / "out", ignore=shutil.ignore_patterns("exports", "annotations")))
    rows(lambda found: found.pop())(dataset / LEDGER_FILE)
    for file in (OTHER, "attempts.parquet"):
        (dataset / file).unlink()
    found = verify(Dataset(dataset))
    assert (found["ok"], found["episodes"], found["open"]) == (True, 1, 1)
    files = next(c for c in found["checks"] if c["name"] == "files")
    assert (files["checked"], files["detail"]) == (1, "1 checked, 1 slots not built yet")


PAGE = """# Detected corruption and how it is repaired

`domino-data verify OUT` reads every byte of every file and judges each file by itself. The table lists what the tests do to a
dataset of two episodes with flow maps and five exports: the file, the damage, the check that reports it, and the command that
repairs it. If that is `you`, the message names the repair. `refused` means that no check is possible: the command ends with
one line that names the file, and exit code 2.

`build` repairs a dataset before it makes anything. It makes damaged episodes again, restores assets, and writes
`attempts.parquet` and `provenance.json`. It reads the files whose length or time changed since it last found them whole. `verify`
notes damaged episodes in the ledger. The next build makes these again even if length and time are as before (a decayed disk,
`rsync -t`, `tar`). `verify` cannot note them on a read-only disk, on an object store, or while another command writes the dataset.
It then prints the reason.

A damaged or missing ledger costs no episode. `verify` reports the ledger and no episode, and `build` writes the entries again
from the episodes and `attempts.parquet`. Seconds by phase are lost. Slots that were given up are tried
again.

An episode holds a hash of every dataset in it, and an export one of every file but its card. These find content that was
exchanged, even if the hash in the ledger is forged (`the ledger's hash forged`). The hashes inside the episode may be forged too
(`all hashes forged`). Then `verify` compares what follows from other content:

- links and end effectors with the joints, cameras with their links,
- tracks with bodies and assets, instructions with the scene,
- the group `interception` with the state log,
- the place of the meeting with the target of the scene, which finds a whole episode exchanged for another.

`domino-data verify --draw N` finds exchanged images. It renders N frames of every camera of each episode again, with the stored
sensors, and compares the bytes. The key of an episode chooses the frames; an N as large as the longest episode compares all. If
this version or device renders differently, `verify` counts the episodes that it cannot compare and ends with exit code 1. Exchanged
impulses stay unnoticed; `domino-data regenerate` makes an episode again and compares all bytes.

`export` and `annotate` refuse an episode whose bytes are not those of the ledger. An export is compared only if all episodes are
sound.

{count} kinds; `pytest tests/run/test_corruption.py` makes them all, and `python -m tests.run.test_corruption` prints this
page. `python -m benchmarks.chaos.mending` also repairs every kind by the command that the table names, or by what the message asks
of `you`. Then `verify` must find nothing, and every file must have its former bytes. On 2026-11-23 that held for all 289 kinds: 184
repaired by `build`, 12 by `annotate`, 69 by `export`, 24 by `you` (AMD EPYC, 2 cores, 39 minutes at a load of 9).

| file | damage | check that fails | repaired by |
|---|---|---|---|
"""


def document() -> str:
    """The page that shows the matrix."""
    lines = [PAGE.format(count=len(KINDS)).removesuffix("\n")]
    for k in KINDS:
        file, check = printable(k.file).replace("ASSET", "HASH").replace("STAGE", "KEY"), k.check.replace("STAGE", "KEY")
        check += f" (with `--draw {k.draw}`)" if k.draw else ""
        lines.append(f"| `{file}` | {k.what} | {check} | {k.by} |")
    return "\n".join(lines) + "\n"


def test_the_page_shows_this_table():
    assert DOCUMENT.read_text() == document()
    assert len(KINDS) >= 270


if __name__ == "__main__":
    print(document(), end="")
