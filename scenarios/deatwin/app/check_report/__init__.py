"""The report of a check: one HTML file that needs nothing else, its figures' data beside it."""

from deatwin.app.check_report.page import write_check_report
from deatwin.app.check_report.view import View

__all__ = ["View", "write_check_report"]
