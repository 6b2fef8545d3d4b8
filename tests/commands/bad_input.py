"""Bad input, one command line a case, with the words that the one line of its message must hold;
and how a case is tried."""

import contextlib
import hashlib
import io
import os
import resource
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from pipeline.cli import main
from tests.commands.bad_places import ODD, RECIPES
from training.puma.cli import main as puma

EPISODE = "episodes/click_bell/aloha-agilex/L1/clean/episode_0000000.hdf5"
LONGEST = 2020
"""Characters of a message."""


@dataclass(frozen=True)
class Case:
    """A command line, and a word of what is wrong."""

    words: tuple[str, ...]
    said: str

    @property
    def name(self) -> str:
        """The command line, shortened."""
        return " ".join(word if len(word) < 40 else f"{word[:37]}..." for word in self.words)


@dataclass(frozen=True)
class Outcome:
    """What a command did: exit code, what it printed, seconds, megabytes that the process grew,
    whether a file changed."""

    code: int
    out: str
    err: str
    seconds: float
    megabytes: float
    changed: bool

    def fault(self, case: Case) -> str:
        """What is wrong with the answer, "" where it is as it must be."""
        checks = {
            f"exit code {self.code}": self.code == 2,
            f"{self.err.count(chr(10))} lines: {self.err[-300:]!r}": self.err.count("\n") == 1,
            f"{self.err[:200]!r} is not about {case.said!r}": (
                case.said in self.err and self.err.startswith(("domino-data: ", "puma: "))
            ),
            f"a message of {len(self.err)} characters": len(self.err) <= LONGEST,
            "prints to standard output": not self.out,
            "changes files": not self.changed,
            f"takes {self.seconds:.1f} s": self.seconds < 20,
            f"takes {self.megabytes:.0f} MB": self.megabytes < 500,
        }
        return next((what for what, ok in checks.items() if not ok), "")


def state_of(root: Path) -> str:
    """One hash of the names of everything below a directory, and of size and time of its files."""
    found = hashlib.sha256()
    for folder, names, files in os.walk(root):
        names.sort()
        found.update(f"{folder} {names}\n".encode())
        # the index is a cache, which a reader may make
        for name in sorted(set(files) - {"index.sqlite"}):
            status = os.lstat(f"{folder}/{name}")
            found.update(f"{name} {status.st_size} {status.st_mtime_ns}\n".encode())
    return found.hexdigest()


def attempt(case: Case, root: Path) -> Outcome:
    """Run the command of a case in this process, in the directory `root`."""
    before, here, arguments = state_of(root), Path.cwd(), sys.argv
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    began, held = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    out, err, code = io.StringIO(), io.StringIO(), 0
    try:
        os.chdir(root)
        sys.argv = ["domino-data", *case.words] if case.words[0] != "puma" else [*case.words]
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            puma() if case.words[0] == "puma" else main()
    except SystemExit as leave:
        code = int(leave.code or 0)
    except Exception as error:  # noqa: BLE001 - a traceback is what is looked for
        code, _ = 70, err.write(f"Traceback: {type(error).__name__}: {error}")
    finally:
        os.chdir(here)
        sys.argv = arguments
        for number, handler in handlers.items():
            signal.signal(number, handler)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - held) / 1024
    return Outcome(
        code,
        out.getvalue(),
        err.getvalue(),
        time.perf_counter() - began,
        grown,
        state_of(root) != before,
    )


def cases(verb: str, *pairs: tuple[str, str]) -> list[Case]:
    """Command lines that begin with `verb`."""
    return [Case((*verb.split(), *options.split()), said) for options, said in pairs]


RECIPE_FLAGS = (
    ("--tasks clik_bell", "clik_bell"),
    ("--tasks ../../etc", "--tasks"),
    ("--tasks ,", "--tasks"),
    ("--levels 4", "--levels"),
    ("--levels -1", "--levels"),
    ("--levels 1.5", "--levels"),
    ("--levels fast", "--levels"),
    ("--levels ,", "--levels"),
    ("--alpha -1", "--alpha"),
    ("--alpha nan", "--alpha"),
    ("--alpha inf", "--alpha"),
    ("--alpha 1e400", "--alpha"),
    ("--alpha 0.2,0.2000000001", "--alpha"),
    ("--embodiment r2d2", "r2d2"),
    ("--embodiment aloha+piper+ur5", "--embodiment"),
    ("--embodiment aloha+", "--embodiment"),
    ("--domains dirty", "--domains"),
    ("--episodes 0", "--episodes"),
    ("--episodes ten", "--episodes"),
    ("--episodes 1e23", "--episodes"),
    (f"--episodes {10**23}", "--episodes"),
    ("--episodes 1000000 --tasks all", "episodes"),
    ("--attempts 0", "--attempts"),
    ("--attempts 1001", "--attempts"),
    ("--seed -3", "--seed"),
    ("--seed x", "--seed"),
    ("--render lovely", "--render"),
    ("--rules fair", "--rules"),
    ("--contact bounce", "--contact"),
    ("--workers 0", "--workers"),
    ("--workers many", "--workers"),
    ("--workers 1000000000", "--workers"),
    ("--manifest missing.yaml", "missing.yaml"),
    ("--assets nowhere", "nowhere"),
    ("--speed 3", "--speed"),
    ("--episodes", "--episodes"),
    ("surplus", "surplus"),
)

CASES = [
    *cases("plan", *RECIPE_FLAGS),
    *cases("build --out OUT", *RECIPE_FLAGS[::4]),
    *cases(
        "build --tasks click_bell",
        ("--executor mars --out OUT", "--executor"),
        ("--executor inline --address 1.2.3.4:5 --out OUT", "--address"),
        ("--address nowhere --out OUT", "--address"),
        ("--slot-timeout 0 --out OUT", "--slot-timeout"),
        ("--slot-timeout nan --out OUT", "--slot-timeout"),
        ("--slot-timeout soon --out OUT", "--slot-timeout"),
        ("--executor inline --out file", "file"),
        ("--executor inline --out file/inside", "file"),
        ("--executor inline --out foreign", "foreign"),
        ("--executor inline --seed 5 --out data", "data"),
    ),
    *(
        Case(("plan", "--manifest", f"recipes/{name}.yaml"), name)
        for name in (*RECIPES, "binary", "utf16", "large", "directory")
    ),
    *(
        Case((*verb.split(), place), place)
        for verb in (
            "status",
            "verify",
            "export --format parquet",
            "annotate --stages flow",
            "render --out OUT",
        )
        for place in ("missing", "file", "foreign")
    ),
    *(
        Case((*verb.split(), place), "manifest.yaml")
        for verb in ("status", "verify", "export --format aloha", "render --out OUT")
        for place in (
            "no-manifest",
            "bad-manifest",
            "bomb-manifest",
            "huge-manifest",
            "binary-manifest",
        )
    ),
    *(
        Case(("export", "--format", format, place), place)
        for format in ("parquet", "aloha")
        for place in ("cut", "changed", "directory")
    ),
    *cases(
        "render data",
        ("", "--out"),
        ("--out data", "data"),
        ("--out data/episodes/x", "data"),
        ("--out .", "."),
        ("--out OUT --size 0x0", "--size"),
        ("--out OUT --size 15x15", "--size"),
        ("--out OUT --size 100000x100000", "--size"),
        ("--out OUT --size 640", "--size"),
        ("--out OUT --variants 2", "--variants"),
        ("--out OUT --visuals randomized --variants 0", "--variants"),
        ("--out OUT --visuals randomized --variants 100000", "--variants"),
        ("--out OUT --visuals randomized --visual-seed -1", "--visual-seed"),
        ("--out OUT --visuals pretty", "--visuals"),
        ("--out OUT --preset lovely", "--render"),
        ("--out OUT --sensors depth", "--sensors"),
        ("--out OUT --cameras none", "--cameras"),
        ("--out OUT --pointcloud --cameras left", "--pointcloud"),
        ("--out OUT --cameras nose", "--cameras"),
        ("--out OUT --cameras ,", "--cameras"),
        ("--out OUT --cameras head,head", "--cameras"),
        ('--out OUT --cameras {"name":"top"}', "pose"),
        ('--out OUT --cameras {"name":"top"}', "fovy"),
        ('--out OUT --cameras {"name":', "--cameras"),
        (
            (
                "--out OUT --cameras"
                ' {"name":"top","link":"tail","pose":[0,0,0,1,0,0,0],"width":64,"height":48,"fovy":40}'  # noqa: E501
            ),
            "--cameras",
        ),
        ("--out OUT --executor mars", "--executor"),
        ("--out OUT --workers -1", "--workers"),
    ),
    Case(("render", "unbuilt", "--out", "OUT"), "unbuilt"),
    *cases(
        "annotate data --stages flow",
        ("--flow-source magic", "--flow-source"),
        ("--flow-stride 0", "--flow-stride"),
        ("--flow-stride x", "--flow-stride"),
        ("--flow-size 64", "--flow-size"),
        ("--flow-size 0x0", "--flow-size"),
        ("--flow-size 100000x100000", "--flow-size"),
        ("--mask-source magic", "--mask-source"),
        ("--prompt poem", "prompt"),
        ("--device toaster", "--device"),
        ("--cameras ,", "--cameras"),
        ("--cameras ../head", "--cameras"),
        ("--executor mars", "--executor"),
        ("--workers 0", "--workers"),
        ("--where level=", "--where"),
        ("--where=", "--where"),
        ("--where task>3", "--where"),
        ("--where embodiment=nope", "embodiment is"),
        ("--where level=one", "--where"),
        ("--where color=red", "--where"),
        ("--where level(1)", "--where"),
        (f"--where {'(' * 3000}level=1{')' * 3000}", "--where"),
        (f"--where level=1{'0' * 5000}", "--where"),
        ("--stages dance", "dance"),
        ("--stages ,", "stage"),
    ),
    *cases(
        "export data",
        ("", "--format"),
        ("--format gif", "gif"),
        ("--format parquet --crf 5", "--crf"),
        ("--format parquet --file-bytes 0", "--file-bytes"),
        ("--format parquet --file-bytes", "--file-bytes"),
        ("--format parquet --camera-names head", "--camera-names"),
        ("--format parquet --camera-names nose=a", "--camera-names"),
        ("--format parquet --camera-names head=../x", "--camera-names"),
        ("--format aloha --size 0x0", "--size"),
        ("--format aloha --jpeg-order bgr", "--jpeg-order"),
        ("--format aloha --compress zip", "--compress"),
        ("--format robotwin", "--jpeg-order"),
        ("--format robotwin --jpeg-order gbr", "--jpeg-order"),
        ("--format lerobot --codec mpeg1", "--codec"),
        ("--format lerobot --gop 0", "--gop"),
        ("--format lerobot-v2.1 --crf low", "--crf"),
        ("--format parquet --out data/episodes/x", "episodes"),
        ("--format parquet --out data/assets", "assets"),
        ("--format parquet --out data", "data"),
        ("--format parquet --out .", "holds the dataset"),
        ("--format parquet --out file", "file"),
        ("--format parquet --out foreign", "foreign"),
        ("--format parquet --workers 0", "--workers"),
        ("--format parquet --nonsense", "--nonsense"),
    ),
    Case(("export", "unbuilt", "--format", "parquet"), "unbuilt"),
    *cases(
        "diff",
        ("data missing", "missing"),
        ("data foreign", "foreign"),
        ("data", "'B'"),
        ("data bad-manifest", "bad-manifest"),
    ),
    *cases("verify", ("data --episode 7", "has no such slot"), ("missing --episode x", "missing")),
    *cases(
        "merge",
        ("data", "--out"),
        ("data --out OUT", "two datasets"),
        ("data missing --out OUT", "missing"),
        ("data data --out data", "data"),
        ("data data --out OUT", "named twice"),
        ("data data --out data/x", "data"),
    ),
    *cases("gc", ("missing", "missing"), ("foreign", "foreign"), ("file", "file")),
    *cases(
        "evaluate --out OUT",
        ("", "--policy"),
        ("--policy magic", "magic"),
        ("--policy missing.py", "missing.py"),
        ("--policy random --episodes 0", "--episodes"),
        ("--policy random --seed -1", "--seed"),
        ("--policy random --clock sundial", "--clock"),
        ("--policy random --cameras nose", "--cameras"),
        ("--policy random --instructions loud", "--instructions"),
        ("--policy random --tasks nothing", "nothing"),
        ("--policy random --levels 9", "--levels"),
        ("--policy random --workers 0", "--workers"),
        ("--policy ws://nowhere:x", "ws://"),
        ("--policy random --depth", "--depth"),
        ("--policy random --films -1", "--films"),
        ("--policy ladder:missing.npz", "missing.npz"),
    ),
    *cases(
        "ladder --out OUT",
        ("--tasks nothing", "nothing"),
        ("--rungs smell", "smell"),
        ("--rungs act", "--data"),
        ("--rungs act --rounds 2 --data data", "--rounds"),
        ("--rounds 1 --rungs velocity --data missing", "missing"),
        ("--train-options '", "--train-options"),
        ("--train-options=--seed=2", "--train-options"),
        ("--corrections-weight 2", "--corrections"),
        ("--corrections data --rungs act --data data", "--rungs"),
        ("--chunks 8", "--chunks"),
        ("--chunks 4:8", "--chunks"),
        ("--seeds 0", "--seeds"),
        ("--levels 9", "--levels"),
        ("--tasks click_bell --data nowhere", "nowhere"),
    ),
    *cases(
        "serve-policy",
        ("", "policy"),
        ("magic", "magic"),
        ("missing.py", "missing.py"),
        ("random --port 70000", "--port"),
        ("random --clients 0", "--clients"),
        ("random --protocol smoke", "--protocol"),
        ("random --embodiment r2d2", "--embodiment"),
    ),
    *cases(
        "check-task",
        ("nothing", "nothing"),
        ("click_bell --embodiment r2d2", "r2d2"),
        ("click_bell --levels 9", "--levels"),
    ),
    *cases(
        "objects",
        ("--families ghost", "ghost"),
        ("--gallery file/page.html --families ball", "file"),
    ),
    *cases("check-object", ("nothing", "nothing"), ("", "NAME")),
    *cases(
        "view data",
        ("--out foreign", "thesis.txt"),
        ("--out data", "inside the dataset"),
        ("--out data/episodes/pages", "inside the dataset"),
        ("--out .", "holds it"),
        ("--episode 7", "has no such slot"),
        ("--out memory://pages", "memory://"),
    ),
    *cases("objects", ("--gallery foreign/thesis.txt", "page"), ("--families ,", "--families")),
    *cases("objects fetch", ("nope", "'source': 'nope' is not one of")),
    *cases(
        "build --tasks click_bell", ("--out memory://", "memory:"), ("--out sftp://a/b", "sftp")
    ),
    *cases(
        "export data --format aloha",
        ("--size 100000x100000", "--size"),
        ("--pad 14", "--pad-rows"),
        ("--rotation 6d", "--actions"),
        ("--weights 0,1", "must be above 0"),
        ("--size 15x15", "--size"),
    ),
    *cases("export data --format lerobot", (f"--crf {10**30}", "--crf"), ("--preset=", "--preset")),
    Case(
        ("export", "data", "--format", "parquet", "--camera-names", "head=a\nb"), "--camera-names"
    ),
    *cases(
        "annotate data --stages flow",
        ("--where alpha=1e999", "--where"),
        ("--flow-stride 99999", "--flow-stride"),
        ("--device cuda:99999", "--device"),
    ),
    *cases(
        "evaluate --out OUT --policy",
        ("interceptor:noise=-1", "noise"),
        ("interceptor:noise=nan", "noise"),
        ("chaser:chunk=1e300", "chunk"),
        ("random --clock latency:-1", "--clock"),
        ("random --cameras ,", "--cameras"),
        ("lerobot:missing?n=[", "--policy"),
    ),
    Case(("evaluate", "--out", "OUT", "--policy", f"lerobot:missing?n={'[' * 5000}"), "--policy"),
    Case(("evaluate", "--out", "OUT", "--policy", "openpi://127.0.0.1:9"), "no images"),
    *cases("ladder --out OUT", ("--rungs ,", "--rungs")),
    *(
        Case((*words.split(), f"odd/{name}"), name)
        for name in ODD
        for words in (
            ()
            if name.endswith(".json")
            else (
                "plan --manifest",
                "puma bench --config",
                "build --out OUT --address 127.0.0.1:1 --runtime-env",
            )
        )
    ),
    Case(("build", "--out", "OUT", "--seed", "3"), "--yes"),
    *(
        Case(("puma", "train", "--out", "OUT", "--set", setting), said)
        for setting, said in (
            ("train.steps=true", "train.steps"),
            ("train.steps='10'", "train.steps"),
            (f"train.steps={10**30}", "train.steps"),
            ("train.clip=true", "train.clip"),
            ("train.clip=.nan", "train.clip"),
            ("data.image_size=[100000,100000]", "data.image_size"),
            ("data.cameras=[]", "data.cameras"),
            ("name={a: 1}", "name"),
            ("model.chunk.x=3", "chunk"),
            ("a=[", "--set"),
            (f"a={'[' * 5000}", "--set"),
            (f"{'a.' * 2000}b=1", ""),
            ("=1", ""),
            ("train", "--set"),
        )
    ),
    *(Case((verb,), verb) for verb in ("dance", "--nonsense")),
    *(
        Case((verb, "--nonsense"), "--nonsense")
        for verb in ("tasks", "embodiments", "status", "verify", "doctor")
    ),
]
