"""A build straight to an object server: killed, gone on with from another machine, verified from
there, with the same bytes."""

import logging
import shutil
import signal

from pipeline.data.store.mirror import Mirror, open_url
from pipeline.data.store.mirror_files import is_listed
from tests.object_server import object_server
from tests.run.command import WANTED, contents, inside, start
from tests.run.processes import wait_for

URL = "s3://bucket/sets/bells"


def test_a_build_to_an_object_server_is_killed_and_gone_on_with_elsewhere(
    built, tmp_path, monkeypatch
):
    logging.getLogger("werkzeug").disabled = True
    with object_server() as server:
        environment = server.environment(tmp_path / "cache")
        process = start(
            "build", *WANTED, "--out", URL, "--quiet", "--executor", "inline", extra=environment
        )
        wait_for(lambda: server.names("sets/bells/episodes/") or process.poll() is not None, 200)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert process.returncode == -signal.SIGKILL
        finished = server.names("sets/bells/episodes/")
        assert finished

        for name, value in server.environment(tmp_path / "elsewhere").items():
            monkeypatch.setenv(name, value)
        fetched = []
        get = Mirror._fetch
        monkeypatch.setattr(
            Mirror, "_fetch", lambda self, path: (fetched.append(path.name), get(self, path))
        )
        code, out, err = inside("status", URL)
        assert code == 0 and "of 3 accepted" in out, err
        code, out, err = inside("build", *WANTED, "--out", URL, "--quiet", "--executor", "inline")
        assert (
            code == 0
            and f"3 of 3 episodes in {URL}" in out
            and f"images: {URL}/report/index.html" in out
        ), err
        assert f"{3 - len(finished)} slots by this run" in out
        assert all(not name.endswith(".npz") for name in fetched)
        shutil.rmtree(tmp_path / "elsewhere")
        code, out, err = inside("verify", URL, "--quiet")
        assert code == 0 and "FAIL" not in out, out + err

        with open_url(URL, writes=False) as root:
            mirror = Mirror(root)
            assert sorted(
                f"sets/bells/{mirror.name(p)}" for p in root.rglob("*") if p.is_file()
            ) == server.names("sets/bells/")
            mirror.fetch_below(root)
            assert not any(is_listed(path) for path in root.rglob("*"))
            # seconds are only in the index, and an episode of the killed build has no row there
            assert contents(root, timed=False) == contents(built, timed=False)

        server.accept_only_known_keys()
        code, out, err = inside("status", URL)
        server.accept_everybody()
        assert (code, out) == (2, "")
        assert err.startswith(
            f"domino-data: cannot open {URL}: the credential is not accepted: check it, then rerun"
            " the same command"
        )
        code, _, err = inside("status", "s3://nowhere/set")
        assert (code, err.count("\n")) == (2, 1) and "there is no such bucket" in err
        code, _, err = inside("evaluate", "--out", URL, "--policy", "scripted")
        assert (code, err) == (
            2,
            f"domino-data: {URL}: evaluate takes a path of this machine there, no URL\n",
        )
