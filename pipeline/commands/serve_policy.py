"""serve-policy: put a policy behind a WebSocket."""

import sys
from typing import Annotated

import typer

from pipeline.commands.common import AsJson, UsageError, say


def serve_policy(
    policy: Annotated[str, typer.Argument(help="FILE.py with make_policy(), random, or lerobot:PATH and the other kinds.")],
    host: Annotated[
        str, typer.Option(help="Where to listen; others than loopback want a token in DOMINO_POLICY_TOKEN.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free port.")] = 8765,
    clients: Annotated[int, typer.Option(min=1, help="Clients at the same time, each with a policy of its own.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Serve a policy to `evaluate --policy ws://HOST:PORT`, here or on another machine."""
    from pipeline.evaluate.policies import make_policy, policy_name
    from pipeline.evaluate.policy import Policy, SeesTruth
    from pipeline.evaluate.serving.address import token
    from pipeline.evaluate.serving.server import Limits, Place, PolicyServer
    from pipeline.evaluate.serving.session import Domino

    place, name = Place(host, port, token()), policy_name(policy)

    def made() -> Policy:
        found = make_policy(name)
        if isinstance(found, SeesTruth):
            raise UsageError(f"{policy} is shown the simulation itself and cannot be served: give it to evaluate --policy")
        return found

    def started(port: int) -> None:
        shown = f"[{host}]" if ":" in host else host
        say({"policy": name.label, "host": host, "port": port}, as_json, f"serving {name.label} on ws://{shown}:{port}")
        sys.stdout.flush()

    server = PolicyServer(made, Domino(name.label), place, Limits(clients), lambda line: typer.echo(line, err=True))
    server.run(started)
