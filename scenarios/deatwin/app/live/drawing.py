"""One drawing at a time: the style of a figure is matplotlib's own global one while it is drawn."""

import threading

DRAWING = threading.Lock()
