"""A hub on this machine from which files can be listed, read and deleted, too: what HfFileSystem
asks for."""

import hashlib
import json
from urllib.parse import parse_qs, unquote

from tests.export.hub import Hub

MISSING = 404, {"error": "not found", "code": "EntryNotFound"}


class FileHub(Hub):
    """A hub with one data set, me/set, whose files are `files`."""

    def answer(self, method, path, body):
        """(status, JSON or bytes) of a call."""
        path = unquote(path)
        _, tree, below = path.partition("/tree/main")
        if tree:
            found = self._tree(below.strip("/"), self.query.get("recursive") == ["true"])
            return (200, found) if found else MISSING
        if "/paths-info/main" in path:
            names = parse_qs(body.decode())["paths"]
            return 200, [self._file(name) for name in names if name in self.files]
        if (name := path.partition("/resolve/main/")[2]) in self.files:
            return 200, self.files[name]
        if name:
            return MISSING
        if "/commit/" in path:
            for line in body.decode().splitlines():
                entry = json.loads(line)
                if (
                    entry["key"] == "deletedFile"
                    and self.files.pop(entry["value"]["path"], None) is None
                ):
                    return MISSING
        return super().answer(method, path, body)

    def _file(self, name):
        return {
            "type": "file",
            "path": name,
            "size": len(self.files[name]),
            "oid": hashlib.sha1(self.files[name]).hexdigest(),
        }

    def _tree(self, folder, recursive):
        start = f"{folder}/" if folder else ""
        inside = [name for name in sorted(self.files) if name.startswith(start)]
        deeper = sorted(
            {name[: name.index("/", len(start))] for name in inside if "/" in name[len(start) :]}
        )
        folders = [{"type": "directory", "path": each, "size": 0, "oid": "0"} for each in deeper]
        return folders + [
            self._file(name) for name in inside if recursive or "/" not in name[len(start) :]
        ]
