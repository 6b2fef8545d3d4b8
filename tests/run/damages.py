"""Kinds of damage with the report of `verify` and the command that repairs each: the table of docs/measurements/corruption.md."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.run.damage import (
    ANNOTATE,
    CAMERA,
    EPISODE,
    EXPORT,
    FIRST,
    LEDGER_FILE,
    OTHER,
    SECOND,
    SEGMENT,
    USER,
    Kind,
    at,
    attempt_with,
    attribute,
    column,
    copied,
    cut,
    dangling,
    device,
    directory,
    drop,
    endless,
    entry,
    entry_with,
    exchanged,
    flip,
    gone,
    hdf5,
    huge,
    image,
    inner,
    inside,
    jpeg,
    kept,
    key,
    line_of,
    moved,
    pipe,
    put,
    rows,
    segment,
    swap,
    table,
    text,
    vast,
)
from tests.run.forgeries import FORGED

NAN = float("nan")

EPISODES = (
    Kind(EPISODE, "missing", gone, "files"),
    Kind(EPISODE, "a link to nothing", dangling, "files"),
    Kind(EPISODE, "a directory", directory, "readable"),
    Kind(EPISODE, "a pipe", pipe, "readable"),
    Kind(EPISODE, "a link to an endless device", device, "readable"),
    Kind(EPISODE, "empty", cut(0), "readable"),
    *(Kind(EPISODE, f"cut to {100 * share:g} % of its length", cut(share), "hashes") for share in (0.01, 0.25, 0.5, 0.75, 0.999)),
    Kind(EPISODE, "text", text("once upon a time"), "readable"),
    Kind(EPISODE, "random bytes", lambda p: p.write_bytes(np.random.default_rng(0).bytes(p.stat().st_size)), "readable"),
    Kind(EPISODE, "bytes appended", lambda p: p.write_bytes(p.read_bytes() + bytes(64)), "hashes"),
    *(Kind(EPISODE, f"a byte inverted at {100 * a:g} %", flip(a), "hashes") for a in (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.99)),
    Kind(EPISODE, "4096 bytes inverted in the middle", flip(0.5, 4096), "hashes"),
    Kind(EPISODE, "exchanged with another episode", swap(EPISODE, OTHER), "spec"),
    Kind(EPISODE, "a copy of another episode", copied(EPISODE, OTHER), "spec"),
    Kind(EPISODE, "schema of another version", attribute("schema", 1), "readable"),
    Kind(EPISODE, "no schema", attribute("schema", None), "readable"),
    Kind(EPISODE, "schema is text", attribute("schema", "two"), "readable"),
    Kind(EPISODE, "no spec", attribute("spec", None), "readable"),
    Kind(EPISODE, "spec is no JSON", attribute("spec", "{"), "readable"),
    Kind(EPISODE, "spec names a path for a task", inside("spec", task="../../etc"), "readable"),
    Kind(EPISODE, "spec of another task", inside("spec", task="grab_roller"), "spec"),
    Kind(EPISODE, "spec of another level", inside("spec", level=2), "spec"),
    Kind(EPISODE, "spec of another slot", inside("spec", slot=7), "spec"),
    Kind(EPISODE, "spec of another seed", inside("spec", seed=12345), "spec"),
    Kind(EPISODE, "no meta", attribute("meta", None), "readable"),
    Kind(EPISODE, "meta is no JSON", attribute("meta", "yes"), "readable"),
    Kind(EPISODE, "meta with an unknown key", inside("meta", color="red"), "readable"),
    Kind(EPISODE, "meta: another frame rate", inside("meta", fps=30), "recipe"),
    Kind(EPISODE, "meta: another variant", inside("meta", variant=3), "variant"),
    Kind(EPISODE, "meta: another physics_id", inside("meta", physics_id="0" * 32), "physics id"),
    Kind(EPISODE, "meta: another key", inside("meta", physics_key="0" * 32), "keys"),
    Kind(EPISODE, "meta: another meeting time", inside("meta", meeting_time=0.1), "meeting place"),
    Kind(EPISODE, "meta: another speed", inside("meta", average_speed=1.0), "speed"),
    Kind(EPISODE, "meta: other rules", inside("meta", rules="domino"), "recipe"),
    Kind(EPISODE, "meta: rules that there are not", inside("meta", rules="fair"), "recipe"),
    Kind(EPISODE, "meta: another touch", inside("meta", contact="continue"), "recipe"),
    Kind(EPISODE, "meta: another place of the robot", inside("meta", layout="original"), "recipe"),
    Kind(EPISODE, "no commands", drop("joint_action/vector"), "arrays"),
    Kind(EPISODE, "no poses", drop("state/poses"), "arrays"),
    Kind(EPISODE, "no images", drop(f"{CAMERA}/rgb"), "jpeg"),
    Kind(EPISODE, "no camera", drop(CAMERA), "recipe"),
    Kind(EPISODE, "no instructions", drop("instruction/seen"), "readable"),
    Kind(EPISODE, "a group in place of an array", hdf5(lambda f: (f.pop("state/qpos"), f.create_group("state/qpos"))), "arrays"),
    Kind(EPISODE, "joints as float32", put("state/qpos", lambda v: v.astype(np.float32)), "arrays"),
    Kind(EPISODE, "joints as text", put("state/qpos", lambda v: "none"), "arrays"),
    Kind(EPISODE, "one row of commands less", put("joint_action/vector", lambda v: v[:-1]), "arrays"),
    Kind(EPISODE, "measured joints transposed", put("joint_state/vector", lambda v: v.T), "arrays"),
    Kind(EPISODE, "NaN in the poses", put("state/poses", at((3, 2, 1), NAN)), "finite"),
    Kind(EPISODE, "NaN in the commands", put("joint_action/vector", at((5, 0), NAN)), "finite"),
    Kind(EPISODE, "infinity in the joint velocities", put("state/qvel", at((0, 0), float("inf"))), "finite"),
    Kind(EPISODE, "NaN in the timestamps", put("timestamp", at(4, NAN)), "finite"),
    Kind(EPISODE, "a quaternion of length 0", put("endpose/left_endpose", at((2, slice(3, 7)), 0.0)), "quaternions"),
    Kind(EPISODE, "target/pose 1 cm off", put("target/pose", moved), "stored twice"),
    Kind(EPISODE, "commands of one arm that are not the vector's", put("joint_action/left_arm", lambda v: v + 0.1), "stored twice"),
    Kind(EPISODE, "a camera matrix that is not its pose", put(f"{CAMERA}/extrinsic_cv", lambda v: -v), "stored twice"),
    Kind(EPISODE, "all bodies 1 cm off", put("state/poses", moved), "target path"),
    Kind(EPISODE, "a contact of an unknown body", put("state/contacts", at("b", 32000)), "contacts"),
    Kind(EPISODE, "a contact after the last frame", put("state/contacts", at("frame", 32000)), "contacts"),
    Kind(EPISODE, "no contacts", put("state/contacts", lambda v: v[:0]), "success"),
    Kind(EPISODE, "timestamps 1 % longer", put("timestamp", lambda v: 1.01 * v), "timestamps"),
    Kind(EPISODE, "timestamps in disorder", put("timestamp", lambda v: v[::-1]), "timestamps"),
    Kind(EPISODE, "an event after the end", put("events", lambda _: '[{"name": "meeting", "time": 1e6}]'), "events"),
    Kind(EPISODE, "no events", put("events", lambda _: "[]"), "events"),
    Kind(EPISODE, "events that are no JSON", put("events", lambda _: "soon"), "readable"),
    Kind(EPISODE, "motion that is no JSON", put("motion", lambda _: "{"), "target path"),
    Kind(EPISODE, "motion of another kind", put("motion", lambda _: '{"kind": "linear"}'), "target path"),
    Kind(EPISODE, "empty instructions", put("instruction/seen", lambda v: np.array([""] * len(v), object)), "instructions"),
    Kind(EPISODE, "one image less", put(f"{CAMERA}/rgb", lambda v: v[:-1]), "frames"),
    Kind(EPISODE, "an image that is none", put(f"{CAMERA}/rgb", image(b"none")), "jpeg"),
    Kind(EPISODE, "an image of one color", put(f"{CAMERA}/rgb", image(jpeg(64, 48, 90))), "jpeg"),
    Kind(EPISODE, "an image of another size", put(f"{CAMERA}/rgb", image(jpeg(32, 48))), "jpeg"),
    Kind(EPISODE, "an image whose header has 65000 x 65000 pixels", put(f"{CAMERA}/rgb", image(huge())), "jpeg"),
    Kind(EPISODE, "a text of a wrong size, behind which HDF5 reads for ever", endless, "readable"),
)

LEDGER = (
    Kind(LEDGER_FILE, "missing", gone, "files"),
    Kind(LEDGER_FILE, "a directory", directory, "ledger"),
    Kind(LEDGER_FILE, "a pipe", pipe, "ledger"),
    Kind(LEDGER_FILE, "empty", cut(0), "ledger"),
    Kind(LEDGER_FILE, "cut to 50 % of its length", cut(0.5), "ledger"),
    Kind(LEDGER_FILE, "binary", lambda p: p.write_bytes(bytes(range(256))), "ledger"),
    *(Kind(LEDGER_FILE, f"a byte inverted at {100 * a:g} %", flip(a), "ledger") for a in (0.0, 0.2, 0.9999)),
    Kind(LEDGER_FILE, "another table", table(lambda t: t.select(["sha256"])), "ledger"),
    Kind(LEDGER_FILE, "an entry less", rows(lambda found: found.pop()), "files"),
    Kind(LEDGER_FILE, "keys that are no JSON", entry_with(keys="{"), "ledger"),
    Kind(LEDGER_FILE, "given up, with an episode", entry_with(accepted=False), "ledger"),
    Kind(LEDGER_FILE, "accepted is null", entry_with(accepted=None), "ledger"),
    Kind(LEDGER_FILE, "a hash of other bytes", entry_with(sha256="0" * 64, stamp=""), "hashes"),
    Kind(LEDGER_FILE, "a hash that is none", entry_with(sha256="zero"), "ledger"),
    Kind(LEDGER_FILE, "no attempts", entry_with(attempts=[]), "ledger", USER),
    Kind(LEDGER_FILE, "an attempt that failed as the last", attempt_with(outcome="failed"), "ledger"),
    Kind(LEDGER_FILE, "an attempt without an outcome", attempt_with(outcome=None), "ledger"),
    Kind(LEDGER_FILE, "an infinite time", attempt_with(seconds=float("inf")), "ledger"),
    Kind(LEDGER_FILE, "an attempt of another seed", attempt_with(seed=5), "ledger", USER),
    Kind(LEDGER_FILE, "another render key", key, "keys"),
    Kind(LEDGER_FILE, "two entries exchanged", rows(exchanged), "hashes"),
    Kind(LEDGER_FILE, "an entry twice", rows(lambda found: found.append(dict(found[0]))), "ledger"),
    Kind(LEDGER_FILE, "the name of a task is a path", entry_with(task="../../x"), "files"),
    Kind(LEDGER_FILE, "a byte inverted at 50 %; length and time kept", kept(flip(0.5)), "ledger"),
    Kind(SEGMENT, "a line cut to 50 % of its length", segment(lambda s: s[: len(s) // 2]), "ledger"),
    Kind(SEGMENT, "a list", segment(lambda _: "[]"), "ledger"),
    Kind(SEGMENT, "nested too deeply", segment(lambda _: "[" * 20000 + "]" * 20000), "ledger"),
    Kind(SEGMENT, "a key twice", segment(lambda s: s.replace('"accepted":', '"accepted":true,"accepted":')), "ledger"),
    Kind(SEGMENT, "an unknown field", segment(lambda s: s.replace('"accepted"', '"color":"red","accepted"')), "ledger"),
    Kind(
        SEGMENT, "a number that no column holds", segment(lambda s: s.replace('"sim_steps":', '"sim_steps":1' + 30 * "0")), "ledger"
    ),
    Kind(SEGMENT, "an infinite time", segment(lambda s: s.replace('"seconds":', '"seconds":Infinity,"was":')), "ledger"),
    Kind(SEGMENT, "a text that has no UTF-8", segment(lambda s: s.replace('"detail":"', '"detail":"\\ud800')), "ledger"),
    Kind(SEGMENT, "a time that is text", segment(lambda s: s.replace('"seconds":', '"seconds":"long","was":')), "ledger"),
    Kind("attempts.parquet", "missing", gone, "attempts"),
    Kind("attempts.parquet", "a pipe", pipe, "attempts"),
    Kind("attempts.parquet", "empty", cut(0), "attempts"),
    Kind("attempts.parquet", "cut to 50 % of its length", cut(0.5), "attempts"),
    Kind("attempts.parquet", "a row less", table(lambda t: t.slice(1)), "attempts"),
    Kind("attempts.parquet", "another seed", column("seed", 1), "attempts"),
    Kind("attempts.parquet", "another table", table(lambda t: t.select(["seed"])), "attempts"),
    Kind("provenance.json", "missing", gone, "provenance"),
    Kind("provenance.json", "nested too deeply", text("[" * 20000 + "]" * 20000), "provenance"),
    Kind("provenance.json", "no JSON", text("{"), "provenance"),
    Kind("provenance.json", "an empty mapping", text("{}"), "provenance"),
    Kind("provenance.json", "another version of the code", entry(code_version="0" * 32), "provenance"),
    Kind("provenance.json", "another renderer", entry(renderer="none"), "provenance"),
)

STRAYS = (
    Kind(EPISODE.replace("0.hdf5", "9.hdf5"), "an episode too many", copied("9.hdf5", "0.hdf5"), "strays", USER),
    Kind("episodes/notes.txt", "a text", text("mine"), "strays", USER),
    Kind("episodes/notes\x1b[2J\n.txt", "a name that a terminal would obey", text("mine"), "strays", USER),
    Kind("ledger/notes.json", "a text", text("{}"), "strays", USER),
    Kind("assets/bodies/notes.txt", "a text", text("mine"), "strays", USER),
)

MANIFEST = (
    Kind("manifest.yaml", "missing", gone, "refused", USER),
    Kind("manifest.yaml", "a pipe", pipe, "refused", USER),
    Kind("manifest.yaml", "empty", cut(0), "refused", USER),
    Kind("manifest.yaml", "no YAML", text("a: [1"), "refused", USER),
    Kind("manifest.yaml", "binary", lambda p: p.write_bytes(bytes(range(128, 256))), "refused", USER),
    Kind("manifest.yaml", "an unknown key", lambda p: p.write_text(p.read_text() + "color: red\n"), "refused", USER),
    Kind("manifest.yaml", "another seed", line_of("\nseed: 0", "\nseed: 1"), "ledger", USER),
    Kind("manifest.yaml", "another camera", line_of("- head\n", "- observer\n"), "recipe", USER),
)

ASSET = "assets/bodies/ASSET.npz"
ASSETS = (
    Kind(ASSET, "missing", gone, "assets"),
    Kind(ASSET, "empty", cut(0), "assets"),
    Kind(ASSET, "cut to 50 % of its length", cut(0.5), "assets"),
    Kind(ASSET, "a byte inverted in the middle", flip(0.5), "assets"),
    Kind(ASSET, "text", text("chair"), "assets"),
    Kind(ASSET, "a directory", directory, "assets"),
    Kind(ASSET, "an array that claims 800 GB", vast, "assets"),
    Kind(ASSET, "a byte inverted in the middle; length and time kept", kept(flip(0.5)), "assets"),
    Kind(ASSET, "another content", lambda p: np.savez(p, attributes=np.frombuffer(b"[]", np.uint8)), "assets"),
)

FLOW = "annotations/flow@STAGE"
ANNOTATIONS = (
    Kind(f"{FLOW}/{FIRST}.h5", "empty", cut(0), FLOW, ANNOTATE),
    Kind(f"{FLOW}/{FIRST}.h5", "cut to 50 % of its length", cut(0.5), FLOW, ANNOTATE),
    Kind(f"{FLOW}/{FIRST}.h5", "text", text("none"), FLOW, ANNOTATE),
    Kind(f"{FLOW}/{FIRST}.h5", "another number", put("scale", lambda v: v + 1), FLOW, ANNOTATE),
    Kind(f"{FLOW}/{FIRST}.h5", "an array less", drop("flow"), FLOW, ANNOTATE),
    Kind(f"{FLOW}/{FIRST}.h5", "another key", attribute("key", "0" * 64), FLOW, ANNOTATE),
    Kind(f"{FLOW}/{FIRST}.h5", "no checksum", attribute("checksum", None), FLOW, ANNOTATE),
    Kind(f"{FLOW}/{FIRST}.h5", "exchanged with another", swap(f"{FIRST}.h5", f"{SECOND}.h5"), FLOW, ANNOTATE),
    Kind(f"{FLOW}/{FIRST[:-1]}9.h5", "of no episode", copied("9.h5", "0.h5"), "strays", USER),
    Kind(f"{FLOW}/stage.json", "missing", gone, FLOW, ANNOTATE),
    Kind(f"{FLOW}/{FIRST}.h5", "a pipe", pipe, FLOW, USER),
    Kind(f"{FLOW}/stage.json", "no JSON", text("{"), FLOW, ANNOTATE),
    Kind(f"{FLOW}/stage.json", "another version", entry(version=9), FLOW, ANNOTATE),
    Kind(f"{FLOW}/{FIRST}.h5", "a text of a wrong size, behind which HDF5 reads for ever", endless, FLOW, ANNOTATE),
)


def export(format: str, file: str, what: str, damage: Callable[[Path], object]) -> Kind:
    """A way to damage an export."""
    return Kind(f"exports/{format}/{file}", what, damage, f"export {format}", EXPORT)


def foreign(format: str, file: str, damage: Callable[[Path], object]) -> Kind:
    """A file in an export that it did not write."""
    return Kind(f"exports/{format}/{file}", "of no episode", damage, "strays", USER)


CONFIGURATION = "click_bell/aloha-agilex_L1_clean"
V3_DATA, V3_VIDEO = "data/chunk-000/file-000.parquet", "videos/observation.images.cam_high/chunk-000/file-000.mp4"
V21_DATA, V21_VIDEO = "data/chunk-000/episode_000000.parquet", "videos/chunk-000/observation.images.cam_high/episode_000000.mp4"

EXPORTS = (
    *(
        replace(export(format, "export.json", "missing", gone), by=USER)
        for format in ("parquet", "aloha", "robotwin", "lerobot", "lerobot-v2.1")
    ),
    *(
        export(format, "export.json", what, damage)
        for format in ("parquet", "aloha", "robotwin", "lerobot", "lerobot-v2.1")
        for what, damage in (("no JSON", text("{")), ("another format", entry(format="gif")))
    ),
    export("parquet", "episodes.parquet", "another key of the physics", column("physics_key", "0" * 32)),
    export("parquet", "data-00000.parquet", "a byte inverted in the middle", flip(0.5)),
    foreign("parquet", "data-00009.parquet", copied("9.parquet", "0.parquet")),
    export("aloha", "episode_0.hdf5", "sim is false", attribute("sim", False)),
    export("aloha", "episode_0.hdf5", "events of another time", attribute("events", "[]")),
    export("aloha", "episodes.parquet", "another source", column("source", "x")),
    foreign("robotwin", f"{CONFIGURATION}/data/episode9.hdf5", copied("9.hdf5", "0.hdf5")),
    export("robotwin", f"{CONFIGURATION}/episodes.parquet", "another instruction", column("instruction", "go")),
    export("lerobot", "meta/stats.json", "a mean of 99", inner("action", mean=[99.0])),
    export("lerobot", V3_VIDEO, "4 bytes inverted in the middle", flip(0.5, 4)),
    foreign("lerobot", V3_VIDEO.replace("000.mp4", "009.mp4"), copied("009.mp4", "000.mp4")),
    export("lerobot", "meta/info.json", "another robot", entry(robot_type="none")),
    export("lerobot-v2.1", V21_VIDEO, "4 bytes inverted in the middle", flip(0.5, 4)),
    foreign("lerobot-v2.1", V21_VIDEO.replace("0.mp4", "9.mp4"), copied("9.mp4", "0.mp4")),
    export("lerobot-v2.1", "meta/episodes_stats.jsonl", "another number", line_of('"episode_index": 0', '"episode_index": 0 ')),
    Kind("exports/parquet/notes.txt", "a text", text("mine"), "strays", USER),
    export("parquet", "data-00000.parquet", "missing", gone),
    export("parquet", "data-00000.parquet", "cut to 50 % of its length", cut(0.5)),
    export("parquet", "data-00000.parquet", "another number", column("timestamp", 9.0)),
    export("parquet", "episodes.parquet", "empty", cut(0)),
    export("parquet", "episodes.parquet", "another seed", column("seed", 1)),
    export("aloha", "episode_0.hdf5", "missing", gone),
    export("aloha", "episode_0.hdf5", "a pipe", pipe),
    export("aloha", "episode_0.hdf5", "empty", cut(0)),
    export("aloha", "episode_0.hdf5", "cut to 50 % of its length", cut(0.5)),
    export("aloha", "episode_0.hdf5", "another number", put("action", lambda v: v + 1)),
    export("aloha", "episode_0.hdf5", "no images", drop("observations/images/cam_high")),
    export("aloha", "episode_0.hdf5", "exchanged with another", swap("0.hdf5", "1.hdf5")),
    foreign("aloha", "episode_9.hdf5", copied("9.hdf5", "0.hdf5")),
    export("aloha", "episodes.parquet", "cut to 50 % of its length", cut(0.5)),
    export("robotwin", f"{CONFIGURATION}/data/episode0.hdf5", "cut to 50 % of its length", cut(0.5)),
    export("robotwin", f"{CONFIGURATION}/data/episode0.hdf5", "an array less", drop("endpose/left_endpose")),
    export("robotwin", f"{CONFIGURATION}/instructions/episode0.json", "no JSON", text("{")),
    export("robotwin", f"{CONFIGURATION}/instructions/episode0.json", "other sentences", text('{"seen": [], "unseen": []}')),
    export("robotwin", f"{CONFIGURATION}/scene_info.json", "missing", gone),
    export("robotwin", f"{CONFIGURATION}/seed.txt", "another seed", text("1 2")),
    export("lerobot", V3_DATA, "cut to 50 % of its length", cut(0.5)),
    export("lerobot", V3_DATA, "another number", column("timestamp", 9.0)),
    export("lerobot", V3_VIDEO, "missing", gone),
    export("lerobot", V3_VIDEO, "cut to 50 % of its length", cut(0.5)),
    export("lerobot", "meta/info.json", "no JSON", text("{")),
    export("lerobot", "meta/stats.json", "missing", gone),
    export("lerobot", "meta/domino.json", "another rate", entry(fps=60)),
    export("lerobot", "meta/tasks.parquet", "empty", cut(0)),
    export("lerobot-v2.1", V21_DATA, "cut to 50 % of its length", cut(0.5)),
    export("lerobot-v2.1", V21_VIDEO, "empty", cut(0)),
    export("lerobot-v2.1", V21_VIDEO, "exchanged with another", swap("000000.mp4", "000001.mp4")),
    export("lerobot-v2.1", "meta/episodes.jsonl", "no JSON", text("{\n{")),
    export("lerobot-v2.1", "meta/modality.json", "missing", gone),
)

KINDS = (*EPISODES, *FORGED, *LEDGER, *STRAYS, *MANIFEST, *ASSETS, *ANNOTATIONS, *EXPORTS)
