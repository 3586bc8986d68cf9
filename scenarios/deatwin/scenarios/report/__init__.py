"""The report of a diagnosis: one HTML file that needs nothing else, its figures' data beside it."""

from deatwin.scenarios.report.page import Origin, write_report

__all__ = ["Origin", "write_report"]
