"""What answers at an address and is no Ray is refused in one line, before Ray is asked."""

import socket
import threading
import time

import pytest

from pipeline.crew import ray_session
from pipeline.crew.pool import EngineError


@pytest.mark.parametrize(("answer", "said"), [(b"HTTP/1.1 400 Bad Request\r\n\r\n", "something else"), (None, "timed out")])
def test_a_server_that_is_no_ray_is_refused(monkeypatch, answer, said):
    monkeypatch.setattr(ray_session, "_ANSWER_SECONDS", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"

        def serve():
            connection, _ = server.accept()
            if answer is None:
                time.sleep(1)
            else:
                connection.sendall(answer)

        threading.Thread(target=serve, daemon=True).start()
        with pytest.raises(EngineError, match=f"^no Ray cluster at {address}: .*{said}") as error:
            ray_session.check_cluster(address)
    assert "\n" not in str(error.value)
