"""Ctrl-C is held back while workers start."""

import os
import signal
import threading
import time

import pytest

from deatwin.plant.interrupts import interrupts_held


@pytest.mark.skipif(os.name == "nt", reason="os.kill of Windows ends the process")
def test_an_interrupt_that_another_thread_takes_is_held_back_too(heard):
    over, reached = threading.Event(), False
    other = threading.Thread(target=over.wait)
    other.start()
    try:
        with pytest.raises(KeyboardInterrupt), interrupts_held():
            os.kill(os.getpid(), signal.SIGINT)
            for _ in range(50):
                time.sleep(0.001)
            reached = True
        assert reached
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    finally:
        over.set()
        other.join()
