"""Signals that ask a process to end, wherever they arrive."""

import os
import signal

import pytest

from taichi_cloth.backend.interrupts import noted, raised


@pytest.fixture(autouse=True)
def handlers():
    """Signals of a run that was started in the background are ignored, and would stay so."""
    before = {number: signal.signal(number, signal.default_int_handler) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, old in before.items():
        signal.signal(number, old)


def ask(number: int = signal.SIGINT) -> None:
    os.kill(os.getpid(), number)


@pytest.mark.parametrize("error", [ImportError, KeyboardInterrupt])
def test_an_error_after_the_signal_is_an_interrupt(error):
    """An import that is interrupted may end with an ImportError."""
    with pytest.raises(KeyboardInterrupt), raised():
        try:
            ask()
        except KeyboardInterrupt:
            raise error from None


def test_an_error_without_a_signal_stays_as_it_is():
    with pytest.raises(ImportError), raised():
        raise ImportError


def test_the_first_signal_is_noted_and_the_second_raised():
    told = []
    with noted(lambda: told.append(1)) as asked:
        assert not asked() and not told
        ask(signal.SIGTERM)
        assert asked() and told == [1]
        with pytest.raises(KeyboardInterrupt):
            ask()
        assert told == [1]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_the_second_is_known_to_those_around():
    with pytest.raises(KeyboardInterrupt), raised(), noted():
        ask()
        try:
            ask()
        except KeyboardInterrupt:
            raise ImportError from None


def test_without_a_handler_before_the_second_is_raised_all_the_same():
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with noted():
        ask(signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            ask(signal.SIGTERM)
