"""A build straight to an object server: killed, gone on with from another machine, verified from
there, with the same bytes."""

import logging
import signal

from pipeline.data.store.place import Place
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
        # seldom: a listing costs moto 20 ms
        wait_for(
            lambda: server.names("sets/bells/episodes/") or process.poll() is not None, 200, 0.4
        )
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert process.returncode == -signal.SIGKILL
        finished = server.names("sets/bells/episodes/")
        assert finished

        for name, value in server.environment(tmp_path / "elsewhere").items():
            monkeypatch.setenv(name, value)
        fetched, fetch = [], Place.fetch
        monkeypatch.setattr(
            Place, "fetch", lambda self, path: fetched.append(path.name) or fetch(self, path)
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
        code, out, err = inside("verify", URL, "--quiet")
        assert code == 0 and "FAIL" not in out, out + err

        code, _, err = inside("pull", URL, tmp_path / "pulled")
        assert code == 0, err
        # seconds are only in the index, and an episode of the killed build has no row there
        assert contents(tmp_path / "pulled", timed=False) == contents(built, timed=False)

        server.accept_only_known_keys()
        code, out, err = inside("status", URL)
        server.accept_everybody()
        assert (code, out) == (2, "")
        assert err.startswith(f"domino-data: cannot read {URL}/manifest.yaml: ")
        assert err.count("\n") == 1 and "check the bucket, the credentials" in err
        code, _, err = inside("status", "s3://nowhere/set")
        assert (code, err.count("\n")) == (2, 1) and "bucket does not exist" in err
        code, _, err = inside("evaluate", "--out", URL, "--policy", "scripted")
        assert code == 2 and err.startswith(f"domino-data: {URL}: evaluate takes a path of this")
