"""Kinds of damage, each with what `verify` must say and which command puts it right: the table of docs/corruption.md."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.run.damage import (
    ANNOTATE,
    CAMERA,
    ENTRY,
    EPISODE,
    EXPORT,
    FIRST,
    OTHER,
    OTHER_ENTRY,
    SECOND,
    USER,
    Kind,
    at,
    attribute,
    column,
    copied,
    cut,
    dangling,
    directory,
    drop,
    entry,
    flip,
    gone,
    hdf5,
    huge,
    image,
    inside,
    jpeg,
    key,
    line_of,
    moved,
    put,
    row,
    swap,
    table,
    text,
)

NAN = float("nan")

EPISODES = (
    Kind(EPISODE, "missing", gone, "files"),
    Kind(EPISODE, "a link to nothing", dangling, "files"),
    Kind(EPISODE, "a directory", directory, "readable"),
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
    Kind(EPISODE, "an image that says it has 65000 x 65000 pixels", put(f"{CAMERA}/rgb", image(huge())), "jpeg"),
)

LEDGER = (
    Kind(ENTRY, "missing", gone, "files"),
    Kind(ENTRY, "a directory", directory, "ledger"),
    Kind(ENTRY, "empty", cut(0), "ledger"),
    Kind(ENTRY, "cut to 50 % of its length", cut(0.5), "ledger"),
    Kind(ENTRY, "binary", lambda p: p.write_bytes(bytes(range(256))), "ledger"),
    Kind(ENTRY, "a list", text("[]"), "ledger"),
    Kind(ENTRY, "no keys", entry(keys=None), "ledger"),
    Kind(ENTRY, "an unknown field", entry(color="red"), "ledger"),
    Kind(ENTRY, "given up, with an episode", entry(accepted=False), "ledger"),
    Kind(ENTRY, "accepted is text", entry(accepted="yes"), "ledger"),
    Kind(ENTRY, "a hash of other bytes", entry(sha256="0" * 64), "hashes"),
    Kind(ENTRY, "a hash that is none", entry(sha256="zero"), "ledger"),
    Kind(ENTRY, "no attempts", entry(attempts=[]), "ledger", USER),
    Kind(ENTRY, "attempts of another type", entry(attempts=[7]), "ledger"),
    Kind(ENTRY, "an attempt that failed as the last", row(outcome="failed"), "ledger"),
    Kind(ENTRY, "an attempt of another seed", row(seed=5), "ledger", USER),
    Kind(ENTRY, "a time that is text", row(seconds="long"), "ledger"),
    Kind(ENTRY, "another render key", key, "keys"),
    Kind(ENTRY, "exchanged with another entry", swap(ENTRY, OTHER_ENTRY), "hashes"),
    Kind("attempts.parquet", "missing", gone, "attempts"),
    Kind("attempts.parquet", "empty", cut(0), "attempts"),
    Kind("attempts.parquet", "cut to 50 % of its length", cut(0.5), "attempts"),
    Kind("attempts.parquet", "a row less", table(lambda t: t.slice(1)), "attempts"),
    Kind("attempts.parquet", "another seed", column("seed", 1), "attempts"),
    Kind("attempts.parquet", "another table", table(lambda t: t.select(["seed"])), "attempts"),
    Kind("provenance.json", "missing", gone, "provenance"),
    Kind("provenance.json", "no JSON", text("{"), "provenance"),
    Kind("provenance.json", "says nothing", text("{}"), "provenance"),
)

STRAYS = (
    Kind(EPISODE.replace("0.hdf5", "9.hdf5"), "an episode too many", copied("9.hdf5", "0.hdf5"), "strays", USER),
    Kind("episodes/notes.txt", "a text", text("mine"), "strays", USER),
    Kind("ledger/notes.json", "a text", text("{}"), "strays", USER),
    Kind("assets/bodies/notes.txt", "a text", text("mine"), "strays", USER),
)

MANIFEST = (
    Kind("manifest.yaml", "missing", gone, "refused", USER),
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
    Kind(f"{FLOW}/stage.json", "no JSON", text("{"), FLOW, ANNOTATE),
    Kind(f"{FLOW}/stage.json", "another version", entry(version=9), FLOW, ANNOTATE),
)


def export(format: str, file: str, what: str, damage: Callable[[Path], object]) -> Kind:
    """A way to damage an export."""
    return Kind(f"exports/{format}/{file}", what, damage, f"export {format}", EXPORT)


CONFIGURATION = "click_bell/aloha-agilex_L1_clean"
V3_DATA, V3_VIDEO = "data/chunk-000/file-000.parquet", "videos/observation.images.cam_high/chunk-000/file-000.mp4"
V21_DATA, V21_VIDEO = "data/chunk-000/episode_000000.parquet", "videos/chunk-000/observation.images.cam_high/episode_000000.mp4"

EXPORTS = (
    *(
        export(format, "export.json", what, damage)
        for format in ("parquet", "aloha", "robotwin", "lerobot", "lerobot-v2.1")
        for what, damage in (("missing", gone), ("no JSON", text("{")), ("another format", entry(format="gif")))
    ),
    export("parquet", "data-00000.parquet", "missing", gone),
    export("parquet", "data-00000.parquet", "cut to 50 % of its length", cut(0.5)),
    export("parquet", "data-00000.parquet", "another number", column("timestamp", 9.0)),
    export("parquet", "episodes.parquet", "empty", cut(0)),
    export("parquet", "episodes.parquet", "another seed", column("seed", 1)),
    export("aloha", "episode_0.hdf5", "missing", gone),
    export("aloha", "episode_0.hdf5", "empty", cut(0)),
    export("aloha", "episode_0.hdf5", "cut to 50 % of its length", cut(0.5)),
    export("aloha", "episode_0.hdf5", "another number", put("action", lambda v: v + 1)),
    export("aloha", "episode_0.hdf5", "no images", drop("observations/images/cam_high")),
    export("aloha", "episode_0.hdf5", "exchanged with another", swap("0.hdf5", "1.hdf5")),
    export("aloha", "episode_9.hdf5", "of no episode", copied("9.hdf5", "0.hdf5")),
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

KINDS = (*EPISODES, *LEDGER, *STRAYS, *MANIFEST, *ASSETS, *ANNOTATIONS, *EXPORTS)
