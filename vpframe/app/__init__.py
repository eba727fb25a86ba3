"""The command line, the task runner, progress and what a run may write."""
