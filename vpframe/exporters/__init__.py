"""Exporters, one file for each format; `vpframe.exporters.export` selects the format by suffix."""
