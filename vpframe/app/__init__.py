"""Command line, task runner, progress and output files."""
