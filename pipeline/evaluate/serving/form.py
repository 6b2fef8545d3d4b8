"""The names of policies on servers that others run: KIND://HOST:PORT?option=value."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from pipeline.evaluate.policies.policy import Policy, PolicyName
from pipeline.evaluate.serving.address import Address, parse_address


class Client(Policy, Protocol):
    """A policy on a server."""

    def greet(self) -> None:
        """Ask the server for a sign of life. Raises PolicyError."""
        ...

    def close(self) -> None:
        """End the connection."""
        ...


@dataclass(frozen=True)
class ServerForm:
    """How a kind of server is named: its usual port, and the options that its client takes besides `label`."""

    client: Callable[[Address], Client]
    port: int
    options: tuple[str, ...]

    def name(self, text: str) -> PolicyName:
        """Check that the server is there. Raises PolicyError."""
        address = self._address(text)
        client = self.client(address)
        client.greet()
        client.close()
        return PolicyName(text, address.label())

    def make(self, text: str) -> Policy:
        """The client."""
        return self.client(self._address(text))

    def _address(self, text: str) -> Address:
        return parse_address(text, self.port, (*self.options, "label"))
