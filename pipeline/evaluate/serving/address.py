"""Addresses of policy servers, SCHEME://HOST:PORT?option=value, and tokens."""

import ipaddress
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import parse_qsl, urlsplit

from pipeline.evaluate.policies.policy import PolicyError

TOKEN = "DOMINO_POLICY_TOKEN"
"""An environment variable: everybody on a machine can read its command lines."""


@dataclass(frozen=True)
class Address:
    text: str
    host: str
    port: int
    options: Mapping[str, str] = field(default_factory=dict)

    @property
    def scheme(self) -> str:
        return self.text.partition(":")[0]

    def url(self, scheme: str) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{scheme}://{host}:{self.port}"

    def number(self, option: str) -> int | None:
        value = self.options.get(option)
        if value is None:
            return None
        if not re.fullmatch(r"0*[1-9]\d{0,5}", value, re.ASCII):
            what = f"{option}={value} is not a whole number from 1 to 999999"
            raise PolicyError(f"--policy {self.text}: {what}")
        return int(value)

    def choice(self, option: str, known: tuple[str, ...]) -> str:
        value = self.options.get(option, known[0])
        if value not in known:
            raise PolicyError(f"--policy {self.text}: {option}={value}: choose {', '.join(known)}")
        return value

    def label(self, served: str | None = None) -> str:
        """The name in results: option `label`, else `served`, else the address; then other options.
        Raises PolicyError."""
        given = self.options.get("label")
        if given is not None and not re.fullmatch(r"[A-Za-z0-9_.@+-]{1,80}", given, re.ASCII):
            raise PolicyError(f"--policy {self.text!r}: label: up to 80 letters, digits and _.@+-")
        name = f"{self.scheme}:{given}" if given else f"ws:{served}" if served else ""
        others = sorted(item for item in self.options.items() if item[0] != "label")
        return (name or self.url(self.scheme)) + "".join(f",{k}={v}" for k, v in others)


def parse_address(text: str, port: int | None = None, options: tuple[str, ...] = ()) -> Address:
    """The address in a text. Raises PolicyError for anything else, and for unknown options."""
    try:
        parts = urlsplit(text)
        host, given = parts.hostname, parts.port or port
        strict = bool(parts.query)
        query = dict(parse_qsl(parts.query, keep_blank_values=True, strict_parsing=strict))
    except ValueError as error:
        raise PolicyError(f"--policy {text!r}: {error}; write SCHEME://HOST:PORT") from error
    more = parts.path not in ("", "/") or parts.username is not None or parts.fragment
    if not host or given is None or more or not text.isprintable():
        raise PolicyError(f"--policy {text!r} is no address: write {parts.scheme}://HOST:PORT")
    if unknown := sorted(set(query) - set(options)):
        known = ", ".join(options) or "(none)"
        raise PolicyError(f"--policy {text}: option {unknown[0]!r} is unknown: options are {known}")
    return Address(text, host, given, query)


def is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def token() -> str | None:
    return os.environ.get(TOKEN) or None
