"""Whether the frequency responses of two models, or of two records, differ: in which order and band."""
