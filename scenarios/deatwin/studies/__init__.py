"""What stories and commands share: running of studies, result folders, progress, run records, pages and figures."""
