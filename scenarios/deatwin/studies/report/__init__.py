"""The report of a diagnosis: one HTML file that needs nothing else, its figures' data beside it."""

from deatwin.studies.report.origin import Origin
from deatwin.studies.report.page import write_report

__all__ = ["Origin", "write_report"]
