"""Runs on disk: the run folder, its stages and report, and ``generate``, which fills it."""
