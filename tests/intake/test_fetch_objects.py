"""Objects of wheels and of the hub: what is made of them, and what is refused."""

import hashlib
import io
import json
import stat
import threading
import zipfile
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
import trimesh
from huggingface_hub import HfApi

from pipeline.intake import fetch_objects as fetch
from pipeline.intake.fetch_objects import FetchedObject, HubDataset, Wheel
from pipeline.intake.objects.add import draft_all, enter_objects
from pipeline.world.objects.contract import FAMILIES
from pipeline.world.objects.from_files import ObjectError

BOX = FetchedObject("thing", "tea_box", "their/meshes/box.obj", 1.0, "z", ("box", "paper box"))
LICENCE = "tiny-1.0.dist-info/licenses/LICENSE"
COMMIT = "c0ffee" + "0" * 34


def box(size=(0.05, 0.04, 0.09)) -> bytes:
    return trimesh.creation.box(size).export(file_type="obj").encode()


def archive(path, members):
    with zipfile.ZipFile(path, "w") as file:
        for name, data in members.items():
            file.writestr(name, data)
    return path


@pytest.fixture
def to(tmp_path):
    """A directory of plugins; the objects that are registered meanwhile are taken out again."""
    before = set(FAMILIES)
    yield tmp_path / "plugins"
    for name in set(FAMILIES) - before:
        FAMILIES.remove(name)


@pytest.fixture
def wheel(tmp_path, monkeypatch):
    """A wheel with a box, and the source `tiny` that makes an object of it."""
    path = archive(
        tmp_path / "tiny-1.0-py3-none-any.whl",
        {BOX.file: box(), LICENCE: "do as you like", "their/__init__.py": "raise SystemExit"},
    )
    monkeypatch.setitem(fetch.WHEELS, "tiny", Wheel("tiny", "1.0", "MIT", ""))
    monkeypatch.setattr(fetch, "read_catalogue", lambda source: (BOX,))
    monkeypatch.setattr(fetch, "check_content", lambda files, wheel, what: None)
    monkeypatch.setattr(  # in this process: a child takes seconds
        fetch, "add_objects", lambda file, given: enter_objects(draft_all(file, given), given.to)
    )
    return path


def test_a_wheel_becomes_checked_objects_with_their_licence(wheel, to):
    [line] = fetch.fetch_wheel("tiny", to, wheel)
    assert line.startswith("tea_box: wrote") and "5.0 x 4.0 x 9.0" in line.replace(
        "4.0 x 5.0", "5.0 x 4.0"
    )
    assert 'licence = "MIT (tiny 1.0)"' in (to / "objects/thing/object.toml").read_text()
    assert (to / "licences/tiny" / LICENCE).read_text() == "do as you like"
    assert not list(to.rglob("*.py"))
    assert list(fetch.fetch_wheel("tiny", to, wheel)) == ["thing: is there already"]


def test_an_object_that_fails_a_check_or_cannot_be_read_is_left_out(wheel, to, monkeypatch):
    solid = BOX._replace(family="mug")  # it has no hollow
    monkeypatch.setattr(fetch, "read_catalogue", lambda source: (solid,))
    [line] = fetch.fetch_wheel("tiny", to, wheel)
    assert line.startswith("thing: left out: hollows")
    assert not (to / "objects/thing").exists()
    FAMILIES.remove("thing")
    archive(wheel, {BOX.file: box((3, 3, 3))})
    [line] = fetch.fetch_wheel("tiny", to, wheel)
    assert line.startswith("thing: left out: ") and "try --scale" in line


def test_other_files_than_those_of_the_known_release_are_refused(tmp_path):
    (tmp_path / "box.obj").write_bytes(box())
    with pytest.raises(ObjectError, match=r"tiny\.whl.* tiny 1\.0"):
        fetch.check_content(tmp_path, Wheel("tiny", "1.0", "MIT", "0"), "tiny.whl")


@pytest.mark.parametrize(
    "name", ["../out.obj", "/tmp/domino/out.obj", "a/../../out.obj", "a\\..\\out.obj"]
)
def test_a_member_that_would_leave_the_directory_stays_in_it(tmp_path, name):
    path = archive(tmp_path / "a.zip", {"fine.obj": b"", name: b""})
    fetch.unpack(path, lambda name: True, tmp_path / "into")
    assert sorted(tmp_path.iterdir()) == [path, tmp_path / "into"]
    assert len([each for each in (tmp_path / "into").rglob("*") if each.is_file()]) == 2


def test_links_are_plain_files_and_bombs_and_what_is_no_zip_are_refused(tmp_path, monkeypatch):
    link = zipfile.ZipInfo("link.obj")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    linked = archive(tmp_path / "a.zip", {link: b"/etc/passwd"})
    fetch.unpack(linked, lambda name: True, tmp_path / "into")
    assert not (tmp_path / "into/link.obj").is_symlink()
    monkeypatch.setattr(fetch, "TOTAL", 1000)
    bomb = archive(tmp_path / "a.zip", {"bomb.obj": bytes(2000)})
    with pytest.raises(ObjectError, match="holds more than"):
        fetch.unpack(bomb, lambda name: True, tmp_path / "into")
    (tmp_path / "b.zip").write_bytes(b"<html>not found</html>")
    with pytest.raises(ObjectError, match="cannot be read as a zip file"):
        fetch.unpack(tmp_path / "b.zip", lambda name: True, tmp_path / "into")


def test_pip_is_asked_for_the_pinned_wheel(wheel, tmp_path, monkeypatch):
    client, log, into = tmp_path / "bin/uvx", tmp_path / "log", tmp_path / "into"
    into.mkdir()
    client.parent.mkdir()
    client.write_text(
        f'#!/bin/sh\necho "$@" >> {log}\nwhile [ "$1" != --dest ]; do shift; done\n'
        f'/bin/cp {wheel} "$2"\n'
    )
    client.chmod(0o755)
    monkeypatch.setenv("PATH", str(client.parent))
    found = fetch.download_wheel(fetch.WHEELS["tiny"], into)
    assert found.read_bytes() == wheel.read_bytes()
    [line] = log.read_text().splitlines()
    assert " download " in line and line.endswith("tiny==1.0") and "--no-deps" in line
    client.write_text("#!/bin/sh\necho 'ERROR: no such version' >&2\nexit 1\n")
    with pytest.raises(ObjectError, match="no such version; give the file with --wheel"):
        fetch.download_wheel(fetch.WHEELS["tiny"], into)


@pytest.fixture
def hub():
    """The files of a dataset on a hub of this machine, by name; and its HfApi."""
    files, stated = {}, {}

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            if self.path.startswith("/api/datasets/"):
                listed = [
                    {
                        "rfilename": name,
                        "size": len(data),
                        "blobId": git_hash(stated.get(name, data)),
                    }
                    for name, data in files.items()
                ]
                self.send({}, json.dumps({"id": "a/b", "sha": COMMIT, "siblings": listed}).encode())
            else:
                data = files[self.path.partition(f"/resolve/{COMMIT}/")[2]]
                self.send({"X-Repo-Commit": COMMIT, "ETag": f'"{git_hash(data)}"'}, data)

        do_HEAD = do_GET

        def send(self, headers, data):
            self.send_response(200)
            for key, value in ({"Content-Length": str(len(data))} | headers).items():
                self.send_header(key, value)
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(data)

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield files, stated, HfApi(endpoint=f"http://127.0.0.1:{server.server_address[1]}")
    server.shutdown()
    server.server_close()
    thread.join()


def git_hash(data: bytes) -> str:
    return hashlib.sha1(f"blob {len(data)}\0".encode() + data).hexdigest()


def test_objects_of_the_hub_name_their_commit_and_hashes(wheel, to, hub, monkeypatch):
    files, stated, api = hub
    files |= {BOX.file: box(), "README.md": b"licence: CC-BY-4.0"}
    monkeypatch.setitem(fetch.HUB, "tiny", HubDataset("a/b", "CC-BY-4.0"))
    stated[BOX.file] = b"another file"
    with pytest.raises(ObjectError, match="not what the hub states"):
        list(fetch.fetch_dataset("tiny", to, api, "main"))
    assert not to.exists()
    stated.clear()
    [line] = fetch.fetch_dataset("tiny", to, api, "main")
    assert line.startswith("tea_box: wrote")
    source = json.loads((to / "licences/tiny/source.json").read_text())
    assert source["revision"] == COMMIT
    assert source["sha256"][BOX.file] == hashlib.sha256(box()).hexdigest()
    assert (to / "licences/tiny/README.md").is_file()


def test_a_hub_that_cannot_be_reached_is_one_line(tmp_path):
    with pytest.raises(ObjectError, match=r"ai-habitat/ycb: .*refused"):
        list(fetch.fetch_dataset("ycb", tmp_path, HfApi(endpoint="http://127.0.0.1:9"), "main"))


def test_the_archive_of_robotwin_is_unpacked_for_assets(tmp_path, hub, monkeypatch):
    files, _, api = hub
    data = io.BytesIO()
    archive(data, {"objects/039_mug/model_data0.json": "{}"})
    files["objects.zip"] = data.getvalue()
    [line] = fetch.fetch_dataset("robotwin", tmp_path / "plugins", api, "main")
    assert line.endswith(f"--assets robotwin:{tmp_path / 'plugins/robotwin'}")
    assert (tmp_path / "plugins/robotwin/objects/039_mug/model_data0.json").read_text() == "{}"
    archive(files_zip := io.BytesIO(), {"../039_mug": "{}"})
    files["objects.zip"] = files_zip.getvalue()
    list(fetch.fetch_dataset("robotwin", tmp_path / "other", api, "main"))
    assert (tmp_path / "other/robotwin/039_mug").read_text() == "{}"


def test_the_catalogue_names_families_that_exist_and_each_object_once():
    rows = [each for source in (*fetch.WHEELS, "ycb") for each in fetch.read_catalogue(source)]
    assert len({each.name for each in rows}) == len(rows) > 20
    assert {each.family for each in rows} <= set(FAMILIES)
    assert not {each.name for each in rows} & set(FAMILIES)
