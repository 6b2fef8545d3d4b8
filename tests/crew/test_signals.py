"""A signal stops what runs, once; off the main thread nothing is asked of Python's handlers."""

import signal
import threading

import pytest

from pipeline.crew.signals import Stopped, hold_signals, stop_on_signal


def test_a_signal_raises_once_and_the_handlers_are_put_back():
    before = signal.getsignal(signal.SIGINT)
    cleaned = []
    with pytest.raises(Stopped), stop_on_signal():
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            # an impatient Ctrl-C does not cut cleaning up short
            signal.raise_signal(signal.SIGINT)
            cleaned.append(True)
    assert cleaned
    assert signal.getsignal(signal.SIGINT) is before


def test_a_signal_that_is_held_takes_effect_at_the_end_whoever_sets_handlers_meanwhile():
    done = []
    with pytest.raises(Stopped), stop_on_signal(), hold_signals():
        signal.raise_signal(signal.SIGTERM)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        done.append(True)
    assert done


def test_off_the_main_thread_there_are_no_handlers():
    done = []

    def work() -> None:
        with stop_on_signal(), hold_signals():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done
