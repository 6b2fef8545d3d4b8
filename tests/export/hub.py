"""A hub on this machine: an HTTP server with the calls that huggingface_hub makes to publish a data
set."""

import base64
import hashlib
import json
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs

LARGE = 2000  # bytes from which a file goes the way of large files


class Hub:
    """What has arrived: repositories, files by path, tags, and a log of requests; `broken` says how
    often to refuse a call."""

    def __init__(self):
        self.repos, self.files, self.tags, self.log = {}, {}, [], []
        self.objects, self.broken, self.lock, self.address, self.query = (
            {},
            {},
            threading.Lock(),
            "",
            {},
        )

    def answer(self, method, path, body):
        """(status, JSON) of a call."""
        for part, times in self.broken.items():
            if part in path and times:
                self.broken[part] -= 1
                return 403, {"error": "you may not"}
        if path == "/api/repos/create":
            said = json.loads(body)
            name = f"{said.get('organization') or 'me'}/{said['name']}"
            self.repos[name] = said
            return 200, {"url": f"{self.address}/datasets/{name}", "name": name}
        if path == "/api/whoami-v2":
            return 200, {"type": "user", "name": "me", "orgs": []}
        if path == "/api/validate-yaml":
            return 200, {"errors": [], "warnings": []}
        if "/preupload/" in path:
            files = json.loads(body)["files"]
            modes = [
                {"path": f["path"], "uploadMode": "lfs" if f["size"] > LARGE else "regular"}
                for f in files
            ]
            return 200, {"files": [mode | {"shouldIgnore": False, "oid": None} for mode in modes]}
        if path.endswith("/info/lfs/objects/batch"):
            wanted = json.loads(body)["objects"]
            return 200, {"objects": [self._ticket(o) for o in wanted], "transfer": "basic"}
        if path.startswith("/upload/"):
            oid = path.removeprefix("/upload/")
            assert hashlib.sha256(body).hexdigest() == oid
            self.objects[oid] = body
            return 200, {}
        if "/commit/" in path:
            return 200, self._commit(body)
        if "/tag/" in path:
            self.tags.append(json.loads(body)["tag"])
            return 200, {}
        if path.startswith("/api/datasets/"):
            return 200, {
                "id": "me/set",
                "sha": "0" * 40,
                "private": False,
                "siblings": [],
                "tags": [],
                "downloads": 0,
                "likes": 0,
            }
        return 404, {"error": f"{method} {path} is unknown here"}

    def _ticket(self, wanted):
        ticket = {"oid": wanted["oid"], "size": wanted["size"]}
        if wanted["oid"] in self.objects:
            return ticket
        return ticket | {
            "actions": {"upload": {"href": f"{self.address}/upload/{wanted['oid']}", "header": {}}}
        }

    def _commit(self, body):
        for line in body.decode().splitlines():
            entry = json.loads(line)
            value = entry["value"]
            if entry["key"] == "file":
                self.files[value["path"]] = base64.b64decode(value["content"])
            elif entry["key"] == "lfsFile":
                self.files[value["path"]] = self.objects[value["oid"]]
        url = f"{self.address}/datasets/me/set/commit/{'0' * 40}"
        return {"success": True, "commitOid": "0" * 40, "commitUrl": url, "hookOutput": ""}


@contextmanager
def running(kind=Hub):
    """A hub that answers on this machine while the block runs."""
    hub = kind()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def _do(self):
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            with hub.lock:
                hub.log.append(
                    (self.command, self.path.split("?")[0], self.headers.get("Authorization"))
                )
                hub.query = parse_qs(self.path.partition("?")[2])
                status, said = hub.answer(self.command, self.path.split("?")[0], body)
            data = said if isinstance(said, bytes) else json.dumps(said).encode()
            self.send_response(status)
            if status == 404 and "code" in said:
                self.send_header("X-Error-Code", said["code"])
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(data)

        do_GET = do_POST = do_PUT = do_HEAD = _do

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    hub.address = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield hub
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
