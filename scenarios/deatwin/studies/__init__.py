"""Common parts of scenarios and commands: studies, result folders, progress, run records, pages, figures."""
