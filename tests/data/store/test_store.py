"""Objects on a store: listed, written, read and deleted; what goes wrong there is one line, a lost
connection is tried again."""

import threading
import time
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import fsspec
import pytest
from fsspec.implementations.memory import MemoryFileSystem

from pipeline.data.store.files import Store, StoreError, _server


@pytest.fixture
def store(tmp_path):
    return Store(f"memory://{tmp_path.name}/set", pauses=())


def put(store, tmp_path, name, data):
    path = tmp_path / "sent"
    path.write_bytes(data)
    return store.put(path, name)


def test_what_is_put_is_listed_and_got_by_the_same_name(store, tmp_path):
    assert store.list() == {}
    sent = put(store, tmp_path, "a/b.txt", b"four")
    put(store, tmp_path, "c", b"")
    assert store.list() == {"a/b.txt": sent, "c": store.stat("c")}
    assert (sent.size, store.stat("c").size, store.stat("a"), store.stat("none")) == (
        4,
        0,
        None,
        None,
    )
    store.get("a/b.txt", tmp_path / "got")
    assert (tmp_path / "got").read_bytes() == b"four" == store.read("a/b.txt")
    assert store.read("none") is None
    again = put(store, tmp_path, "a/b.txt", b"five")
    assert again.size == sent.size and again.identity != sent.identity
    # a neighbour whose name begins alike is none of it
    put(Store(f"{store.url}-2"), tmp_path, "d", b"")
    store.delete(["a/b.txt", "none"])
    assert list(store.list()) == ["c"]


def test_an_object_is_created_once(store):
    assert store.create("lease", b"1")
    assert not store.create("lease", b"2")
    assert store.read("lease") == b"1"


class Dropping(MemoryFileSystem):
    """A store whose connection is lost a number of times."""

    protocol = "dropping"
    lost = 0

    def find(self, path, **options):
        if Dropping.lost:
            Dropping.lost -= 1
            raise ConnectionResetError(104, "Connection reset by peer")
        return super().find(path, **options)


@pytest.mark.parametrize(("lost", "works"), [(0, True), (2, True), (3, False)])
def test_a_lost_connection_is_tried_again_a_few_times(monkeypatch, lost, works):
    fsspec.register_implementation("dropping", Dropping, clobber=True)
    monkeypatch.setattr(Dropping, "lost", lost)
    pauses = []
    monkeypatch.setattr("time.sleep", pauses.append)
    store = Store("dropping://x/set", pauses=(1.0, 2.0))
    if works:
        assert store.list() == {}
    else:
        with pytest.raises(
            StoreError,
            match=(
                r"^cannot list dropping://x/set: the connection is lost .*Connection reset by"
                r" peer\)$"
            ),
        ):
            store.list()
    assert pauses == [1.0, 2.0][:lost]


class Silent(MemoryFileSystem):
    """A store whose server takes requests and answers none."""

    protocol, endpoint_url = "silent", "http://silent:9000"
    ended = threading.Event()

    def cat_file(self, path, **options):
        self.ended.wait(60)
        raise ConnectionError


def test_a_server_that_does_not_answer_is_one_line_soon():
    fsspec.register_implementation("silent", Silent, clobber=True)
    said = (
        r"^cannot open silent://x/set: http://silent:9000 has not answered for 0 s: check the"
        r" network and the endpoint"
    )
    with pytest.raises(StoreError, match=said):
        Store("silent://x/set", pauses=()).reach("manifest.yaml", seconds=0.05)
    Silent.ended.set()


def test_what_was_wrong_before_the_time_ran_out_is_said(monkeypatch):
    fsspec.register_implementation("silent", Silent, clobber=True)
    tried = threading.Event()

    def refused(*_, **__):
        if tried.is_set():
            Silent.ended.wait(60)
        tried.set()
        raise ConnectionRefusedError(111, "Connection refused")

    monkeypatch.setattr(Silent, "ended", threading.Event())
    monkeypatch.setattr(Silent, "cat_file", refused)
    with pytest.raises(
        StoreError, match=r"check the network .*\(\[Errno 111\] Connection refused\)$"
    ):
        Store("silent://x/set", pauses=(0.0,)).reach("manifest.yaml", seconds=0.3)
    Silent.ended.set()


def test_a_command_that_was_stopped_waits_once_for_a_silent_store_and_says_so(monkeypatch, capsys):
    fsspec.register_implementation("silent", Silent, clobber=True)
    monkeypatch.setattr(Silent, "ended", threading.Event())
    for name, value in (("HURRY", 0.2), ("WORD", 0.05), ("_POLL", 0.01)):
        monkeypatch.setattr(f"pipeline.data.store.files.{name}", value)
    store, began = Store("silent://x/set"), time.monotonic()
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt:
        for _ in range(20):
            with pytest.raises(StoreError, match="has not answered"):
                store.read("a")
    assert time.monotonic() - began < 2
    assert "no answer for" in capsys.readouterr().err
    Silent.ended.set()


def test_the_first_request_reads_an_object(store):
    assert store.reach("a") is None
    store.write("a", b"1")
    assert store.reach("a") == b"1"


def test_a_full_disk_of_this_machine_is_no_fault_of_the_store(store, tmp_path):
    put(store, tmp_path, "a", b"four")
    with pytest.raises(OSError, match="No space left on device"):
        store.get("a", "/dev/full")


@contextmanager
def answering(answers):
    """The address of a server that answers every request with the error of S3 that `answers` ends
    with: its status and its code."""

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def answer(self):
            self.rfile.read(int(self.headers.get("Content-Length") or 0))
            status, code = answers[-1]
            body = f"<Error><Code>{code}</Code><Message>The server says {code}.</Message></Error>".encode()  # noqa: E501
            self.send_response(status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        do_GET = do_PUT = answer

        def log_message(self, format, *args):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.block_on_close = False
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


REFUSALS = {
    (
        400,
        "ExpiredToken",
    ): "the credential has expired: renew it, then rerun the same command to resume",
    (403, "InvalidAccessKeyId"): "the credential is not accepted: check it",
    (403, "AccessDenied"): "the credential has no permission: grant it",
    (404, "NoSuchBucket"): "there is no such bucket or repository: make it first",
}


def test_what_a_server_refuses_is_one_line_with_the_fix(monkeypatch, tmp_path):
    for name, value in {
        "ACCESS_KEY_ID": "key",
        "SECRET_ACCESS_KEY": "secret",
        "DEFAULT_REGION": "us-east-1",
    }.items():
        monkeypatch.setenv(f"AWS_{name}", value)
    answers = []
    with answering(answers) as address:
        monkeypatch.setenv("AWS_ENDPOINT_URL", address)
        store = Store("s3://bucket/set", pauses=())
        for answer, said in REFUSALS.items():
            answers.append(answer)
            requests = {
                "list": store.list,
                "write": lambda: put(store, tmp_path, "a", b"four"),
                "open": lambda: store.reach("a"),
            }
            for words, request in requests.items():
                with pytest.raises(
                    StoreError, match=rf"cannot {words} s3://bucket/set(/a)?: {said}"
                ) as raised:
                    request()
                assert "\n" not in str(raised.value) and f"The server says {answer[1]}." in str(
                    raised.value
                )
        assert _server(store._at[0]) == address


def test_a_store_without_its_library_is_one_line():
    with pytest.raises(StoreError, match=r"^nosuch://x: Protocol not known: nosuch"):
        Store("nosuch://x").list()
