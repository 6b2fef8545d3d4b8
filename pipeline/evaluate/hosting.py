"""One policy, in a process of its own, for all worker processes on this machine."""

from collections.abc import Iterator
from contextlib import contextmanager

from pipeline.evaluate.policies.policy import PolicyError, PolicyName
from pipeline.evaluate.serving.messages import MessageError, unpack
from pipeline.evaluate.serving.process import Process


@contextmanager
def host_policy(name: PolicyName, clients: int, wait: float) -> Iterator[PolicyName]:
    """The name under which so many clients at once reach the policy `name`, which answers in
    batches.

    It listens on loopback, at a free port. Its label in results is that of `name`. Raises
    PolicyError for a policy that cannot be made, is no BatchPolicy, or is shown the simulation.
    """
    process = Process(name, str(clients), str(wait))
    try:
        port = unpack(process.greet()).get("port")
        if not isinstance(port, int):
            raise PolicyError(f"{name.label}: its process names no port")
        yield PolicyName(f"ws://127.0.0.1:{port}", name.label, name.probe, "server")
    except MessageError as error:
        raise PolicyError(f"{name.label}: its process names no port ({error})") from error
    finally:
        process.close()
