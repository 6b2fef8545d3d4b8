"""An object server (S3) for tests: moto's, in this process."""

import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from xml.etree import ElementTree

from moto.server import ThreadedMotoServer

from pipeline.data.process.machine import CACHE

BUCKET = "bucket"


class ObjectServer:
    """A running server with an empty bucket."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._request("PUT", BUCKET)

    def environment(self, cache: object) -> dict[str, str]:
        """Variables of a process that uses the server."""
        keys = {
            "AWS_ACCESS_KEY_ID": "key",
            "AWS_SECRET_ACCESS_KEY": "secret",
            "AWS_DEFAULT_REGION": "us-east-1",
        }
        return keys | {"AWS_ENDPOINT_URL": self.address, "AWS_MAX_ATTEMPTS": "1", CACHE: str(cache)}

    def names(self, prefix: str) -> list[str]:
        """Objects whose names begin so."""
        found = ElementTree.fromstring(
            self._request("GET", f"{BUCKET}?list-type=2&prefix={prefix}")
        )
        return [key.text or "" for key in found.iter() if key.tag.endswith("}Key")]

    def accept_only_known_keys(self) -> None:
        """From now on, no credential is known."""
        self._request("POST", "moto-api/reset-auth", b"0")

    def accept_everybody(self) -> None:
        """As at the start."""
        self._request("POST", "moto-api/reset-auth", b"inf")

    def _request(self, method: str, path: str, data: bytes | None = None) -> bytes:
        request = urllib.request.Request(
            f"{self.address}/{path}", data, {"Content-Type": "text/plain"}, method=method
        )
        with urllib.request.urlopen(request) as answer:
            return answer.read()


@contextmanager
def object_server() -> Iterator[ObjectServer]:
    """A server within the block."""
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    try:
        host, port = server.get_host_and_port()
        yield ObjectServer(f"http://{host}:{port}")
    finally:
        server.stop()
