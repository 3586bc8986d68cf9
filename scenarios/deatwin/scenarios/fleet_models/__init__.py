"""Six actuators identified: what `semp-fleet` and `svb-fleet` share, and the two stories."""
