"""Controllers as C source."""

from deatwin.control.export.controller import controller_source

__all__ = ["controller_source"]
