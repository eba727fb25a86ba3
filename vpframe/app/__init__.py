"""The command line: commands and their options, the runner of task scripts, the terminal, the live workbench.

The highest folder: it may use all others, and no other imports it. It alone draws progress and reads the terminal.
Start with `cli` (every command and option), then `commands` (what each does; `exit_code` ends them); `task_runner` is
`vpframe run`, `workbench` is `vpframe view`.
"""
