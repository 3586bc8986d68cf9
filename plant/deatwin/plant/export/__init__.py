"""Plants and sampled models for other programs: functional mock-up units (FMI 3.0) and C source."""
