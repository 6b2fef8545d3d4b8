"""Publishing to a hub on this machine: what arrives, what is refused beforehand, trying again, and
no token in sight."""

import json
from dataclasses import replace

import huggingface_hub.constants
import pytest
from huggingface_hub import HfApi

from pipeline.data.keys import file_hash, seal
from pipeline.export import ExportError
from pipeline.export.publish import prepare, publish
from tests.export.hub import running
from tests.export.running import run
from tests.synthetic import episode_path, make_episode

TOKEN = "hf_secretsecretsecret"


@pytest.fixture
def hub(monkeypatch):
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_DISABLE_XET", True)
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_DISABLE_PROGRESS_BARS", True)
    with running() as hub:
        monkeypatch.setattr(huggingface_hub.constants, "ENDPOINT", hub.address)
        yield hub


@pytest.fixture
def export(tmp_path):
    """A Parquet export of two episodes."""
    paths = [
        make_episode(
            episode_path(tmp_path, slot=i), slot=i, seed=i, frames=3, cameras=("head_camera",)
        )
        for i in range(2)
    ]
    run("parquet", tmp_path, tmp_path / "out", paths)
    return tmp_path / "out"


def test_every_file_arrives_as_it_is(hub, export):
    before = {
        p.relative_to(export).as_posix(): p.read_bytes() for p in export.rglob("*") if p.is_file()
    }
    ours = set(before)
    (export / "meta").mkdir()
    for name in ("meta/stats_gr00t.json", "meta/steps_ab12.pkl", "notes [1].txt"):
        (export / name).write_text("not ours")
    shipment = prepare(export, "me/set", private=True)
    assert set(shipment.files) == ours and shipment.bytes == sum(map(len, before.values()))
    assert set(shipment.unlisted) == {
        "meta/stats_gr00t.json",
        "meta/steps_ab12.pkl",
        "notes [1].txt",
    }
    assert "stays here, it is no part of the export: notes [1].txt" in shipment.describe()
    url = publish(shipment, HfApi(endpoint=hub.address, token=TOKEN))
    assert url.endswith("/datasets/me/set") and "private" in (
        hub.repos["me/set"].get("visibility"),
        *hub.repos["me/set"],
    )
    assert hub.files == before and hub.tags == []
    assert {who for _, path, who in hub.log if path.startswith("/api/datasets/")} == {
        f"Bearer {TOKEN}"
    }
    assert prepare(export, "me/set", private=True).files == shipment.files


def test_a_refusal_is_one_line_without_the_token_and_the_next_try_goes_on(hub, export):
    hub.broken = {"/commit/": 1}
    shipment, api = (
        prepare(export, "me/set", private=False),
        HfApi(endpoint=hub.address, token=TOKEN),
    )
    with pytest.raises(ExportError) as error:
        publish(shipment, api)
    assert (
        "me/set: the hub refused: " in str(error.value)
        and "\n" not in str(error.value)
        and TOKEN not in str(error.value)
    )
    publish(shipment, api)
    sent = [path for method, path, _ in hub.log if method == "PUT"]
    publish(shipment, api)
    assert [path for method, path, _ in hub.log if method == "PUT"] == sent and len(sent) >= 1


def test_lerobot_gets_its_tag(hub, export):
    summary = json.loads((export / "export.json").read_text())
    (export / "export.json").write_bytes(seal(summary | {"format": "lerobot"}))
    (export / "meta").mkdir()
    (export / "meta/info.json").write_text("{}")
    # datasets of several robots lie in directories, and a meta/info.json that is no part of the
    # export is nobody's
    assert prepare(export, "me/set", private=False).tag is None
    written = {"meta/info.json": {"sha256": file_hash(export / "meta/info.json"), "bytes": 2}}
    (export / "export.json").write_bytes(
        seal(summary | {"format": "lerobot", "contents": summary["contents"] | written})
    )
    publish(prepare(export, "me/set", private=False), HfApi(endpoint=hub.address, token=TOKEN))
    assert hub.tags == ["v3.0"]


def test_what_the_hub_would_not_take_is_said_before_anything_is_sent(hub, export, monkeypatch):
    (export / "README.md").write_text("no front matter")
    monkeypatch.setattr("pipeline.export.publish.FILES_OF_A_FOLDER", 2)
    shipment = prepare(export, "me/set", private=False)
    said = shipment.describe()
    assert "./ has 4 files, 2 are allowed" in said and "no card can be read" in said
    with pytest.raises(ExportError, match="are allowed"):
        publish(shipment, HfApi(endpoint=hub.address, token=TOKEN))
    assert hub.log == []


def test_a_hub_that_is_down_is_one_line(export):
    api = HfApi(endpoint="http://127.0.0.1:9", token=TOKEN)
    with pytest.raises(ExportError, match="me/set") as refused:
        publish(prepare(export, "me/set", private=False), api)
    assert "\n" not in str(refused.value) and TOKEN not in str(refused.value)


def test_the_words_of_a_shipment(export):
    shipment = prepare(export, "me/set", private=False)
    assert (
        "a PUBLIC dataset repository me/set" in shipment.describe()
        and "a private" in replace(shipment, private=True).describe()
    )
    for name in ("a//b", "a b", "x" * 200):
        with pytest.raises(ExportError, match="--repo-id"):
            prepare(export, name, private=False)


@pytest.mark.parametrize("name", ["episodes.parquet", "README.md", "export.json"])
def test_a_link_in_an_export_is_never_followed(hub, export, tmp_path, name):
    secret = tmp_path / "secret"
    secret.write_bytes((export / name).read_bytes())  # the very bytes that are recorded
    (export / name).unlink()
    (export / name).symlink_to(secret)
    with pytest.raises(ExportError, match=f"{name}.*link"):
        prepare(export, "me/set", private=False)


def test_links_and_changed_files_beside_and_in_an_export_are_not_sent(hub, export, tmp_path):
    (tmp_path / "keys").mkdir()
    (tmp_path / "keys" / "id").write_text("secret")
    (export / "stray.json").symlink_to(tmp_path / "keys" / "id")
    (export / "more").symlink_to(tmp_path / "keys")
    shipment = prepare(export, "me/set", private=False)
    assert set(shipment.unlisted) == {"stray.json", "more"}
    publish(shipment, HfApi(endpoint=hub.address, token=TOKEN))
    assert set(hub.files) == set(shipment.files) and not any(
        b"secret" in data for data in hub.files.values()
    )
    (export / "episodes.parquet").write_bytes(b"x")
    with pytest.raises(
        ExportError, match=r"episodes\.parquet: is not what was written: export again"
    ):
        prepare(export, "me/set", private=False)
