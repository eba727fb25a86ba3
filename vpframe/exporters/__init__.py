"""Exporters of scenes, motions, clashes and tables, one file for each format; `export` selects it by suffix.

Each returns notes on what its format cannot contain (`losses`).
May use `scene`, `analysis`, `importers` (the process of the CAD kernel writes STEP), `view` and `report` for pictures.
Start with `export`, then `glb` as an example of a format.
"""
