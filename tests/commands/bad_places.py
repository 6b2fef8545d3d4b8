"""What the cases of bad input are about: recipes, datasets, exports and vendors' robots, most of
them bad."""

import shutil
from pathlib import Path

from pipeline.data.dataset import Dataset
from pipeline.data.keys import Key, SlotKeys
from pipeline.run.names import recipe_from
from tests.recording import record_file
from tests.synthetic import make_episode

BOMB = "a: &a [x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
"""A few lines that stand for 9^8 values."""

RECIPES = {
    "empty": "",
    "list": "[1, 2]",
    "scalar": "click_bell",
    "null": "~",
    "broken": "a: [1\nb: {",
    "tabs": "tasks:\n\t- click_bell",
    "tag": "tasks: !!python/object/apply:os.system [ls]",
    "bomb": f"{BOMB}tasks: *i\n",
    "deep": "tasks: " + "[" * 20_000 + "]" * 20_000,
    "deep-maps": "\n".join(" " * n + "a:" for n in range(1000)),
    "twice": "seed: 1\nseed: 2\n",
    "number-keys": "1: 2\n",
    "unknown": "tasks: click_bell\nepisdoes: 3\n",
    "bool-episodes": "episodes: true",
    "bool-seed": "seed: yes",
    "bool-levels": "levels: [true]",
    "bool-alpha": "alpha: [on]",
    "bool-fps": "fps: true",
    "bool-domain": "episodes: {clean: true}",
    "text-episodes": "episodes: ten",
    "text-depth": "depth: maybe",
    "many-episodes": f"episodes: {10**23}",
    "float-episodes": "episodes: 1.0e+23",
    "half-episodes": "episodes: 1.5",
    "no-episodes": "episodes: {clean: 0}",
    "many-slots": "episodes: 1000000\nalpha: [0.1, 0.2]\n",
    "huge-number": f"seed: {'9' * 6000}",
    "nan-alpha": "alpha: .nan",
    "inf-alpha": "alpha: .inf",
    "close-alphas": "alpha: [0.2, 0.20000001]",
    "dirty-domain": "episodes: {dirty: 1}",
    "text-size": "size: 320x240",
    "nan-lead": "lead: .nan",
    "tiny-alpha": "alpha: 1.0e-300",
    "long-task": f"tasks: {'a' * 100_000}",
    "tail-camera": (
        "cameras: [{name: s, link: nolink, pose: [0, 0, 0, 1, 0, 0, 0], width: 64, height: 48,"
        " fovy: 40}]"
    ),
    "no-levels": "levels: []",
    "no-embodiments": "embodiments: []",
    "no-alpha": "alpha: []",
    "no-cameras": "cameras: []",
    "maps-for-tasks": "tasks: {click_bell: 1}",
    "path-task": "tasks: ../../etc/passwd",
    "date-name": "name: 2024-01-01",
    "null-seed": "seed: ~",
    "fps-7": "fps: 7",
    "small": "size: [1, 1]",
    "one-side": "size: [64]",
    "nose": "cameras: nose",
    "camera-twice": "cameras: [head, head]",
    "camera-bare": "cameras: [{name: top}]",
    "camera-nan": (
        "cameras: [{name: top, pose: [.nan, 0, 0, 1, 0, 0, 0], width: 64, height: 48, fovy: 40}]"
    ),
    "camera-turn": (
        "cameras: [{name: top, pose: [0, 0, 0, 0, 0, 0, 0], width: 64, height: 48, fovy: 40}]"
    ),
    "camera-path": (
        "cameras: [{name: ../top, pose: [0, 0, 0, 1, 0, 0, 0], width: 64, height: 48, fovy: 40}]"
    ),
    "variants": "variants: 3",
    "cloud": "pointcloud: true\ncameras: left",
    "attempts": "attempts: 100000",
    "line-break": 'name: "a\\nb"',
    "escape": 'name: "a\\e[31mb"',
    "no-name": "name: ''",
    "quoted-number": "episodes: '1_0'",
    "far-camera": (
        "cameras: [{name: s, pose: [1.0e+300, 0, 0, 1, 0, 0, 0], width: 64, height: 48, fovy: 40}]"
    ),
    "far-turn": (
        "cameras: [{name: s, pose: [0, 0, 0, 1.0e+300, 0, 0, 0], width: 64, height: 48, fovy: 40}]"
    ),
    "big-camera": (
        "cameras: [{name: s, pose: [0, 0, 0, 1, 0, 0, 0], width: 100000, height: 48, fovy: 40}]"
    ),
    "big": "size: [100000, 100000]",
    "large-seed": f"seed: {10**30}",
    "lead": "lead: -1",
    "instructions": "instructions: 0",
    "meshes": "robot_meshes: {r2d2: abc}",
}
"""Text by name of a recipe that cannot be used."""

ODD = {
    "deep.json": b"[" * 20_000 + b"]" * 20_000,
    "nested.json": b"[" * 200 + b"]" * 200,
    "latin.json": '["\xe9"]'.encode("latin-1"),
    "binary.json": bytes(range(128, 256)),
    "cut.json": b'{"a": ',
    "twice.json": b'{"a": 1, "a": 2}',
    "digits.json": b"[" + b"9" * 6000 + b"]",
    "large.json": b" " * 1_100_000,
    "deep.yaml": RECIPES["deep"].encode(),
    "nested.yaml": b"[" * 200 + b"]" * 200,
    "latin.yaml": "name: \xe9".encode("latin-1"),
    "binary.yaml": bytes(range(128, 256)),
    "bomb.yaml": RECIPES["bomb"].encode(),
    "cut.yaml": b"a: [",
    "tag.yaml": RECIPES["tag"].encode(),
    "twice.yaml": b"seed: 1\nseed: 2\n",
    "list.yaml": b"[1, 2]",
    "large.yaml": b"# large\n" * 200_000,
}
"""Files that no JSON or YAML is read from, wherever one is given."""


def furnish(root: Path) -> None:
    """Write everything below `root`."""
    recipes = root / "recipes"
    recipes.mkdir(parents=True)
    for name, text in RECIPES.items():
        (recipes / f"{name}.yaml").write_text(text)
    (recipes / "binary.yaml").write_bytes(bytes(range(128, 256)))
    (recipes / "utf16.yaml").write_bytes("seed: 1".encode("utf-16"))
    (recipes / "large.yaml").write_text("# large\n" * 200_000)
    (recipes / "directory.yaml").mkdir()
    (root / "odd").mkdir()
    for name, data in ODD.items():
        (root / "odd" / name).write_bytes(data)
    (root / "file").write_text("x")
    (root / "foreign").mkdir()
    (root / "foreign" / "thesis.txt").write_text("precious")
    (root / "policy.py").write_text("def make_policy(:\n")
    (root / "no_policy.py").write_text("x = 1\n")
    _datasets(root)


def _datasets(root: Path) -> None:
    whole = root / "data"
    recipe = recipe_from({"tasks": "click_bell", "levels": [1], "episodes": 1})
    dataset = Dataset(whole)
    dataset.create(recipe)
    for slot in recipe.slots():
        make_episode(dataset.episode(slot), frames=3)
        keys = SlotKeys(Key({"core": "x"}), Key({"looks": "x"}), Key({"phrases": "x"}))
        record_file(
            dataset,
            slot,
            keys,
            [
                {
                    "attempt": 0,
                    "seed": recipe.spec(slot, 0).seed,
                    "outcome": "accepted",
                    "seconds": 1.0,
                }
            ],
        )
    for name, text in {
        "no-manifest": None,
        "bad-manifest": "levels: [9]\n",
        "bomb-manifest": RECIPES["bomb"],
        "huge-manifest": RECIPES["many-episodes"],
        "binary-manifest": "\x00",
    }.items():
        copy = Path(shutil.copytree(whole, root / name))
        (copy / "manifest.yaml").unlink()
        if text is not None:
            (copy / "manifest.yaml").write_text(text)
    for name in ("cut", "changed", "directory"):
        path = next(Path(shutil.copytree(whole, root / name)).glob("episodes/**/*.hdf5"))
        data = path.read_bytes()
        path.write_bytes(data[:1000] if name == "cut" else data + b"\0")
        if name == "directory":
            path.unlink()
            path.mkdir()
    unbuilt = Dataset(root / "unbuilt")
    unbuilt.create(recipe)
