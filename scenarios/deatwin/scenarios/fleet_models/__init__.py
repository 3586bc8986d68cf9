"""Six actuators identified: what `semp-fleet` and `svb-fleet` share, and the two stories."""

from deatwin.studies.report.words import Words

WORDS = Words(__name__)
