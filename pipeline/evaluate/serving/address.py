"""Addresses of policy servers: SCHEME://HOST:PORT?option=value, and the token that goes with them."""

import ipaddress
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import parse_qsl, urlsplit

from pipeline.evaluate.policies.policy import PolicyError

TOKEN = "DOMINO_POLICY_TOKEN"
"""The environment variable that holds the token, on both sides: a command line can be read by everybody on the machine."""

_LABEL = r"[A-Za-z0-9_]([A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?"


@dataclass(frozen=True)
class Address:
    """Where a server listens. `text` is what the user wrote."""

    text: str
    host: str
    port: int
    options: Mapping[str, str] = field(default_factory=dict)

    def url(self, scheme: str) -> str:
        """The address with another scheme and without options."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{scheme}://{host}:{self.port}"

    def number(self, option: str, default: int | None = None) -> int | None:
        """An option that is a positive whole number. Raises PolicyError for something else."""
        value = self.options.get(option)
        if value is None:
            return default
        if not re.fullmatch(r"0*[1-9]\d{0,5}", value, re.ASCII):
            raise PolicyError(f"--policy {self.text}: {option}={value} is not a whole number from 1 to 999999")
        return int(value)

    def label(self) -> str:
        """How the policy there is named in results: by its option `label`, else by its address; and by its other options.

        Raises PolicyError for a label that is no word.
        """
        scheme, given = self.text.partition(":")[0], self.options.get("label")
        if given is not None and not re.fullmatch(r"[A-Za-z0-9_.@+-]{1,80}", given, re.ASCII):
            raise PolicyError(f"--policy {self.text!r}: a label has up to 80 letters, digits and _.@+-")
        others = "".join(f",{key}={value}" for key, value in sorted(self.options.items()) if key != "label")
        return f"{scheme}:{given}{others}" if given else f"{self.url(scheme)}{others}"


def parse_address(text: str, port: int | None = None, options: tuple[str, ...] = ()) -> Address:
    """The address in a text, with a default port. Raises PolicyError for anything else, and for options not among `options`."""
    try:
        parts = urlsplit(text)
        host, given = parts.hostname, parts.port or port
        query = dict(parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query)))
    except ValueError as error:
        raise PolicyError(f"--policy {text!r}: {error}; write SCHEME://HOST:PORT") from error
    if not host or given is None or parts.path not in ("", "/") or parts.username is not None or parts.fragment:
        raise PolicyError(f"--policy {text!r} is no address: write {parts.scheme}://HOST:PORT")
    if not is_host(host):
        raise PolicyError(f"--policy {text!r}: {host!r} is no name of a machine and no IP address")
    if unknown := sorted(set(query) - set(options)):
        raise PolicyError(f"--policy {text}: option {unknown[0]!r} is unknown: options are {', '.join(options) or '(none)'}")
    return Address(text, host, given, query)


def is_host(host: str) -> bool:
    """Whether a text can be the name of a machine (ASCII labels of up to 63 characters) or is an IP address."""
    bare = re.sub(r"%[A-Za-z0-9_.-]+$", "", host)
    try:
        ipaddress.ip_address(bare)
    except ValueError:
        return len(host) <= 253 and bool(re.fullmatch(rf"{_LABEL}(\.{_LABEL})*\.?", host, re.ASCII))
    return "%" not in bare


def is_loopback(host: str) -> bool:
    """Whether a host can be reached from this machine only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def token() -> str | None:
    """The token from the environment, if there is one."""
    return os.environ.get(TOKEN) or None
