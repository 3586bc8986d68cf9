"""A lock that allows one drawing at a time, because matplotlib's style is global."""

import threading

DRAWING = threading.Lock()
