"""Which input would tell rival explanations apart."""
