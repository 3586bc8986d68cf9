"""Where the mismatch is: when, at which frequencies, in which operating region, in which part of the plant."""

from deatwin.ident.mismatch.locate.frequency import Band, locate_frequency
from deatwin.ident.mismatch.locate.region import Region, locate_region
from deatwin.ident.mismatch.locate.response import ResponseDifference, locate_response
from deatwin.ident.mismatch.locate.time import Window, locate_time
from deatwin.ident.mismatch.locate.track import Track

__all__ = [
    "Band",
    "Region",
    "ResponseDifference",
    "Track",
    "Window",
    "locate_frequency",
    "locate_region",
    "locate_response",
    "locate_time",
]
