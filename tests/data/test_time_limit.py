import time
from contextlib import suppress

import pytest

from pipeline.data.process.own_code import time_limit


def test_a_time_limit_holds_against_code_that_catches_everything():
    began = time.monotonic()
    with pytest.raises(TimeoutError, match="no end"), time_limit(0.1, TimeoutError("no end")):
        while time.monotonic() - began < 1.5:
            with suppress(BaseException):
                time.sleep(2)
    with time_limit(5, TimeoutError()):
        pass
