"""A signal stops what runs, wherever it arrives."""

import signal
import time
import weakref

import pytest

from pipeline.crew.signals import Stopped, stop_on_signal


class Thing:
    """Something to refer to weakly."""


def test_a_signal_raises_once_and_the_handlers_are_put_back():
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(Stopped), stop_on_signal():
        signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_signal_that_arrives_in_the_callback_of_a_weak_reference_stops_all_the_same():
    thing = Thing()
    reference = weakref.ref(thing, lambda _: signal.raise_signal(signal.SIGINT))
    began = time.monotonic()
    with pytest.raises(Stopped), stop_on_signal():
        del thing
        time.sleep(30)
    assert reference() is None
    # the wait itself was interrupted
    assert time.monotonic() - began < 20
