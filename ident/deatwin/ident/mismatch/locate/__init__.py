"""Where the mismatch is: when, at which frequencies, in which operating region, in which part of the plant."""

from deatwin.ident.mismatch.locate.frequency import Bands, locate_frequency
from deatwin.ident.mismatch.locate.lines import Lines, locate_lines
from deatwin.ident.mismatch.locate.location import Location, locate
from deatwin.ident.mismatch.locate.place import OpenedPlace, Places, locate_place
from deatwin.ident.mismatch.locate.region import Regions, locate_region
from deatwin.ident.mismatch.locate.response import locate_response
from deatwin.ident.mismatch.locate.time import Times, locate_time
from deatwin.ident.mismatch.locate.track import Track, readings, tracks
from deatwin.ident.mismatch.located import Band, LineGroup, Region, ResponseDifference, Window

__all__ = [
    "Band",
    "Bands",
    "LineGroup",
    "Lines",
    "Location",
    "OpenedPlace",
    "Places",
    "Region",
    "Regions",
    "ResponseDifference",
    "Times",
    "Track",
    "Window",
    "locate",
    "locate_frequency",
    "locate_lines",
    "locate_place",
    "locate_region",
    "locate_response",
    "locate_time",
    "readings",
    "tracks",
]
